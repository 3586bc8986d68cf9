"""Does the explanation hold on data that no fit has seen?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.name import Candidate

__all__ = ["Verification", "shares_explained", "verify"]


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Rms residuals before and after the amendment, SI.

    Parameters
    ----------
    fitted_before, fitted_after : float
        On the fitted part.
    unseen_before, unseen_after : float
        On the unseen part, in free run.
    gain_low : float
        Lower 95 % bound of the fall on the unseen part.
    """

    fitted_before: float
    fitted_after: float
    unseen_before: float
    unseen_after: float
    gain_low: float

    @property
    def holds(self) -> bool:
        """Whether the error on unseen data falls for certain."""
        return self.gain_low > 0.0


def verify(base: Candidate, amended: Candidate, rng: np.random.Generator) -> Verification:
    """Compare a candidate with the base plant on the unseen part.

    Parameters
    ----------
    base, amended : Candidate
        Judged on the same samples.
    rng : numpy.random.Generator
        Of the paired block bootstrap.

    Returns
    -------
    Verification
    """
    before, after = block_losses(base.unseen), block_losses(amended.unseen)
    return Verification(
        fitted_before=base.calibration.rms, fitted_after=amended.calibration.rms,
        unseen_before=float(np.sqrt(np.mean(base.unseen**2))),
        unseen_after=float(np.sqrt(np.mean(amended.unseen**2))),
        gain_low=bootstrap_gain(before, after, rng),
    )  # fmt: skip


def shares_explained(
    base: Candidate, amended: Candidate, tried: tuple[Candidate, ...], noise: float
) -> dict[str, float]:
    """What share of the mismatch's energy goes with each effect of a candidate.

    An effect's share is what returns when it alone is taken out (the other effects refitted), relative to the
    base plant's energy above noise; for a single effect that is what the whole candidate explains.

    Parameters
    ----------
    base, amended : Candidate
        Without effects, and the explanation.
    tried : tuple of Candidate
        Where the reduced candidates are looked up.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    dict of str to float
        From 0 to 1.
    """
    missing = max(float(base.losses.mean()) - noise**2, 1e-300)
    by_name = {c.effects: float(c.losses.mean()) for c in tried}
    shares = {}
    for effect in amended.effects:
        rest = tuple(e for e in amended.effects if e != effect)
        without = by_name.get(rest, float(base.losses.mean()))
        shares[effect] = float(np.clip((without - amended.losses.mean()) / missing, 0.0, 1.0))
    return shares

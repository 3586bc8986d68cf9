"""Which explanation is the best, and which others these recordings cannot rule out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from deatwin.ident.mismatch.candidate import Candidate

__all__ = ["Naming", "cannot_rule_out", "decide"]

EVIDENCE_RATIO = 20.0
"""An explanation stands alone where no rival is within this ratio (Kass & Raftery 1995: strong evidence)."""
RIVAL_SHARE = 0.5
"""A rival is also kept while its error differs from the best by less than this share of the model error."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Naming:
    """All explanations that were tried.

    Parameters
    ----------
    candidates : tuple of Candidate
        All that could be fitted, in the order in which they were tried; the base plant first.
    best : Candidate or None
        The adequate explanation with the most evidence.
    rivals : tuple of Candidate
        Other adequate ones that these recordings cannot rule out.
    probabilities : mapping of tuple of str to float
        Of each candidate of the size of the best one, by evidence.
    noise : float
        Standard deviation of the sensor's noise, as the best explanation shows it, SI.
    failed : tuple of str
        Effects and sets of effects that could not be tried, since no fit with them could be simulated; that is no
        evidence against them.
    """

    candidates: tuple[Candidate, ...]
    best: Candidate | None
    rivals: tuple[Candidate, ...]
    probabilities: Mapping[tuple[str, ...], float]
    noise: float
    failed: tuple[str, ...] = field(default=())

    @property
    def base(self) -> Candidate:
        """The calibrated plant without further effects."""
        return self.candidates[0]


def decide(tried: Sequence[Candidate], stage: Sequence[Candidate], noise: float) -> Naming:
    """The best of one stage, and the ones that cannot be ruled out beside it.

    Parameters
    ----------
    tried : sequence of Candidate
        Everything so far, the base plant first.
    stage : sequence of Candidate
        Those that compete: all with the same number of effects.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Naming
    """
    if not stage:
        return Naming(candidates=tuple(tried), best=None, rivals=(), probabilities={}, noise=noise)
    ranked = sorted(stage, key=lambda c: -c.evidence)
    weights = np.exp([c.evidence - ranked[0].evidence for c in ranked])
    probabilities = {c.effects: float(w / weights.sum()) for c, w in zip(ranked, weights, strict=True)}
    adequate = [c for c in ranked if c.adequate]
    best = adequate[0] if adequate else None
    rivals = tuple(c for c in adequate[1:] if best is not None and cannot_rule_out(c, best))
    return Naming(candidates=tuple(tried), best=best, rivals=rivals, probabilities=probabilities, noise=noise)


def cannot_rule_out(rival: Candidate, best: Candidate) -> bool:
    """Whether the recordings leave a rival possible.

    Parameters
    ----------
    rival, best : Candidate
        Both adequate.

    Returns
    -------
    bool
        True if the evidence for the best is not strong, or if the two differ by less than the plant's own error.
    """
    if best.evidence - rival.evidence < np.log(EVIDENCE_RATIO):
        return True
    apart = np.sqrt(max(rival.losses.mean() - best.losses.mean(), 0.0))
    return bool(apart < RIVAL_SHARE * best.calibration.plant.rig.model_error)

"""Test an explanation, mainly on held-out data.

The tests compare free runs before and after, on all held-out data, in each record and at each third of the amplitudes.
Each effect is removed in turn (ablation) and compared with placebo effects, and its strength must be constant.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.model_error import perhaps_absent, with_own_errors
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.naming.clocks import of_one_clock
from deatwin.ident.mismatch.naming.criteria import held_back_by, takes_most
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.refit.fitted import fitted_effect
from deatwin.ident.mismatch.refit.search import refit, settle
from deatwin.ident.mismatch.result import Ablation
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import MOST, TINY
from deatwin.ident.mismatch.verify.constancy import Constancy, constancies
from deatwin.ident.mismatch.verify.placebos import Placebo, placebo_effects
from deatwin.ident.mismatch.verify.transfer import transfers
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.plant.arrays import root_mean_square

if TYPE_CHECKING:
    from deatwin.ident.greybox.fit import Calibration


@checks_its_arguments
def verify(
    base: Candidate,
    amended: Candidate,
    rng: np.random.Generator,
    problem: DiagnosisProblem | None = None,
    tried: Sequence[Candidate] = (),
) -> Verification:
    """Test an explanation, mainly on held-out data.

    Ablation: the error must rise if one effect is removed and the others are refitted. Placebo effects: a copy of an
    effect with wrong physics must not fit as well as the effect. Transfer: the error must not rise in any recording, or
    at small, medium or large commands. Constancy: the strength of an effect must not change with time.

    Parameters
    ----------
    base, amended : Candidate
        Base plant, and the plant with the explanation; both have the same fitted and held-out samples.
    rng : numpy.random.Generator
        Random generator for the paired block bootstrap and for random phases.
    problem : DiagnosisProblem, optional
        Diagnosis problem with the recordings. Without it, placebo effects, transfer and constancy are not tested.
    tried : sequence of Candidate
        Candidates that were already fitted. The ablation uses them where possible, and refits otherwise.

    Returns
    -------
    Verification
    """
    reduced = _reduced(base, amended, problem, tried)
    whole = None if problem is None else _whole(amended, problem)
    return Verification(
        fitted_before=base.calibration.rms,
        fitted_after=amended.calibration.rms,
        unseen_before=root_mean_square(base.unseen),
        unseen_after=root_mean_square(amended.unseen),
        gain_low=bootstrap_gain(block_losses(base.unseen), block_losses(amended.unseen), rng),
        ablations=tuple(_ablation(name, base, amended, without, rng) for name, without in reduced.items()),
        shams=() if problem is None else _placebos(amended, reduced, problem, rng),
        transfers=() if problem is None else transfers(base, amended, problem, rng),
        constancies=() if problem is None else _constancies(amended, problem, whole),
        counts=_takes_most_unseen(base, amended) and _counts(base, amended, rng),
        noise=amended.noise,
        output_unit=amended.calibration.plant.rig.output_unit,
        whole=whole,
        one_clock=of_one_clock(amended),
        perhaps_absent=() if problem is None else _perhaps_absent(amended, problem),
    )


def shares_explained(base: Candidate, amended: Candidate, tried: Sequence[Candidate], noise: float) -> dict[str, float]:
    """Return the share, from 0 to 1, of the mismatch's power that each effect of a candidate explains."""
    # It is the power that returns if the effect is removed and the others are refitted, relative to the base plant's
    # power beyond noise. The share of a single effect is that of the whole candidate.
    found = _reduced(base, amended, None, tried)
    return {name: share_of(base, amended, found.get(name, base), noise) for name in amended.effects}


def share_of(base: Candidate, amended: Candidate, without: Candidate, noise: float) -> float:
    """Return the share, from 0 to 1, of the base plant's power beyond noise that returns without some effects."""
    missing = max(float(base.losses.mean()) - noise**2, TINY)
    return float(np.clip((without.losses.mean() - amended.losses.mean()) / missing, 0.0, 1.0))


def _reduced(
    base: Candidate, amended: Candidate, problem: DiagnosisProblem | None, tried: Sequence[Candidate]
) -> dict[str, Candidate]:
    """Return the fitted explanation without each of its effects; fits that fail are left out."""
    carried = (c for c in tried if not c.calibration.given_up)
    known = {frozenset(c.effects): c for c in (*carried, base)}
    found = {}
    for name in amended.effects:
        rest = frozenset(amended.effects) - {name}
        candidate = known.get(rest) or (None if problem is None else _refitted(problem, amended, name))
        if candidate is not None:
            found[name] = candidate
    return found


def _refitted(problem: DiagnosisProblem, amended: Candidate, name: str) -> Candidate | None:
    fit = settle(amended.calibration.plant.without_effects(name), problem.fitted, amended.noise)
    return judge(problem, fit, amended.noise) if fit.status.ok else None


def _ablation(name: str, base: Candidate, amended: Candidate, without: Candidate, rng: np.random.Generator) -> Ablation:
    gain_low = bootstrap_gain(block_losses(without.unseen), block_losses(amended.unseen), rng)
    return Ablation(
        effect=name,
        fitted=without.calibration.rms,
        unseen=root_mean_square(without.unseen),
        gain_low=gain_low,
        share=share_of(base, amended, without, amended.noise),
        counts=_counts(without, amended, rng),
    )


def _counts(without: Candidate, amended: Candidate, rng: np.random.Generator) -> bool:
    """Return whether the residual certainly falls over all data, and in held-out data by more than the model error."""
    over_both = bootstrap_gain(without.losses, amended.losses, rng)
    return over_both > 0.0 and _gained_unseen(without, amended) > amended.calibration.plant.rig.model_error**2


def _perhaps_absent(amended: Candidate, problem: DiagnosisProblem) -> tuple[str, ...]:
    """Return the effects whose strength may be zero; none if there is one effect, whose absence the detection tests."""
    if len(amended.effects) < 2:
        return ()
    return perhaps_absent(with_own_errors(amended.calibration, problem, amended.noise), amended.effects)


def _takes_most_unseen(base: Candidate, amended: Candidate) -> bool:
    """Return whether most of the held-out residual's power beyond noise is removed."""
    return _gained_unseen(base, amended) > MOST * float(np.mean(base.unseen**2) - amended.noise**2)


def _gained_unseen(without: Candidate, amended: Candidate) -> float:
    """Return the fall of the held-out mean square residual."""
    return float(np.mean(without.unseen**2) - np.mean(amended.unseen**2))


def _whole(amended: Candidate, problem: DiagnosisProblem) -> Calibration | None:
    """Refit an explanation that leaves too much to all recordings; None for others, or if the fit fails."""
    if amended.adequate or not amended.effects:
        return None
    fit = refit(amended.calibration, problem.everything)
    return None if fit is amended.calibration else fit


def _constancies(amended: Candidate, problem: DiagnosisProblem, whole: Calibration | None) -> tuple[Constancy, ...]:
    """Test constancy on the fitted data and, if the explanation leaves too much, also on all recordings."""
    fitted = constancies(amended.calibration, problem.fitted, amended.effects)
    if whole is None:
        return fitted
    # Extrapolation may leave too much although this fit does not; the limit is at least a share of the noise's power.
    left = max(whole.rms**2 - amended.noise**2, practical_size(amended.noise, 0.0) ** 2)
    everywhere = constancies(whole, problem.everything, amended.effects, too_much=float(np.sqrt(left)))
    return tuple(e if e.mends and not e.holds else f for f, e in zip(fitted, everywhere, strict=True))


def _placebos(
    amended: Candidate, reduced: dict[str, Candidate], problem: DiagnosisProblem, rng: np.random.Generator
) -> tuple[Placebo, ...]:
    found: list[Placebo] = []
    for name, without in reduced.items():
        effect = fitted_effect(amended.calibration.plant, name)
        gain = _gained_unseen(without, amended)
        found += placebo_effects(without.calibration, effect, gain, problem.fitted, problem.everything, rng)
    return tuple(found)


def first_that_stands(
    found: Iterable[Naming], problem: DiagnosisProblem, rng: np.random.Generator, started: Callable[[str], None]
) -> tuple[Naming, Verification, bool]:
    """Return the first explanation that passes verification, else the first one; its verification; whether it passed.

    The likeliest of `found` comes first, the last one may have none; `started` is called with the step as text.
    """
    # An explanation that was refuted in a rig variant is no alternative to the next one there. The same holds for the
    # remainder of an explanation if one of its effects is in doubt.
    verified: list[tuple[Naming, Verification, bool]] = []
    refuted: list[tuple[Calibration, frozenset[str]]] = []
    for naming in found:
        if verified:
            verified[0] = (verified[0][0].knowing(naming), *verified[0][1:])
            if naming.best is None:
                break
        started("verifying on held-out data")
        known = [effects for variant, effects in refuted if variant is naming.base.calibration]
        answer = naming.without(known)
        verification = verify(answer.base, answer.best or answer.base, rng, problem, answer.candidates)
        spared = _without_doubted(answer, verification, known)
        stands = verification.holds or bool(spared)
        verified.append((answer.as_likely(spared), verification, stands))
        if stands or answer.best is None:
            return verified[-1]
        refuted.append((answer.base.calibration, frozenset(answer.best.effects)))
        started("looking for another explanation")
    return verified[0]


def _without_doubted(
    naming: Naming, verification: Verification, refuted: Collection[frozenset[str]] = ()
) -> list[Candidate]:
    """Return the explanation without each effect in doubt; empty if one of these does not explain most by itself."""
    # It is also empty if one of these smaller explanations is unknown or was refuted. If the strength of an effect may be
    # zero, the explanation without it is possible whatever values a fit without it needs.
    if naming.best is None:
        return []
    known = {frozenset(c.effects): c for c in naming.candidates if not c.calibration.given_up}
    rest = {name: known.get(frozenset(naming.best.effects) - {name}) for name in verification.doubted}
    standing = [
        c
        for name, c in rest.items()
        if c is not None
        and frozenset(c.effects) not in refuted
        and (
            c in naming.alternatives
            or (takes_most(c, naming.base) and (name in verification.perhaps_absent or not held_back_by(c)))
        )
    ]
    return standing if len(standing) == len(rest) else []

"""Test whether a mismatch is significant and large enough to matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch.detect.detection import Curves, Detection, counts
from deatwin.ident.mismatch.detect.law import Law, Power
from deatwin.ident.mismatch.detect.leftover import Leftover, leftover_of
from deatwin.ident.mismatch.detect.origin import origin_of
from deatwin.ident.mismatch.detect.statistics import GROUPS, Scores
from deatwin.ident.mismatch.excess import beyond_noise, excess_of, practical_size
from deatwin.ident.mismatch.likelihood.beforehand import LATEST
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.quality.noise import noise_level
from deatwin.ident.mismatch.quality.repeats import find_repeats, repeatability
from deatwin.ident.mismatch.refit.search import finish, refit, roughly
from deatwin.ident.mismatch.result import OriginSummary, Statistic
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import ACCURACY
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.effects.delay import USUAL, Delay
from deatwin.plant.effects.sizes import PERIOD, Sizes

if TYPE_CHECKING:
    from deatwin.ident.mismatch.naming.candidate import Candidate
    from deatwin.ident.mismatch.naming.screen import LinearisedResponse
    from deatwin.ident.mismatch.problem import DiagnosisProblem


DRAWS = 400
CERTAIN = 1.25
"""Multiple of the practical size above which an excess counts if its p-value is below a half. Of 81 clean rigs drawn
for this limit 80 reached at most 0.92; one reached 1.3 through the scatter of its noise, for which `SCATTER` allows."""
BEYOND_CHANCE = 3.0
"""Multiple of the practical size above which an excess counts whatever its p-value. The largest of about 90 clean rigs
was 1.8."""
SCATTER = 3.0
"""Allowance for the scatter of the noise's power, in standard deviations; it matters in short records."""
POINTS = 400
"""Largest number of points of a drawn curve."""


@checks_its_arguments
def detect(base: Candidate, problem: DiagnosisProblem, rng: np.random.Generator) -> Detection:
    """Test whether physics is missing from a calibrated plant.

    Parameters
    ----------
    base : Candidate
        The calibrated plant.
    problem : DiagnosisProblem
        Diagnosis problem with the recordings.
    rng : numpy.random.Generator
        Random generator for the bootstrap.

    Returns
    -------
    Detection
    """
    found = detect_in(leftover_of(base, problem), rng)
    if not found.mismatch:
        return found
    whole = _taking_up_the_rest(base, problem)
    return replace(found, taken_up=_answering_late(base, problem, found.size) if whole is None else whole)


def detect_in(left: Leftover, rng: np.random.Generator, *, draws: int = DRAWS) -> Detection:
    """Test a residual with a bootstrap that takes this number of `draws`."""
    law = Law(left, rng, draws)
    scores = law.battery(left.residual[None])
    groups = law.groups(scores)[0]
    practical = practical_size(left.noise, left.model_error)
    first = left.of_first
    pieces = [first.residual[r] for r in first.records]
    commands = [first.commands[r] for r in first.records]
    repeats = find_repeats(commands, left.sample_time)
    p_value, size = law.p_value(float(groups.max())), _size(left)
    least = practical * (CERTAIN if p_value < 0.5 else BEYOND_CHANCE)
    certain = _is_certain(left, law.refit.white, least)
    return Detection(
        p_value=p_value,
        statistics=_statistics(law, left, scores, groups),
        size=size,
        practical=practical,
        noise=left.noise,
        model_error=left.model_error,
        certain=certain,
        sensor=noise_level(pieces, left.sample_time, left.sheet, commands, repeats),
        repeatability=None if repeats is None else repeatability(first.residual, repeats, left.noise),
        evidence=origin_of(first, repeats, practical)
        if counts(p_value, size, practical, certain)
        else OriginSummary.none(size),
        moved=root_mean_square(left.moved),
        seen=partial(_seen, law, left, practical),
        output_unit=left.output_unit,
        curves=_curves(law, left, scores),
    )


def _taking_up_the_rest(base: Candidate, problem: DiagnosisProblem) -> Calibration | None:
    """Refit the plant to all recordings; return the fit if it is adequate in fitted and in held-out data."""
    # Parameters from the fitted data alone may amplify the model error in the held-out data. A fit that drives further
    # parameters to bounds is rejected.
    if not base.fitted_test.within_error:
        return None  # more data cannot improve the fitted part
    whole = refit(base.calibration, problem.everything)
    biased = {*whole.at_bound} - {*base.calibration.at_bound}
    return whole if _leaves_nothing(whole, base, problem) and not biased else None


def _answering_late(base: Candidate, problem: DiagnosisProblem, size: float) -> Calibration | None:
    """Refit the plant with a dead time; return the fit if it is adequate and the dead time within the timing error."""
    # Triggers, filters and integrators of real rigs are slightly late, which is no missing physics. This is not tried
    # if the residual's `size`, SI, is larger than such a dead time could cause.
    fit = base.calibration
    if Delay.name in fit.plant.effect_names or Delay.name not in {effect.name for effect in problem.effects}:
        return None
    steps = np.concatenate([np.diff(readings) for readings in _simulated(base, problem)])
    moved = LATEST * root_mean_square(steps)
    if size > np.hypot(moved, practical_size(base.noise, fit.plant.rig.model_error)):
        return None
    longest = LATEST * problem.nominal.rig.sample_time
    # The range of a dead time in the catalogue may be many samples, each of which enlarges the equations. Here it ends at
    # twice the longest time, and the fit starts at a quarter of it.
    sizes = replace(problem.nominal.rig.sizes or Sizes(), period=PERIOD * 2 * longest / USUAL)
    short_delay = sizes.of(Delay(time=USUAL / 4))
    late = finish(roughly(fit.plant.with_effects(short_delay), problem.everything), problem.everything)
    short = late.status.ok and late.plant.parameters["delay.time"].value <= longest
    return late if short and _leaves_nothing(late, base, problem) else None


def _simulated(base: Candidate, problem: DiagnosisProblem) -> list[np.ndarray]:
    """Return the base plant's readings in the fitted part of each experiment, SI."""
    readings = readings_of_fit(problem.fitted, base.calibration.residuals)
    return np.split(readings, np.cumsum([part.size for part in problem.fitted])[:-1])


def _leaves_nothing(whole: Calibration, base: Candidate, problem: DiagnosisProblem) -> bool:
    """Return whether a fit is adequate in fitted and in held-out data."""
    left = [free_run_residuals(whole.plant, parts) for parts in (problem.fitted, problem.unseen)]
    error = whole.plant.rig.model_error
    return all(r is not None and excess_of(r, base.noise, error).within_error for r in left)


def _size(left: Leftover) -> float:
    """Return the larger of the rms residuals beyond noise in fitted and in held-out data."""
    powers = [np.mean(left.residual[p] ** 2) for p in (left.fitted, ~left.fitted) if p.any()]
    return beyond_noise(max(powers), left.noise)


def _is_certain(left: Leftover, white: np.ndarray, least: float) -> bool:
    """Return whether the residual of fitted or held-out data is too large for noise."""
    for part in (left.fitted, ~left.fitted):
        if part.any():
            noise = left.noise**2 * white[part].mean() * (1.0 + SCATTER * np.sqrt(2.0 / part.sum()))
            if np.mean(left.residual[part] ** 2) > noise + least**2:
                return True
    return False


def _statistics(law: Law, left: Leftover, scores: Scores, groups: np.ndarray) -> tuple[Statistic, ...]:
    names = law.battery.names
    ratio, linear = int(np.argmax(scores.ratios[0])), int(np.argmax(np.abs(law.correlations(scores)[0])))
    apart = np.abs(scores.spectra[0] - law.spectrum)
    squared = int(np.argmax(np.abs(scores.squared[0])))
    root = np.sqrt(left.residual.size)
    rows = (
        (float(np.exp(scores.ratios[0, ratio])), "held-out part" if ratio else "fitted part"),
        (float(apart.max()), f"{law.battery.frequencies[np.argmax(apart)]:.3g} Hz"),
        (float(scores.linear[0, linear] / root), names[linear]),
        (float(scores.squared[0, squared] / root), names[squared]),
    )
    return tuple(
        Statistic(
            name=name,
            value=value,
            where=where,
            score=float(score),
            p_value=float((1 + np.sum(law.drawn[:, k] >= score)) / (1 + law.drawn.shape[0])),
        )
        for k, (name, (value, where), score) in enumerate(zip(GROUPS, rows, groups, strict=True))
    )


def _seen(
    law: Law, left: Leftover, practical: float, known: Sequence[LinearisedResponse]
) -> tuple[dict[str, float | None], bool]:
    """Return the smallest detectable size of each effect, at its best shape, and whether any is physically possible."""
    smallest: dict[str, float | None] = {}
    visible, power = not known, Power(law)
    for response in known:
        effect = response.effect
        smallest.setdefault(effect.name, None)
        whole = np.zeros(left.residual.size)
        whole[left.fitted] = response.change
        rest = law.refit(whole[None])[0][left.fitted]
        if np.linalg.norm(rest) <= ACCURACY * np.linalg.norm(whole):
            continue
        strength = power.smallest(rest, practical)
        if strength is None:
            continue
        rms, before = float(strength * np.sqrt(np.mean(response.change**2))), smallest[effect.name]
        smallest[effect.name] = rms if before is None else min(before, rms)
        own = effect.described(effect.strength)
        visible = visible or own.lower <= strength <= own.upper or own.lower <= -strength <= own.upper
    return smallest, visible


def _curves(law: Law, left: Leftover, scores: Scores) -> Curves:
    from scipy.signal import welch

    segment = min(1024, *(r.stop - r.start for r in left.records))
    densities = [welch(left.residual[r], 1 / left.sample_time, nperseg=segment) for r in left.records]
    weights = [r.stop - r.start for r in left.records]
    some = np.unique(np.linspace(0, law.spectrum.size - 1, POINTS).astype(int))
    return Curves(
        frequency=densities[0][0][1:],
        spectrum=np.average([d[1:] for _, d in densities], axis=0, weights=weights),
        noise=2 * left.sample_time * left.noise**2,
        lines=law.battery.frequencies[some],
        cumulated=scores.spectra[0][some],
        expected=law.spectrum[some],
        distance=law.distance,
        regressors=law.battery.names,
        correlations=law.correlations(scores)[0],
        bound=law.correlation,
    )

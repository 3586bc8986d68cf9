"""Fits with few simulations: a rough fit for every candidate, a complete one for good candidates."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part, free_run_residuals, reading_times
from deatwin.ident.mismatch.thresholds import ACCURACY, NEGLIGIBLE
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Scale

OPENING_SAMPLES = 2000
"""Number of samples of each experiment's opening that a first fit uses, enough for the film's fast parameters."""
OPENING_EVALUATIONS = 8
ROUGH = 3e-3
"""Tolerance of a rough fit, as a share of the squared residual: 0.15 % of the residual."""
FORESEEN = 0.01
"""Relative difference of the rms residuals that two successive linear models predict, below which a rough fit ends: a
tenth of the difference within which fits are completed."""
TO_COMPARE: Mapping[str, Any] = {"evaluations": 10, "tolerance": ROUGH}
"""Largest number of simulations, and tolerance, of a fit that is compared with others and may not be completed."""
ROUGHLY: Mapping[str, Any] = {**TO_COMPARE, "foreseen": FORESEEN}
"""Options of a rough fit."""
EVALUATIONS = 60
"""Largest number of simulations of a final fit, which ends within a tenth of a standard deviation."""
ROUNDS = 4
"""Largest number of restarts from the end of a fit."""
EVENT_STEP = 0.02
"""First step of the search for an event's time, as a share of the record."""
FINEST = 1 / 8
"""Last step of that search, as a share of a sample. A jump of six times the noise shows its time to 0.17 samples,
because a single sample depends on it."""
AROUND = 4
"""Number of samples on either side of a minimum that are searched for a lower one, because noise makes the residual
rough."""
DECADE = 10.0
"""Standard error of a parameter, as a factor, beyond which the readings do not determine its order of magnitude."""
PROMISING = 1.3
"""Ratio of the mean squared residual to noise and model error below which a fit is completed."""


def approach(start: Plant, parts: Sequence[Part], foreseen: float = 0.0) -> Calibration:
    """Fit the opening of each experiment only, as a cheap start for further fits; `foreseen` as for `descend`."""
    openings = [opening(part, OPENING_SAMPLES) for part in parts]
    return descend(start, openings, evaluations=OPENING_EVALUATIONS, tolerance=ROUGH, foreseen=foreseen)


def roughly(near: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Fit all counted samples roughly, from the values of `approach`; `hopeless` as for `calibrate`."""
    return descend(near, parts, **ROUGHLY, hopeless=hopeless)


def is_promising(rough: Calibration, noise: float) -> bool:
    """Return whether a rough fit leaves little more than noise, SI, and model error."""
    return bool(rough.foreseen**2 < PROMISING * (noise**2 + rough.plant.rig.model_error**2))


def settle(near: Plant, parts: Sequence[Part], noise: float) -> Calibration:
    """Fit all counted samples roughly; complete the fit if the residual is nearly noise."""
    rough = descend(near, parts, **TO_COMPARE)
    return finish(rough, parts) if rough.status.ok and is_promising(rough, noise) else rough


def finish(rough: Calibration, parts: Sequence[Part]) -> Calibration:
    """Complete a rough fit; return it as it is if that fails."""
    # In a narrow valley the solver's steps shrink until it stops before the minimum. So it is restarted with steps of
    # full size until that gains nothing.
    found = rough
    for _ in range(ROUNDS):
        again = further(found, parts, tolerance=NEGLIGIBLE)
        if not again.status.ok:
            break
        spent = found.evaluations + again.evaluations - 1  # both fits count the simulation that they share
        settled, found = again.rms**2 >= (1.0 - NEGLIGIBLE) * found.rms**2, replace(again, evaluations=spent)
        if settled:
            break
    return found


def further(fit: Calibration, parts: Sequence[Part], **options: Any) -> Calibration:
    """Continue a fit of the same `parts`, without repeating its last simulation."""
    return descend(fit.plant, parts, response=(fit.residuals, fit.jacobian), **options)


def search(start: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Fit a plant roughly, from starting values that may be far off; `hopeless` as for `calibrate`."""
    near = approach(start, parts, FORESEEN)
    found = roughly(near.plant, parts, hopeless)
    return found if found.status.ok or not near.status.ok else roughly(start, parts, hopeless)


def where_it_acts(near: Calibration, parts: Sequence[Part], names: Collection[str]) -> Plant:
    """Move each of some parameters that a fit hardly determines to the half decade that suits the `parts` best."""
    # A descent finds no slope there, as for a damping that is far too small to matter, so the parameter stays or drifts
    # to a bound. The readings of an underdamped plant are sampled at random phases of its ringing, so they may change
    # for the worse before they change for the better; half decades find the valley beyond.
    errors = dict(zip(near.names, np.sqrt(np.diag(near.covariance)), strict=True))
    known = (near.plant.parameters[name] for name in near.names if name in names)
    found = near.plant
    for parameter in (p for p in known if p.scale is Scale.LOGARITHMIC and not errors[p.name] < np.log(DECADE)):
        down, up = (np.log10(end / parameter.value) for end in (parameter.lower, parameter.upper))
        powers = np.arange(np.ceil(2.0 * down), np.floor(2.0 * up) + 1.0) / 2.0
        tried = [found.with_values({parameter.name: parameter.value * DECADE**k}) for k in powers if k]
        least = (1.0 - ROUGH) * _squares(found, parts)
        losses = [_squares(plant, parts) for plant in tried]
        found = tried[int(np.argmin(losses))] if losses and min(losses) < least else found
    return found


def at_its_time(fit: Calibration, parts: Sequence[Part], hopeless: float = np.inf, enough: float = 0.0) -> Calibration:
    """Move the events of a fitted plant to the times at which they explain most, and refit roughly if one moves.

    `enough` is the smallest share of the squared residual that counts as a gain; `hopeless` as for `calibrate`.
    """
    # A fit cannot move an event, because only one or two samples depend on its time; so the time is searched.
    if fit.given_up:
        return fit
    plant = fit.plant
    for name in plant.event_times:
        plant = _moved(plant, name, parts, enough=enough)
    return fit if plant is fit.plant else roughly(plant, parts, hopeless)


def in_a_wider_range(fit: Calibration, unbiased: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Refit with wider ranges if parameters ended at a usual, not a physical limit, as long as that gains."""
    # The limit biases the other fitted parameters, so the search begins at the `unbiased` plant.
    ended = {name: fit.plant.parameters[name].beyond for name in fit.at_bound}
    further = {name: value for name, value in ended.items() if value is not None}
    if not further:
        return fit
    again = search(unbiased.with_values(further), parts, hopeless)
    gains = again.status.ok and again.foreseen**2 < (1.0 - ROUGH) * fit.foreseen**2
    return in_a_wider_range(again, unbiased, parts, hopeless) if gains else fit


def in_its_gap(fit: Calibration, fitted: Sequence[Part], everything: Sequence[Part]) -> Calibration:
    """Place events between fitted stretches by all samples and refit; keep the given fit if none moves or it fails."""
    # The fitted samples do not determine the time of an event within such a gap; the held-out ones do.
    plant = fit.plant
    for name in plant.event_times:
        if (gap := gap_around(plant, name, fitted, everything)) is not None:
            plant = _moved(plant, name, everything, gap)
    if plant is fit.plant:
        return fit
    moved = descend(plant, fitted, tolerance=NEGLIGIBLE)
    return finish(moved, fitted) if moved.status.ok else fit


def gap_around(
    plant: Plant, name: str, fitted: Sequence[Part], everything: Sequence[Part]
) -> tuple[float, float] | None:
    """Return the clock times of the fitted readings around an event, s, if held-out readings lie between them."""
    times, known = (reading_times(plant, parts) for parts in (fitted, everything))
    at = plant.parameters[name].value
    before, after = times[times < at], times[times >= at]
    if not (before.size and after.size):
        return None
    first, last = float(before.max()), float(after.min())
    return (first, last) if ((known > first) & (known < last)).any() else None


def refit(found: Calibration, everything: Sequence[Part]) -> Calibration:
    """Fit a plant to all sound samples, after the verdict; return the given fit if that fails."""
    placed = at_its_time(found, everything)
    final = descend(placed.plant, everything, evaluations=EVALUATIONS, tolerance=ACCURACY)
    return final if final.status.ok else found


def _moved(
    plant: Plant,
    name: str,
    parts: Sequence[Part],
    within: tuple[float, float] = (-np.inf, np.inf),
    enough: float = 0.0,
) -> Plant:
    """Move one event to the minimum of the squared residual, with steps that are halved."""
    # The search ends if a step in either direction changes the residual by a share of less than `enough`.
    times, sample = reading_times(plant, parts), plant.rig.sample_time
    known = plant.parameters[name]
    first, last = max(times.min(), known.lower, within[0]), min(times.max(), known.upper, within[1])
    step, best, least = min(EVENT_STEP * float(np.ptp(times)), (last - first) / 2), plant, _squares(plant, parts)
    around = [side * k * sample for k in range(1, AROUND + 1) for side in (-1, 1)]
    seen = [known.value]
    while True:
        offsets = (-step, step) if step > FINEST * sample else around
        places = [best.parameters[name].value + offset for offset in offsets]
        new = [at for at in places if first < at < last and np.abs(np.subtract(seen, at)).min() > ACCURACY * sample]
        seen += new
        tried = [best.with_values({name: at}) for at in new]
        losses = [_squares(other, parts) for other in tried]
        if losses and min(losses) < least:
            least, best = min(losses), tried[int(np.argmin(losses))]
            step = sample / 2 if offsets is around else step
        elif offsets is around:
            return best
        elif len(losses) == len(places) and max(losses) <= (1.0 + enough) * least:
            return best
        else:
            step /= 2


def free_run_rms(plant: Plant, parts: Sequence[Part]) -> float:
    """Return the rms free-run residual of a plant; infinite if it cannot be simulated."""
    residuals = free_run_residuals(plant, parts)
    return float(np.inf) if residuals is None else root_mean_square(residuals)


def _squares(plant: Plant, parts: Sequence[Part]) -> float:
    left = free_run_residuals(plant, parts)
    return float(np.inf) if left is None else float(np.sum(left**2))


def opening(part: Part, samples: int) -> Part:
    """Return a part with only the counted samples of its opening; the given part if there are none."""
    left, masks = samples, []
    for mask in part.masks:
        masks.append(mask & (np.arange(mask.size) < left))
        left -= mask.size
    if not any(mask.any() for mask in masks):
        return part
    return replace(part, masks=tuple(masks))

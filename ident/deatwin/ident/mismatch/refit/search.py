"""Fits that spend their simulations where they matter: a rough one for every variant, a fine one for the good ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part, free_run_residuals, reading_times
from deatwin.plant.model import Plant

OPENING_SAMPLES = 2000
"""The first approach uses the opening of each experiment, long enough for the film's fast parameters."""
OPENING_EVALUATIONS = 8
ROUGH = 3e-3
"""A variant that leaves a large residual need not be fitted better than to 0.15 % of it,"""
ROUGHLY: Mapping[str, Any] = {"evaluations": 10, "tolerance": ROUGH}
"""nor with more simulations than these."""
DECIDING = 1e-3
"""Relative change of the squared residual that no decision sees: a tenth of a nat in a hundred blocks."""
SETTLED, EVALUATIONS = 1e-6, 60
"""Tolerance of a last fit: a tenth of a standard deviation along the flattest direction remains."""
ROUNDS = 4
"""Fits from where the last one ended."""
EVENT_STEP = 0.02
"""Share of the record by which an event is moved first,"""
FINEST = 1 / 8
"""and of a sample, from which on it is moved no more: the noise of a jump that is six times as large leaves 0.17 of its
time, since one sample knows of it, whose reading rises by the jump within a sample."""
SAME = 1e-6
"""Share of a sample: an event is not tried again nearer to a time that was tried."""
AROUND = 4
"""Samples on either side of a least squared residual, each of which may hide a lesser one: noise roughens it."""
PROMISING = 1.3
"""Mean squared residual against noise and model error, below which a variant is fitted to the end."""


def approach(start: Plant, parts: Sequence[Part]) -> Calibration:
    """Fit the opening of each experiment only: cheap, and near enough to go on from.

    Parameters
    ----------
    start : Plant
        With starting values.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    Calibration
        On the openings of `parts`.
    """
    openings = [opening(part, OPENING_SAMPLES) for part in parts]
    return descend(start, openings, evaluations=OPENING_EVALUATIONS, tolerance=ROUGH)


def roughly(near: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Fit all counted samples roughly.

    Parameters
    ----------
    near : Plant
        With values from `approach`.
    parts : sequence of Part
        Samples that count.
    hopeless : float
        As for `calibrate`.

    Returns
    -------
    Calibration
        On all of `parts`.
    """
    return descend(near, parts, **ROUGHLY, hopeless=hopeless)


def is_promising(rough: Calibration, noise: float) -> bool:
    """Return whether a rough fit leaves little more than noise and model error.

    Parameters
    ----------
    rough : Calibration
        On all samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    bool
    """
    return bool(rough.rms**2 < PROMISING * (noise**2 + rough.plant.rig.model_error**2))


def settle(near: Plant, parts: Sequence[Part], noise: float) -> Calibration:
    """Fit all counted samples: roughly, and to the end where what is left is nearly noise.

    Parameters
    ----------
    near : Plant
        With values from `approach`.
    parts : sequence of Part
        Samples that count.
    noise : float
        Standard deviation of the sensor's noise, SI.

    Returns
    -------
    Calibration
        On all of `parts`.
    """
    rough = roughly(near, parts)
    return finish(rough, parts) if rough.status.ok and is_promising(rough, noise) else rough


def finish(rough: Calibration, parts: Sequence[Part]) -> Calibration:
    """Fit to the end what was fitted roughly.

    In a narrow valley the solver's steps shrink until it calls the fit settled where it is not: it is asked again from
    there, with steps of full size, until that gains nothing.

    Parameters
    ----------
    rough : Calibration
        On `parts`.
    parts : sequence of Part
        Samples that count.

    Returns
    -------
    Calibration
        The rough one where the fit fails.
    """
    found = rough
    for _ in range(ROUNDS):
        again = further(found, parts, tolerance=DECIDING)
        if not again.status.ok:
            break
        spent = found.evaluations + again.evaluations - 1  # the first of a further fit is the last of the one before
        gained, found = 1.0 - (again.rms / found.rms) ** 2, replace(again, evaluations=spent)
        if gained < DECIDING:
            break
    return found


def further(fit: Calibration, parts: Sequence[Part], **options: Any) -> Calibration:
    """Go on from where a fit of the same `parts` has ended, whose last simulation need not be made again."""
    return descend(fit.plant, parts, response=(fit.residuals, fit.jacobian), **options)


def search(start: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Fit a plant from far away, roughly.

    Parameters
    ----------
    start : Plant
        With starting values.
    parts : sequence of Part
        Samples that count.
    hopeless : float
        As for `calibrate`.

    Returns
    -------
    Calibration
        On all of `parts`.
    """
    near = approach(start, parts)
    found = roughly(near.plant, parts, hopeless)
    return found if found.status.ok or not near.status.ok else roughly(start, parts, hopeless)


def at_its_time(fit: Calibration, parts: Sequence[Part], hopeless: float = np.inf, enough: float = 0.0) -> Calibration:
    """Move the events in a fitted plant to where they explain most, and fit it anew, roughly.

    Only a sample or two know of the time of an event, so no fit moves it; it is searched for.

    Parameters
    ----------
    fit : Calibration
        Of a plant on `parts`.
    parts : sequence of Part
        Samples that count.
    hopeless : float
        As for `calibrate`.
    enough : float
        Share of the squared residual for which an event is moved no more.

    Returns
    -------
    Calibration
        The same one where the plant has no event or none that moves, or the fit was given up.
    """
    if fit.given_up:
        return fit
    plant = fit.plant
    for name in plant.event_times:
        plant = _moved(plant, name, parts, enough=enough)
    return fit if plant is fit.plant else roughly(plant, parts, hopeless)


def in_a_wider_range(fit: Calibration, unbiased: Plant, parts: Sequence[Part], hopeless: float = np.inf) -> Calibration:
    """Fit anew, from just beyond, what ended where only the usual ends and not physics, as long as that gains.

    Parameters
    ----------
    fit : Calibration
        Of a plant on `parts`.
    unbiased : Plant
        The same with starting values: at the end of the range the others were biased to do what lay beyond it.
    parts : sequence of Part
        Samples that count.
    hopeless : float
        As for `calibrate`.

    Returns
    -------
    Calibration
        The same one where no parameter ended so, or a wider range gains nothing.
    """
    ended = {name: fit.plant.parameters[name].beyond for name in fit.at_bound}
    further = {name: value for name, value in ended.items() if value is not None}
    if not further:
        return fit
    again = search(unbiased.with_values(further), parts, hopeless)
    gains = again.status.ok and again.rms**2 < (1.0 - ROUGH) * fit.rms**2
    return in_a_wider_range(again, unbiased, parts, hopeless) if gains else fit


def in_its_gap(fit: Calibration, fitted: Sequence[Part], everything: Sequence[Part]) -> Calibration:
    """Move events that lie between fitted stretches to where they explain most of all samples.

    The fit cannot tell where in such a gap an event lies, and hardly depends on it; what was not fitted can.

    Parameters
    ----------
    fit : Calibration
        Of a plant on `fitted`.
    fitted : sequence of Part
        Samples that were fitted.
    everything : sequence of Part
        Those and the others.

    Returns
    -------
    Calibration
        Fitted once more from there; the same one where the plant has no such event, it stays where it is, or there is
        no fit.
    """
    plant = fit.plant
    for name in plant.event_times:
        if (gap := gap_around(plant, name, fitted, everything)) is not None:
            plant = _moved(plant, name, everything, gap)
    if plant is fit.plant:
        return fit
    moved = descend(plant, fitted, tolerance=DECIDING)
    return finish(moved, fitted) if moved.status.ok else fit


def gap_around(
    plant: Plant, name: str, fitted: Sequence[Part], everything: Sequence[Part]
) -> tuple[float, float] | None:
    """The fitted readings between which an event lies, if others were not fitted in between.

    Parameters
    ----------
    plant : Plant
        With the event.
    name : str
        Of the event's time among the plant's parameters.
    fitted, everything : sequence of Part
        As for `in_its_gap`.

    Returns
    -------
    tuple of two floats, or None
        Clock times of the last one before and of the first one after, s.
    """
    times, known = (reading_times(plant, parts) for parts in (fitted, everything))
    at = plant.parameters[name].value
    before, after = times[times < at], times[times >= at]
    if not (before.size and after.size):
        return None
    first, last = float(before.max()), float(after.min())
    return (first, last) if ((known > first) & (known < last)).any() else None


def refit(found: Calibration, everything: Sequence[Part]) -> Calibration:
    """After the judgement a plant is fitted to all sound samples, its events at their times.

    Parameters
    ----------
    found : Calibration
        Of the fitted part.
    everything : sequence of Part
        All that may be fitted.

    Returns
    -------
    Calibration
        On `everything`; `found` where there is no such fit.
    """
    placed = at_its_time(found, everything)
    final = descend(placed.plant, everything, evaluations=EVALUATIONS, tolerance=SETTLED)
    return final if final.status.ok else found


def _moved(
    plant: Plant,
    name: str,
    parts: Sequence[Part],
    within: tuple[float, float] = (-np.inf, np.inf),
    enough: float = 0.0,
) -> Plant:
    """The plant with one event where the squared residual is least, found by steps that are halved.

    Until a step either way changes that by less than a share which is `enough`.
    """
    times, sample = reading_times(plant, parts), plant.rig.sample_time
    known = plant.parameters[name]
    first, last = max(times.min(), known.lower, within[0]), min(times.max(), known.upper, within[1])
    step, best, least = min(EVENT_STEP * float(np.ptp(times)), (last - first) / 2), plant, _squares(plant, parts)
    around = [side * k * sample for k in range(1, AROUND + 1) for side in (-1, 1)]
    seen = [known.value]
    while True:
        offsets = (-step, step) if step > FINEST * sample else around
        places = [best.parameters[name].value + offset for offset in offsets]
        new = [at for at in places if first < at < last and np.abs(np.subtract(seen, at)).min() > SAME * sample]
        seen += new  # what was seen before leaves no less than the best does
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


def _squares(plant: Plant, parts: Sequence[Part]) -> float:
    left = free_run_residuals(plant, [part.until_last() for part in parts])
    return float(np.inf) if left is None else float(np.sum(left**2))


def opening(part: Part, samples: int) -> Part:
    """The counted samples among the first of an experiment.

    Parameters
    ----------
    part : Part
        What counts.
    samples : int
        How many samples of the experiment open it.

    Returns
    -------
    Part
        The whole one where none of the first samples counts.
    """
    left, masks = samples, []
    for mask in part.masks:
        masks.append(mask & (np.arange(mask.size) < left))
        left -= mask.size
    if not any(mask.any() for mask in masks):
        return part
    return replace(part, masks=tuple(masks))

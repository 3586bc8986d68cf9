"""Faults that a comparison with a calibrated plant reveals.

These are held readings, bursts of noise, readings after a gap that depend on an unknown change of the command within
the gap, and readings that differ from the model's by a factor which no calibration reaches: a reversed sign, or a wrong
unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.bursts import noisier
from deatwin.ident.mismatch.quality.quality import DataQuality, Masks, by_experiment, marked_in_any
from deatwin.ident.mismatch.quality.suspects import held
from deatwin.ident.mismatch.thresholds import ACCURACY, MOST, PRACTICAL_SHARE
from deatwin.ident.soundness import resolution
from deatwin.plant.effects.delay import USUAL
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording, label


def without_faults(checked: DataQuality, plant: Plant) -> DataQuality:
    """Mark faults of readings that a comparison with a calibrated plant reveals; return the same object if none."""
    outputs = [plant.simulate(experiment).require().outputs for experiment in checked.experiments]
    commands = [record.inputs[0] for experiment in checked.experiments for record in experiment.recordings]
    stuck: dict[str, Masks] = {}
    bursts: dict[str, Masks] = {}
    for row, reading in enumerate(plant.rig.readings):
        name, simulated, measured = reading.name if row else "", [], []
        for experiment, rows, sound in zip(checked.experiments, outputs, checked.sound, strict=True):
            simulated += [each[row] for each in rows]
            for record, mask in zip(experiment.recordings, sound, strict=True):
                measured.append(record.reading(name) if name else np.where(mask, record.outputs[0], np.nan))
        still = [
            held(*three, plant.rig.sample_time, reading.noise)
            for three in zip(measured, simulated, commands, strict=True)
        ]
        alive = [np.where(mask, np.nan, values) for mask, values in zip(still, measured, strict=True)]
        steps = [resolution(known) for known in (values[np.isfinite(values)] for values in alive) if known.size]
        residuals = [values - y for values, y in zip(alive, simulated, strict=True)]
        noisy = noisier(residuals, commands, max([reading.noise, *(step / np.sqrt(12.0) for step in steps)]))
        for found, masks in ((stuck, still), (bursts, noisy)):
            if any(mask.any() for mask in masks):
                found[name] = by_experiment(checked, masks)
    if not stuck and not bursts:
        return checked
    own = stuck.pop("", None)
    return replace(
        checked, bursts=bursts, stuck_further=stuck, stuck=marked_in_any(checked.stuck, own) if own else checked.stuck
    )


def without_unknown(checked: DataQuality, plant: Plant, noise: float) -> DataQuality:
    """Mark readings that depend on how a command changed in a gap; `noise` is in SI.

    Return the same object if there are none, or hardly any others.
    """
    # The command is assumed to have changed at the end of the gap. It may instead have changed at its beginning, or
    # varied as on either side of it. A reading is unknown if a calibrated plant then differs by more than noise and
    # model error, so an oscillating plant is left out for as long as it oscillates.
    floor, marked = float(np.hypot(noise, plant.rig.model_error)), []
    for experiment in checked.experiments:
        masks = [np.zeros(record.n_samples, dtype=bool) for record in experiment.recordings]
        histories = [_filled(experiment, fill) for fill in (_early, _as_before, _as_behind)]
        if len(histories[0].recordings) > len(masks):
            starts = {record.start for record in experiment.recordings}
            assumed = plant.simulate(experiment).require().outputs
            for history in histories:
                found = zip(history.recordings, plant.simulate(history).require().outputs, strict=True)
                known = [rows for record, rows in found if record.start in starts]
                for mask, one, other in zip(masks, assumed, known, strict=True):
                    mask[: np.flatnonzero(np.abs(other[0] - one[0]) > floor).max(initial=-1) + 1] = True
        marked.append(tuple(masks))
    every = np.concatenate([mask for masks in marked for mask in masks])
    return replace(checked, unknown=tuple(marked)) if every.any() and np.mean(~every) >= PRACTICAL_SHARE else checked


def _filled(experiment: Experiment, fill: Callable[[np.ndarray, np.ndarray, int], np.ndarray]) -> Experiment:
    """Return an experiment with given commands in each gap in which the command changed."""
    first, *others = experiment.recordings
    records: list[Recording] = [first]
    for record in others:
        before = records[-1]
        gap = round((record.start - before.end) / before.sample_time)
        if gap > 0 and record.inputs[0, 0] != before.inputs[0, -1]:
            inputs = np.repeat(record.inputs[:, :1], gap, axis=1)
            inputs[0] = fill(before.inputs[0], record.inputs[0], gap)
            outputs = np.repeat(record.outputs[:, :1], gap, axis=1)
            records.append(replace(record, start=before.end, inputs=inputs, outputs=outputs, extras={}))
        records.append(record)
    return Experiment(recordings=tuple(records))


def _early(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the command after a gap, applied from the beginning of the gap."""
    return np.full(gap, behind[0])


def _as_before(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the commands before a gap in reversed order, so that there is no step at its beginning."""
    return np.pad(before[::-1][:gap], (0, max(gap - before.size, 0)), mode="reflect")[:gap]


def _as_behind(before: np.ndarray, behind: np.ndarray, gap: int) -> np.ndarray:
    """Return the commands after a gap in reversed order, up to its end."""
    return _as_before(behind[::-1], before, gap)[::-1]


WRONG_UNIT = 10.0
"""Smallest factor between two units of a quantity with different prefixes."""
STRETCHES = 8
"""Number of equal stretches of a part, which end at gaps, too. A straight line in a stretch is slow: drifts may exceed the
motion, and a reading may jump in a gap."""


def factors(problem: DiagnosisProblem, calibrated: Plant) -> tuple[tuple[Part, float], ...]:
    """Return the parts of which neither the calibrated nor the nominal plant explains most, but the nominal plant's
    readings, multiplied by one factor, do; each with its factor. Slow changes do not count, because readings drift.
    """
    found = []
    for part in problem.of_first.everything:
        measured = _fast(part.measured, part)
        if measured is None or _share(measured, _fast(simulated(calibrated, [part]), part)) > MOST:
            continue  # as nearly always, so that the nominal plant need not be simulated
        nominal = _fast(simulated(problem.nominal, [part]), part)
        if nominal is None or _share(measured, nominal) > MOST:
            continue
        factor = _factor(measured, nominal)
        if _share(measured, factor * nominal) > MOST:
            found.append((part, factor))
    return tuple(found)


def require_same_scale(problem: DiagnosisProblem, calibrated: Plant) -> None:
    """Raise DataError if readings fall where those of the model rise, or are in another unit."""
    for part, factor in factors(problem, calibrated):
        record = label(part.experiment.recordings[0])
        explains = f"{factor:.3g} times the readings of the model explain most of the readings, but no calibration does"
        if factor < 0 and not _is_late(part, problem):
            raise DataError(
                f"{record}: the readings fall where those of the model rise: {explains}; reverse the sign of the readings "
                'or of the commands; in a rig file, direction = "against the motion" reverses the readings'
            )
        if not 1 / WRONG_UNIT < abs(factor) < WRONG_UNIT:
            raise DataError(
                f"{record}: the readings and the model differ as if one of them had another unit: {explains}; check the "
                "units of readings and command, and what is stated about the rig, first of all the gain"
            )


def _fast(row: np.ndarray | None, part: Part) -> np.ndarray | None:
    """Return a signal about its own line in each stretch; None if it is constant there except for rounding."""
    from scipy.signal import detrend

    if row is None or not row.size:
        return None
    steps = np.diff(part.timepts)
    gaps = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1 if steps.size else np.zeros(0, dtype=int)
    cuts = np.linspace(0, row.size, STRETCHES + 1).astype(int)[:-1]
    fast = detrend(row, bp=np.union1d(cuts, gaps))
    return np.asarray(fast) if np.std(fast) > ACCURACY * np.abs(row).max() else None


def _is_late(part: Part, problem: DiagnosisProblem) -> bool:
    """Return whether a usual dead time explains readings about as well as a reversed sign: half a period of a sine."""
    measured, fast = _fast(part.measured, part), _fast(simulated(problem.nominal, [part]), part)
    if fast is None or measured is None:
        return False
    reversed_sign = 1.0 - _share(measured, _factor(measured, fast) * fast)
    for late in range(1, min(round(USUAL / problem.nominal.rig.sample_time), measured.size // 2) + 1):
        after, before = measured[late:], fast[:-late]
        factor = _factor(after, before)
        if factor > 0.0 and MOST * (1.0 - _share(after, factor * before)) < reversed_sign:
            return True
    return False


def _factor(measured: np.ndarray, readings: np.ndarray) -> float:
    """Return the factor by which simulated readings are nearest to the measured ones."""
    return float(readings @ measured / (readings @ readings))


def _share(measured: np.ndarray, readings: np.ndarray | None) -> float:
    """Return the share of the variance of the readings that simulated readings explain."""
    return 0.0 if readings is None else 1.0 - float(np.var(measured - readings) / np.var(measured))

"""Readings that differ from the model's by a factor which no calibration reaches: a reversed sign, or a wrong unit."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import ACCURACY, MOST
from deatwin.plant.effects.delay import USUAL
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import label

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

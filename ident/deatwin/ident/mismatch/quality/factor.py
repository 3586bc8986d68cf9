"""Readings that differ from the model's by a factor which no calibration reaches: a reversed sign, or a wrong unit."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import MOST
from deatwin.plant.errors import DataError
from deatwin.plant.model import Plant
from deatwin.plant.recording import label

WRONG_UNIT = 10.0
"""Smallest factor between two units of a quantity with different prefixes."""


def factors(problem: DiagnosisProblem, calibrated: Plant) -> tuple[tuple[Part, float], ...]:
    """Return the parts of which the calibrated plant does not explain most, but the nominal plant's readings, multiplied
    by one factor, do; each with its factor.
    """
    found = []
    for part in problem.of_first.everything:
        measured, fitted, nominal = part.measured, simulated(calibrated, [part]), simulated(problem.nominal, [part])
        explained = _share(measured, fitted)
        if explained > MOST or nominal is None or not np.ptp(nominal):
            continue
        centred = nominal - nominal.mean()
        factor = float(centred @ measured / (centred @ centred))
        if _share(measured, factor * nominal) > MOST:
            found.append((part, factor))
    return tuple(found)


def require_same_scale(problem: DiagnosisProblem, calibrated: Plant) -> None:
    """Raise DataError if readings fall where those of the model rise, or are in another unit."""
    for part, factor in factors(problem, calibrated):
        record = label(part.experiment.recordings[0])
        explains = f"{factor:.3g} times the readings of the model explain most of the readings, but no calibration does"
        if factor < 0:
            raise DataError(
                f"{record}: the readings fall where those of the model rise: {explains}; reverse the sign of the readings "
                'or of the commands; in a rig file, direction = "against the motion" reverses the readings'
            )
        if not 1 / WRONG_UNIT < factor < WRONG_UNIT:
            raise DataError(
                f"{record}: the readings and the model differ as if one of them had another unit: {explains}; check the "
                "units of readings and command, and what is stated about the rig, first of all the gain"
            )


def _share(measured: np.ndarray, readings: np.ndarray | None) -> float:
    """Return the share of the variance of the readings that simulated readings explain."""
    return 0.0 if readings is None else 1.0 - float(np.var(measured - readings) / np.var(measured))

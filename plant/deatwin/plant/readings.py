"""Further readings of a rig besides the first one, such as the current into a film."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.plant.arguments import instance, require_fields
from deatwin.plant.errors import RigError
from deatwin.plant.rigs.stated import require_number
from deatwin.plant.safe_read import clipped

ELECTRICAL_UNITS: Mapping[str, str] = {"current": "A", "capacitance": "F", "film_voltage": "V"}
"""Readings that each rig with a film offers, with their SI units."""
MEANS = frozenset({"current"})  # Readings of a film that are means over the sample that ends when the rig is read
ROOM_TEMPERATURE = 293.15  # Reading of a thermometer unless an effect replaces it, K
ROWS = 3  # Number of rows of equations per further reading: level, stored quantity, and the share of it that flows


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One reading of a rig: the measured signal, its unit, and the accuracy of the measurement.

    Parameters
    ----------
    name : str
        Name of the measured signal: ``current``, ``capacitance`` or ``film_voltage`` for a rig with a film, or one of
        the signals in `Plant.signals`.
    unit : str
        SI unit. By default, ``current`` is in A, ``capacitance`` in F and ``film_voltage`` in V; the unit of other
        signals is unknown.
    noise : float
        Standard deviation of the sensor noise, in `unit`, above 0.
    model_error : float
        Rms error of the rig's equations in this reading, in `unit`.
    series_resistance : float
        Known resistance between the drive and the film, ohm. It matters only for the reading ``current`` of a plant
        with the effect `Leakage`: the leakage current is the voltage drop across the resistance divided by the
        resistance.
    column : str
        Header of the file column that holds the reading. A unit may follow an equals sign: ``"I_mon=nA"``. By default,
        the column with the name of the reading, if the file has one.

    Raises
    ------
    RigError
        If a number is out of range, if the name is empty, or if the name, the unit or the column is not a string.
    """

    name: str
    noise: float
    unit: str = ""
    model_error: float = 0.0
    series_resistance: float = 1e9
    column: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.strip():
            raise RigError(f"a reading has the name {clipped(repr(self.name))}; it must be the name of a signal")
        require_fields(self, unit=instance(str, error=RigError), column=instance(str, error=RigError))
        for name, least in (("noise", None), ("model_error", 0.0), ("series_resistance", None)):
            require_number(f'{name} of the reading "{self.name}"', getattr(self, name), least=least)
        if not self.unit:
            object.__setattr__(self, "unit", ELECTRICAL_UNITS.get(self.name, ""))


def readings_from(described: Any) -> tuple[Reading, ...]:
    """Return the further readings from a rig's plain data."""
    try:
        return tuple(Reading(**one) for one in described)
    except TypeError as error:
        raise RigError(f"malformed readings of a rig: {error}; each needs a name and its noise") from None


def combined(rows: np.ndarray, sample_time: float) -> np.ndarray:
    """Return l_k + s_k (q_k - q_{k-1}) / h. Shapes: `rows` (m, 3 k) of l, q, s at ends of samples; returns (m, k)."""
    level, stored, share = np.split(rows, ROWS, axis=1)
    return level + share * _risen(stored) / sample_time


def combined_slopes(rows: np.ndarray, slopes: np.ndarray, sample_time: float) -> np.ndarray:
    """Derivative of `combined`. Shapes: `rows` (m, 3 k); `slopes` (m, 3 k, n); returns (m, k, n)."""
    _, stored, share = np.split(rows, ROWS, axis=1)
    d_level, d_stored, d_share = np.split(slopes, ROWS, axis=1)
    flowing = d_share * _risen(stored)[:, :, None] + share[:, :, None] * _risen(d_stored)
    return d_level + flowing / sample_time


def _risen(stored: np.ndarray) -> np.ndarray:
    return np.diff(stored, axis=0, prepend=stored[:1])

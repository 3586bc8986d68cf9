"""Write recordings as CSV text that reads back exactly."""

from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import even_pieces
from deatwin.plant.files.csvcells import is_number
from deatwin.plant.files.csvnumbers import EXACT, decimal_relation, power_of_ten, reader
from deatwin.plant.files.csvtable import DESCRIPTION
from deatwin.plant.files.formats.description import describe, header_with_unit, rows_of, signals_of
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import UNITS, Unit
from deatwin.plant.files.usual import COLUMNS, usual_unit
from deatwin.plant.recording import Recording

_PLAIN = ("command", "displacement")
_MOST = 1e9  # Number that no unit of `COLUMNS` turns into the mark of an overflow


def csv_text(recording: Recording) -> str:
    """Return a recording as CSV."""
    timepts = _times(recording)
    signals = signals_of(recording, _header, taken=[COLUMNS["time"]])
    columns = [
        list(map(repr, timepts.tolist())),
        *(_texts(signal.header, row) for signal, row in zip(signals, rows_of(recording), strict=True)),
    ]
    lines = [",".join([COLUMNS["time"], *(signal.header for signal in signals)])]
    lines += map(",".join, zip(*columns, strict=True))
    if not _is_plain(recording, timepts):
        lines.insert(0, DESCRIPTION + describe(recording, signals))
    return "\n".join(lines) + "\n"


def _times(recording: Recording) -> NDArray[np.float64]:
    """Return the times, rounded to 1 ns if that does not change the first."""
    rounded = np.round(recording.timepts, 9)
    fine = rounded[:1] == recording.start and recording.sample_time > 1e-6
    return rounded if np.all(fine) else recording.timepts


def _is_plain(recording: Recording, timepts: NDArray[np.float64]) -> bool:
    """Return whether plain columns suffice: usual signals, no provenance, a sample time that can be recovered.

    Without a description, a huge number would mark an overflow.
    """
    names = (*recording.input_names, *recording.output_names)
    units = (*recording.input_units, *recording.output_units, *recording.extra_units.values())
    usual = (*names, *recording.extras)
    if names != _PLAIN or any(name not in COLUMNS for name in usual) or recording.provenance:
        return False
    if any((np.abs(row) > _MOST).any() for row in rows_of(recording)):
        return False
    if units != tuple(map(usual_unit, usual)) or len(set(usual)) < len(usual) or "time" in usual:
        return False
    try:
        sample_time, _ = even_pieces(timepts, str, allow_gaps=False)
    except DataError:
        return False
    return sample_time == recording.sample_time


def _header(name: str, unit: str) -> str:
    """Return the usual column of a signal, else its name and SI unit; empty if that could be read as a number."""
    usual = name in COLUMNS and unit == usual_unit(name)
    header = COLUMNS[name] if usual else header_with_unit(name, unit)
    return "" if is_number(header) else header


def _texts(header: str, values: NDArray[np.float64]) -> list[str]:
    """Write SI values in the unit of the header, such that they read back exactly."""
    unit = UNITS[split_unit(header)[1]]
    with np.errstate(over="ignore"):  # near the largest float, the value in the unit overflows
        texts = ["" if text == "nan" else text for text in map(repr, unit.from_si(values).tolist())]
    if power_of_ten(unit) == 0:
        return texts
    read = reader(unit)
    return [
        text if not text or (text not in ("inf", "-inf") and read(text) == value) else _exact(value, unit)
        for text, value in zip(texts, values.tolist(), strict=True)
    ]


def _exact(value: float, unit: Unit) -> str:
    """Write an SI value in a unit with as many digits as reading it back exactly requires."""
    shift, numerator, denominator = decimal_relation(unit)
    scaled = EXACT.divide(EXACT.multiply(Decimal(repr(value)), denominator), numerator)
    return str(EXACT.normalize(EXACT.subtract(scaled, shift)))

"""JSON text that accompanies a recording's columns in every format: which are input and output, their names and SI
units inside, the sample time to the last bit, and the provenance.
"""

import json
import re
from collections.abc import Callable, Iterable, Mapping
from itertools import chain, count
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.files.formats.table import Declared, Signal, Timing
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import UNITS
from deatwin.plant.safe_read import clipped

SCHEMA = "deatwin/recording/1"
KEY = "deatwin"  # Name of the variable, property or attribute that holds the description


class Signals(Protocol):
    """Signals of a recording, in SI units."""

    @property
    def inputs(self) -> NDArray[np.float64]: ...
    @property
    def outputs(self) -> NDArray[np.float64]: ...
    @property
    def extras(self) -> Mapping[str, NDArray[np.float64]]: ...
    @property
    def input_names(self) -> tuple[str, ...]: ...
    @property
    def output_names(self) -> tuple[str, ...]: ...
    @property
    def input_units(self) -> tuple[str, ...]: ...
    @property
    def output_units(self) -> tuple[str, ...]: ...
    @property
    def extra_units(self) -> Mapping[str, str]: ...
    @property
    def sample_time(self) -> float: ...
    @property
    def provenance(self) -> Mapping[str, str]: ...


def signals_of(recording: Signals, header: Callable[[str, str], str], *, taken: Iterable[str]) -> list[Signal]:
    """Return the signals of a recording, each with a unique header."""
    plain = [
        *(("input", *pair) for pair in zip(recording.input_names, recording.input_units, strict=True)),
        *(("output", *pair) for pair in zip(recording.output_names, recording.output_units, strict=True)),
        *(("extra", name, recording.extra_units[name]) for name in recording.extras),
    ]
    used, signals = set(taken), []
    for number, (role, name, unit) in enumerate(plain, 1):
        numbered = (f"signal_{number}{'x' * more}" for more in count())
        fit = next(text for text in chain([header(name, unit)], numbered) if text and text not in used)
        used.add(fit)
        signals.append(Signal(role=role, name=name, unit=unit, header=fit))
    return signals


def unmistakable(unit: str) -> str:
    """Write a unit so that it cannot be misread after any name: C and F may be degrees."""
    return {"C": "coulomb", "F": "farad"}.get(unit, unit)


def rows_of(recording: Signals) -> list[NDArray[np.float64]]:
    """Return the values of all signals in SI units, in the order of `signals_of`."""
    return [*recording.inputs, *recording.outputs, *recording.extras.values()]


def plain_header(name: str, unit: str) -> str:
    """Return a signal's name as its header; empty if it would be misread."""
    fits = re.fullmatch(r"[^\W\d_]\w*", name) and not split_unit(name)[1]
    return name if fits else ""


def header_with_unit(name: str, unit: str) -> str:
    """Return a signal's name and SI unit as its header; empty if it would be misread."""
    said = unit if unit in UNITS and UNITS[unit].si == unit else ""  # any other unit is in the description
    header = f"{name}_{said}" if said else name
    fits = re.fullmatch(r"[^\W\d_]\w*", name) and split_unit(header)[1] == said
    return header if fits else ""


def describe(recording: Signals, signals: Iterable[Signal]) -> str:
    """Make the description of a recording."""
    return json.dumps(
        {
            "schema": SCHEMA,
            "sample_time": float(recording.sample_time),
            "signals": [vars(signal) for signal in signals],
            "provenance": {str(key): str(value) for key, value in recording.provenance.items()},
        }
    )


def read_description(text: str, path: str, *, start: float = 0.0) -> Declared:
    """Read a description. `start` is the time of the first sample, s, if the file has no column of times."""
    try:
        content = json.loads(text)
        schema = str(content["schema"])
    except _DAMAGED as error:
        raise _damaged(path, error) from None
    if schema != SCHEMA:
        raise DataError(f'{path}: its description has the schema "{clipped(schema)}"; "{SCHEMA}" can be read')
    try:
        return Declared(
            timing=Timing(sample_time=float(content["sample_time"]), start=start),
            signals=tuple(_signal(entry) for entry in content["signals"]),
            provenance={str(key): str(value) for key, value in content["provenance"].items()},
        )
    except _DAMAGED as error:  # including DataError, which is a ValueError
        raise _damaged(path, error) from None


_DAMAGED = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)


def all_provenance(own: Mapping[str, str], stored: Mapping[str, str]) -> dict[str, str]:
    """Return the provenance of a file's samples: first its own entries, then those stored in it."""
    found = dict(own)
    for key, value in stored.items():
        while key in found:
            key = f"origin.{key}"
        found[key] = value
    return found


def _damaged(path: str, error: Exception) -> DataError:
    return DataError(
        f"{path}: the description of its columns ('{KEY}') is damaged ({clipped(error, 200)}); delete this description, "
        "and the columns are read by their headers"
    )


def _signal(entry: Mapping[str, Any]) -> Signal:
    """Return a signal from the description."""
    if entry["role"] not in ("input", "output", "extra"):
        raise ValueError(f'role "{entry["role"]}"')
    return Signal(**{key: str(entry[key]) for key in ("role", "name", "unit", "header")})

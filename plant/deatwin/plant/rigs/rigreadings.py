"""Sections ``[readings.NAME]`` of a rig file: further readings with their columns and noise."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.readings import ELECTRICAL_UNITS, Reading
from deatwin.plant.rigs.rigkeys import Keys, NumberKey, TextKey, key_schema
from deatwin.plant.words import spaced

_LARGEST = 1e12
READING_KEYS: Keys = MappingProxyType(
    {
        "column": TextKey(
            field="column", required=False, about="header of the column; its unit may follow an equals sign"
        ),
        "unit": TextKey(field="unit", about="of the numbers below, such as nA or pF"),
        "noise": NumberKey(field="noise", lower=1e-12, upper=_LARGEST, about="rms, in that unit"),
        "model_error": NumberKey(
            field="model_error", lower=0.0, upper=_LARGEST, required=False, about="rms, in that unit; 0 if left out"
        ),
        "series_resistance_Mohm": NumberKey(
            field="series_resistance",
            lower=1e-6,
            upper=1e9,
            per_si=1e-6,
            required=False,
            about="between drive and film, where it is known",
        ),
    }
)
"""Keys of the section of each further reading."""


def unit_fault(name: str, unit: object) -> str:
    """Describe the fault of a reading's unit; empty if there is none, or if another check finds it."""
    wanted = ELECTRICAL_UNITS.get(name)
    if wanted is None or not isinstance(unit, str) or not unit.strip() or UNITS[find_unit(unit)].si == wanted:
        return ""
    likes = [known for known, one in UNITS.items() if one.si == wanted]
    return f'"{unit[:20]}" is not a unit of the {spaced(name)}; it must be one of {", ".join(likes)}'


def readings_of(sections: Mapping[str, Mapping[str, Any]]) -> tuple[Reading, ...]:
    """Return the readings from sections without mistakes, in SI units."""
    found = []
    for name, values in sections.items():
        unit = UNITS[find_unit(values["unit"])]
        known: dict[str, Any] = {
            READING_KEYS[key].field: READING_KEYS[key].to_si(value) for key, value in values.items()
        }
        known |= {key: float(unit.to_si(np.array(known[key]))) for key in ("noise", "model_error") if key in known}
        found.append(Reading(name=name, **{**known, "unit": ELECTRICAL_UNITS[name]}))
    return tuple(found)


def readings_schema() -> dict[str, Any]:
    """Return the schema of these sections."""
    one = {
        "type": "object",
        "additionalProperties": False,
        "required": [name for name, key in READING_KEYS.items() if key.required],
        "properties": {name: key_schema(key) for name, key in READING_KEYS.items()},
    }
    return {
        "description": "readings beside the displacement",
        "type": "object",
        "additionalProperties": False,
        "properties": dict.fromkeys(ELECTRICAL_UNITS, one),
    }

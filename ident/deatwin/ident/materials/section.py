"""The section [material] of a rig file, before and after a calibration."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from deatwin.ident.materials.energies import EnergyStart
from deatwin.ident.materials.fit import Fit, Quantity
from deatwin.plant.errors import RigError
from deatwin.plant.laws.formula import Formula
from deatwin.plant.rigs.rigmaterial import read_material
from deatwin.plant.substance import energy_named

KEYS = ("name", "energy", "parameters", "permittivity", "breakdown", "density_kg_m3")
"""Keys that may be stated; branches are determined by the tests."""
_BRANCH = {"modulus_Pa": (1.0, 1e9), "time_s": (1e-4, 1e7)}


def stated_energy(about: Mapping[str, Any]) -> EnergyStart | str | None:
    """Return the energy stated in a section: its name, or a formula with starting values; None if the tests decide."""
    wrong = [key for key in about if key not in KEYS]
    if wrong:
        raise RigError(f'[material]: unknown key "{wrong[0]}" before a calibration; known are {", ".join(KEYS)}')
    energy = about.get("energy")
    _checked({"name": "film", "energy": "neo_hookean", "parameters": {"shear_modulus": 1e5}} | _without_energy(about))
    if energy is None:
        if "parameters" in about:
            raise RigError(
                '[material]: parameters belong to an energy; name it, as in energy = "gent", or leave them out'
            )
        return None
    try:
        law = energy_named(str(energy))
    except RigError as error:
        raise RigError(f"[material] energy: {error}") from None
    if not isinstance(law, Formula) and "parameters" not in about:
        return str(law.__name__)
    start = _checked(about)
    return EnergyStart(energy=start.energy, parameters=start.elastic, called=str(energy))


def _without_energy(about: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in about.items() if key not in ("energy", "parameters")}


def _checked(section: Mapping[str, Any]) -> Any:
    found, mistakes = read_material(section)
    if found is None:
        (path, text), *_ = mistakes
        raise RigError(f"[material]{''.join(f' {key}' for key in path)}: {text}")
    return found


def section_of(about: Mapping[str, Any], fitted: Fit, quantities: Sequence[Quantity]) -> dict[str, Any]:
    """Return the section that describes a calibrated material."""
    count = len(fitted.start.parameters)
    section: dict[str, Any] = {"name": "calibrated", **_without_energy(about), "energy": fitted.start.called}
    section["parameters"] = {one.name: _ranged(one.value, one.low, one.high) for one in quantities[:count]}
    pairs = zip(quantities[count::2], quantities[count + 1 :: 2], strict=True)
    section["branches"] = [
        {
            key: _ranged(*np.clip([one.value, one.low, one.high], *_BRANCH[key]))
            for key, one in zip(_BRANCH, pair, strict=True)
        }
        for pair in pairs
    ]
    return section


def _ranged(value: float, low: float, high: float) -> dict[str, float]:
    value, low, high = (float(f"{number:.7g}") for number in (value, low, high))
    if low == high:  # a parameter at an end of its range
        return {"value": value, "low": min(low, low * (1 - 1e-6)), "high": max(high, high * (1 + 1e-6))}
    return {"value": value, "low": low, "high": high}


def toml_of(section: Mapping[str, Any], head: Iterable[str]) -> str:
    """Return the text of a file with a section; `head` contains lines of comment."""
    return "\n".join([*(f"# {line}" if line else "#" for line in head), *_lines("material", section), ""])


def _lines(name: str, table: Mapping[str, Any]) -> Iterator[str]:
    """Return the lines of a table: its values first, then its inner tables."""
    yield f"[{name}]"
    later = {key: value for key, value in table.items() if key in ("parameters", "breakdown", "branches")}
    for key, value in table.items():
        if key not in later:
            yield f"{key} = {_value(value)}"
    for key, value in later.items():
        if isinstance(value, Mapping):
            yield ""
            yield f"[{name}.{key}]"
            yield from (f"{one} = {_value(number)}" for one, number in value.items())
        for branch in value if isinstance(value, list) else ():
            yield ""
            yield f"[[{name}.{key}]]"
            yield from (f"{one} = {_value(number)}" for one, number in branch.items())
    if not table.get("branches", True):
        yield ""
        yield "# no branches"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, str):
        escaped = "".join(c if c.isprintable() and c not in '"\\' else f"\\u{ord(c):04x}" for c in value)
        return f'"{escaped}"'
    return repr(float(value)) if not isinstance(value, bool) else str(value).lower()

"""The section [material] of a rig file: a published material, possibly changed, or an energy with its parameters."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import Any

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.laws.breakdown import BreakdownLaw
from deatwin.plant.laws.energies import ENERGIES, ogden
from deatwin.plant.laws.formula import Formula
from deatwin.plant.material import MATERIALS, material
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.published import STIFFEST, UNKNOWN
from deatwin.plant.rigs.rigkeys import NumberKey, kind_of
from deatwin.plant.safe_read import clipped
from deatwin.plant.substance import Branch, Material, Symbol, energy_named

SPREAD = 5.0
"""Ratio of a value given without a range to the ends of its range; published sets of one elastomer differ by less."""
LIMITS = ("stretch_limit", "locking_stretch")
_VALUE = "a number, or { value = 330e3, low = 250e3, high = 500e3 }"
KEYS = ("name", "energy", "parameters", "branches", "permittivity", "breakdown", "density_kg_m3")
_MODULUS = NumberKey(
    field="modulus", lower=1.0, upper=1e9, usual=(500.0, 1e9), slips=(("in MPa", 1e6, 0.0), ("in kPa", 1e3, 0.0))
)
_BRANCH = {"modulus_Pa": _MODULUS, "time_s": NumberKey(field="time", lower=1e-4, upper=1e7)}
_PERMITTIVITY = NumberKey(field="permittivity", lower=1.0, upper=1e6, usual=(1.0, 150.0))
_DENSITY = NumberKey(field="density", lower=1e-3, upper=1e6, usual=(200.0, 8000.0), slips=(("in g/cm³", 1e3, 0.0),))
_BREAKDOWN = {
    "field_MV_m": NumberKey(field="field", lower=0.1, upper=1e4, per_si=1e-6),
    "thickness_um": NumberKey(field="thickness", lower=0.01, upper=1e5, per_si=1e6, required=False),
    "thickness_power": NumberKey(field="thickness_power", lower=-2.0, upper=2.0, required=False),
    "stretch_power": NumberKey(field="stretch_power", lower=-5.0, upper=5.0, required=False),
}
_NUMBER = {"type": "number"}
_RANGED: dict[str, Any] = {
    "anyOf": [
        _NUMBER,
        {
            "type": "object",
            "additionalProperties": False,
            "required": ["value"],
            "properties": {"value": _NUMBER, "low": _NUMBER, "high": _NUMBER},
        },
    ]
}
MATERIAL_SCHEMA: dict[str, Any] = {
    "description": "A published material by its name, or a name of one's own with an energy and its parameters, Pa. "
    "What else is said replaces what was published.",
    "type": "object",
    "additionalProperties": False,
    "properties": {
        "name": {"type": "string"},
        "energy": {"type": "string"},
        "parameters": {"type": "object", "additionalProperties": _RANGED},
        "branches": {
            "type": "array",
            "items": {
                "type": "object",
                "additionalProperties": False,
                "required": list(_BRANCH),
                "properties": dict.fromkeys(_BRANCH, _RANGED),
            },
        },
        "permittivity": _RANGED,
        "breakdown": {
            "type": "object",
            "additionalProperties": False,
            "required": ["field_MV_m"],
            "properties": {
                n: {"type": "number", "minimum": k.lower, "maximum": k.upper} for n, k in _BREAKDOWN.items()
            },
        },
        "density_kg_m3": {"type": "number", "exclusiveMinimum": 0},
    },
}


@dataclass
class _Reader:
    """A section being read, with the mistakes found so far: for each the path of keys and a description."""

    section: Mapping[str, Any]
    mistakes: list[tuple[tuple[str, ...], str]] = field(default_factory=list)

    def told(self, path: tuple[str, ...], text: str) -> None:
        self.mistakes.append((path, text))

    def unknown(self, given: Iterable[str], known: Collection[str], *path: str) -> None:
        """Note each unknown key, with the nearest known one, else all of them."""
        for name in given:
            if name not in known:
                hint = nearest(name[:100], known) or f"; known are {', '.join(known)}"
                self.told((*path, name), f'unknown key "{clipped(name)}"{hint}')

    def table(self, name: str) -> Mapping[str, Any] | None:
        """Return a table of the section; None if it is missing or is no table."""
        value = self.section.get(name)
        if value is None or isinstance(value, Mapping):
            return value
        self.told((name,), f"{name} is {kind_of(value)}; it must be a table [material.{name}]")
        return None

    def parameter(self, path: tuple[str, ...], given: object, name: str, unit: str) -> Parameter | None:
        """Read a parameter given as a number or with its range."""
        numbers: dict[str, Any] = dict(given) if isinstance(given, Mapping) else {"value": given}
        unknown = [key for key in numbers if key not in ("value", "low", "high")]
        wrong = [
            v for v in numbers.values() if isinstance(v, bool) or not isinstance(v, int | float) or not isfinite(v)
        ]
        if "value" not in numbers or unknown or wrong:
            self.told(path, f"{clipped(str(given), 40)} is {kind_of(given)}; it must be {_VALUE}")
            return None
        value = float(numbers["value"])
        if value == 0.0 and not {"low", "high"} <= set(numbers):
            self.told(path, "0 has no range of its own; write { value = 0.0, low = -1e3, high = 1e3 }")
            return None
        if name == "permittivity" and value < 1.0:
            self.told(path, f"{value:g} is below 1, the permittivity of a vacuum")
            return None
        least, most = _usual(name, value, unit)
        low, high = float(numbers.get("low", min(least, value))), float(numbers.get("high", max(most, value)))
        if low > high:
            self.told(path, f"low = {low:g} exceeds high = {high:g}")
            return None
        if not low <= value <= high or low == high:
            self.told(path, f"{value:g} does not lie in its range from {low:g} to {high:g}")
            return None
        positive = low > 0.0
        scale = Scale.LINEAR if not positive else Scale.RECIPROCAL if name in LIMITS else Scale.LOGARITHMIC
        widest = STIFFEST if positive and unit == "Pa" and high < STIFFEST else None
        return Parameter(
            name=name, value=value, unit=unit, lower=low, upper=high, scale=scale, source="rig file", widest=widest
        )

    def text(self, name: str) -> str:
        value = self.section.get(name, "")
        if not isinstance(value, str) or (name in self.section and not value.strip()):
            self.told((name,), f"{clipped(str(value), 40)} is {kind_of(value)}; it must be text in quotes")
            return ""
        return value


def _usual(name: str, value: float, unit: str) -> tuple[float, float]:
    """Return a range for a value given without one."""
    if name in LIMITS:
        return value / 2.0, 1e4
    if name == "permittivity":  # elastomers of one kind differ by less; a vacuum has 1
        return max(1.0, value / 2.0), 2.0 * value
    if unit == "1" and name.startswith("alpha"):
        return min(value / 2.0, value * 2.0), max(value / 2.0, value * 2.0)
    return (value / SPREAD, value * SPREAD) if value > 0.0 else (value * SPREAD, value / SPREAD)


def read_material(section: object) -> tuple[Material | None, list[tuple[tuple[str, ...], str]]]:
    """Return the material of a section and its mistakes; the material is None if there are any."""
    if not isinstance(section, Mapping):
        return None, [((), f"material is {kind_of(section)}; it must be a section [material]")]
    reader = _Reader(section)
    reader.unknown(section, KEYS)
    found = _base(reader)
    base = found[0] if found else UNKNOWN[next(iter(UNKNOWN))]  # so that the other entries are checked, too
    changed: dict[str, Any] = {"elastic": tuple(_elastic(reader, *found)), "energy": found[1]} if found else {}
    changed["name"] = section.get("name") or ("of the rig file" if "energy" in section else base.name)
    if "branches" in section:
        changed["branches"] = tuple(_branches(reader))
    if "permittivity" in section:
        given = reader.parameter(("permittivity",), section["permittivity"], "permittivity", "1")
        changed["permittivity"] = given
    if (law := reader.table("breakdown")) is not None:
        changed["breakdown"] = _breakdown(reader, law)
    if "density_kg_m3" in section:
        given = reader.parameter(("density_kg_m3",), section["density_kg_m3"], "density", "kg/m^3")
        changed["density"] = given.value if given is not None else 0.0
        if not changed["density"] > 0.0:
            reader.told(("density_kg_m3",), "a density must be above 0")
    return (None if reader.mistakes else replace(base, **changed)), reader.mistakes


def material_remarks(section: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the path of each value of a section without mistakes that hardly any elastomer has, and a description."""
    found, _ = read_material(section)
    if found is None:
        return
    stated: list[tuple[tuple[str, ...], NumberKey, float]] = []
    if "parameters" in section:  # the coefficients of higher orders may be small
        stiffest = max((p for p in found.elastic if p.unit == "Pa"), key=lambda p: abs(p.value), default=None)
        stated += [(("parameters", stiffest.name), _MODULUS, stiffest.value)] if stiffest else []
    if "branches" in section:
        stated += [(("branches",), _MODULUS, branch.modulus.value) for branch in found.branches]
    if "permittivity" in section:
        stated.append((("permittivity",), _PERMITTIVITY, found.permittivity.value))
    if "density_kg_m3" in section:
        stated.append((("density_kg_m3",), _DENSITY, found.density))
    for path, key, value in stated:
        if text := key.remark(value):
            yield path, text


def _base(reader: _Reader) -> tuple[Material, Callable[..., Symbol]] | None:
    """Return the published material with the section's name, or an unknown one, and the energy."""
    name, energy = reader.text("name"), reader.text("energy")
    if any(key in reader.section and not text for key, text in (("name", name), ("energy", energy))):
        return None  # told already
    if name in MATERIALS and not energy:
        return MATERIALS[name], MATERIALS[name].energy
    if not energy:
        known = (*MATERIALS, *ENERGIES)
        reader.told(
            ("name",) if name else (),
            f'"{clipped(name)}" is not a published material{nearest(name, known)} (known: {", ".join(MATERIALS)}); a '
            'material of your own needs its energy, as in energy = "gent"',
        )
        return None
    try:
        law = energy_named(energy)
    except RigError as error:
        reader.told(("energy",), str(error))
        return None
    return UNKNOWN[next(iter(UNKNOWN))] if isinstance(law, Formula) else material(law.__name__), law


def _elastic(reader: _Reader, base: Material, energy: Callable[..., Symbol]) -> Iterator[Parameter]:
    """Yield the elastic parameters, from the section or from the published material."""
    given = reader.table("parameters") or {}
    published = {} if "energy" in reader.section else {p.name: p for p in base.elastic}
    if isinstance(energy, Formula):
        needed = energy.names
    elif energy is ogden and not published:
        needed = tuple(name for k in range(1, 1 + max(1, len(given) // 2)) for name in (f"mu{k}", f"alpha{k}"))
    else:
        needed = tuple(p.name for p in base.elastic)
    for name in given:
        if name not in needed:
            hint = nearest(name[:100], needed) or f"; the energy has {', '.join(needed)}"
            reader.told(("parameters", name), f'unknown parameter "{clipped(name)}"{hint}')
    for name in needed:
        unit = "1" if name in LIMITS or name.startswith("alpha") else "Pa"
        if name in given:
            found = reader.parameter(("parameters", name), given[name], name, unit)
        elif name in published:
            found = published[name]
        else:
            reader.told(
                ("parameters",),
                f'the parameter "{name}" is missing; it must be {_VALUE if unit == "Pa" else "a number"}{"" if unit == "1" else f", in {unit}"}',
            )
            found = None
        if found is not None:
            yield found


def _branches(reader: _Reader) -> Iterator[Branch]:
    given = reader.section["branches"]
    if not isinstance(given, list) or not all(isinstance(entry, Mapping) for entry in given):
        reader.told(("branches",), f"branches is {kind_of(given)}; it must be tables [[material.branches]]")
        return
    for number, entry in enumerate(given, start=1):
        name = "branch" if number == 1 else f"branch_{number}"
        for key in entry:
            if key not in _BRANCH:
                reader.told(
                    ("branches",), f'unknown key "{clipped(key)}" in branch {number}; known are modulus_Pa, time_s'
                )
        parts = []
        for key, allowed in _BRANCH.items():
            what, unit = key.split("_")
            found = reader.parameter(("branches",), entry.get(key), f"{name}_{what}", unit) if key in entry else None
            if key not in entry:
                reader.told(("branches",), f'branch {number} lacks "{key}"; it must be {_VALUE}')
            elif found is not None and not allowed.lower <= found.lower <= found.upper <= allowed.upper:
                reader.told(
                    ("branches",),
                    f"{key} of branch {number} is out of range; it must be from {allowed.lower:g} to {allowed.upper:g}"
                    + allowed.slip(found.value),
                )
            parts.append(found)
        if parts[0] is not None and parts[1] is not None:
            yield Branch(name=name, modulus=parts[0], time=parts[1])


def _breakdown(reader: _Reader, law: Mapping[str, Any]) -> BreakdownLaw | None:
    reader.unknown(law, _BREAKDOWN, "breakdown")
    values = {"thickness": 1e-4, "thickness_power": 0.0, "stretch_power": 0.0}
    for name, key in _BREAKDOWN.items():
        if name not in law:
            if key.required:
                reader.told(("breakdown",), f'the key "{name}" is missing; it must be {key.allowed}')
        elif fault := key.fault(law[name]):
            reader.told(("breakdown", name), fault)
        else:
            values[key.field] = key.to_si(law[name])
    return None if "field" not in values else BreakdownLaw(**values, source="rig file")

"""All mistakes of a rig file at once: key, line if known, and what is allowed."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from deatwin.plant.errors import nearest
from deatwin.plant.readings import ELECTRICAL_UNITS
from deatwin.plant.rigs.rigkeys import RIG_KEYS, Keys, kind_of
from deatwin.plant.rigs.rigreadings import READING_KEYS, unit_fault
from deatwin.plant.safe_read import clipped

Place = tuple[str, ...]
"""A section, or a section and one of its keys; empty for the whole file."""

READINGS = "readings"
"""Section whose own sections describe further readings."""
MOST = 20
"""Number of mistakes that are listed one by one."""
_BELOW = (
    (("film", "electrode_diameter_mm"), ("film", "frame_diameter_mm")),
    (("load", "contact_diameter_mm"), ("film", "electrode_diameter_mm")),
    (("drive", "command_min_V"), ("drive", "command_max_V")),
)
"""Numbers that must be below others, since one part cannot hold the other otherwise."""

_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\\]*"|'[^']*')"""
_PATH = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[\s*({_PATH})\s*\]\s*(?:#.*)?")
_KEY = re.compile(rf"\s*({_PATH})\s*=")


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A mistake of a rig file."""

    text: str  # Mistake, and what is allowed
    at: Place = ()
    line_of: Place = ()  # Entry whose line the user should look at
    missing: Place = ()  # Missing entry, and the entry that an unknown name probably means
    meant: Place = ()

    @property
    def where(self) -> str:
        """Section and key, as error texts write them."""
        return " ".join([f"[{self.at[0]}]", *self.at[1:]]) if self.at else ""


def mistakes_of(data: Mapping[str, Any]) -> list[Mistake]:
    """Find all mistakes of a rig file."""
    outside = [_outside(name) for name in data if name not in (*RIG_KEYS, READINGS)]
    called = {section: section for section in RIG_KEYS}
    for mistake in outside:  # a section with a misspelt name is read by the name that it should have
        name = mistake.line_of[0]
        if len(mistake.meant) == 1 and mistake.meant[0] not in data and isinstance(data[name], Mapping):
            called[mistake.meant[0]] = name
    found = [
        *outside,
        *(mistake for section, name in called.items() for mistake in _inside(section, name, data.get(name))),
        *_order({section: data.get(name) for section, name in called.items()}, called),
        *_of_readings(data.get(READINGS, {})),
    ]
    meant = {mistake.meant for mistake in found if mistake.meant}
    return [mistake for mistake in found if mistake.missing not in meant]


def lines_of(text: str) -> dict[Place, int]:
    """Return the line numbers of the sections and keys of a rig file."""
    if '"""' in text or "'''" in text:
        return {}
    found: dict[Place, int] = {}
    section: Place = ()
    for number, line in enumerate(text.split("\n"), start=1):
        if header := _HEADER.fullmatch(line):
            section = _parts(header[1])
            found.setdefault(section, number)
        elif key := _KEY.match(line):
            found.setdefault((*section, *_parts(key[1])), number)
    return found


def format_errors(source: str, mistakes: Sequence[Mistake], lines: Mapping[Place, int]) -> str:
    """Write mistakes as the text of one error."""
    if len(mistakes) == 1:
        (only,) = mistakes
        return f"{source}, {only.where}: {only.text}" if only.at else f"{source}: {only.text}"
    placed = [(_line(mistake, lines), mistake) for mistake in mistakes]
    placed.sort(key=lambda pair: (pair[0] is None, pair[0]))
    parts = [
        f"({number}) {_prefix(line, mistake.where)}{mistake.text}"
        for number, (line, mistake) in enumerate(placed[:MOST], start=1)
    ]
    rest = f" and {len(placed) - MOST} more" if len(placed) > MOST else ""
    return f"{source}: {len(placed)} mistakes: {' '.join(parts)}{rest}"


def _line(mistake: Mistake, lines: Mapping[Place, int]) -> int | None:
    """Line of the key, or else of its section: the keys of an inline table stand in its line."""
    return lines.get(mistake.line_of, lines.get(mistake.line_of[:1]))


def _prefix(line: int | None, where: str) -> str:
    said = ", ".join([*([] if line is None else [f"line {line}"]), *([where] if where else [])])
    return f"{said}: " if said else ""


def _parts(path: str) -> Place:
    return tuple(part[1:-1] if part[0] in "\"'" else part for part in re.findall(_PART, path))


def _outside(name: str) -> Mistake:
    """Mistake of an unknown section, or of a key above all sections."""
    for section, keys in RIG_KEYS.items():
        if name in keys:
            return Mistake(
                text=f'the key "{name}" stands outside of the sections; it belongs into [{section}]',
                line_of=(name,),
                meant=(section, name),
            )
    known = (*RIG_KEYS, READINGS)
    hint = nearest(name[:100], known)
    return Mistake(
        text=f"unknown section [{clipped(name)}]{hint or f'; known are {_listed(known)}'}",
        line_of=(name,),
        meant=_offered(hint, RIG_KEYS),
    )


def _of_readings(sections: object) -> Iterator[Mistake]:
    """Mistakes of the sections of further readings."""
    if not isinstance(sections, Mapping):
        yield Mistake(
            text=f"{READINGS} is {kind_of(sections)}; write a section [{READINGS}.current]", line_of=(READINGS,)
        )
        return
    for name, values in sections.items():
        called = f"{READINGS}.{name}"
        if name not in ELECTRICAL_UNITS:
            hint = nearest(name[:100], ELECTRICAL_UNITS) or f"; known are {_listed(ELECTRICAL_UNITS)}"
            yield Mistake(text=f'unknown reading "{clipped(name)}"{hint}', line_of=(READINGS, name))
            continue
        unit = values.get("unit") if isinstance(values, Mapping) else None
        if fault := unit_fault(name, unit):
            yield Mistake(text=fault, at=(called, "unit"), line_of=(READINGS, name, "unit"))
        for mistake in _inside(called, called, values, READING_KEYS):
            yield replace(mistake, line_of=(READINGS, name, *mistake.line_of[1:]))


def _inside(section: str, called: str, values: object, keys: Keys | None = None) -> Iterator[Mistake]:
    """Mistakes of a section, which may have another name in the file."""
    keys = RIG_KEYS[section] if keys is None else keys
    if values is None:
        required = _listed(name for name, key in keys.items() if key.required)
        yield Mistake(text=f"the section [{section}] is missing; it must hold {required}", missing=(section,))
        return
    if not isinstance(values, Mapping):
        yield Mistake(text=f"{section} is {kind_of(values)}; it must be a section [{section}]", line_of=(section,))
        return
    yield from (_unknown(name, section, called, keys) for name in values if name not in keys)
    for name, key in keys.items():
        if name not in values and key.required:
            yield Mistake(
                text=f'the key "{name}" is missing; it must be {key.allowed}',
                at=(called,),
                line_of=(called,),
                missing=(section, name),
            )
        elif name in values and (fault := key.fault(values[name])):
            yield Mistake(text=fault, at=(called, name), line_of=(called, name))


def _unknown(name: str, section: str, called: str, keys: Keys) -> Mistake:
    """Mistake of an unknown key. It offers the key's own section, else the nearest name, else all names."""
    owners = [other for other, others in RIG_KEYS.items() if name in others]
    hint = nearest(name[:100], keys)
    right = f"; it belongs into [{owners[0]}]" if owners else hint or f"; known are {_listed(keys)}"
    meant = (owners[0], name) if owners else (section, *_offered(hint, keys))
    return Mistake(
        text=f'unknown key "{clipped(name)}"{right}',
        at=(called,),
        line_of=(called, name),
        meant=meant if len(meant) == 2 else (),
    )


def _order(sections: Mapping[str, object], called: Mapping[str, str]) -> Iterator[Mistake]:
    """Mistakes of numbers that are each right on their own."""
    for (section, name), (other, limit) in _BELOW:
        value, most = _number(sections[section], section, name), _number(sections[other], other, limit)
        if value is not None and most is not None and value >= most:
            place = (called[section], name)
            yield Mistake(
                text=f"{value:g} is out of range; it must be below {limit}, {most:g}", at=place, line_of=place
            )


def _number(values: object, section: str, name: str) -> float | None:
    value = values.get(name) if isinstance(values, Mapping) else None
    return None if value is None or RIG_KEYS[section][name].fault(value) else float(value)


def _offered(hint: str, known: Iterable[str]) -> Place:
    """The name that a hint offers."""
    return tuple(name for name in known if f'"{name}"' in hint)


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names)

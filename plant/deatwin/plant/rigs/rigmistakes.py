"""Find all mistakes of a rig file at once, each with key, line if known, and allowed values."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from deatwin.plant.errors import RigError, nearest
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.material import material
from deatwin.plant.readings import ELECTRICAL_UNITS
from deatwin.plant.rigs.rigkeys import DRIVE, HIGHEST_FILM_VOLTAGE, Keys, NumberKey, TextKey, kind_of
from deatwin.plant.rigs.rigkinds import COMMANDS, KINDS, Pair
from deatwin.plant.rigs.rigmaterial import material_remarks, read_material
from deatwin.plant.rigs.rigreadings import READING_KEYS, unit_fault
from deatwin.plant.safe_read import clipped
from deatwin.plant.supply import Supply
from deatwin.plant.words import first_of

Place = tuple[str, ...]  # A section, or a section and one of its keys; empty for the whole file

READINGS = "readings"  # Section whose own sections describe further readings
ALIKE = 0.85  # Likeness of names of one quantity: a letter or two are wrong
MOST = 20  # Number of mistakes that are listed one by one
_THINNEST_TAPE = 0.5  # mm, that of VHB 4905
_PART = r"""(?:[A-Za-z0-9_-]+|"[^"\\]*"|'[^']*')"""
_PATH = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[{{1,2}}\s*({_PATH})\s*\]{{1,2}}\s*(?:#.*)?")
_KEY = re.compile(rf"\s*({_PATH})\s*=")


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A mistake of a rig file."""

    text: str  # Description of the mistake and of what is allowed
    at: Place = ()
    line_of: Place = ()  # Entry whose line the user should look at; by default `at`
    missing: Place = ()  # Missing entry
    meant: Place = ()  # Entry that an unknown name probably means

    def __post_init__(self) -> None:
        object.__setattr__(self, "line_of", self.line_of or self.at)

    @property
    def where(self) -> str:
        """Section and key, in the form of error texts."""
        return " ".join([f"[{self.at[0]}]", *self.at[1:]]) if self.at else ""


def mistakes_of(data: Mapping[str, Any]) -> list[Mistake]:
    """Find all mistakes of a rig file."""
    key = _key_of_kind(data)
    kind, wrong = _kind(data[key] if key in data else _misplaced_kind(data))
    if key not in data and kind == "diaphragm" and (others := _kinds_with(data)):
        entry = " or ".join(f'kind = "{other}"' for other in others)
        text = f'the key "kind" is missing, and the keys are those of another kind of rig; write {entry} above all sections'
        return [Mistake(text=text)]
    table = KINDS[kind].sections
    strange = (name for name in data if name not in (*table, "kind", "material", READINGS))
    misnamed = Mistake(text=f'unknown key "{clipped(key)}"; did you mean "kind"?', line_of=(key,))
    outside = [m for name in strange for m in ([misnamed] if name == key else _outside(name, data, table))]
    called = {section: section for section in table}
    for mistake in outside:  # a section with a misspelt name is read under the name that it should have
        name = mistake.line_of[-1]
        if (
            len(mistake.meant) == len(mistake.line_of) == 1
            and mistake.meant[0] in table
            and mistake.meant[0] not in data
            and isinstance(data[name], Mapping)
        ):
            called[mistake.meant[0]] = name
    read = {section: data.get(name) for section, name in called.items() if section != "material"}
    found = [
        *wrong,
        *outside,
        *_material(data, read.get("film"), called.get("film", "film")),
        *(m for section, values in read.items() for m in _inside(section, called[section], values, table, data)),
        *_order((*KINDS[kind].below, *(p for p in COMMANDS if p[0][1] in table["drive"])), read, called, table),
        *_beyond(read.get("drive"), called.get("drive", "drive"), table["drive"]),
        *_of_supply(read.get("drive"), called.get("drive", "drive")),
        *_of_readings(data.get(READINGS, {})),
    ]
    meant = {mistake.meant for mistake in found if mistake.meant}
    return [mistake for mistake in found if mistake.missing not in meant]


def remarks_of(data: Mapping[str, Any]) -> list[Mistake]:
    """Find the values of a rig file without mistakes that such rigs hardly have."""
    sections = KINDS[data.get("kind", "diaphragm")].sections
    found = [
        Mistake(text=text, at=(section, name))
        for section, keys in sections.items()
        for name, value in data.get(section, {}).items()
        if isinstance(key := keys[name], NumberKey) and (text := key.remark(value))
    ]
    if text := _stretched_already(data.get("film", {})):
        found.append(Mistake(text=text, at=("film", "thickness_mm")))
    found += [Mistake(text=text, at=("material", *path)) for path, text in material_remarks(data.get("material", {}))]
    return found


def _stretched_already(film: Mapping[str, Any]) -> str:
    """Describe a thickness that a tape of VHB has only when it is stretched; empty for others."""
    thickness, prestretch = film.get("thickness_mm", _THINNEST_TAPE), film.get("prestretch")
    tape = prestretch is not None and str(film.get("material", "")).startswith("VHB")
    if not tape or thickness >= 0.8 * _THINNEST_TAPE:
        return ""
    before = thickness * prestretch * film.get("side_prestretch", prestretch)
    meant = f"; if that is after stretching, write {before:.2g}" if before >= 0.8 * _THINNEST_TAPE else ""
    return f"{thickness:g} is unusual; tapes of VHB are sold {_THINNEST_TAPE:g} mm thick or more{meant}"


def _key_of_kind(data: Mapping[str, Any]) -> str:
    """Return the key above the sections that names the kind of the rig, under whatever name."""
    texts = () if "kind" in data else (name for name, value in data.items() if isinstance(value, str))
    return next((name for name in texts if data[name] in KINDS or nearest(name[:100], ("kind",))), "kind")


def _misplaced_kind(data: Mapping[str, Any]) -> str:
    """Return the kind that stands in a section instead of above all; the usual one if there is none."""
    inside = (values["kind"] for values in data.values() if isinstance(values, Mapping) and "kind" in values)
    return next((kind for kind in inside if isinstance(kind, str) and kind in KINDS), "diaphragm")


def _kinds_with(data: Mapping[str, Any]) -> list[str]:
    """Return the kinds of rig that have all keys of a rig file, and lack the fewest, if the diaphragm has not."""
    sections = {name: values for name, values in data.items() if isinstance(values, Mapping)}
    written = {(name, key) for name, keys in sections.items() if name not in ("material", READINGS) for key in keys}
    lacking: dict[str, int] = {}
    for kind, rig in KINDS.items():
        known = {(name, key): about.required for name, keys in rig.sections.items() for key, about in keys.items()}
        if written <= known.keys():
            lacking[kind] = sum(known.values()) - sum(known[place] for place in written)
    return [] if "diaphragm" in lacking else [kind for kind in lacking if lacking[kind] == min(lacking.values())]


def _kind(name: object) -> tuple[str, list[Mistake]]:
    """Return the kind of the rig, or the one probably meant, and the mistake in its name."""
    if isinstance(name, str) and name in KINDS:
        return name, []
    hint = nearest(name[:100], KINDS) if isinstance(name, str) else ""
    said = f'"{clipped(name)}"' if isinstance(name, str) else kind_of(name)
    text = f"{said} is not a kind of rig{hint} (known: {', '.join(KINDS)})"
    return next(iter(_offered(hint, KINDS)), "diaphragm"), [Mistake(text=f"kind: {text}", line_of=("kind",))]


def _material(data: Mapping[str, Any], film: object, called: str) -> Iterator[Mistake]:
    """Find mistakes of the section [material], or of the key in [film] that it may replace."""
    if "material" not in data:
        name = film.get("material") if isinstance(film, Mapping) else None
        if isinstance(name, str) and name.strip():  # other values are told as those of a key
            try:
                material(name)
            except RigError as error:
                yield Mistake(text=str(error), at=(called, "material"))
        return
    if isinstance(film, Mapping) and "material" in film:
        yield Mistake(text="there is a section [material] too; keep one of them", at=("film", "material"))
    for path, text in read_material(data["material"])[1]:
        yield Mistake(text=text, at=("material", *path))


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
        place = _prefix(_line(only, lines), only.where)
        return f"{source}, {place}{only.text}" if place else f"{source}: {only.text}"
    placed = [(_line(mistake, lines), mistake) for mistake in mistakes]
    placed.sort(key=lambda pair: (pair[0] is None, pair[0]))
    parts = [
        f"({number}) {_prefix(line, mistake.where)}{mistake.text}"
        for number, (line, mistake) in enumerate(placed, start=1)
    ]
    return f"{source}: {len(placed)} mistakes: {first_of(parts, MOST, ' ')}"


def _line(mistake: Mistake, lines: Mapping[Place, int]) -> int | None:
    """Return the line of the key, or of the table that contains it."""
    places = (mistake.line_of[:length] for length in range(len(mistake.line_of), 0, -1))
    return next((lines[place] for place in places if place in lines), None)


def _prefix(line: int | None, where: str) -> str:
    said = ", ".join([*([] if line is None else [f"line {line}"]), *([where] if where else [])])
    return f"{said}: " if said else ""


def _parts(path: str) -> Place:
    return tuple(part[1:-1] if part[0] in "\"'" else part for part in re.findall(_PART, path))


def _outside(name: str, data: Mapping[str, Any], table: Mapping[str, Keys]) -> Iterator[Mistake]:
    """Find the mistake of an unknown section, which may hold known ones, or of a key above all sections."""
    inside = [section for section in table if isinstance(data[name], Mapping) and section in data[name]]
    for section in inside:
        yield Mistake(
            text=f"write [{section}], not [{clipped(name)}.{section}]", line_of=(name, section), meant=(section,)
        )
    if inside:
        return
    for section, keys in table.items():
        if name in keys and not isinstance(data[name], Mapping):
            yield Mistake(
                text=f'the key "{name}" stands outside the sections; it belongs in [{section}]',
                line_of=(name,),
                meant=(section, name),
            )
            return
    known = (*table, "material", READINGS)
    hint = nearest(name[:100], known)
    yield Mistake(
        text=f"unknown section [{clipped(name)}]" + (hint or f"; known are {', '.join(known)}"),
        line_of=(name,),
        meant=_offered(hint, known),
    )


def _beyond(drive: object, called: str, keys: Keys) -> Iterator[Mistake]:
    """Find commands that would put more on the film than any film takes."""
    if not isinstance(drive, Mapping):
        return
    gain = 1.0 if "input" in drive else _number(drive, keys.get("gain", DRIVE["gain"]), "gain")
    for name in ("command_min_V", "command_max_V") if "gain" in keys else ():
        volts = _number(drive, keys[name], name)
        if volts is None or gain is None or abs(volts * gain) <= HIGHEST_FILM_VOLTAGE:
            continue
        fits = abs(volts) <= HIGHEST_FILM_VOLTAGE < abs(volts * gain)
        yield Mistake(
            text=f"{volts:g} times the gain of {gain:g} is {volts * gain:g} V on the film, but no film takes more than "
            f"{HIGHEST_FILM_VOLTAGE:g} V"
            + (f"; if {volts:g} V is on the film, write {volts / gain:.6g}" if fits else ""),
            at=(called, name),
        )


def _of_supply(drive: object, called: str) -> Iterator[Mistake]:
    """Find limits of a source that are stated although the film's voltage itself was recorded."""
    if not isinstance(drive, Mapping) or "input" not in drive:
        return
    limits = {key.field for key in DRIVE.values()} & {field.name for field in fields(Supply)}
    for name in (name for name, key in DRIVE.items() if key.field in limits and name in drive):
        yield Mistake(
            text="the input of this rig is the voltage on the film, so limits of the drive do not apply; remove this key",
            at=(called, name),
        )


def _of_readings(sections: object) -> Iterator[Mistake]:
    """Find mistakes in the sections of further readings."""
    if not isinstance(sections, Mapping):
        yield Mistake(
            text=f"{READINGS} is {kind_of(sections)}; write a section [{READINGS}.current]", line_of=(READINGS,)
        )
        return
    for name, values in sections.items():
        called = f"{READINGS}.{name}"
        if name not in ELECTRICAL_UNITS:
            hint = nearest(name[:100], ELECTRICAL_UNITS) or f"; known are {', '.join(ELECTRICAL_UNITS)}"
            yield Mistake(text=f'unknown reading "{clipped(name)}"{hint}', line_of=(READINGS, name))
            continue
        unit = values.get("unit") if isinstance(values, Mapping) else None
        if fault := unit_fault(name, unit):
            yield Mistake(text=fault, at=(called, "unit"), line_of=(READINGS, name, "unit"))
        for mistake in _inside(called, called, values, {called: READING_KEYS}, {}):
            yield replace(mistake, line_of=(READINGS, name, *mistake.line_of[1:]))


def _inside(
    section: str, called: str, values: object, table: Mapping[str, Keys], data: Mapping[str, Any]
) -> Iterator[Mistake]:
    """Find mistakes of a section, which may have another name in the file."""
    keys = table[section]
    if values is None:
        required = ", ".join(name for name, key in keys.items() if key.required)
        if not required:
            return
        yield Mistake(text=f"the section [{section}] is missing; it must hold {required}", missing=(section,))
        return
    if not isinstance(values, Mapping):
        yield Mistake(text=f"{section} is {kind_of(values)}; it must be a section [{section}]", line_of=(section,))
        return
    yield from (_unknown(name, values[name], section, called, table) for name in values if name not in keys)
    for name, key in keys.items():
        replaced = key.instead in values or key.instead[1:-1] in data
        if name in values and key.instead in values:
            yield Mistake(text=f'"{key.instead}" already states this; keep one of the two keys', at=(called, name))
        if name not in values and key.required and not replaced:
            other = f"; or give {_written(key.instead, keys)} instead" if key.instead else ""
            yield Mistake(
                text=f'the key "{name}" is missing; it must be {key.allowed}{other}',
                at=(called,),
                missing=(section, name),
            )
        elif name in values and (fault := key.fault(values[name])):
            yield Mistake(text=fault, at=(called, name))


def _written(name: str, keys: Keys) -> str:
    """Return the file's value for another key."""
    key = keys.get(name)
    return f'{name} = "{key.choices[0]}"' if isinstance(key, TextKey) else name


def _unknown(name: str, value: object, section: str, called: str, table: Mapping[str, Keys]) -> Mistake:
    """Return the mistake of an unknown key, with its proper section, else the nearest name, else all names."""
    keys = table[section]
    if name in (*table, "material", READINGS) and isinstance(value, Mapping):
        text = f'"{name}" is a section of its own, not a part of [{called}]: write [{name}]'
        return Mistake(text=text, line_of=(called, name), meant=(name,))
    if name == "kind":
        text = 'the key "kind" belongs above the first section'
        return Mistake(text=text, at=(called,), line_of=(called, name))
    owners = [other for other, others in table.items() if name in others]
    hint = nearest(name[:100], keys)
    offered = _offered(hint, keys)
    unit = _in_its_unit(name, value, offered[0]) if offered else ""
    right = f"; it belongs in [{owners[0]}]" if owners else f"{hint}{unit}" or f"; known are {', '.join(keys)}"
    meant = (owners[0], name) if owners else (section, *offered)
    return Mistake(
        text=f'unknown key "{clipped(name)}"{right}',
        at=(called,),
        line_of=(called, name),
        meant=meant if len(meant) == 2 else (),
    )


def _in_its_unit(name: str, value: object, offered: str) -> str:
    """Say that the key that is offered is another quantity or has another unit, with the value in it if it is known."""
    (said, given), (other, wanted) = map(_quantity_and_unit, (name, offered))
    if not given or not wanted:
        return ""
    if not nearest(said, (other,), likeness=ALIKE):
        return f" It is another quantity, in {wanted}"
    if given == wanted:
        return ""
    said = f" Its value is in {wanted}, not in {given}"
    if isinstance(value, bool) or not isinstance(value, int | float) or UNITS[given].si != UNITS[wanted].si:
        return said
    return f"{said}: {float(UNITS[given].onto(UNITS[wanted], wanted).to_si(np.array(float(value)))):.6g}"


def _quantity_and_unit(key: str) -> tuple[str, str]:
    """Return the name of a key without its unit, and the unit: ``N/m`` of ``spring_rate_N_m``; both may be empty."""
    *said, above, below = ["", "", *key.split("_")]
    quotient = find_unit(f"{above}/{below}") if find_unit(above) and said[-1] else ""
    return ("_".join(said[2:]), quotient) if quotient else ("_".join([*said, above][2:]), find_unit(below))


def _order(
    below: Sequence[Pair], sections: Mapping[str, object], called: Mapping[str, str], table: Mapping[str, Keys]
) -> Iterator[Mistake]:
    """Find numbers that contradict each other although each is in range."""
    for (section, name), (other, limit) in below:
        value, most = (
            _number(sections[section], table[section][name], name),
            _number(sections[other], table[other][limit], limit),
        )
        if value is not None and most is not None and value >= most:
            place = (called[section], name)
            yield Mistake(text=f"{value:g} is out of range; it must be below {limit}, {most:g}", at=place)


def _number(values: object, key: NumberKey | TextKey, name: str) -> float | None:
    value = values.get(name) if isinstance(values, Mapping) else None
    return None if value is None or key.fault(value) else float(value)


def _offered(hint: str, known: Iterable[str]) -> Place:
    """Return the name that a hint suggests."""
    return tuple(name for name in known if f'"{name}"' in hint)

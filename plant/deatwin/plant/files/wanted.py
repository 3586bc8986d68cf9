"""Units that a user or plant requests for columns, instead of SI."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.formats.table import Table
from deatwin.plant.files.headers import for_name, is_misspelt, split_unit, without_unit
from deatwin.plant.files.units import UNITS, Unit, find_unit, same_kind
from deatwin.plant.files.usual import COLUMNS, usual_unit
from deatwin.plant.readoptions import ReadOptions
from deatwin.plant.safe_read import clipped

_SCALE = re.compile(r"(?:1\s*)?([^\d\s]+?)\s*(?:/|\sper\s|=\s*1?)\s*([^\d\s]+)")
_COUNTED = re.compile(
    r"(?i)(?:.*[^a-z])?(counts|lsbs?|digits|bits|codes|steps|ticks|pulses|duty(?:[ _-]?cycle)?|pwm|percent|prozent)\W*"
)
"""Name of a column of an input or output that is no voltage and no length, although it gives no unit."""


def require_known_units(table: Table, columns: Sequence[int]) -> None:
    """Refuse columns in a unit that differs from a known one by its capitals only, or that may be one of two."""
    for column in columns:
        said = table.own_unit(column)
        if column not in table.wanted and table.units[column] == "C":
            place = table.unmistakable(column)
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" is in C, which may be degrees Celsius or coulombs; '
                f'state which is meant: "{place}=degC" or "{place}=coulomb"'
            )
        if column not in table.wanted and is_misspelt(said):
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" is in "{clipped(said)}", which is not a known unit'
                f"{nearest(said, [unit for unit in UNITS if unit.lower() == said.lower()])} (capitals count)"
            )


def split_stated(table: Table, wanted: str) -> tuple[str, str]:
    """Split a column into name and unit after ``=``; a column whose own name contains such a sign takes precedence."""
    name, sign, unit = wanted.rpartition("=")
    whole = not sign or not unit.strip() or wanted in (*table.headers, *table.names)
    return (wanted, "") if whole else (name, unit.strip())


def with_stated_units(table: Table, asked: Mapping[str, str | None]) -> tuple[Table, dict[str, str | None]]:
    """Return a table with units that a user stated for input and output, such as ``"#3=mm"``."""
    bare, units = dict(asked), list(table.units)
    said = list(table.said or [""] * len(units))
    for role in ("input", "output"):
        name, unit = split_stated(table, asked.get(role) or "")
        if not unit:
            continue
        bare[role] = name
        try:
            column = table.column(name)
        except DataError:  # the later search for the column raises a better error
            continue
        known = for_name(table.names[column], find_unit(unit))
        certain = units[column] not in ("", "C", known) and known not in _scaled(units[column])
        if certain and not _may_be(units[column], known):  # C alone may mean two units
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" is in {units[column]}, but is said to be in '
                f'{clipped(unit)}; remove "={clipped(unit)}"'
            )
        units[column], said[column] = known, unit
    return replace(table, units=tuple(units), said=tuple(said)), bare


def _scaled(unit: str) -> list[str]:
    """Return the units, the larger first, of which a scale such as ``V/kV``, ``1 V = 1 kV`` or ``mm/V`` tells the size."""
    parts = _SCALE.fullmatch(unit)
    known = [find_unit(part) for part in parts.groups()] if parts else []
    if not all(known):
        return []  # a division of a screen is no unit
    return sorted(known, key=lambda name: -UNITS[name].numerator / UNITS[name].denominator)


def _may_be(count: str, angle: str) -> bool:
    """Return whether a number per time, such as 1/min, may mean turns or radians per time, or a mass its weight."""
    own, said = UNITS[count], UNITS[angle]
    size = said.numerator * own.denominator / (said.denominator * own.numerator)
    if own.si == "kg" and said.si == "N":
        return math.isclose(size, UNITS["gn"].numerator, rel_tol=1e-9)
    if not same_kind(own.si, "1/s") or said.si != "rad/s":
        return False
    counts = (2.0 * math.pi,) if count.endswith("Hz") else (1.0, 2.0 * math.pi)  # a hertz counts turns
    return any(math.isclose(size, one, rel_tol=1e-9) for one in counts)


def require_stated_unit(table: Table, column: int, wanted: str) -> None:
    """Refuse a reading without a unit where one is wanted: 27 um would be taken for 27 m."""
    if column in table.wanted or wanted in ("", "1"):
        return
    shown = split_unit(COLUMNS["displacement"])[1] if wanted == usual_unit("displacement") else wanted
    likes, name = units_like(wanted), table.names[column]
    also = f" (possible units: {', '.join(likes)})" if len(likes) > 1 else ""
    offers = ReadOptions(output_column=f"{table.unmistakable(column)}={shown}")
    raise DataError(
        f'{table.path}: the column "{table.shown(column)}" has no unit, but the model needs it in {wanted}: put the unit '
        f'in the header, as in "{header_like(name, shown)}"{also}, or state it with {offers}',
        offers,
    )


def in_units(table: Table, wanted: Mapping[int, str]) -> Table:
    """Return a table with columns in the wanted units; a column without a unit is unchanged."""
    ways = {column: way for column, unit in wanted.items() if (way := _way(table, column, unit or "1", wanted))}
    names = list(table.names)
    for column in ways:
        names[column] = without_unit(table.headers[column], wanted[column]) or names[column]
    return replace(table, names=tuple(names), wanted={**table.wanted, **ways})


def _way(table: Table, column: int, wanted: str, taken: Collection[int]) -> Unit | None:
    """Return the unit that converts a column to the wanted one; None if the column has no unit."""
    header, known = table.headers[column], table.units[column]
    said = table.said[column].strip("()[] ") if table.said else ""
    if not known:
        said = said or next((s.unit for s in table.declared.signals if s.header == header), "")
    if without_unit(header, wanted) or said == wanted:
        return Unit(wanted)
    unit, target = UNITS[known or find_unit(said)], UNITS[find_unit(wanted)]
    if unit.si and target.si and same_kind(unit.si, target.si):
        return unit.onto(target, wanted)
    if wanted == "1" and (unit.is_si or unit.si == "1"):
        return replace(unit, si=wanted)
    if not (said := known or said or table.own_unit(column)):
        if wanted != "1" and (counted := _COUNTED.fullmatch(table.names[column])):
            raise DataError(
                f'{table.path}: the column "{table.shown(column)}" seems to hold {counted[1].lower()}, but the model needs it '
                f"in {wanted}: multiply the numbers by their size in {wanted}, and name the column "
                f'"{header_like("signal", wanted)}"; if they are in {wanted} already, state it: '
                f'"{table.unmistakable(column)}={wanted}"'
            )
        return None
    raise _another_unit(table, column, said, wanted, taken)


def units_like(wanted: str) -> list[str]:
    """Return the units in which a column may be that is wanted in this one, the wanted one first.

    >>> units_like("rad/s")[:4], units_like("widgets/h")
    (['rad/s', 'rpm', 'mrad/s', 'urad/s'], ['widgets/h'])
    """
    kind = UNITS[find_unit(wanted)].si
    return [wanted, *(name for name, unit in UNITS.items() if kind and name != wanted and same_kind(unit.si, kind))]


def _another_unit(table: Table, column: int, unit: str, wanted: str, taken: Collection[int]) -> DataError:
    """Return an error for a column whose unit measures another quantity than the wanted one."""
    place = f'{table.path}: the column "{table.shown(column)}" is in {clipped(unit)}'
    name = table.names[column]
    better = header_like(name.removesuffix(unit).rstrip(" _") if name.endswith(unit) else name, wanted)
    if wanted == "1":
        return DataError(
            f"{place}, but the model needs plain numbers: compute a ratio, such as a stretch, from this column first; if the "
            f'model needs the numbers in this column as they are, name the column "{better}"'
        )
    likes = units_like(wanted)
    fault = f"{place}, but the model needs it in {wanted}"
    if meant := next((part for part in _scaled(unit) if part in likes), ""):
        state = f'"{table.unmistakable(column)}={meant}"'
        return DataError(
            f"{fault}; if that is the scale of a monitor, of which 1 stands for 1 {meant}, state it: {state}"
        )
    if len(likes) == 1:
        return DataError(f'{fault}; if the numbers in this column are in {wanted}, name the column "{better}"')
    fitting = [k for k, own in enumerate(table.units) if own in likes and k not in taken]
    example = f', such as "{table.unmistakable(fitting[0])}"' if fitting else ""
    counted = [like for like in likes if unit in UNITS and _may_be(unit, like)]
    if counted:
        ways = " or ".join(f'"{table.unmistakable(column)}={like}"' for like in counted)
        other = f"; or name a column whose unit is one of {', '.join(likes)}{example}" if fitting else ""
        return DataError(f"{fault}; state the unit that is meant: {ways}{other}")
    # Only names that differ in capitals are offered, because any other letter may change the size.
    hint = nearest(unit, (like for like in likes if like.lower() == unit.lower())) if unit not in UNITS else ""
    if hint:
        return DataError(
            f'{fault}{hint} (write one of {", ".join(likes)} after the name of the column, as in "{better}")'
        )
    wrong = "" if unit in UNITS else f'; or state the unit that is meant: "{table.unmistakable(column)}=UNIT"'
    return DataError(f"{fault}; name a column whose unit is one of {', '.join(likes)}{example}{wrong}")


def header_like(name: str, wanted: str) -> str:
    """Return a header under which a column is taken in the unit that is wanted, whatever that is.

    >>> header_like("speed (krad/s)", "rad/s")
    'speed (rad/s)'
    """
    bare = name.partition("(")[0].partition("[")[0].strip() or "signal"
    return f"{bare} ({wanted})"

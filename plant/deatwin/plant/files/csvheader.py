"""Names and units in the header lines of a CSV file."""

import re

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvcells import is_value
from deatwin.plant.files.headers import SURE, for_name, is_misspelt, split_unit, split_units
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.files.usual import COLUMNS, LIKE_TIMES
from deatwin.plant.safe_read import clipped

_UNITS_LABEL = re.compile(r"(?i)(units?|einheit(en)?|unités?)\s*:?|#+|//+")  # Before the units in their line
_FACTOR = re.compile(r"[xX×*]\s?(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)")  # Of a scale, as in x10


def names_and_units(head: list[list[str]], path: str) -> tuple[list[str], list[str], list[str]]:
    """Return headers and units from the header lines, and the line of units."""
    for cells in head[1:]:
        factors = [_FACTOR.fullmatch(cell) for cell in cells]
        wrong = next((found for found in factors if found and float(found[1]) != 1.0), None)
        if wrong and all(found for found, cell in zip(factors, cells, strict=True) if cell):
            raise DataError(
                f'{path}: the line of factors in the header has "{clipped(wrong[0])}", which is not applied; multiply the '
                "samples, or write the factor as a prefix of the unit, and remove the line"
            )
    # A line with the channels' rates, ranges or the like may follow the names and units.
    head = head[:-1] if len(head) > 1 and len(head[-2]) >= len(head[-1]) and _are_quantities(head[-1]) else head
    head = _without_remarks(head)
    if len(head) > 1 and _stand_above(head[-2], head[-1]):
        head = [*head[:-2], head[-1], head[-2]]
    only_units = len(head) > 1 and _give_units(head[-1], head[-2])
    headers = _with_names_above(_header(head[:-1] if only_units else head), head)
    names, units = (list(part) for part in zip(*split_units(headers), strict=True))
    said = ["" for _ in headers]
    if only_units:
        for k, cell in enumerate("" if _UNITS_LABEL.fullmatch(cell) else cell for cell in head[-1]):
            said[k] = "" if LIKE_TIMES.search(cell) else cell
            if units[k] and cell and units[k] not in (find_unit(cell), for_name(names[k], find_unit(cell))):
                raise DataError(
                    f'{path}, column "{clipped(headers[k])}": the name gives the unit {units[k]}, but the line of units '
                    f"gives {clipped(cell.strip('()[] '))}; correct one of them"
                )
            units[k] = units[k] or for_name(names[k], find_unit(cell))
    elif len(headers) > 1 and all(find_unit(header) or LIKE_TIMES.search(header) for header in headers):
        # The file has units instead of names, perhaps beside those of the times. Letters such as V and F may be names, too.
        if all(map(find_unit, headers)) or any(map(SURE.fullmatch, headers)):
            units = [unit or find_unit(header) for unit, header in zip(units, headers, strict=True)]
    return headers, units, said


def _without_remarks(head: list[list[str]]) -> list[list[str]]:
    """Return the header lines without those that follow names and units, such as a line with the channels' devices."""
    last = head[-1]
    if any(split_unit(cell)[1] for cell in last):
        return head
    for k in range(len(head) - 2, 0, -1):
        names = head[k - 1]
        numbered = all(cell[-1:].isdigit() for cell in names)  # channels, whose names come below
        distinct = len(names) == len(set(names)) == len(head[k]) >= len(last)
        timed = any(map(LIKE_TIMES.search, names)) or not any(map(LIKE_TIMES.search, last))
        if _give_units(head[k], names) and distinct and timed and not numbered:
            return head[: k + 1]
    return head


def _header(head: list[list[str]]) -> list[str]:
    """Return the last header line, or the one above if only that names all columns, or only that gives units."""
    last, above = head[-1], head[-2] if len(head) > 1 else []
    named = len(above) == len(last) == len(set(above)) and all(above) and not any(map(is_value, above))
    known = any(split_unit(cell)[1] or cell in COLUMNS for cell in last)  # if so, the line above is a title
    better = not all(last) or all(split_unit(cell)[1] for cell in above)
    return above if named and better and not known else last


def _with_names_above(headers: list[str], head: list[list[str]]) -> list[str]:
    """Return headers with the names of cells that stretch over two lines, and of times whose unit stands below their name.

    >>> _with_names_above(["", "U (V)"], [["Time (s)", "Drive"], ["", "U (V)"]])
    ['Time (s)', 'U (V)']
    >>> _with_names_above(["s", "U_V"], [["Time", "Drive"], ["s", "U_V"]])
    ['Time (s)', 'U_V']
    """
    above = next((head[k - 1] for k in range(1, len(head)) if head[k] == headers), [])
    if sum(map(bool, above)) < 2 or any(map(is_value, above)):
        return headers
    pairs = [(header, above[k] if k < len(above) else "") for k, header in enumerate(headers)]
    timed = [LIKE_TIMES.search(name) and UNITS[find_unit(header)].si == "s" for header, name in pairs]
    return [f"{name} ({header})" if said else header or name for (header, name), said in zip(pairs, timed, strict=True)]


def are_units(cells: list[str]) -> bool:
    """Return whether a line contains units: at least one known, others in brackets, after a slash, or a dash."""
    filled = [cell for cell in cells if cell and not _UNITS_LABEL.fullmatch(cell)]
    known = [cell for cell in filled if find_unit(cell)]
    return bool(known) and all(
        cell in known
        or is_misspelt(cell)
        or cell in ("-", "%", "1")
        or re.fullmatch(r"\(.*\)|\[.*\]|\S*[/%°]\S*|[-+\d.,/^eE]*\d ?\D+", cell)
        for cell in filled
    )


def _give_units(cells: list[str], names: list[str]) -> bool:
    """Return whether a line below names contains their units, perhaps among words such as ``No.`` or ``status``."""
    return len(cells) <= len(names) and (are_units(cells) or _are_mostly_units(cells, names))


def _are_mostly_units(cells: list[str], names: list[str]) -> bool:
    """Return whether a line below names contains units, and further words.

    Letters such as s, F and V may be names, too, but those differ from each other.
    """
    known = [k for k, cell in enumerate(cells) if find_unit(cell)]
    units, others = [cells[k] for k in known], [cell for cell in cells if not find_unit(cell)]
    certain = (
        max(map(len, units), default=0) > 1 or len(set(units)) < len(units) or not re.search(r"\w", "".join(others))
    )
    return (
        len(known) > 1
        and certain
        and len(set(filter(None, names))) == sum(map(bool, names))
        and all(names[k] == cells[k] or (names[k] and not find_unit(names[k])) for k in known)
        and not any(split_unit(cell)[1] or cell in COLUMNS for cell in others)
    )


def _stand_above(units: list[str], names: list[str]) -> bool:
    """Return whether units stand above the names instead of below them."""
    several = sum(map(bool, map(find_unit, units))) > 1 and len(units) <= len(names)
    named = all(name for name, unit in zip(names, units, strict=False) if unit)  # the number of a row may have no name
    return several and are_units(units) and named and not any(map(find_unit, names))


def _are_quantities(cells: list[str]) -> bool:
    """Return whether a line contains numbers with units, such as ``200 Hz``."""
    parts = [re.fullmatch(r"([-+±\d.,eE]*\d)\s*([^\d\s].*)", cell) for cell in cells if cell]
    return bool(parts) and all(part and is_value(part[1].lstrip("±")) and find_unit(part[2]) for part in parts)

"""The text of a CSV file: its encoding, its delimiter, and where the header ends.

Nothing is guessed where two readings are possible: a delimiter counts only if the header has as many cells by it
as the samples, and it must be the only one that does.
"""

import csv
import re
from collections import Counter
from dataclasses import dataclass

from deatwin.plant.errors import DataError
from deatwin.plant.files.units import find_unit, for_name, split_unit
from deatwin.plant.intake import clipped

__all__ = ["Layout", "decode", "find_layout", "is_number", "names_and_units", "split_cells"]

_WANTED = "time_s,command_V,displacement_mm"
_DELIMITERS = {"\t": "tab", ";": "semicolon", "|": "bar", ",": "comma"}
_HEAD = 1000  # lines at most before the samples
_LIKE_SAMPLES = 3  # lines that hold numbers follow a header, where there are so many


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How the lines of a file are laid out.

    Parameters
    ----------
    delimiter : str
        Tab, semicolon, bar or comma.
    first : int
        Which of the lines is the first that holds samples.
    """

    delimiter: str
    first: int


def decode(content: bytes, path: str) -> str:
    """Return the text of a file in UTF-8, UTF-16 with its mark at the start, GBK, or Latin-1.

    Parameters
    ----------
    content : bytes
        The file.
    path : str
        Its name, for error texts.

    Returns
    -------
    str

    Raises
    ------
    DataError
        If it is not text, or damaged.
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError as error:
            raise DataError(f"{path}: UTF-16 text that breaks off at byte {error.start}; save it again") from None
    if b"\0" in content:
        raise DataError(f"{path}: not a text file; save the table as CSV in UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Chinese characters take two such bytes each; Latin-1's µ, ° and accents stand alone.
        paired = all(len(run) % 2 == 0 for run in re.findall(rb"[\x80-\xff]+", content))
        return content.decode("gbk" if paired else "latin-1", errors="replace")


def find_layout(lines: list[str], rows: list[int], path: str) -> Layout:
    """Return delimiter and end of the header.

    Parameters
    ----------
    lines : list of str
        The lines of the file that are not blank.
    rows : list of int
        Their numbers in the file.
    path : str
        The file, for error texts.

    Returns
    -------
    Layout

    Raises
    ------
    DataError
        If there are no header or no samples, no delimiter gives both as many cells, or several do.
    """
    widths = {mark: _width(lines, mark) for mark in _DELIMITERS}
    marks = [mark for mark in _DELIMITERS if widths[mark] > 1] or [","]
    starts = {mark: _first_sample(lines, mark, widths[mark]) for mark in marks}
    fitting = [mark for mark in marks if starts[mark] is not None]
    if len(fitting) > 1:
        raise DataError(
            f"{path}, row {rows[starts[fitting[0]] or 0]}: the columns may be delimited by "
            f"{' or '.join(_DELIMITERS[mark] for mark in fitting)}; use only one of them"
        )
    if not fitting:
        raise _no_layout(lines, rows, marks[0], path)
    return Layout(delimiter=fitting[0], first=starts[fitting[0]] or 0)


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without quotes and blanks around them, and without empty ones at its end.

    Parameters
    ----------
    line : str
    delimiter : str

    Returns
    -------
    list of str
    """
    try:
        cells = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]
    except csv.Error:  # a cell too long for the reader, which no number and no name is
        cells = [cell.strip() for cell in line.split(delimiter)]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with decimal point.

    Parameters
    ----------
    cell : str

    Returns
    -------
    bool
    """
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's own mark between thousands


def names_and_units(head: list[list[str]], path: str) -> tuple[list[str], list[str], list[str]]:
    """Return headers and units from the header lines, and what the line of units says.

    Parameters
    ----------
    head : list of list of str
        The cells of each line. The last line holds the names, unless it holds nothing but units: then the one
        above does.
    path : str
        The file, for error texts.

    Returns
    -------
    headers, units, said : list of str
        For each column; a unit is a key of `deatwin.plant.files.units.UNITS` or an empty text. What the line of units
        says, in its own spelling; empty where it, or its cell, is missing.

    Raises
    ------
    DataError
        If a name and the line below it say different units.
    """
    only_units = len(head) > 1 and len(head[-2]) >= len(head[-1]) and _are_units(head[-1])
    headers = head[-2] if only_units else head[-1]
    names, units = (list(part) for part in zip(*map(split_unit, headers), strict=True))
    said = ["" for _ in headers]
    if only_units:
        for k, cell in enumerate(head[-1]):
            said[k] = cell
            if units[k] and cell and units[k] not in (find_unit(cell), for_name(names[k], find_unit(cell))):
                raise DataError(
                    f'{path}, column "{clipped(headers[k])}": its name says {units[k]}, the line below '
                    f"{clipped(cell)}; correct one"
                )
            units[k] = units[k] or for_name(names[k], find_unit(cell))
    return headers, units, said


def _are_units(cells: list[str]) -> bool:
    """Return whether a line holds units: known ones, or others in brackets or as a dash, one known at least."""
    filled = [cell for cell in cells if cell]
    known = [cell for cell in filled if find_unit(cell)]
    return bool(known) and all(
        cell in known or cell in ("-", "%", "1") or re.fullmatch(r"\(.*\)|\[.*\]", cell) for cell in filled
    )


def _width(lines: list[str], delimiter: str) -> int:
    """Return how many cells most lines of the second half have, where the delimiter occurs at all."""
    counts = [
        len(split_cells(line, delimiter)) if '"' in line else line.rstrip(delimiter + " ").count(delimiter) + 1
        for line in lines
    ]
    whole, half = Counter(counts), Counter(counts[len(counts) // 2 :])
    half.pop(1, None)
    return max(half, key=lambda count: (half[count], whole[count])) if half else 1


def _first_sample(lines: list[str], delimiter: str, width: int) -> int | None:
    """Return the first line of samples: numbers, no more cells than in the line before, which has no number."""
    cells = [split_cells(line, delimiter) for line in lines[:_HEAD]]
    numeric = [_holds_number(row) for row in cells]
    for k in range(1, len(cells)):
        header = cells[k - 1]
        follow = numeric[k : k + _LIKE_SAMPLES]
        if not numeric[k - 1] and all(follow) and width <= len(header) >= len(cells[k]):
            return k
    return None


def _holds_number(cells: list[str]) -> bool:
    """Return whether a line holds a number, which no header line does; a comma may be its decimal sign."""
    return any(is_number(cell) or is_number(cell.replace(",", ".")) for cell in cells)


def _no_layout(lines: list[str], rows: list[int], delimiter: str, path: str) -> DataError:
    """Return the error of a file in which no header belongs to the samples."""
    cells = [split_cells(line, delimiter) for line in lines[:_HEAD]]
    numeric = [_holds_number(row) for row in cells]
    if not any(numeric):
        blanks = next((k for k, line in enumerate(lines[:_HEAD]) if _holds_number(line.split())), None)
        if blanks is None:
            return DataError(f"{path}: a header but no samples")
        return DataError(
            f"{path}, row {rows[blanks]}: no delimiter between the numbers; "
            f"delimit the columns by {', '.join(_DELIMITERS.values())}"
        )
    if numeric[0]:
        return DataError(
            f"{path}, row {rows[0]}: no header; the first line must name the columns, for example {_WANTED}"
        )
    width = _width(lines, delimiter)
    before = [k for k in range(1, len(cells)) if numeric[k] and not numeric[k - 1]]
    k = next((k for k in before if len(cells[k]) >= width), before[-1])
    advice = (
        "; a comma is not delimiter and decimal sign at once: delimit by semicolon or tab"
        if delimiter == "," and len(cells[k]) > len(cells[k - 1])
        else "; each column needs a name"
    )
    return DataError(
        f"{path}, row {rows[k]}: {len(cells[k])} cells by {_DELIMITERS[delimiter]}, "
        f"but the header in row {rows[k - 1]} has {len(cells[k - 1])}{advice}"
    )

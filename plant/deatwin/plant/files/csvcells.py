"""Cells of a line of CSV text: how they part, and what each of them is."""

import csv
import re

from deatwin.plant.files.dates import is_clock, is_date
from deatwin.plant.safe_read import clipped

BLANKS = " "  # Delimiter that stands for any run of blanks and tabs
NO_VALUE = frozenset("|nan|na|n/a|n.a.|null|none|-|--|---|-nan|nan(ind)|-nan(ind)|1.#qnan|-1.#ind".split("|"))
"""Marks of a missing value, in lower case: nothing, words and dashes, and C's numbers that are none."""
_ERROR = re.compile(r"##+|(?i:#N/?[ADV])|#[¡¿]?[^\W\d_a-z][^\sa-z]*[!?]")
"""Error of a spreadsheet in place of a value, in the language of the program: ``#N/A``, ``#NV``, ``#DIV/0!``, ``#WERT!``;
and ``####``, where a column was too narrow."""
COMMENT = re.compile(r"\s*(?:#+|%+|//+)[ \t]*")  # Mark before a comment, with the blanks around it


def is_comment(line: str) -> bool:
    """Return whether a line begins with ``#``, ``%`` or ``//``, and not with a cell that holds an error."""
    if not COMMENT.match(line):
        return False
    ways = [re.split(r"[,;|\t]", line.strip(), maxsplit=1), line.split(maxsplit=1)]
    if not ways[1][0].strip("#"):  # "## remark"
        ways.pop()
    return not any(len(parts) > 1 and is_error(parts[0].strip()) for parts in ways)


def is_error(cell: str) -> bool:
    """Return whether a cell holds an error of a spreadsheet.

    >>> is_error("#N/A"), is_error("#WERT!"), is_error("#1"), is_error("#remark")
    (True, True, False, False)
    """
    return _ERROR.fullmatch(cell) is not None


def split_cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without quotes and blanks around them, and without empty ones at its end."""
    quoted = '"' in line
    if delimiter == BLANKS:
        if not quoted:
            return line.split()
        line = line.strip().replace("\t", BLANKS)
    try:
        parts = (
            next(csv.reader([line], delimiter=delimiter, skipinitialspace=True)) if quoted else line.split(delimiter)
        )
    except csv.Error:  # a cell is too long for the reader, so it is neither number nor name
        parts = line.split(delimiter)
    cells = list(map(str.strip, parts))
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def formula(cell: str) -> str:
    """Return the fault of a cell that contains a formula."""
    return (
        f'"{clipped(cell)}" is a formula whose value the file does not hold; open it in a spreadsheet program, and save '
        "it there"
    )


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, with decimal point."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # which Python accepts between digits


def is_value(cell: str) -> bool:
    """Return whether a cell is a number, with decimal point or comma."""
    return is_number(cell) or is_number(cell.replace(",", "."))


def holds_number(cells: list[str]) -> bool:
    """Return whether a line contains a number, also with a decimal comma; header lines contain none."""
    return any(map(is_value, cells))


def kind_of_cell(cell: str) -> str:
    """Return the kind of a cell: empty, number, date, text, or a mixture."""
    if not cell or is_value(cell):
        return "number" if cell else ""
    if is_date(cell) or is_clock(cell):
        return "date"
    return "text" if re.search(r"[^\W\d_]", cell) and not any(map(is_value, cell.split())) else "mixture"


def advice_for(cell: str) -> str:
    """Return advice for a cell that is no number; empty if there is none."""
    if re.search(r"\d:\d\d|\d[-.hH时時]\d\d[-.mM分]\d\d|\d\d年", cell):
        return "; write a date as in 2024-05-01 12:00:00.25, and a time of day as in 12:00:00.25"
    if re.fullmatch(r"[-+]?[\d.,]*\d\s?(?:[^\W\d_]|[%‰°]).{0,5}", cell):
        return "; write only numbers in the rows, and the unit, with its prefix, in the header"
    return "" if re.search(r"\d", cell) else "; if it marks a missing value, leave the cell empty"

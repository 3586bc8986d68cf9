"""Excel workbooks (.xlsx, .xlsm), by openpyxl: the one visible sheet with samples, or ``lab.xlsx#Sheet2``, as a CSV file."""

import hashlib
import io
import re
import zipfile
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.csvtable import CsvTable, read_bytes, table_of
from deatwin.plant.files.formats.optional import reading, require
from deatwin.plant.safe_read import TEXT_BYTES, clipped, in_words

_FIRST_YEAR = 1900  # Year in which workbooks begin to count days
_LISTED = 10  # Largest number of sheets that an error lists


def split_sheet(path: str | Path) -> tuple[str, str]:
    """Split a path into the file and the sheet named after its ending; empty if none is named."""
    found = re.fullmatch(r"(.*\.xls[xm])#(.+)", str(path), re.IGNORECASE | re.DOTALL)
    return (found[1], found[2]) if found else (str(path), "")


def read_xlsx(path: str | Path) -> CsvTable:
    """Read a workbook."""
    name, wanted = split_sheet(path)
    content = read_bytes(name)
    openpyxl = require("openpyxl", f"{name}: an Excel workbook")
    with reading(name, "XLSX"):
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            if (size := sum(entry.file_size for entry in packed.infolist())) > TEXT_BYTES:
                raise DataError(f"{name}: it unpacks to {in_words(size)}; at most {in_words(TEXT_BYTES)} can be read")
        # Formulas replace missing values, because programs that only write workbooks do not compute them.
        books = [openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=only) for only in (True, False)]
        pairs = zip(*(book.worksheets for book in books), strict=True)
        sheets = {values.title: _lines(values, formulas) for values, formulas in pairs}
        seen = {sheet.title for sheet in books[0].worksheets if sheet.sheet_state == "visible"}
    filled = {title: lines for title, lines in sheets.items() if lines}
    titles = ", ".join(f'"{clipped(title)}"' for title in list(filled)[:_LISTED])
    if wanted and wanted not in filled:
        raise DataError(f'{name}: no sheet "{clipped(wanted)}" with cells{nearest(wanted, filled)}; there are {titles}')
    if wanted:
        filled = {wanted: filled[wanted]}
    hidden = [title for title in filled if title not in seen and not wanted]
    if len(hidden) < len(filled):
        filled = {title: lines for title, lines in filled.items() if title not in hidden}
    tables = {}
    for title, lines in filled.items() or [("", [])]:
        try:
            rows, texts = zip(*lines, strict=True) if lines else ((), ())
            tables[title] = table_of(texts, rows, str(path), hashlib.sha256(content).hexdigest())
        except DataError as error:  # a sheet of notes, beside the one with samples
            if len(filled) < 2 and hidden and hidden[0] not in filled:
                advice = f'a hidden sheet is read if you name it behind the file, as in "{name}#{clipped(hidden[0])}"'
                raise DataError(f"{error}; {advice}") from None
            if len(filled) < 2:
                raise
    if len(tables) == 1:
        return next(iter(tables.values()))
    longest = max(tables or filled, key=lambda title: len(filled[title]))
    raise DataError(
        f'{name}: {len(filled)} sheets hold cells, {titles}; name one behind the file, as in "{name}#{clipped(longest)}"'
    )


def _lines(values: Any, formulas: Any) -> list[tuple[int, str]]:
    """Return the non-empty rows of a sheet as text with tabs, each with its number."""
    lines = []
    for sheet in (values, formulas):
        sheet.reset_dimensions()  # the size stated in the file may be wrong, and is not needed
    in_percent: set[int] = set()  # columns with a header that contains "%"
    for row, (cells, written) in enumerate(
        zip(values.iter_rows(), formulas.iter_rows(values_only=True), strict=True), 1
    ):
        in_percent |= {k for k, cell in enumerate(cells) if isinstance(cell.value, str) and "%" in cell.value}
        known = (_shown(cell, in_percent=k in in_percent) for k, cell in enumerate(cells))
        texts = [_text(source if cell is None else cell) for cell, source in zip(known, written, strict=True)]
        if any(texts):
            lines.append((row, "\t".join(texts)))
    return lines


def _shown(cell: Any, *, in_percent: bool) -> object:
    """Return the value of a cell in the unit that a workbook shows: 50 for 0.5 shown as 50 %, and hours since the first
    midnight for a day of which it shows no year.
    """
    value = cell.value
    if in_percent and isinstance(value, int | float) and "%" in cell.number_format:
        return float(f"{100 * value:.15g}")
    of_day = isinstance(value, datetime) and value.year <= _FIRST_YEAR and "y" not in cell.number_format.lower()
    if not of_day:
        return value
    days = int(require("openpyxl.utils.datetime", "an Excel workbook").to_excel(value))
    return f"{24 * days + value.hour}:{value:%M:%S.%f}"


def _text(cell: object) -> str:
    """Write a cell as in a CSV file."""
    match cell:
        case None:
            return ""
        case bool():
            return str(cell).upper()
        case float() | int():
            return repr(cell)
        case datetime():
            return cell.isoformat(sep=" ")
        case timedelta():
            return repr(cell.total_seconds())
        case time():
            return cell.isoformat(timespec="microseconds")
    # A double quote would begin a quoted cell, which may contain tabs.
    return " ".join(str(cell).replace('"', "'").split())

"""Convert CSV text to named columns of numbers, for any encoding, delimiter and header."""

import csv
import gzip
import hashlib
import io
import re
import zipfile
import zlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.csvcells import (
    BLANKS,
    COMMENT,
    NO_VALUE,
    advice_for,
    formula,
    holds_number,
    is_comment,
    is_error,
    is_number,
    kind_of_cell,
    split_cells,
)
from deatwin.plant.files.csvheader import are_units, names_and_units
from deatwin.plant.files.csvnumbers import si_values
from deatwin.plant.files.csvtext import (
    decode,
    find_layout,
    grouped,
    lacks_cells,
    require_no_numbered_columns,
    require_no_settings,
    require_whole_numbers,
    with_name_of_rows,
    with_whole_names,
    without_index_line,
    without_label_column,
    without_labels,
)
from deatwin.plant.files.formats.description import SCHEMA, read_description
from deatwin.plant.files.formats.optional import reading
from deatwin.plant.files.formats.table import Declared, Table
from deatwin.plant.files.headers import for_name, scale_in, split_unit, split_units
from deatwin.plant.files.rates import sample_time_in
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.files.usual import COLUMNS as COLUMN_NAMES
from deatwin.plant.files.usual import LIKE_TIMES
from deatwin.plant.safe_read import COLUMNS, RECORDING_BYTES, ROWS, TEXT_BYTES, clipped, in_words, read_regular

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".jsonl", ".ndjson")  # Endings of the names of files with text
DESCRIPTION = f"# {SCHEMA} "  # Start of a line above the header that holds a description
_GZIP = b"\x1f\x8b"  # First bytes of a gzip file
_FORTRAN = re.compile(r"(\d\.\d*)[dD](?=[+-]\d\d)")  # Exponent of a double-precision number in Fortran
_APART = re.compile(
    r"(?<=\d)['’\u00a0\u2009\u202f ](?=\d{3}(?!\d))"
)  # Mark between thousands that no decimal sign can be
_SPACED = re.compile(r"[+-]?[1-9]\d{0,2}(?:(['’\u00a0\u2009\u202f ])\d{3})(?:\1\d{3})*(?:[.,]\d*)?")  # 1'234.5
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:(?:([.,])\d{3})+(?!\1)[.,]\d+|([.,])\d{3}(?:\2\d{3})+)")
"""Number whose mark between thousands is certain: 1,234.5 and 1.234.567."""
_DASH = re.compile('(?<![^\\s,;|"])\u2013(?=[\\d.,])')  # Dash in place of a minus sign
_GUARDED = re.compile(r'(?m)(^|[,;|\t])="([^"\n]*)"(?=[,;|\t]|$)')
"""Text that a program keeps from a spreadsheet's guesses."""
_SIGN_APART = re.compile(r'(?<=[,;|\t"])([-+]) +(?=[\d.])')  # Sign of a number that a logger aligns at the right
_RECEIVED = re.compile(
    r"(?m)^(\d\d:\d\d:\d\d\.\d{3}) -> (.*)"
)  # Line with the time at which Arduino's monitor received it
_UNIT_COLUMN = re.compile(r"(?i)(.*[\W_])?(units?|einheit(en)?)")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_INTEGER = re.compile(r"[+-]?(0|[1-9]\d{0,2}(\.\d{3})*)")  # Perhaps with points between thousands
_DIGITS = 3  # Number of digits in a group of thousands
_LISTED = 5  # Largest number of files that an error lists
_FEW = 1000  # Number of cells that are looked at first
_MARKS = re.compile(
    r"(?i)(?:\bno[ _-]?data|\bnull(?=\s*[.:=])|\b(?:missing|fill|invalid|bad|null)[ _-]?(?:data[ _-]?)?(?:value|code|flag|marker|mark|number))"
    r"(?:[ _-]?value)?[\s\"':=,;.]*(?:is |as |are )?[\s\"':=,;]*(?P<mark>[-+]?\d[\d.]*(?:[eE][-+]?\d+)?)\s*(?:$|[,;:\t)'\"])"
)
"""Number that a line above the samples declares to mark missing values: ``NODATA: -999.25``."""
_WHOLE = re.compile(r"(\d{1,10}|(?:.*\D)?\d?\d:\d\d:\d\d)(?:\.0*)?(\s?[AaPp]\.?[Mm]\.?)?")
"""Whole seconds: a number, a time of day or a date."""
_PARTS = (
    (re.compile(r"ms|msec|milli(s|sec|seconds?|sekunden?)?"), 3),
    (re.compile(r"[uµμ]s|usec|micro(s|sec|seconds?)?"), 6),
    (re.compile(r"ns|nsecs?|nano(s|secs?|seconds?)?"), 9),
    (re.compile(r"frac(tion)?"), 0),
)
"""Names of a column with the part of a second behind a column of whole seconds, and the digits of this part."""
_HOURS = re.compile(r"(h|hh|hours?|stunden?) (min|mm|minutes?|minuten?) (s|ss|sec|seconds?|sekunden?)")
"""Last words of the names of three columns with hours, minutes and seconds."""
_MINUTES = re.compile(r"(min|minutes?|minuten?) (s|sec|seconds?|sekunden?)")
"""Last words of the names of two columns with minutes and seconds."""
_OF_DAYS = re.compile(r"(?i)date|datum|fecha")  # Name of a column that says only the day
_OF_DAY = re.compile(r"(\d{1,2}) ([0-5]?\d) ([0-5]?\d(?:[.,]\d*)?)")
_OF_HOUR = re.compile(r"(\d{1,3}) ([0-5]?\d)(?:[.,](\d*))?")
_EMPTY = ",;|\t "  # All characters of an empty row of a spreadsheet
_RULED = re.compile(r"(?=.*(?:---|===|[-–]\s*[,;|\t]\s*[-–]))[-–=+:|,;\t ]+")
"""Line that underlines the names, or says of no column that it has a unit."""
_NO_PATHS = {
    "://": "; download it first, and give the file",
    "~": "; write the whole path in place of ~",
    "*": "; give the files one by one, in Python with pathlib.Path.glob",
}
"""Marks of what a shell or a browser knows, and what to give in its place."""
_TRUTH = {"true": 1.0, "false": 0.0}  # Numbers of the words that PLCs and spreadsheets write
_ALIKE = 3  # Number of rows that show how many digits numbers have
_PIECE = 50_000  # Number of lines that are split at a time


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvTable(Table):
    """Header and sample lines of a CSV file, before conversion."""

    lines: list[str]  # Lines that hold samples
    rows: Sequence[int]  # Number of each of these lines in the file, as an editor shows it; the first line is 1
    ended: bool = True  # False if no line break follows the last row, which may then be cut short

    def row(self, sample: int) -> int:
        """Return the row of a sample in the file, counted as in an editor."""
        return self.rows[sample]

    def texts(self, column: int) -> Iterator[str]:
        """Yield the cells of a column as text; empty for a missing cell."""
        for line in self.lines:
            row = split_cells(line, self.delimiter)
            yield row[column] if column < len(row) else ""

    def si(self, columns: Sequence[int], *, missing: Collection[int] = ()) -> NDArray[np.float64]:
        """Return columns in SI units, or in those of `wanted`, (len(columns), n), exactly rounded."""
        if (even := self._of_even_rows([column for column in columns if column not in self.scales])) is not None:
            rest = iter(even)
            read = (self._numbers(k, [*self.texts(k)]) if k in self.scales else next(rest) for k in columns)
            if len(whole := [values for values in read if values is not None]) == len(columns):
                return np.array(whole)
        rows = self._cells()
        try:
            texts = [[row[column] for row in rows] for column in columns]
        except IndexError:
            texts = self._of_short_rows(rows, columns, missing)
        plain = [k for k, column in enumerate(columns) if not self._dated(column)]
        bare = _without_thousands([texts[k] for k in plain])
        numbers = self._with_decimal_points([columns[k] for k in plain], bare)
        for k, cells in zip(plain, numbers, strict=True):
            texts[k] = cells
        values = [self._numbers(column, cells) for column, cells in zip(columns, texts, strict=True)]
        for k, column in enumerate(columns):
            if values[k] is None and column in missing:
                absent = [_is_absent(cell) for cell in texts[k]]
                cells = ["0" if gone else cell for cell, gone in zip(texts[k], absent, strict=True)]
                if (found := self._numbers(column, cells)) is not None:
                    values[k] = np.where(absent, np.nan, found)
        known = [found for found in values if found is not None]
        if len(known) < len(columns):
            raise self._bad_cell(columns, missing)
        return np.array(known)

    def without_cut_number(self, columns: Collection[int]) -> "CsvTable":
        """Return the table without its last row if that lacks some columns, or ends in them with fewer digits than others."""
        *before, last = [split_cells(line, self.delimiter) for line in self.lines[-_FEW:]]
        column, needed = len(last) - 1, max(columns, default=-1) + 1
        if len(before) > 1 and len(last) < needed <= min(map(len, before)):
            return self.without_last_row(f"has {len(last)} of {len(self.headers)} cells")
        numbers = [row[column] for row in before if column < len(row) and is_number(row[column].replace(",", "."))]
        others = list(map(_digits, numbers))
        if self.ended or column not in columns or len(others) < _ALIKE:
            return self
        if _may_be_thousands([cell.replace(",", ".") for cell in (*numbers, last[column])]):
            return self  # which is refused later
        fewest = tuple(map(min, zip(*others, strict=True)))
        whole, *parts = zip(_digits(last[column]), fewest, strict=True)
        cut = any(own < few for own, few in parts) or (not any(few for _, few in parts) and whole[0] < whole[1])
        said = f"ends with {clipped(last[column])}, which may be cut short (put a line break behind it if it is whole)"
        return self.without_last_row(said) if cut else self

    def without_last_row(self, fault: str) -> "CsvTable":
        """Return the table without its last row, which is incomplete."""
        said = f"row {self.rows[-1]} {fault}"
        return replace(self, lines=self.lines[:-1], rows=self.rows[:-1], left_out=said)

    def _of_even_rows(self, columns: Sequence[int]) -> NDArray[np.float64] | None:
        """Return columns of numbers piece by piece, which takes a third of the time and memory.

        None if anything needs a closer look: rows of different lengths, quotation marks, cells without a finite number.
        """
        count, mark = len(self.headers), self.delimiter
        separator = f"{mark}\0{mark}"  # between the rows, so that cells of even rows are count + 1 apart
        units = [self.unit(column) for column in columns]
        found = np.empty((len(columns), len(self.lines)))
        seen: set[str] = set()  # Signs in the cells, and whether a comma is certainly a decimal one
        for first in range(0, len(self.lines), _PIECE):
            text = separator.join(piece := self.lines[first : first + _PIECE])
            cells = text.split() if mark == BLANKS else text.split(mark)
            if (
                '"' in text
                or len(cells) != (count + 1) * len(piece) - 1
                or {*cells[count :: count + 1], "\0"} != {"\0"}
            ):
                return None
            commas = mark != "," and "," in text
            for k, column in enumerate(columns):
                part = cells[column :: count + 1]
                said = "\0".join(part) if commas else ""
                seen.update(sign for sign in ",." if sign in said)
                if "," in said:
                    if any("," in cell and not _THOUSANDS.fullmatch(cell.strip()) for cell in part):
                        seen.add("sure")
                    part = said.replace(",", ".").split("\0")
                if not first and _may_be_thousands(part[:_FEW]):
                    return None
                try:
                    found[k, first : first + len(piece)] = si_values(part, units[k])
                except (ValueError, ArithmeticError):
                    return None
            seen.update("." if not commas and "." in text else "")
        clear = "," not in seen or ("." not in seen and "sure" in seen)
        fits = all(map(self._fits, columns, found))
        return found if clear and fits else None

    def _of_short_rows(
        self, rows: Sequence[Sequence[str]], columns: Sequence[int], missing: Collection[int]
    ) -> list[list[str]]:
        """Return the cells of columns; short rows are filled up."""
        widest = max(map(len, rows))
        try:
            return [
                [row[k] if k < len(row) or k not in missing or k >= widest else "" for row in rows] for k in columns
            ]
        except IndexError:
            raise self._bad_cell(columns, missing) from None

    def _numbers(self, column: int, cells: list[str]) -> NDArray[np.float64] | None:
        """Return a column (n,) in SI units, dates in seconds since the first; None unless all are finite numbers."""
        scale = self.scales.get(column)
        if not scale and cells and cells[0].strip().lower() in _TRUTH:
            words = [cell.strip().lower() for cell in cells]
            return np.array([_TRUTH[word] for word in words]) if _TRUTH.keys() >= set(words) else None
        try:
            found = np.asarray(scale.seconds(cells) if scale else si_values(cells, self.unit(column)), dtype=np.float64)
        except (ValueError, TypeError, ArithmeticError):  # ArithmeticError: outside the range of Decimal
            return None
        return found if self._fits(column, found) else None

    def _fits(self, column: int, values: NDArray[np.float64]) -> bool:
        """Return whether SI values (n,) are finite, and none marks an overflow."""
        return bool(np.isfinite(values).all() and (np.abs(values) <= self.largest(column)).all())

    def _is_head(self, cell: str) -> bool:
        """Return whether a cell is one of a header: a name of this table, or a name with a unit."""
        return cell in self.headers or split_unit(cell)[1] != ""

    def _dated(self, column: int) -> bool:
        """Return whether a column holds dates or times of day."""
        return column in self.scales and self.scales[column].texts

    def _cells(self) -> list[list[str]]:
        """Return the cells of all rows: no more than the header has, and exactly as many if blanks delimit them."""
        if self.delimiter == BLANKS:
            rows = [split_cells(line, BLANKS) if '"' in line else line.split() for line in self.lines]
            for sample, row in enumerate(rows):
                if len(row) != len(self.headers):
                    raise DataError(
                        f"{self.where(sample)}: the row has {len(row)} cells separated by blanks, but there are "
                        f"{len(self.headers)} columns"
                    )
            return rows
        if any('"' in line for line in self.lines):
            try:
                rows = list(csv.reader(self.lines, delimiter=self.delimiter, skipinitialspace=True))
            except csv.Error:
                raise DataError(f"{self.path}: a quotation mark is not closed, or a cell does not end") from None
        else:
            rows = [line.split(self.delimiter) for line in self.lines]
        if len(rows) != len(self.lines):
            raise DataError(f"{self.path}: a quoted cell contains a line break; write each sample on one line")
        count = len(self.headers)
        for sample, row in enumerate(rows):
            if len(row) > count and any(cell.strip() for cell in row[count:]) and not is_comment(row[count]):
                hint = grouped(self.lines[sample], self.delimiter)
                raise DataError(f"{self.where(sample)}: the row has {len(row)} cells, but the header has {count}{hint}")
        if self.delimiter == ",":
            require_whole_numbers(self.lines, self.rows, list(map(len, rows)), count, self.path)
        return rows

    def _with_decimal_points(self, columns: Sequence[int], texts: list[list[str]]) -> list[list[str]]:
        """Return the cells with decimal points, if their commas are certainly decimal commas."""
        if not any("," in cell for cells in texts for cell in cells):
            for column, cells in zip(columns, texts, strict=True):
                self._require_no_thousands(column, cells)
            return texts
        comma = point = ""  # Places of the first cell with a comma and of the first with a point
        sure = False
        for column, cells in zip(columns, texts, strict=True):
            for sample, cell in enumerate(map(str.strip, cells)):
                if not ("," in cell or (not point and "." in cell and is_number(cell))):
                    continue
                place = f'{self.where(sample)}, column "{self.shown(column)}": "{clipped(cell)}"'
                if "," not in cell:
                    point = place
                    continue
                mark = "," if cell.rfind(".") > cell.rfind(",") or cell.count(",") > 1 else "."
                bare = cell.replace(mark, "")
                if mark in cell and is_number(bare.replace(",", ".")):
                    raise DataError(f"{place} has a thousands separator; write it as {clipped(bare)}")
                comma = comma or place
                sure = sure or not _THOUSANDS.fullmatch(cell)
        if comma and point:
            raise DataError(
                f"{comma} has a comma, but {point.removeprefix(f'{self.path}, ')} has a decimal point; use the same "
                "decimal sign in all numbers, and no thousands separators"
            )
        if not sure:
            raise DataError(
                f"{comma} may mean thousands or a decimal comma, and no number in the file shows which; "
                "write it with a decimal point"
            )
        pointed = [[cell.replace(",", ".") for cell in cells] for cells in texts]
        for column, cells in zip(columns, pointed, strict=True):
            self._require_no_thousands(column, cells)
        return pointed

    def _require_no_thousands(self, column: int, cells: list[str]) -> None:
        """Refuse a column in which 999 and 1.234 stand, and no number that shows whether the point parts thousands."""
        if not _may_be_thousands(cells[:_FEW]) or not all(map(_INTEGER.fullmatch, map(str.strip, cells))):
            return
        sample = next(k for k, cell in enumerate(cells) if "." in cell)
        written = split_cells(self.lines[sample], self.delimiter)[column]
        mark = "comma" if "," in written else "point"
        raise DataError(
            f'{self.where(sample)}, column "{self.shown(column)}": "{clipped(written)}" may mean thousands or a decimal '
            f"{mark}, and no number in the column shows which; write all numbers with as many decimals, or without the {mark}"
        )

    def _bad_cell(self, columns: Sequence[int], missing: Collection[int]) -> DataError:
        """Return the error of the first cell that is not a finite number; those of `missing` columns may be empty."""
        # A column with words of truth and numbers has words that are none.
        words = {k: {cell.strip().lower() for cell in self.texts(k)} for k in columns}
        logical = {k for k in columns if _TRUTH.keys() & words[k] and not any(map(is_number, words[k]))}
        for sample, line in enumerate(self.lines):
            row = split_cells(line, self.delimiter)
            for column in columns:
                place = f'{self.where(sample)}, column "{self.shown(column)}"'
                if column >= max(len(row), line.count(self.delimiter) + 1):
                    everywhere = all(not cell for cell in self.texts(column))
                    if everywhere or column not in missing:
                        ends = ", like all rows: remove the additional cells of the header" if everywhere else ""
                        return DataError(f"{place}: the row has {len(row)} of {len(self.headers)} cells{ends}")
                cell = row[column] if column < len(row) else ""
                if column in missing and _is_absent(cell):
                    continue
                if not cell:
                    return DataError(f"{place}: the cell is empty; it must be a number")
                if scale := self.scales.get(column):
                    if fault := scale.fault(cell):
                        return DataError(f"{place}: {fault}")
                    cell = cell.removesuffix(scale.behind).strip()
                if self._dated(column):
                    continue
                if column in logical and cell.lower() in _TRUTH:
                    continue
                if cell.startswith("="):
                    return DataError(f"{place}: {formula(cell)}")
                bare = _APART.sub("", cell)
                if bare != cell and is_number(bare.replace(",", ".")):
                    return DataError(
                        f'{place}: "{clipped(cell)}" has a thousands separator; write it as {clipped(bare)}'
                    )
                if not holds_number(row) and len(row) > 1 and any(map(self._is_head, row)):
                    return _another_header(self.where(sample))
                if not is_number(cell.replace(",", ".")):
                    return DataError(f'{place}: "{clipped(cell)}" is not a number{advice_for(cell)}')
                if not np.isfinite(number := np.array(float(cell.replace(",", ".")))):
                    return DataError(f"{place}: {clipped(cell)} is not a finite number; leave the cell empty")
                if np.abs(self.unit(column).to_si(number)) > self.largest(column):
                    return DataError(
                        f"{place}: {clipped(cell)} marks an overflow or a missing value; leave the cell empty, or give a "
                        "true value in a larger unit"
                    )
        return DataError(f"{self.path}: the samples cannot be read as numbers")


def _without_thousands(texts: list[list[str]]) -> list[list[str]]:
    """Return cells of numbers without marks between thousands, if these are certain; else as they are.

    A blank is certain only where other cells have none, since otherwise each cell may hold two numbers. What is certain
    in one column is not in another, which may have been written by another program.

    >>> _without_thousands([["999.5", "1,234.5", "12,345"], ["1'000.5"]]), _without_thousands([["1,234", "0,5"]])
    ([['999.5', '1234.5', '12345'], ['1000.5']], [['1,234', '0,5']])
    >>> _without_thousands([["999", "1 000"], ["512 498", "513 499"], ["0.123", "1.000,5"]])
    [['999', '1000'], ['512 498', '513 499'], ['0.123', '1.000,5']]
    """
    texts = list(map(_grouped_apart, texts))
    if not any("," in cell for cells in texts for cell in cells):
        return texts
    shown = [next((found for cell in cells if (found := _GROUPED.fullmatch(cell.strip()))), None) for cells in texts]
    certain = next(filter(None, shown), None)
    mark = (certain[1] or certain[2]) if certain else ""
    fits = re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{re.escape(mark)}\d{{3}})+(?:[.,]\d*)?")
    if not mark or any(mark in cell and not fits.fullmatch(cell.strip()) for cells in texts for cell in cells):
        return texts
    pairs = zip(texts, shown, strict=True)
    return [[cell.replace(mark, "") for cell in cells] if found else cells for cells, found in pairs]


def _grouped_apart(cells: list[str]) -> list[str]:
    """Return cells of a column without marks between thousands that no decimal sign can be."""
    if not any(map(_APART.search, cells)) or all(" " in cell.strip() for cell in cells):
        return cells
    return [_APART.sub("", cell) if _SPACED.fullmatch(cell.strip()) else cell for cell in cells]


def _digits(cell: str) -> tuple[int, int, int]:
    """Return how many digits a number has before and behind its decimal sign, and in its exponent."""
    mantissa, _, exponent = cell.lower().partition("e")
    whole, _, decimals = mantissa.replace(",", ".").partition(".")
    return len(whole.strip("+-")), len(decimals), len(exponent.strip("+-"))


def _may_be_thousands(cells: Sequence[str]) -> bool:
    """Return whether all points in cells may part thousands, and 999 stands among them."""
    hundreds = any("." not in cell and len(cell.strip("+- ")) == _DIGITS for cell in cells)
    return hundreds and any("." in cell for cell in cells) and all(map(_INTEGER.fullmatch, map(str.strip, cells)))


def _another_header(where: str) -> DataError:
    """Return the error of names or units below samples, which differ from those above."""
    return DataError(f"{where}: another header begins here; give each part of the file a file of its own")


def _is_absent(cell: str) -> bool:
    """Return whether a cell marks a missing value."""
    return cell.strip().lower() in NO_VALUE or is_error(cell)


def read_table(path: str | Path) -> CsvTable:
    """Read a CSV file: UTF-8, UTF-16 with its mark, GBK or Windows-1252; comma, semicolon, tab, bar or blanks."""
    content, name = read_bytes(path, TEXT_BYTES), str(path)
    if content[:2] == _GZIP or name.lower().endswith(".zip"):
        content = _unzipped(content, name)
    if (count := max(content.count(b"\n"), content.count(b"\r"))) > ROWS:
        raise DataError(f"{name}: it has {count} lines; at most {ROWS} can be read: split it, or give NetCDF or TDMS")
    text = decode(content, name)
    written = text.rstrip("\0")
    unwritten = written != text and not written.endswith(("\n", "\r"))
    text = written.replace("\r\n", "\n").replace("\r", "\n").replace("\u2212", "-")
    text = text.replace("\n\ufeff", "\n").replace("\f", "")  # the marks of joined files, and ends of printed pages
    text = _GUARDED.sub(r'\1"\2"', text) if '="' in text else text
    text = _DASH.sub("-", text) if "\u2013" in text else text
    text = _SIGN_APART.sub(r"\1", text) if "+ " in text or "- " in text else text
    lines = text.split("\n")
    if _RECEIVED.match(text):
        lines = [_RECEIVED.sub(_with_stamp, line) for line in lines]
    said = f"the file breaks off within row {len(lines)}, and zeros follow" if unwritten else ""
    lines = lines[:-1] if unwritten else lines
    digest, ended = hashlib.sha256(content).hexdigest(), unwritten or not lines[-1].strip()
    table = table_of(lines, range(1, len(lines) + 1), name, digest, ended=ended)
    return replace(table, left_out=said or table.left_out)


def _with_stamp(line: re.Match[str]) -> str:
    """Return a line with the time at which it was received as its first cell."""
    cells = line[2]
    mark = next((mark for mark in ";\t," if mark in cells), BLANKS)
    named = not holds_number(split_cells(cells, mark)) and re.search(r"[^\W\d_]", cells)
    return f"{'received' if named else line[1]}{mark}{cells}"


def _unzipped(content: bytes, path: str) -> bytes:
    """Return the text in a gzip file, or in a zip archive."""
    if content[:2] == _GZIP:
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
                text = packed.read(TEXT_BYTES + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise DataError(f"{path}: gzip cannot unpack it: {clipped(error)}; it is damaged or incomplete") from None
    else:
        with reading(path, "zip"), _only_file(content, path) as packed:
            text = packed.read(TEXT_BYTES + 1)
    if len(text) > TEXT_BYTES:
        raise DataError(f"{path}: it unpacks to more than {in_words(TEXT_BYTES)}, which is the most that can be read")
    return text


def _only_file(content: bytes, path: str) -> IO[bytes]:
    """Open the one file of a zip archive, which must be text."""
    archive = zipfile.ZipFile(io.BytesIO(content))
    files = [file.filename for file in archive.infolist() if not file.is_dir() and "__MACOSX" not in file.filename]
    if len(files) != 1 or not files[0].lower().endswith(TEXTS):
        held = ", ".join(map(clipped, files[:_LISTED])) or "no file"
        more = f" and {len(files) - _LISTED} more" if len(files) > _LISTED else ""
        raise DataError(
            f"{path}: only an archive of one text file ({', '.join(TEXTS)}) can be read, but this one holds {held}{more}; "
            "unpack it, and give the files inside it"
        )
    return archive.open(files[0])


def table_of(lines: Sequence[str], rows: Sequence[int], name: str, sha256: str, *, ended: bool = True) -> CsvTable:
    """Return the table in lines of text, of which each has its number in the file."""
    last = len(lines)
    while last and not lines[last - 1].strip(_EMPTY):
        last -= 1
    rows, lines = rows[:last], list(lines[:last])
    if not all(map(str.strip, lines)):
        kept = [k for k, line in enumerate(lines) if line.strip()]
        rows, lines = [rows[k] for k in kept], [lines[k] for k in kept]
    rows, lines = _without_empty_rows(rows, lines)
    lines = [_FORTRAN.sub(r"\1E", line) if "D" in line or "d" in line else line for line in lines]
    declared = Declared()
    if lines and lines[0].startswith(DESCRIPTION):
        declared = read_description(lines[0].removeprefix(DESCRIPTION), name)
        rows, lines = rows[1:], lines[1:]
    if not lines:
        raise DataError(f"{name}: the file is empty; it must hold a header, with the names of its columns, and samples")
    if lines[0].rstrip() == "    -1" and lines[1:] and lines[1].strip().isdecimal():
        raise DataError(
            f"{name}: this is a universal file (data set {clipped(lines[1].strip())}), which cannot be read; export columns of text"
        )
    lines, rows = with_whole_names(with_name_of_rows(lines), rows)
    lines, rows = without_label_column(*without_index_line(lines, rows), name)
    last_row = rows[-1]
    lines, rows = without_labels(lines, rows, name)
    left_out = "" if rows[-1] == last_row else f"the file breaks off within row {last_row}"
    layout = find_layout(lines, rows, name)
    if layout.head:
        headers, units, said = names_and_units(list(layout.head), name)
        names = [name for name, _ in split_units(headers)]
    else:
        first = [split_cells(line, layout.delimiter)[0] for line in lines[:_FEW]]
        if len(lines) < _FEW and all(cell in COLUMN_NAMES or split_unit(cell)[1] for cell in first):
            raise DataError(
                f'{name}, row {rows[0]}: "{clipped(first[0])}" and its samples run along the row; give each signal a column, '
                "in Python with DataFrame.T of pandas"
            )
        require_no_numbered_columns(lines[layout.first :], rows[layout.first :], layout.delimiter, name)
        places = range(1, 1 + len(split_cells(lines[layout.first], layout.delimiter)))
        headers, names = [f"#{k}" for k in places], [f"column_{k}" for k in places]
        units = said = ["" for _ in places]
    if len(headers) > COLUMNS:
        raise DataError(f"{name}: it has {len(headers)} columns; at most {COLUMNS} can be read")
    above, header = lines[: layout.first], lines[layout.first - 1]
    remarks = [*above, *filter(is_comment, lines[layout.first : layout.first + _FEW])]
    marks = tuple(float(match["mark"]) for line in remarks if (match := _MARKS.search(line)))
    rows, lines = rows[layout.first :], lines[layout.first :]
    whole = "".join(lines)  # one search of the whole text is quicker than a test of each line
    if any(mark in whole for mark in ("#", "%", "//")):
        kept = [k for k, line in enumerate(lines) if not is_comment(line)]
        for k in set(range(kept[0], kept[-1])).difference(kept) if kept else ():
            cells = split_cells(COMMENT.sub("", lines[k], count=1), layout.delimiter)
            if len(cells) == len(headers) > 1 and are_units(cells) and lines[k] not in above:
                raise _another_header(f"{name}, row {rows[k]}")
        rows, lines = [rows[k] for k in kept], [lines[k] for k in kept]
    # A logger that is started again repeats its header; without times the runs could not be told apart.
    if layout.head and header in lines and any(map(_is_time, names, units)):
        kept = [k for k, line in enumerate(lines) if line not in above]
        rows, lines = [rows[k] for k in kept], [lines[k] for k in kept]
    if not lines:
        raise DataError(f"{name}: the file has a header but no samples")
    # A remark at the end is no sample.
    while len(lines) > 1 < len(headers) and layout.delimiter not in lines[-1] and kind_of_cell(lines[-1]) == "text":
        lines, rows = lines[:-1], rows[:-1]
    require_no_settings(lines, rows, layout.delimiter, name)
    if not ended and lacks_cells(lines, layout.delimiter):
        left_out = f"row {rows[-1]} has {len(split_cells(lines[-1], layout.delimiter))} of {len(headers)} cells"
        lines, rows, ended = lines[:-1], rows[:-1], True
    for k in range(1, len(headers)):
        if _UNIT_COLUMN.fullmatch(headers[k]) and not (units[k - 1] or said[k - 1]):
            units[k - 1], said[k - 1] = _unit_of_rows(
                names[k - 1], [split_cells(line, layout.delimiter) for line in lines], k
            )
    for k in range(2, len(headers)):
        others = [j for j in range(len(headers)) if not k - 2 <= j <= k + 1 and not _OF_DAYS.fullmatch(names[j])]
        timed = any(_is_time(names[j], units[j]) for j in others)
        joined = None if timed else _with_hours(lines, layout.delimiter, k, headers)
        if joined is not None:
            lines, names[k - 2 : k + 1] = joined, ["", "", "time"]
            units[k - 2 : k + 1] = said[k - 2 : k + 1] = ["", "", ""]
    for k in range(1, len(headers)):
        timed = any(_is_time(names[j], units[j]) for j in range(len(headers)) if not k - 1 <= j <= k + 1)
        joined = None if timed or not names[k - 1] else _with_minutes(lines, layout.delimiter, k, headers)
        if joined is not None:
            lines, names[k - 1 : k + 1] = joined, ["", "time"]
            units[k - 1 : k + 1] = said[k - 1 : k + 1] = ["", ""]
    for k in range(1, len(headers)):
        timed = _is_time(names[k - 1], units[k - 1])
        joined = _with_parts_of_seconds(lines, layout.delimiter, k, headers) if timed else None
        if joined is not None:
            lines, names[k], units[k], said[k] = joined, "", "", ""
    return CsvTable(
        path=name,
        sha256=sha256,
        headers=tuple(headers),
        names=tuple(names),
        units=tuple(units),
        declared=declared,
        nameless=not layout.head,
        said=tuple(said),
        lines=lines,
        rows=rows,
        delimiter=layout.delimiter,
        marks=marks,
        scale=next((scale for line in remarks if line != header and (scale := scale_in(line))), ""),
        rate=sample_time_in(remarks, [split_cells(line, layout.delimiter) for line in above]),
        ended=ended,
        left_out=left_out,
    )


def _with_hours(lines: list[str], mark: str, column: int, headers: Sequence[str]) -> list[str] | None:
    """Return lines in which seconds have the hours and minutes from the two columns before; None if these hold no such.

    >>> _with_hours(["9,59,59.98", "10,0,0"], ",", 2, ["Hour", "Minute", "Second"])
    ['9,59,9:59:59.98', '10,0,10:00:00']
    """
    last_words = (re.split(r"[\W_]+", header.strip("()[] "))[-1] for header in headers[column - 2 : column + 1])
    if not _HOURS.fullmatch(" ".join(last_words).lower()):
        return None
    cells = [split_cells(line, mark)[column - 2 : column + 1] for line in lines]
    found = [_OF_DAY.fullmatch(" ".join(row)) for row in cells]
    times = [f"{row[1]}:{row[2]:0>2}:{'0' * (row[3][1:2] in ('', '.', ','))}{row[3]}" for row in found if row]
    return _with_cells(lines, mark, column, [row[-1] for row in cells], times) if len(times) == len(lines) else None


def _with_minutes(lines: list[str], mark: str, column: int, headers: Sequence[str]) -> list[str] | None:
    """Return lines in which seconds have the minutes from the column before, on past the hour; None if these hold no such.

    >>> _with_minutes(["59,59.98", "0,0", "0,0.02"], ",", 1, ["min", "s"])
    ['59,0:59:59.98', '0,1:00:00.0', '0,1:00:00.02']
    """
    pair = headers[column - 1 : column + 1]
    words = [re.split(r"[\W_]+", header.strip("()[] ")) for header in pair]
    # "y min" and "y s" may be a minimum and a standard deviation.
    of_times = all(len(own) == 1 or any(map(LIKE_TIMES.search, own[:-1])) for own in words)
    if not of_times or not _MINUTES.fullmatch(" ".join(own[-1] for own in words).lower()):
        return None
    cells = [split_cells(line, mark)[column - 1 : column + 1] for line in lines]
    found = [row for row in (_OF_HOUR.fullmatch(" ".join(both)) for both in cells) if row]
    if len(found) < len(lines):
        return None
    minutes = [int(row[1]) for row in found]
    hours = accumulate((after < before - 30 for before, after in pairwise(minutes)), initial=0)
    times = [
        f"{hour + minute // 60}:{minute % 60:02d}:{row[2]:0>2}.{row[3] or 0}"
        for hour, minute, row in zip(hours, minutes, found, strict=True)
    ]
    return _with_cells(lines, mark, column, [row[-1] for row in cells], times)


def _with_parts_of_seconds(lines: list[str], mark: str, column: int, headers: Sequence[str]) -> list[str] | None:
    """Return lines in which whole seconds have the part of a second from the next column; None if it holds no such part.

    The name of the part says nothing else, unlike ``loop_ms``, but that of the seconds: ``tv_sec`` and ``tv_usec``.

    >>> _with_parts_of_seconds(["7,980,a", "7,990,b", "8,0,c"], ",", 1, ["sec", "msec", "note"])
    ['7.980,980,a', '7.990,990,b', '8.000,0,c']
    """
    whole, part = (re.split(r"[\W_]+", header.strip("()[] ").lower()) for header in headers[column - 1 : column + 1])
    own = " ".join(word for word in part if word not in whole or len(part) == 1)
    digits = next((count for name, count in _PARTS if name.fullmatch(own)), -1)
    if digits < 0:
        return None
    form = re.compile(rf"(\d{{1,{digits}}})(?:[.,](\d*))?" if digits else r"0?[.,](\d+)|0")
    seconds, times, before = [], [], ("", "")
    repeats = False
    for line in lines:
        cells = split_cells(line, mark)
        found = form.fullmatch(cells[column]) if column < len(cells) else None
        told = _WHOLE.fullmatch(cells[column - 1]) if found else None
        if not found or not told:
            return None
        now = (told[0], f"{found[1].zfill(digits)}{found[2] or ''}" if digits else found[1] or "0")
        if now[0] == before[0] and now[1] <= before[1]:  # a duration, or the times of a faster clock
            return None
        repeats = repeats or now[0] == before[0]
        seconds.append(told[0])
        times.append(f"{told[1]}.{now[1]}{told[2] or ''}")
        before = now
    return _with_cells(lines, mark, column - 1, seconds, times) if repeats else None


def _with_cells(lines: list[str], mark: str, column: int, old: Sequence[str], new: Sequence[str]) -> list[str] | None:
    """Return lines with new cells in a column, and all else, quotes too, as it was; None if a line is quoted oddly.

    >>> _with_cells(['"a, b", 7 ,', 'c,"8",'], ",", 1, "78", ["7.5", "8.5"])
    ['"a, b", 7.5 ,', 'c,"8.5",']
    """
    cell, between = (
        (r'(?:"[^"]*"|[^\s"]+)', r"\s+") if mark == BLANKS else (rf'(?:\s*"[^"]*"\s*|[^{mark}"]*)', f"[{mark}]")
    )
    before = re.compile(rf"\s*(?:{cell}{between}){{{column}}}")
    found = [before.match(line) for line in lines]
    rows = [
        match[0] + line[match.end() :].replace(was, now, 1)
        for match, line, was, now in zip(found, lines, old, new, strict=True)
        if match
    ]
    return rows if len(rows) == len(lines) else None


def _is_time(name: str, unit: str) -> bool:
    """Return whether a column holds times, as its name or its unit says."""
    return LIKE_TIMES.search(name) is not None or (unit in UNITS and UNITS[unit].si == "s")


def _without_empty_rows(rows: Sequence[int], lines: list[str]) -> tuple[Sequence[int], list[str]]:
    """Return lines and their rows without the rows of empty cells, and the ruled lines, between the lines of a header.

    Below a line with numbers such a row is kept, because there it may be a sample.
    """
    kept: list[int] = []
    for k, line in enumerate(lines[:_FEW]):
        empty = not line.strip(_EMPTY) or _RULED.fullmatch(line)
        if not empty or (kept and any(holds_number(split_cells(lines[kept[-1]], mark)) for mark in _EMPTY)):
            kept.append(k)
    if len(kept) == min(_FEW, len(lines)):
        return rows, lines
    return [*(rows[k] for k in kept), *rows[_FEW:]], [*(lines[k] for k in kept), *lines[_FEW:]]


def _unit_of_rows(name: str, rows: Sequence[Sequence[str]], column: int) -> tuple[str, str]:
    """Return the unit that a column of units gives for the signal before it; an unknown one where the rows differ."""
    cells = sorted({row[column] for row in rows if column < len(row)})
    found = {for_name(name, find_unit(cell)) for cell in cells}
    if not found or "" in found:
        return "", ""
    return (found.pop(), "") if len(found) == 1 else ("", " or ".join(cells))


def read_bytes(path: str | Path, limit: int = RECORDING_BYTES) -> bytes:
    """Return the bytes of a user's file."""
    try:
        return read_regular(path, limit, lambda fault: DataError(f"{path}: {fault}"))
    except FileNotFoundError:
        folder = Path(path).parent
        ending = Path(path).suffix.lower()
        found = folder.iterdir() if folder.is_dir() else ()
        beside = [entry.name for entry in found if entry.is_file() and entry.suffix.lower() == ending]
        # Stricter than usual, because all candidates have the same ending.
        way = next((way for mark, way in _NO_PATHS.items() if mark in str(path)), "")
        raise DataError(f"{path}: no such file{nearest(Path(path).name, beside, likeness=0.8) or way}") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from None

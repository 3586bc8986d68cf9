"""Text of a CSV file to named columns of numbers, whatever its encoding, delimiter and header lines."""

import csv
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError, nearest
from deatwin.plant.units import find_unit, split_unit

_WANTED = "time_s,command_V,displacement_mm"


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvTable:
    """The header of a CSV file and its lines of samples, not yet converted.

    Parameters
    ----------
    path : str
        The file, as error texts call it.
    sha256 : str
        Hash of its bytes.
    headers : tuple of str
        The column headers as the file has them.
    names : tuple of str
        The same without units.
    units : tuple of str
        The unit of each column, a key of `deatwin.plant.units.UNITS`; an empty text where there is none.
    lines : list of str
        The lines that hold samples.
    rows : list of int
        The number of each in the file, as an editor shows it; the first line is 1.
    delimiter : str
        Comma, semicolon or tab.
    """

    path: str
    sha256: str
    headers: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    lines: list[str]
    rows: list[int]
    delimiter: str

    def where(self, sample: int) -> str:
        """Return file and row of a sample, for an error text."""
        return f"{self.path}, row {self.rows[sample]}"

    def column(self, wanted: str) -> int:
        """Return the number of a column, counted from 0.

        Parameters
        ----------
        wanted : str
            The header, with or without its unit, or the place: ``"#2"`` is the second column.

        Returns
        -------
        int

        Raises
        ------
        DataError
            If there is none, or more than one.
        """
        if re.fullmatch(r"#[1-9]\d*", wanted) and wanted not in self.headers:
            if int(wanted[1:]) > len(self.headers):
                raise DataError(f"{self.path}: no column {wanted}; the file has {len(self.headers)} columns")
            return int(wanted[1:]) - 1
        found = [k for k, header in enumerate(self.headers) if header == wanted]
        found = found or [k for k, name in enumerate(self.names) if name == wanted]
        if not found:
            raise DataError(
                f'{self.path}: no column "{wanted}"; the file has {self.listing()}'
                f"{nearest(wanted, self.headers)}"
            )
        if len(found) > 1:
            raise DataError(
                f'{self.path}: the column "{wanted}" stands {len(found)} times; name one by its place, '
                f"for example #{found[0] + 1}"
            )
        return found[0]

    def listing(self) -> str:
        """Return the headers as one text."""
        return ", ".join(f'"{header}"' for header in self.headers)

    def numbers(self, columns: list[int]) -> NDArray[np.float64]:
        """Return columns as numbers in the units of the file.

        Parameters
        ----------
        columns : list of int
            Their numbers, counted from 0.

        Returns
        -------
        (len(columns), n) array

        Raises
        ------
        DataError
            If a cell of them is missing, empty, text, or not finite; the text names row and column.
        """
        try:
            values = np.loadtxt(
                self.lines, delimiter=self.delimiter, usecols=columns, quotechar='"', comments=None, ndmin=2
            )
        except ValueError:
            values = np.full((1, 1), np.nan)
        if not np.isfinite(values).all():
            raise self._bad_cell(columns)
        return np.ascontiguousarray(values.T, dtype=np.float64)

    def _bad_cell(self, columns: list[int]) -> DataError:
        """Return the error of the first cell that is not a finite number."""
        for sample, line in enumerate(self.lines):
            row = _cells(line, self.delimiter)
            for column in columns:
                place = f'{self.where(sample)}, column "{self.headers[column]}"'
                if column >= len(row):
                    return DataError(f"{place}: the row has {len(row)} cells, the header {len(self.headers)}")
                if not row[column]:
                    return DataError(f"{place}: the cell is empty; it must be a number")
                if not _is_number(row[column]):
                    return DataError(f'{place}: "{row[column]}" is not a number')
                if not np.isfinite(float(row[column])):
                    return DataError(f"{place}: {row[column]} is not a finite number")
        return DataError(f"{self.path}: the samples cannot be read as numbers")


def read_table(path: str | Path) -> CsvTable:
    """Read a CSV file.

    The encoding may be UTF-8, UTF-16 with its mark at the start, GBK, or Latin-1; the delimiter comma,
    semicolon or tab (with the last two also a decimal comma); cells may be quoted. Blank lines are passed
    over. Of several header lines the last holds the names, unless it holds nothing but units: then the one
    above does.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    CsvTable

    Raises
    ------
    DataError
        If the file is missing, empty, not text, or without header or samples.
    """
    content = read_bytes(path)
    filled = [(row, line) for row, line in enumerate(_decode(content, path).splitlines(), 1) if line.strip()]
    if not filled:
        raise DataError(f"{path}: the file is empty; it must hold a header ({_WANTED}) and samples")
    delimiter = _delimiter(filled[min(len(filled), 20) - 1][1])
    n_head = next((k for k, (_, line) in enumerate(filled) if _holds_samples(line, delimiter)), len(filled))
    head = [_cells(line, delimiter) for _, line in filled[:n_head]]
    if not head:
        raise DataError(
            f"{path}, row {filled[0][0]}: no header; "
            f"the first line must name the columns, for example {_WANTED}"
        )
    if n_head == len(filled):
        raise DataError(f"{path}: a header but no samples")
    headers, units = _names_and_units(head)
    lines = [line for _, line in filled[n_head:]]
    if delimiter != "," and "," in lines[0]:
        lines = [line.replace(",", ".") for line in lines]
    return CsvTable(
        path=str(path),
        sha256=hashlib.sha256(content).hexdigest(),
        headers=tuple(headers),
        names=tuple(split_unit(header)[0] for header in headers),
        units=tuple(units),
        lines=lines,
        rows=[row for row, _ in filled[n_head:]],
        delimiter=delimiter,
    )


def read_bytes(path: str | Path) -> bytes:
    """Return the bytes of a file of the user.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    bytes

    Raises
    ------
    DataError
        If there is no such file, or it cannot be read.
    """
    try:
        return Path(path).read_bytes()
    except FileNotFoundError:
        folder = Path(path).parent
        beside = [entry.name for entry in folder.iterdir()] if folder.is_dir() else []
        raise DataError(f"{path}: no such file{nearest(Path(path).name, beside)}") from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from None


def _decode(content: bytes, path: str | Path) -> str:
    """Return the text of a file; see `read_table` for the encodings."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content:
        raise DataError(f"{path}: not a text file; save the table as CSV")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Chinese characters take two such bytes each; Latin-1's µ, ° and accents stand alone.
        paired = all(len(run) % 2 == 0 for run in re.findall(rb"[\x80-\xff]+", content))
        return content.decode("gbk" if paired else "latin-1", errors="replace")


def _delimiter(line: str) -> str:
    """Return the delimiter of a line of samples; a comma may also be its decimal sign."""
    return next((mark for mark in ("\t", ";") if mark in line), ",")


def _cells(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without quotes and blanks around them."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _holds_samples(line: str, delimiter: str) -> bool:
    """Return whether a line holds a number, which no header line does."""
    comma = "," if delimiter == "," else "."
    return any(_is_number(cell.replace(",", comma)) for cell in _cells(line, delimiter))


def _names_and_units(head: list[list[str]]) -> tuple[list[str], list[str]]:
    """Return headers and units from the header lines; a trailing delimiter names no column."""
    only_units = len(head) > 1 and all(find_unit(cell) for cell in head[-1] if cell)
    headers = head[-2] if only_units else head[-1]
    while len(headers) > 1 and not headers[-1]:
        headers = headers[:-1]
    units = [split_unit(header)[1] for header in headers]
    if only_units:
        below = [find_unit(cell) for cell in head[-1]]
        units = [unit or (below[k] if k < len(below) else "") for k, unit in enumerate(units)]
    return headers, units

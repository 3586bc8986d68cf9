"""LabVIEW measurement files (.lvm), which are text (NI, "Specification for the LabVIEW Measurement File", versions 1,
2).

A file header gives separator and decimal sign; each segment has a header with units, date of the first sample, ``X0``
and ``Delta_X``, and a line of names. ``X_Columns`` says if x values are left out (``No``), stand in the first column
(``One``) or before each channel (``Multi``). Where they begin again, the dates of segments tell how far they are apart.
"""

import hashlib
import math
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvcells import is_number, split_cells
from deatwin.plant.files.csvtable import CsvTable, read_bytes, read_table
from deatwin.plant.files.csvtext import decode, lacks_cells
from deatwin.plant.files.dates import moment
from deatwin.plant.files.formats.table import Declared, Timing
from deatwin.plant.files.headers import for_name, split_unit
from deatwin.plant.files.times import BEGAN
from deatwin.plant.files.units import find_unit
from deatwin.plant.safe_read import COLUMNS, ROWS, TEXT_BYTES, clipped

_MAGIC, _END = "LabVIEW Measurement", "***End_of_Header***"
_SPECIAL, _SPECIAL_END = "***Start_Special***", "***End_Special***"
_ABSOLUTE = 1e9  # Size above which x values are absolute times, s since 1904
_UNDATED = 1904  # Year that LabVIEW writes for no date
_SEPARATORS = {"Tab": "\t", "Comma": ","}


@dataclass(frozen=True, kw_only=True)
class _Segment:
    """A segment: header by tag, line of names, and samples with their rows in the file."""

    header: dict[str, list[str]]
    names: list[str]
    rows: list[int]
    lines: list[str]

    def number(self, tag: str, column: int) -> float | None:
        """Return a number from the header; None if it is missing."""
        cells = self.header.get(tag, [])
        cell = cells[column] if column < len(cells) else ""
        return value if math.isfinite(value := _number(cell)) else None


def read_lvm(path: str | Path) -> CsvTable:
    """Read a LabVIEW measurement file."""
    content, name = read_bytes(path, TEXT_BYTES), str(path)
    if (count := content.count(b"\n")) > ROWS:
        raise DataError(f"{name}: it has {count} lines; at most {ROWS} can be read: split it, or give NetCDF or TDMS")
    text = decode(content, name)
    text = text.removesuffix("\0")
    lines = text.splitlines()
    if not lines or not lines[0].startswith(_MAGIC):  # LabVIEW also writes the numbers alone
        return read_table(path)
    separator, about = _file_header(lines, name)
    segments = _segments(lines, separator, about, name)
    first = segments[0]
    if other := next((segment for segment in segments if segment.names != first.names), None):
        raise DataError(
            f"{name}, row {other.rows[0]}: the channels differ from those of the first segment; save each segment in its own file"
        )
    kind = next((cell for cell in first.header.get("X_Dimension", []) if cell and cell != "Time"), "")
    if kind:
        raise DataError(f'{name}: its x values are "{clipped(kind)}", but a recording needs times')
    unit = next((cell for cell in first.header.get("X_Unit_Label", []) if cell and find_unit(cell) != "s"), "")
    if unit:
        raise DataError(f'{name}: its x values are in "{clipped(unit)}"; save them in seconds')
    for segment in segments:
        _require_one_start(segment, name)
    table = _table(segments, separator, about.get("X_Columns", "One"), name, hashlib.sha256(content).hexdigest())
    ended = text.endswith("\n")
    if ended or not lacks_cells(table.lines, separator):
        return replace(table, ended=ended)
    return table.without_last_row(f"has {len(split_cells(table.lines[-1], separator))} of {len(table.headers)} cells")


def _file_header(lines: list[str], path: str) -> tuple[str, dict[str, str]]:
    """Return the separator of a file and its header by tag."""
    said = next((line for line in lines if line.startswith("Separator")), "Separator\tTab")
    name = said[len("Separator") + 1 :].strip("\t, ")
    if name not in _SEPARATORS:
        raise DataError(f'{path}: its separator is "{clipped(name)}"; known are {", ".join(_SEPARATORS)}')
    separator, about = _SEPARATORS[name], {}
    for line in lines:
        if line.startswith(_END):
            break
        tag, _, value = line.partition(separator)
        about[tag] = value.strip(separator + " ")
    return separator, about


def _segments(lines: list[str], separator: str, about: dict[str, str], path: str) -> list[_Segment]:
    """Return the segments of a file."""
    comma = about.get("Decimal_Separator") == "," and separator != ","
    segments: list[_Segment] = []
    header: dict[str, list[str]] = {}
    state, special = "file", False
    for row, line in enumerate(lines, 1):
        tag = line.partition(separator)[0].strip()
        if tag in (_SPECIAL, _SPECIAL_END):
            special = tag == _SPECIAL
        elif special or not line.strip(separator + " "):
            continue
        elif tag == _END:
            state = {"file": "header", "header": "names"}.get(state, state)
        elif state == "header" or (state == "samples" and _is_tag(tag, line, separator)):
            header = {} if state == "samples" else header
            state = "header"
            cells = [cell.strip() for cell in line.split(separator)]
            header[tag] = [cell.replace(",", ".") for cell in cells[1:]] if comma else cells[1:]
        elif state == "names":
            names = [cell.strip() for cell in line.rstrip(separator + " ").split(separator)]
            names = names[:-1] if names[-1] == "Comment" else names
            segments.append(_Segment(header=header, names=names, rows=[], lines=[]))
            state = "samples"
        elif state == "samples":
            segments[-1].rows.append(row)
            # A comment after the channels may contain any separator.
            kept = separator.join(line.split(separator, len(segments[-1].names))[: len(segments[-1].names)])
            segments[-1].lines.append(kept.replace(",", ".") if comma else kept)
    segments = [segment for segment in segments if segment.lines]
    if not segments:
        raise DataError(f"{path}: the file has a header but no samples")
    return segments


def _is_tag(tag: str, line: str, separator: str) -> bool:
    """Return whether a line begins the header of another segment."""
    return bool(tag) and tag[0].isalpha() and not is_number(tag.replace(",", ".")) and separator in line


def _table(segments: list[_Segment], separator: str, x_columns: str, path: str, sha256: str) -> CsvTable:
    """Return the samples of all segments as one table."""
    first = segments[0]
    if len(first.names) > COLUMNS:
        raise DataError(f"{path}: it has {len(first.names)} columns; at most {COLUMNS} can be read")
    if x_columns == "Multi":
        _require_one_clock(segments, separator, path)
    deltas = {first.number("Delta_X", k) for k in range(len(first.names) - 1)} - {None}
    # Header entries are counted by channel from 0; even without x values, a channel's samples are one column further.
    timing, lines = None, [line for segment in segments for line in segment.lines]
    if x_columns == "No":
        starts = {first.number("X0", k) for k in range(len(first.names) - 1)} - {None}
        step = deltas.pop() if len(deltas) == 1 else None
        if not step or step < 0.0 or len(starts) > 1:
            raise DataError(f"{path}: its channels have different clocks, or none (Delta_X, X0); save them separately")
        if len(segments) == 1:
            timing = Timing(sample_time=step, start=(starts.pop() if starts else None) or 0.0)
        else:
            lines = [
                f"{time!r}{separator}{line.partition(separator)[2]}"
                for segment in segments
                for k, line in enumerate(segment.lines)
                for time in [(segment.number("X0", 0) or 0.0) + step * k]
            ]
    lines = lines if timing else _on_one_clock(segments, lines, separator)
    headers = [f"{name} {k}" if name == "X_Value" and k else name for k, name in enumerate(first.names)]
    said = _labels(first)
    units = [_unit(header, label, path) for header, label in zip(headers, said, strict=True)]
    split = [split_unit(header)[0] for header in headers]
    if not timing:
        units[0], split[0] = "s", "time"
    x = lines[0].partition(separator)[0].strip()
    absolute = is_number(x) and float(x) > _ABSOLUTE
    return CsvTable(
        path=path,
        sha256=sha256,
        headers=tuple(headers),
        names=tuple(split),
        units=tuple(units),
        declared=Declared(timing=timing, provenance={} if absolute else _began(first)),
        said=said,
        lines=lines,
        rows=[row for segment in segments for row in segment.rows],
        delimiter=separator,
    )


def _labels(segment: _Segment) -> tuple[str, ...]:
    """Return the unit label of each column in a segment's header; empty if there is none."""
    cells = ["", *segment.header.get("Y_Unit_Label", [])]  # the first column holds the x values
    return tuple(cells[k] if k < len(cells) else "" for k in range(len(segment.names)))


def _unit(header: str, label: str, path: str) -> str:
    """Return the unit of a column from its name or its label."""
    (name, own), stated = split_unit(header), find_unit(label)
    if own and stated and own not in (stated, for_name(name, stated)):
        raise DataError(
            f'{path}, column "{clipped(header)}": the name gives the unit {own}, but its Y_Unit_Label gives '
            f"{stated}; correct one of them"
        )
    return for_name(name, stated) or own


def _began(segment: _Segment) -> dict[str, str]:
    """Return the date of the first sample for the provenance; empty if the header has none."""
    return {BEGAN: dates[0].isoformat()} if (dates := _dates(segment)) else {}


def _dates(segment: _Segment) -> list[datetime]:
    """Return the dates of the channels' first samples, without those that LabVIEW writes for none or none can read."""
    pairs = zip(*(segment.header.get(tag, []) for tag in ("Date", "Time")), strict=False)
    found = []
    for date, time in (pair for pair in pairs if all(pair)):
        with suppress(ValueError):
            found.append(moment(f"{date} {time}"))
    return [date for date in found if date.year > _UNDATED]


def _require_one_start(segment: _Segment, path: str) -> None:
    """Raise an error if channels were started more than half a sample apart: their x values are relative."""
    dates, step = _dates(segment), segment.number("Delta_X", 0) or np.inf
    if dates and (apart := (max(dates) - min(dates)).total_seconds()) > 0.5 * step:
        raise DataError(
            f"{path}, row {segment.rows[0]}: the channels below begin up to {apart:g} s apart (Date, Time); save each in a "
            "file of its own"
        )


def _on_one_clock(segments: list[_Segment], lines: list[str], separator: str) -> list[str]:
    """Return the samples with x values that continue from segment to segment."""
    ends = np.cumsum([len(segment.lines) for segment in segments])
    x = [_number(line.partition(separator)[0]) for line in lines]
    dates = [_began(segment).get(BEGAN) for segment in segments]
    if None in dates or all(x[end] > x[end - 1] for end in ends[:-1]):
        return lines
    began = [moment(str(date)) for date in dates]
    moved = []
    for segment, end, date in zip(segments, ends, began, strict=True):
        shift = (date - began[0]).total_seconds()
        for k in range(end - len(segment.lines), end):
            # Text that is not a number stays unchanged, so that the error for its row can show it.
            cell, mark, rest = lines[k].partition(separator)
            moved.append(f"{cell if math.isnan(x[k]) else repr(x[k] + shift)}{mark}{rest}")
    return moved


def _number(cell: str) -> float:
    """Return a cell as a number; NaN if it is none."""
    return float(cell) if is_number(cell) else math.nan


def _require_one_clock(segments: list[_Segment], separator: str, path: str) -> None:
    """Raise an error if channels have different x values."""
    for segment in segments:
        places = [k for k, name in enumerate(segment.names) if name == "X_Value"]
        for row, line in zip(segment.rows, segment.lines, strict=True):
            cells = line.split(separator)
            x = {_number(cells[k]) for k in places if k < len(cells) and is_number(cells[k])}
            if len(x) > 1:
                raise DataError(
                    f"{path}, row {row}: the channels have different times, {min(x):g} and {max(x):g}; save each "
                    "in a file of its own, or with one column of times"
                )

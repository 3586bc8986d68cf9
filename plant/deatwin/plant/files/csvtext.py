"""Layout of a CSV file's text: encoding, delimiter, end of the header.

Nothing is guessed: only one delimiter may give the header as many cells as the samples.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from deatwin.plant.errors import DataError
from deatwin.plant.files.csvcells import (
    BLANKS,
    COMMENT,
    NO_VALUE,
    advice_for,
    formula,
    holds_number,
    is_comment,
    is_number,
    is_value,
    kind_of_cell,
    split_cells,
)
from deatwin.plant.files.csvheader import are_units
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import find_unit
from deatwin.plant.files.usual import LIKE_TIMES
from deatwin.plant.safe_read import clipped

_DELIMITERS = {"\t": "tab", ";": "semicolon", "|": "bar", ",": "comma"}
_HEAD = 1000  # Largest number of lines before the samples
_SHOWN = 10  # Largest number of columns in an example header
_HEADERS = 4  # Largest number of lines with names, units and remarks
_LIKE_SAMPLES = 3  # Number of lines after the header that must hold numbers, if the file has as many
_SETTINGS = re.compile(
    "(?i)scal|offset|gain|factor|zero|range|sensitiv|slope|coupl|calib|resol|bits|min|max|type|rate|sequence|length|points"
    "|samples|count|skal|faktor|null|bereich|empfind|länge|anzahl"
)
"""Beginnings of words before the settings of channels."""
_SCALES = re.compile("(?i)scal|offset|gain|factor|zero|sensitiv|slope|calib|skal|faktor|null|empfind")
_NAMES_LABEL = re.compile(r"(?i)(trace|channel|signal)[ _]?(name|title)s?\b")  # Word before the names
_LABEL = re.compile(r"([A-Za-z][A-Za-z ]*):\s*")  # Before a setting of a channel
_VALUES = re.compile(
    r'(?i)"?((trace|channel|signal)[ _]?)?(value|data|sample)s?"?([,;\t])'
)  # Label of the first sample
_TRACES = re.compile(r"((trace|channel|signal)[ _]?)?(name|path|title)s?")  # Label of a line of names
_UNITS_WORD = re.compile(r"(?i)(?<![^\W_])(units?|einheit(en)?)(?![^\W_])")  # In the label of a line of units
_TIMES = ("s", "ms", "us", "ns", "min", "h")
_GROUPED = re.compile(r"(?<![\d.])[1-9]\d{0,2}(?:,\d{3})+\.\d+|(?<![\d:])[\d:]*\d:\d\d,\d{3}(?!\d)")
_THOUSANDS = re.compile(r"(?<![\d.])[1-9]\d{0,2}(?:,\d{3})+(?![\d:])(?:\.\d+)?")
_BEFORE_UNIT = re.compile(r"\s+(?![(\[])(?![^(]*\))(?![^\[]*\])")  # Blanks that are neither before nor inside brackets
_INDEX_LINE = re.compile(r"([^,;\t|]*)(([,;\t|])\3*)")  # At most a name, and empty cells
_JAPANESE = re.compile(rb"\x83\xca|\x81\x8e|(?:[\x81-\x9f][\x40-\x7e\x80-\xfc]){2}")
"""µ, °C, or two characters of Shift JIS, which begin with bytes that Windows-1252 has for quotes and dashes."""
_BREAKS_OFF = ("truncated data", "unexpected end of data")  # Reasons of a decoder for text that ends within a character
_LETTERS = 3  # Least number of accented letters that follow each other in no language of Windows-1252
_RUSSIAN = re.compile(rb"[\xc0-\xdf]?[\xe0-\xff]{2,}|[\xc0-\xdf]{3,}")
"""Word of Windows-1251: a capital letter and small ones, small letters only, or capital ones only."""
_FAR_APART = re.compile(r"\s{2,}|\t")
_LABELLED = re.compile(r'"?(?<![^\s,;{"])([^\W\d][^":=,;\t{}]{0,60}?)"?\s?[:=]\s?("[^"]*"|[^\s",;{}]+)')
"""Name and value in one cell, as Arduino's plotter and JSON write them."""
_WIDE = 2000  # Number of characters of a line from which it is no such row
_WRAPPED = 60  # Largest number of lines over which the names of one line may be wrapped
_MANY = 10  # Number of rows that must repeat the names, if the file has as many


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of the lines in a file."""

    delimiter: str  # Tab, semicolon, bar or comma; a blank stands for any run of blanks and tabs
    first: int  # Number of the first line that holds samples
    head: tuple[list[str], ...] = ()


def decode(content: bytes, path: str) -> str:
    """Return the text of a file in UTF-8, UTF-16 (also without its mark), UTF-32 with it, GBK, or Windows-1252.

    A zero at its end stands for room that the file has and nobody wrote.
    """
    if content[:4] in (b"\xff\xfe\0\0", b"\0\0\xfe\xff"):
        return content.decode("utf-32", errors="replace")
    halves = content[0:8:2], content[1:8:2]  # of the first four characters, which are Latin in a table
    first, second = (bool(half) and not any(half) for half in halves)
    bare = {(False, True): "utf-16-le", (True, False): "utf-16-be"}.get((first, second))
    if bare or content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        try:
            return content.decode(bare or "utf-16")
        except UnicodeDecodeError as error:
            if error.reason in _BREAKS_OFF:
                return content[: error.start].decode(bare or "utf-16")
            raise DataError(f"{path}: the UTF-16 text is damaged at byte {error.start}; save the file again") from None
    written = content.rstrip(b"\0\x1a")  # a logger that loses power leaves the rest unwritten; DOS marks the end
    rest = "\0" * content.endswith(b"\0")
    if b"\0" in written:
        book = "; end the name of an Excel workbook in .xlsx, and unpack a zip file" if content[:2] == b"PK" else ""
        raise DataError(f"{path}: not a text file; save the table as CSV in UTF-8{book}")
    try:
        return written.decode("utf-8-sig") + rest
    except UnicodeDecodeError as error:
        # If all characters before are plain, the last byte may as well be a letter of another encoding.
        if error.reason in _BREAKS_OFF and not written[: error.start].isascii():
            return written[: error.start].decode("utf-8-sig") + rest
        return written.decode(_code_page(written), errors="replace") + rest


def _code_page(content: bytes) -> str:
    """Return the encoding of a text that is not in UTF-8.

    In Windows-1252, µ, ° and accented letters stand alone, or are small letters from DF on, as in größe.
    """
    if _JAPANESE.search(content):
        try:
            content.decode("cp932")
        except UnicodeDecodeError:
            pass
        else:
            return "cp932"
    runs = re.findall(rb"[\x80-\xff]+", content)
    if any(map(_RUSSIAN.fullmatch, runs)) and all(len(run) < _LETTERS or _RUSSIAN.fullmatch(run) for run in runs):
        return "cp1251"
    # In GBK, a Chinese character takes two such bytes, and common ones begin with B0 to D7.
    paired = all(len(run) % 2 == 0 for run in runs) and any(0xB0 <= lead <= 0xD7 for run in runs for lead in run[::2])
    return "gbk" if paired else "cp1252"


def find_layout(lines: list[str], rows: Sequence[int], path: str) -> Layout:
    """Find the delimiter and the end of the header."""
    whole = "\n".join(lines)  # one search of the whole text is quicker than one of each line
    widths = {mark: _width(lines, mark) if mark in whole else 1 for mark in _DELIMITERS}
    marks = [mark for mark in _DELIMITERS if widths[mark] > 1] or [","]
    starts = {mark: _first_sample(lines, mark, widths[mark]) for mark in marks}
    fitting = [mark for mark in marks if starts[mark] is not None]
    if len(fitting) > 1:  # commas in "U, V;x, mm" and "1,5;2,5" are no delimiters: cells between them are no numbers
        certain = [mark for mark in fitting if _holds_only_values(split_cells(lines[starts[mark] or 0], mark))]
        fitting = certain if len(certain) == 1 else fitting
    if len(fitting) > 1:
        raise DataError(
            f"{path}, row {rows[starts[fitting[0]] or 0]}: the delimiter is ambiguous: it could be "
            f"{' or '.join(_DELIMITERS[mark] for mark in fitting)}; use only one of them"
        )
    if (not fitting or _blanks_too(lines, fitting[0], starts[fitting[0]] or 0)) and (
        start := _first_sample(lines, BLANKS, 1)
    ):
        return _named(lines, BLANKS, start)
    if fitting:
        return _named(lines, fitting[0], starts[fitting[0]] or 0)
    if layout := _nameless(lines):
        return layout
    raise _no_layout(lines, rows, marks[0], path)


def _holds_only_values(cells: list[str]) -> bool:
    """Return whether each cell of a line holds a number, a date or a word, or nothing."""
    return all(kind_of_cell(cell) in ("", "number", "date", "text") for cell in cells)


def without_label_column(lines: list[str], rows: Sequence[int], path: str) -> tuple[list[str], Sequence[int]]:
    """Return lines and rows of a table that labels its lines in the first cell, as ControlDesk of dSPACE does, without labels.

    >>> without_label_column(["path,,u", "unit,s,V", "trace_values,0,1", ",1,2", ",2,3", ",3,4"], range(1, 7), "r.csv")
    (['time,u', 's,V', '0,1', '1,2', '2,3', '3,4'], [1, 2, 3, 4, 5, 6])

    The name of a signal is that of its path if several have the same one. Unnamed are only the times.
    """
    for first, line in enumerate(lines[1:_HEAD], 1):
        if not (found := _VALUES.match(line)):
            continue
        delimiter = found[4]
        cells = [split_cells(below, delimiter) for below in lines[first : first + 1 + _LIKE_SAMPLES]]
        if not all(len(row) > 2 and any(map(is_value, row[1:])) for row in cells) or any(row[0] for row in cells[1:]):
            continue
        head = {row[0].lower(): row[1:] for row in (split_cells(above, delimiter) for above in lines[:first])}
        width = len(cells[0]) - 1
        named = [head[label] for label in sorted(head, key=lambda label: label == "path") if _TRACES.fullmatch(label)]
        named = [row for row in named if width - 1 <= len(row) <= width]
        if not named or len(cells) < 1 + _LIKE_SAMPLES:
            continue
        names = next((row for row in named if len(set(row)) == len(row)), named[-1])
        names = [name or ("" if k else "time") for k, name in enumerate(names)]
        units = next((row for label, row in head.items() if _UNITS_WORD.search(label)), [])
        if again := next((k for k in range(first + 1, len(lines)) if lines[k].startswith(found[0])), 0):
            raise DataError(
                f"{path}, row {rows[again]}: other signals begin here; give each block of signals a file of its own"
            )
        head_rows = [(row + [""] * width)[:width] for row in (names, units) if row]
        made = [delimiter.join(f'"{cell}"' if delimiter in cell else cell for cell in row) for row in head_rows]
        samples = [below.partition(delimiter)[2] for below in lines[first:]]
        return [*made, *samples], [*rows[first - len(made) : first], *rows[first:]]
    return lines, rows


def lacks_cells(lines: Sequence[str], delimiter: str) -> bool:
    """Return whether the last line has fewer cells than each line before it."""
    last = len(split_cells(lines[-1], delimiter))
    return len(lines) > 2 and all(len(split_cells(line, delimiter)) > last for line in lines[:-1])


def with_name_of_rows(lines: list[str]) -> list[str]:
    """Return lines of a table of R with an empty name before the others: R gives the quoted numbers of its rows none."""
    found = re.match(r'"1"([ \t,;])', lines[1]) if len(lines) > 1 else None
    if not found or len(split_cells(lines[0], found[1])) + 1 != len(split_cells(lines[1], found[1])):
        return lines
    return [f'""{found[1]}{lines[0]}', *lines[1:]]


def without_labels(lines: list[str], rows: Sequence[int], path: str) -> tuple[list[str], Sequence[int]]:
    """Return lines and rows of samples that each repeat the names, as ``u:1.5,y:2`` or in JSON Lines, with one header.

    >>> without_labels(["ready", '{"u": 1.5, "at": "1,5"}', '{"u": null, "at": ""}'], [1, 2, 3], "r.csv")
    (['ready', '"u","at"', '1.5,"1,5"', 'null,""'], [1, 2, 2, 3])

    The order of the names may differ between rows. A last row that breaks off is left out.
    """
    first = next((k for k, line in enumerate(lines[:_HEAD]) if len(_labelled(line)) > 1), len(lines))
    names = [name for name, _ in _labelled(lines[first])] if first < len(lines) else []
    like = [sorted(name for name, _ in _labelled(line)) == sorted(names) for line in lines[first : first + _MANY]]
    if 2 * sum(like) <= max(len(like), 2) or len(set(names)) < len(names):
        return lines, rows
    made = [",".join(f'"{name}"' for name in names)]
    for line, row in zip(lines[first:], rows[first:], strict=True):
        cells = _labelled(line)
        if sorted(name for name, _ in cells) != sorted(names):
            whole = line.lstrip().startswith("{") and line.rstrip().endswith("}")
            begun = {name for name, _ in cells} < set(names) and not whole
            if row == rows[-1] and begun and len(made) > _LIKE_SAMPLES:
                return [*lines[:first], *made], [*rows[:first], rows[first], *rows[first:-1]]
            raise DataError(
                f"{path}, row {row}: each row repeats the names, but not this one; write {clipped(', '.join(names))} and their "
                "values, or remove the row"
            )
        made.append(",".join(dict(cells)[name] for name in names))
    return [*lines[:first], *made], [*rows[:first], rows[first], *rows[first:]]


def _labelled(line: str) -> list[tuple[str, str]]:
    """Return names and values of a line that holds nothing else."""
    named = len(line) < _WIDE and _LABELLED.match(line.lstrip(" \t{"))  # quick for lines of another kind
    return [] if not named or _LABELLED.sub("", line).strip(" ,;\t{}") else _LABELLED.findall(line)


def with_whole_names(lines: list[str], rows: Sequence[int]) -> tuple[list[str], Sequence[int]]:
    """Return lines and rows in which quoted names with line breaks, as spreadsheets write wrapped cells, stand on one line.

    >>> with_whole_names(['"time', '(s)","u (V)"', '0,1', '1,"2'], [1, 2, 3, 4])
    (['"time (s)","u (V)"', '0,1', '1,"2'], [2, 3, 4])
    """
    first = next((k for k, line in enumerate(lines[:_HEAD]) if line.count('"') % 2), None)
    if first is None:
        return lines, rows
    last = next((k for k in range(first + 1, min(first + _WRAPPED, len(lines))) if lines[k].count('"') % 2), first)
    whole = " ".join(map(str.strip, lines[first : last + 1]))
    if last == first or any(holds_number(split_cells(whole, mark)) for mark in _DELIMITERS):
        return lines, rows
    return with_whole_names([*lines[:first], whole, *lines[last + 1 :]], [*rows[:first], *rows[last:]])


def without_index_line(lines: list[str], rows: Sequence[int]) -> tuple[list[str], Sequence[int]]:
    """Return lines and rows of a table of pandas without the line that names only its index, below several names.

    The name of the index is put before the names of the columns, where a level's name or nothing stands.
    """
    for k, line in enumerate(lines[1:_HEAD], 1):
        found = _INDEX_LINE.fullmatch(line)
        if not found or k + 1 == len(lines):
            continue
        delimiter, count = found[2][0], len(found[2])
        cells = [split_cells(other, delimiter) for other in lines[: k + 2]]
        labelled = found[1].strip() and not cells[k + 1][0] and holds_number(cells[k + 1])
        if labelled and not any(map(holds_number, cells[:k])):  # lines of remarks, without any, and no settings above
            first = next((j + 1 for j in range(k - 1, -1, -1) if not _INDEX_LINE.fullmatch(lines[j])), 0)
            return [*lines[:first], *lines[k + 1 :]], [*rows[:first], *rows[k + 1 :]]
        above = next(
            (j for j in range(k, 0, -1) if lines[j - 1].count(delimiter) != count or holds_number(cells[j - 1])), 0
        )
        if k - above < 2 or kind_of_cell(cells[k + 1][0]) not in ("number", "date"):
            continue
        head, name = lines[above:k], found[1].strip()
        if name and not any(find_unit(row[0]) or LIKE_TIMES.search(row[0]) for row in cells[above:k]):
            head = [
                other if are_units(row[1:]) else name + delimiter + other.partition(delimiter)[2]
                for other, row in zip(head, cells[above:k], strict=True)
            ]
        return [*lines[:above], *head, *lines[k + 1 :]], [*rows[:k], *rows[k + 1 :]]
    return lines, rows


def require_no_settings(lines: list[str], rows: Sequence[int], delimiter: str, path: str) -> None:
    """Refuse samples that begin or end with lines of a word and numbers, such as scales, units and mean values.

    If the first column holds neither numbers nor dates, a single word may belong to a sample, unless it names a setting.
    """
    for part, place, advice in (
        (
            range(min(_HEAD, len(lines))),
            "below the names",
            "apply scales and other settings to the samples, and remove",
        ),
        (range(-1, -min(_HEAD, len(lines)) - 1, -1), "at the end", "remove"),
    ):
        cells = [split_cells(lines[k], delimiter) for k in part]
        words = list(map(_is_labelled, cells))
        if not words or not words[0] or words[-1] or words != sorted(words, reverse=True):  # words first, then none
            continue
        labels = [row[0] for row, word in zip(cells, words, strict=True) if word]
        setting = part[0] == 0 and (1 < len(labels) == len(set(labels)) or _SETTINGS.match(labels[0]))
        if kind_of_cell(cells[-1][0]) in ("number", "date") or setting:
            raise DataError(
                f'{path}, row {rows[part[0]]}: "{clipped(cells[0][0])}" begins a line {place} that is no sample; {advice} '
                "such lines"
            )


def header_line(width: int, delimiter: str, times: int | None = 0) -> str:
    """Return an example header for rows of a number of cells, one of them the times, for an error text."""
    usual = ["command_V", "displacement_mm"]
    names = ["time_s" if k == times else usual.pop(0) if usual else f"column_{k + 1}" for k in range(width)]
    names[_SHOWN:] = ["..."] if width > _SHOWN else []
    return f"{' '.join(names)}, parted by tabs" if delimiter == "\t" else delimiter.join(names)


def grouped(line: str, delimiter: str) -> str:
    """Return the end of an error text for a line whose commas are both delimiters and parts of a number."""
    found = _GROUPED.search(line) if delimiter == "," else None
    if found and ":" in found[0]:
        return f"; is {found[0]} one time? Then write it with a decimal point"
    return f"; is {found[0]} one number? Then write it without the comma" if found else ""


def require_whole_numbers(lines: list[str], rows: Sequence[int], widths: list[int], count: int, path: str) -> None:
    """Refuse lines, separated by commas, that a comma between thousands lengthens beyond the header's `count` of cells.

    The last cells are empty, so that the numbers behind the comma would be read one column too far left.
    """
    wide = [k for k, width in enumerate(widths) if width > count]
    split = [(k, found[0]) for k in wide if (found := _THOUSANDS.search(lines[k]))]
    if split and (len(wide) < len(lines) or len(split) == len(lines)):
        k, number = split[0]
        raise DataError(
            f"{path}, row {rows[k]}: the row has {widths[k]} cells, but the header has {count}; is {number} one number? Then "
            "write it without the comma, else remove the commas at the end of the row"
        )


def _width(lines: list[str], delimiter: str) -> int:
    """Return the commonest number of cells in the second half of the lines; 1 without the delimiter."""
    ends = f'{delimiter} "'
    counts = [
        line.count(delimiter) + 1 if line[-1] not in ends and '"' not in line else len(split_cells(line, delimiter))
        for line in lines
    ]
    whole, half = Counter(counts), Counter(counts[len(counts) // 2 :])
    half.pop(1, None)
    return max(half, key=lambda count: (half[count], whole[count])) if half else 1


def _first_sample(lines: list[str], delimiter: str, width: int) -> int | None:
    """Return the index of the first line of samples: numbers below a non-numeric line with at least as many cells.

    Settings with a number for each channel, as oscilloscopes write them above the names, are no samples.
    """
    cells = [split_cells(line, delimiter) for line in lines[:_HEAD]]
    starts = list(_starts(lines, cells, delimiter, width))
    unlabelled = (k for k in starts if not all(map(_is_labelled, cells[k : k + _LIKE_SAMPLES])))
    return next(unlabelled, starts[0]) if starts else None


def _starts(lines: list[str], cells: list[list[str]], delimiter: str, width: int) -> Iterator[int]:
    """Yield the index of each line that may be the first one of samples, from the cells of the first lines."""
    numeric = [_is_sample(line, row) for line, row in zip(lines, cells, strict=False)]
    if width > 1:  # a line with numbers only beyond the columns of the samples belongs to the header
        within = [*(holds_number(row[:width]) for row in cells), False]
        numeric = [one and (within[k] or not within[k + 1]) for k, one in enumerate(numeric)]
    for k in range(1, len(cells)):  # below a sample, a line of marks of missing values is one, too, and no header
        numeric[k] = numeric[k] or (numeric[k - 1] and all(cell.lower() in NO_VALUE for cell in cells[k]))
    for k in range(1, len(cells)):
        follow = cells[k : k + _LIKE_SAMPLES]
        if numeric[k - 1] or not all(numeric[k : k + _LIKE_SAMPLES]):
            continue
        header = _header_cells(lines[k - 1], delimiter, len(cells[k]))
        if are_units(header) and delimiter != BLANKS and '"' not in lines[k - 1]:  # its last cells may be empty
            named = len(cells[k - 2]) if k > 1 else 0
            header += [""] * (max(lines[k - 1].count(delimiter) + 1, named) - len(header))
        # No cell can be empty if blanks delimit, so all lines have as many.
        even = delimiter != BLANKS or ({len(row) for row in follow} == {len(header)} and len(header) > 1)
        if even and width <= len(header) >= len(cells[k]):
            yield k


def _is_labelled(cells: list[str]) -> bool:
    """Return whether a line begins with a word, as settings and statistics do."""
    return cells[0][:1].isalpha() and cells[0].lower() not in NO_VALUE and kind_of_cell(cells[0]) in ("text", "mixture")


def _named(lines: list[str], delimiter: str, first: int) -> Layout:
    """Return the layout of a file with a header."""
    width = len(split_cells(lines[first], delimiter))
    if found := _of_block(lines, delimiter, first):
        return found
    # Names above a line of units may be numbers, such as those of an oscilloscope's channels.
    above = lines[max(first - 2 * _HEADERS, 0) : first]
    head: list[list[str]] = []
    for cells in (_header_cells(line, delimiter, width) or split_cells(line, delimiter) for line in above):
        named = any(len(list(filter(None, one))) >= len(cells) for one in head)
        if kept := _without_labels(cells) if named else cells:
            head.append(kept)
    if head and not any(are_units(cells) or any(split_unit(cell)[1] for cell in cells) for cells in head):
        head += _units_among_settings(lines[:first], delimiter, width)
    return Layout(delimiter=delimiter, first=first, head=tuple(head[-_HEADERS:]))


def _units_among_settings(lines: list[str], delimiter: str, width: int) -> list[list[str]]:
    """Return the units that settings above the names give below a word such as ``Vertical Units``, if any."""
    for row in (split_cells(line, delimiter) for line in reversed(lines)):
        units = [find_unit(cell) for cell in row[1:]]
        if len(row) == width > 1 and _UNITS_WORD.search(row[0]) and all(units) and not all(u in _TIMES for u in units):
            return [["", *row[1:]]]
    return []


def _without_labels(cells: list[str]) -> list[str]:
    """Return the cells of a line below names; of one that Simulink labels in each cell, ``Unit: V``, the units or none."""
    found = [_LABEL.match(cell) for cell in cells if cell]
    labels = {label[1].lower() for label in found if label}
    if len(found) < 2 or None in found or len(labels) > 1:
        return cells
    if labels.pop().startswith("unit"):
        return [_LABEL.sub("", cell, count=1) for cell in cells]
    return cells if any(split_unit(cell)[1] for cell in cells) else []  # with units, they are names below a title


def _of_block(lines: list[str], delimiter: str, first: int) -> Layout | None:
    """Return the layout of a file whose names stand in a block of settings: a word, then a value for each channel.

    None if there is no such block right above the samples, or a scale or offset in it has yet to be applied.
    """
    cells = [split_cells(line, delimiter) for line in lines[: first + _HEAD]]
    start = next((k for k in range(first, len(cells)) if not _is_labelled(cells[k])), first)
    names = next((k for k in range(start - 1, -1, -1) if _NAMES_LABEL.search(cells[k][0]) and len(cells[k]) > 2), None)
    ends = start > first or cells[start - 1][0].endswith(("=", ":"))
    if not ends or names is None or any(map(_alters, cells[names:start])):
        return None
    whole, width = cells[names], len(cells[start])
    head = [whole[1:] if len(whole) == width + 1 else ["", *whole[1:]]]
    if len(head[0]) != width or any(map(is_value, whole[1:])):
        return None
    for row in cells[names:start]:
        units = [find_unit(cell) for cell in row[1:]]
        if "unit" in row[0].lower() and len(row) == len(whole) and all(units) and not all(u in _TIMES for u in units):
            return Layout(delimiter=delimiter, first=start, head=(*head, [*head[0][: width - len(units)], *row[1:]]))
    return Layout(delimiter=delimiter, first=start, head=tuple(head))


def _alters(cells: list[str]) -> bool:
    """Return whether a setting scales or shifts samples: a factor that is not 1, or an offset that is not 0."""
    found = _SCALES.search(cells[0])
    neutral = "0" if found and found[0].lower() in ("offset", "zero", "null") else "1"
    return found is not None and any(not is_number(cell) or float(cell) != float(neutral) for cell in cells[1:])


def _header_cells(line: str, delimiter: str, width: int) -> list[str]:
    """Return the cells of a line that may be a header, if possible as many as in the samples."""
    bare = COMMENT.sub("", line, count=1)
    ways = [split_cells(bare, delimiter)] if is_comment(line) else []
    ways = [cells for cells in ways if any(cells[:1])]  # otherwise the mark is a name, such as # for the number
    ways.append(split_cells(line, delimiter))
    if delimiter == BLANKS:
        ways += [apart.split(bare.strip()) for apart in (_BEFORE_UNIT, _FAR_APART)]
        ways = [[cell.strip() for cell in bare.split(",")], *ways] if "," in bare else ways
    if delimiter != BLANKS and width > 1:  # numbers beyond the columns of the samples are settings
        ways = [cells[:width] if _holds_sample(cells) else cells for cells in ways]
    ways = [cells for cells in ways if not _holds_sample(cells)] or [[]]
    return next((cells for cells in ways if len(cells) == width), ways[0])


def _blanks_too(lines: list[str], delimiter: str, first: int) -> bool:
    """Return whether blanks also separate the columns of a table with tabs."""
    cells = split_cells(lines[first], delimiter)
    return delimiter == "\t" and any(len(parts := cell.split()) > 1 and all(map(is_value, parts)) for cell in cells)


def require_no_numbered_columns(lines: list[str], rows: Sequence[int], delimiter: str, path: str) -> None:
    """Refuse a first row that may number the columns, as that of a data frame without names: 0, 1, 2 above decimals."""
    cells = [split_cells(line, delimiter) for line in lines[: 1 + _LIKE_SAMPLES]]
    numbers = cells[0][1:] if not cells[0][0] else cells[0]
    counted = len(numbers) > 2 and any(numbers == [str(k + n) for n in range(len(numbers))] for k in (0, 1))
    below = list(zip(*cells[1:], strict=False))
    if counted and 2 * sum(not all(map(str.isdecimal, column)) for column in below) > len(below):
        raise DataError(
            f"{path}, row {rows[0]}: {', '.join(numbers[:3])}{'...' if len(numbers) > 3 else ''} may be the numbers of the "
            "columns, or a sample: put the names of the columns in its place, or remove the row"
        )


def _nameless(lines: list[str]) -> Layout | None:
    """Return the layout of a file whose first line is a sample like the next ones; None for other files."""
    first = next((k for k, line in enumerate(lines[:_HEAD]) if not is_comment(line)), 0)
    found = []
    for delimiter in (*_DELIMITERS, BLANKS):
        rows = [split_cells(line, delimiter) for line in lines[first : first + 1 + _LIKE_SAMPLES]]
        kinds = [{kind_of_cell(cell) for cell in column} - {""} for column in zip(*rows, strict=False)]
        alike = len({len(row) for row in rows}) == 1 and all(len(kind) < 2 and kind <= _KINDS for kind in kinds)
        cut = delimiter == "," and _is_cut(lines[first : first + _HEAD], rows)
        if alike and {"number"} in kinds and not cut:
            found.append((len(kinds), Layout(delimiter=delimiter, first=first)))
    # A single column fits any delimiter. If another delimiter fits several columns, blanks do not delimit.
    several = [layout for width, layout in found if width > 1]
    marked = [layout for layout in several if layout.delimiter != BLANKS] or several
    return marked[0] if len(marked) == 1 else found[0][1] if found and not several else None


def _is_cut(lines: list[str], rows: list[list[str]]) -> bool:
    """Return whether commas separate thousands: some cells begin with a zero, and none has a decimal point."""
    return any(re.match(r"0\d", cell) for row in rows for cell in row) and not any("." in line for line in lines)


_KINDS = frozenset({"number", "date", "text"})


def _is_sample(line: str, cells: list[str]) -> bool:
    """Return whether a line is a sample; comments are not."""
    return _holds_sample(cells) and not is_comment(line)


def _holds_sample(cells: list[str]) -> bool:
    """Return whether a line holds a number, unless that is the 1 of a quantity without a dimension among units."""
    return holds_number(cells) and not ({cell for cell in cells if is_value(cell)} == {"1"} and are_units(cells))


def _no_layout(lines: list[str], rows: Sequence[int], delimiter: str, path: str) -> DataError:
    """Return an error for a file in which no header fits the samples."""
    cells = [split_cells(line, delimiter) for line in lines[:_HEAD]]
    numeric = [_is_sample(line, row) for line, row in zip(lines, cells, strict=False)]
    if not any(numeric):
        apart = max(map(len, cells)) < 2  # otherwise another delimiter separates cells
        blanks = next((k for k, line in enumerate(lines[:_HEAD]) if apart and _is_sample(line, line.split())), None)
        if blanks is None:
            place = next(((k, cell) for k, row in enumerate(cells) for cell in row if cell.startswith("=")), None)
            if place:
                return DataError(f"{path}, row {rows[place[0]]}: {formula(place[1])}")
            row = next((k for k in range(1, len(cells)) if len(cells[k]) == max(map(len, cells))), 0)
            first = next((cell for cell in cells[row] if kind_of_cell(cell) not in ("", "date")), "")
            advice = advice_for(first) if re.search("[0-9]", first) else ""
            found = f', and in row {rows[row]} "{clipped(first, 40)}" is not a number{advice}' if row and first else ""
            return DataError(
                f"{path}: the file has a header but no samples: no row holds numbers{found}"
                if row
                else f"{path}: the file has a header but no samples"
            )
        delimiter, cells = BLANKS, [split_cells(line, BLANKS) for line in lines[:_HEAD]]
        numeric = [_is_sample(line, row) for line, row in zip(lines, cells, strict=False)]
    if numeric[0]:
        advice = f"the first line must contain the names of the columns, and a name must not be a number; for example {header_line(len(cells[0]), delimiter)}"
        if delimiter == "," and _is_cut(lines, cells):
            advice = "a comma cannot be both delimiter and decimal sign: separate the cells by semicolons or tabs"
        return DataError(f"{path}, row {rows[0]}: there is no header; {advice}")
    width = _width(lines, delimiter) if delimiter != BLANKS else 0
    before = [k for k in range(1, len(cells)) if numeric[k] and not numeric[k - 1]]
    wide = [k for k in before if len(cells[k]) >= width] or before[-1:]
    ends = [next((n for n in range(k, len(cells)) if not numeric[n]), len(cells)) for k in wide]
    k = max(zip(wide, ends, strict=True), key=lambda run: run[1] - run[0])[0]  # the samples are the longest run
    header = _header_cells(lines[k - 1], delimiter, len(cells[k]))
    commas = delimiter == "," and len(cells[k]) > len(header) and "." not in lines[k]
    advice = grouped(lines[k], delimiter) or (
        "; a comma cannot be both delimiter and decimal sign: separate the cells by semicolons or tabs"
        if commas
        else "; a quotation mark among the names is not closed"
        if '"' in lines[k - 1] and lines[k - 1].count('"') % 2
        else "; each column needs a name of one word"
        if delimiter == BLANKS
        else "; each column needs a name"
    )
    by = _DELIMITERS.get(delimiter, "blanks")
    return DataError(
        f"{path}, row {rows[k]}: the row has {len(cells[k])} cells separated by {by}, but the header in row {rows[k - 1]} has "
        f"{len(header)}{advice}"
    )

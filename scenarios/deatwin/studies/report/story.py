"""The end of a scenario: measures with goals, notes, tables and figures on one page, and the result files."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.rendering import Origin, write_page

Item = TypeVar("Item")
_NUMBER = re.compile(r"(?:[-+−±<>≥≤] ?)?(?:\d|∞)|–$")


@dataclass(frozen=True)
class Measure:
    """A measured value and its goal, as text with units."""

    measure: str
    demanded: str
    reached: str
    passed: bool


@dataclass(frozen=True, kw_only=True)
class Note:
    """Text under a heading, optionally with a file or commands."""

    title: str
    paragraphs: Sequence[str]  # Plain text
    code: str = ""  # Shown verbatim, line by line; empty if there is none


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table at the end of the page."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]  # Cells as they are to be shown

    @property
    def numeric(self) -> set[int]:
        """Return the columns after the first that hold numbers only, with or without units."""
        columns = enumerate(zip(*self.rows, strict=False))
        return {i for i, cells in columns if i > 0 and all(map(_NUMBER.match, cells)) and set(cells) != {"–"}}

    @classmethod
    def of(cls, title: str, items: Iterable[Item], columns: Mapping[str, Callable[[Item], object]]) -> Table:
        """Make a row of each item; a column is a function of an item."""
        rows = [[str(cell(item)) for cell in columns.values()] for item in items]
        return cls(title=title, columns=list(columns), rows=rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class StoryPage:
    """Content of the page."""

    title: str  # Name of the story, and of its result file
    sentence: str
    rows: Sequence[Measure]
    notes: Sequence[Note]
    figures: Sequence[Drawing]
    tables: Sequence[Table] = ()
    next: str = ""  # What the reader can do with the result
    caveats: Sequence[str] = ()  # Sentences below the heading

    @property
    def passed(self) -> bool:
        """True if every goal is met."""
        return all(row.passed for row in self.rows)

    @property
    def label(self) -> str:
        """Count the goals that are met, in words."""
        return f"{reached(self.rows)} goals reached"


def reached(rows: Sequence[Measure]) -> str:
    """Count the measures that meet their goals, as in ``7 of 9``."""
    return f"{sum(row.passed for row in rows)} of {len(rows)}"


def write_story(folder: ResultFolder, page: StoryPage, record: RunRecord) -> None:
    """Write the data of the figures and ``report.html``."""
    for figure in page.figures:
        figure.save_data(folder)
    write_page(folder, "story.html.j2", page.figures, Origin.of(record), page=page)


def finish(folder: ResultFolder, record: RunRecord, page: StoryPage, **more: Any) -> dict[str, Any]:
    """Write figures' data, page, ``NAME.json`` and ``run.json``; return the content of ``NAME.json``."""
    write_story(folder, page, record)
    shown = {name: [asdict(one) for one in given] for name, given in (("measures", page.rows), ("tables", page.tables))}
    result = {"sentence": page.sentence, **shown, **more}
    return end_run(folder, record, page.title, result)


def end_run(folder: ResultFolder, record: RunRecord, name: str, result: Mapping[str, Any]) -> dict[str, Any]:
    """Write ``NAME.json`` and ``run.json``; return the result."""
    folder.text(f"{name}.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    record.save(folder)
    return dict(result)

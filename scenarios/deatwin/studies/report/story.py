"""The page of a story: what was demanded, what was reached, notes and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.origin import Origin
from deatwin.studies.report.rendering import write_page


@dataclass(frozen=True, kw_only=True)
class Row:
    """A stated measure."""

    measure: str
    demanded: str
    reached: str
    passed: bool  # Whether what is demanded is reached


@dataclass(frozen=True, kw_only=True)
class Note:
    """Text under a heading, and a file or commands behind it."""

    title: str  # The heading
    paragraphs: Sequence[str]  # Plain text
    code: str = ""  # Shown as it is, line by line; empty for none


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table at the end of the page."""

    title: str  # The heading
    columns: Sequence[str]  # Their names
    rows: Sequence[Sequence[str]]  # Cells as they are to be shown


@dataclass(frozen=True, kw_only=True, eq=False)
class StoryPage:
    """All that the page shows."""

    title: str  # Name of the story, and what came out
    sentence: str
    rows: Sequence[Row]  # The stated measures
    notes: Sequence[Note]
    figures: Sequence[Drawing]
    tables: Sequence[Table] = ()

    @property
    def passed(self) -> bool:
        """Whether all measures are reached."""
        return all(row.passed for row in self.rows)

    @property
    def label(self) -> str:
        """How many are, in words."""
        reached = sum(row.passed for row in self.rows)
        return f"{reached} of {len(self.rows)} measures reached"


def write_story(folder: ResultFolder, page: StoryPage, record: RunRecord) -> None:
    """Write ``report.html``."""
    write_page(folder, "story.html.j2", page.figures, Origin.of(record), page=page)

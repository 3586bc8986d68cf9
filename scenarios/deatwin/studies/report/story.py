"""The page of a story: what was demanded, what was reached, notes and figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.origin import Origin
from deatwin.studies.report.rendering import write_page

__all__ = ["Note", "Row", "StoryPage", "Table", "write_story"]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A stated measure.

    Parameters
    ----------
    measure, demanded, reached : str
        In words, with units.
    passed : bool
        Whether what is demanded is reached.
    """

    measure: str
    demanded: str
    reached: str
    passed: bool


@dataclass(frozen=True, kw_only=True)
class Note:
    """Text under a heading, and a file or commands behind it.

    Parameters
    ----------
    title : str
        The heading.
    paragraphs : sequence of str
        Plain text.
    code : str
        Shown as it is, line by line; empty for none.
    """

    title: str
    paragraphs: Sequence[str]
    code: str = ""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table at the end of the page.

    Parameters
    ----------
    title : str
        The heading.
    columns : sequence of str
        Their names.
    rows : sequence of sequence of str
        Cells as they are to be shown.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True, kw_only=True, eq=False)
class StoryPage:
    """All that the page shows.

    Parameters
    ----------
    title, sentence : str
        Name of the story, and what came out.
    rows : sequence of Row
        The stated measures.
    notes : sequence of Note
        In order.
    figures : sequence of Drawing
        In order.
    tables : sequence of Table
        In order.
    """

    title: str
    sentence: str
    rows: Sequence[Row]
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
    """Write ``report.html``.

    Parameters
    ----------
    folder : ResultFolder
        Where to; it holds the data of the figures already.
    page : StoryPage
        Its content.
    record : RunRecord
        The run, for the end of the page.
    """
    write_page(folder, "story.html.j2", page.figures, Origin.of(record), page=page)

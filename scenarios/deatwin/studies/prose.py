"""The words of a story's page, in the file ``page.toml`` beside the story; the story fills in the numbers by name."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.story import Note, Row, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Span:
    """The smallest and the largest of some numbers: ``{errors:.1f}`` becomes "0.2 to 3.1"."""

    def __init__(self, values: Iterable[float]) -> None:
        self.values = list(values)

    def __format__(self, form: str) -> str:
        if not self.values:
            return "–"
        low, high = format(min(self.values), form), format(max(self.values), form)
        return low if low == high else f"{low} to {high}"


class Each:
    """Some numbers one after the other: ``{errors:.1f}`` becomes "0.2, 3.1, 0.7"."""

    def __init__(self, values: Iterable[Any], between: str = ", ") -> None:
        self.values, self.between = list(values), between

    def __format__(self, form: str) -> str:
        return self.between.join(format(value, form) for value in self.values)


def listed(texts: Sequence[str]) -> str:
    """Join texts as a person does: "a, b and c"."""
    return " and ".join([*filter(None, [", ".join(texts[:-1])]), *texts[-1:]])


class Prose:
    """The words of a page.

    The file has the tables ``measure`` (each with ``of``, ``demanded`` and ``reached``), ``note`` (``title`` and
    ``text``, its paragraphs parted by empty lines), ``figure`` (``title`` and ``caption``) and ``table`` (``title`` and
    ``columns``). Texts are format strings.
    """

    def __init__(self, module: str) -> None:
        self._words = tomllib.loads(Path(module).with_name("page.toml").read_text(encoding="utf-8"))

    def text(self, name: str, /, **numbers: Any) -> str:
        """A text by its dotted name, with its numbers."""
        found: Any = self._words
        for part in name.split("."):
            found = found[part]
        return _filled(found, numbers)

    def row(self, name: str, passed: bool, /, **numbers: Any) -> Row:
        """A measure beside its goal."""
        words = {key: _filled(text, numbers) for key, text in self._words["measure"][name].items()}
        return Row(measure=words["of"], demanded=words["demanded"], reached=words["reached"], passed=bool(passed))

    def note(self, name: str, /, **numbers: Any) -> Note:
        """A note of one or more paragraphs."""
        words = self._words["note"][name]
        paragraphs = [_filled(text, numbers) for text in re.split(r"\n\s*\n", words["text"].strip())]
        return Note(title=words["title"], paragraphs=paragraphs)

    def drawing(self, figure: Figure, name: str, called: str = "", /, **numbers: Any) -> Drawing:
        """A drawn figure with its title and caption; it may be called otherwise than its words."""
        words = self._words["figure"][name]
        title, caption = (_filled(words[part], numbers) for part in ("title", "caption"))
        return Drawing.of(figure, called or name, title, caption)

    def table(self, name: str, rows: Sequence[Sequence[str]], /, *more: str, **numbers: Any) -> Table:
        """A table under its title, with further columns after those that the file names."""
        words = self._words["table"][name]
        columns = [*(_filled(column, numbers) for column in words["columns"]), *more]
        return Table(title=_filled(words["title"], numbers), columns=columns, rows=rows)


def _filled(text: str, numbers: dict[str, Any]) -> str:
    return re.sub(r"[ \n]+", " ", text.strip()).format(**numbers)

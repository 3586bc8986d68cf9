"""Texts of a page from files next to the scenario, with numbers by name: a TOML file of lines, a template of notes."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from numpy.typing import ArrayLike

from deatwin.plant.drawing import Figure
from deatwin.plant.words import listed
from deatwin.studies.report.drawing import Drawing
from deatwin.studies.report.story import Measure, Note, Table
from deatwin.studies.report.tables import drawn_table

_HEADING = re.compile(r"^## +(.+)$", re.MULTILINE)
_CODE = re.compile(r"^```\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def notes(package: str, name: str = "notes.md.j2", /, **numbers: Any) -> list[Note]:
    """Read a page's notes from a template: ``## `` begins a note, blank lines part paragraphs, a fence of backticks
    holds code, ``{{ x|form(".2f") }}`` shows a number."""
    source = files(package).joinpath(name).read_text(encoding="utf-8")
    _, *parts = _HEADING.split(rendered(source, **numbers))
    return [_note(title, text) for title, text in zip(parts[::2], parts[1::2], strict=True)]


def rendered(source: str, /, **numbers: Any) -> str:
    """Fill the numbers into a template."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, autoescape=False)
    environment.filters |= {"form": format, "listed": listed}
    return environment.from_string(source).render(**numbers)


def _note(title: str, text: str) -> Note:
    code = _CODE.search(text)
    paragraphs = [" ".join(one.split()) for one in _CODE.sub("", text).split("\n\n")]
    return Note(title=title.strip(), paragraphs=[*filter(None, paragraphs)], code=code[1] if code else "")


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
    """Numbers one after the other: ``{errors:.1f}`` becomes "0.2, 3.1, 0.7"; tuples are joined by "and"."""

    def __init__(self, values: Iterable[Any]) -> None:
        self.values = list(values)

    def __format__(self, form: str) -> str:
        parts = (one if isinstance(one, tuple) else (one,) for one in self.values)
        return ", ".join(" and ".join(format(number, form) for number in part) for part in parts)


class Words:
    """A package's ``words.toml`` of format strings: tables ``measure.NAME`` (``of``, ``demanded``, ``reached``),
    ``figure.NAME`` (``title``, ``caption``), ``table.NAME`` (``title``, ``columns``); lines are joined."""

    def __init__(self, package: str) -> None:
        self._words = tomllib.loads(files(package).joinpath("words.toml").read_text(encoding="utf-8"))

    def text(self, name: str, /, **numbers: Any) -> str:
        """Return a text by its dotted name."""
        return _filled(self._found(name), numbers)

    def texts(self, name: str, /, **numbers: Any) -> tuple[str, ...]:
        """Return several texts by their dotted name."""
        return tuple(_filled(text, numbers) for text in self._found(name))

    def _found(self, name: str) -> Any:
        found: Any = self._words
        for part in name.split("."):
            found = found[part]
        return found

    def measure(self, name: str, passed: bool, /, **numbers: Any) -> Measure:
        """Make a measure with its goal."""
        measure, demanded, reached = (self.text(f"measure.{name}.{part}", **numbers) for part in _MEASURE)
        return Measure(measure, demanded, reached, bool(passed))

    def drawing(
        self,
        figure: Figure,
        name: str,
        columns: Mapping[str, ArrayLike] | str | None = None,
        called: str = "",
        /,
        **numbers: Any,
    ) -> Drawing:
        """Make a figure with title, caption and data (those it draws by default); figures may share a text."""
        title, caption = (self.text(f"figure.{name}.{part}", **numbers) for part in ("title", "caption"))
        data = drawn_table(figure) if columns is None else columns
        return Drawing.of(figure, called or name, title, caption, data)

    def table(self, name: str, rows: Sequence[Sequence[str]], /, *more: str, **numbers: Any) -> Table:
        """Make a table; `more` lists columns after those in the file."""
        columns = [*(_filled(column, numbers) for column in self._words["table"][name]["columns"]), *more]
        return Table(title=self.text(f"table.{name}.title", **numbers), columns=columns, rows=rows)


_MEASURE = ("of", "demanded", "reached")


def _filled(text: str, numbers: Mapping[str, Any]) -> str:
    return re.sub(r"[ \n]+", " ", text.strip()).format_map(numbers)

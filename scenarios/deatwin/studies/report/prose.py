"""Text of a page from a template next to the scenario, with numbers by name."""

from __future__ import annotations

import re
from importlib.resources import files
from typing import Any

from deatwin.studies.report.story import Note

_HEADING = re.compile(r"^## +(.+)$", re.MULTILINE)
_CODE = re.compile(r"^```\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def listed(texts: list[str]) -> str:
    """Join texts in words.

    >>> listed(["A", "B", "C"]), listed(["A"]), listed([])
    ('A, B and C', 'A', '')
    """
    return " and ".join([*filter(None, [", ".join(texts[:-1])]), *texts[-1:]])


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

"""The pages of the documents, their blocks of code, and the calls of ``deatwin`` on them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")])
FENCE = re.compile(r"^```(\w+)(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@cache
def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> Iterator[tuple[str | None, str]]:
    """Titles and texts of the fenced blocks of a language."""
    for found in FENCE.finditer(text_of(page)):
        if found[1] == language:
            yield found[2], found[3]


def commands(page: Path) -> Iterator[list[str]]:
    """Arguments of all calls of ``deatwin`` in shell blocks and in running text."""
    lines = [part for _, block in blocks(page, "sh") for line in block.splitlines() for part in line.split("&&")]
    lines += re.findall(r"`(deatwin\s[^`]+)`", FENCE.sub("", text_of(page)))
    for line in lines:
        words = shlex.split(line.replace("\n", " "))
        if words and Path(words[0]).name == "deatwin":
            yield words[1:]

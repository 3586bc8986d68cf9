"""What tests ask of a page without a browser."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path


class Page(HTMLParser):
    """Tags, headings, ids and addresses; every element is closed where it was opened."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.headings: list[str] = []
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        assert self.open == []
        assert len(self.ids) == len(set(self.ids))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in ("meta", "br", "wbr"):
            self.open.append(tag)
        self.ids += [value or "" for name, value in attrs if name == "id"]
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


def report_alone(folder: Path) -> tuple[Page, str]:
    """The report of a folder and its text, after a look that it needs nothing beside the folder's own files."""
    text = (folder / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    page = Page(text)
    assert page.tags.count("h1") == 1
    assert not {"link", "img", "iframe"} & set(page.tags) and page.tags.count("script") == 1
    for address in page.addresses:
        assert address[1:] in page.ids if address.startswith("#") else (folder / address).is_file(), address
    assert "@import" not in text and len(text) < 5e6
    assert not re.search(r"#010a0\d", text)  # every colour of the figures is one of the page's
    return page, text


def story_page(folder: Path, figures: tuple[str, ...] | list[str], drawn: int | None = None) -> str:
    """The page of a story, after a look that it shows so many figures, each of these with its data."""
    page = (folder / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert page.count("<figure>") == page.count("<svg ") == (len(figures) if drawn is None else drawn)
    for name in figures:
        header = (folder / f"figures/{name}.csv").read_text(encoding="utf-8").splitlines()[0]
        assert f"figures/{name}.csv" in page and header
    assert (folder / "run.json").is_file()
    return page

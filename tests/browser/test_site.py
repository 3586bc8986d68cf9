"""The site as a reader has it: on a screen and on a phone, light and dark, and on paper.

It is built here, or was built in the folder that ``DEATWIN_SITE`` names, as in ``.ci/run``.
"""

import base64
import html
import importlib
import importlib.util
import inspect
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from public import PUBLIC

pytestmark = pytest.mark.extras

ROOT = Path(__file__).parents[2]
LONG = ("control", "effects", "frequency", "materials", "mismatch", "narx", "plant", "rigs")
"""Pages of the reference of which axe-core takes minutes, and that have the same parts as the other ones."""
SOURCES = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("docs/gallery/*.html.xz")]
PAGES = sorted(
    {path.relative_to(ROOT / "docs").as_posix().partition(".")[0] for path in SOURCES}
    - {f"reference/{name}" for name in LONG}
)
LARGEST = 5_000_000
SCREENS = ((400, "light"), (1400, "dark"))
SWALLOWED = re.compile(r"\n\s*(?:\d+\.|[-*]) \S")
"""The mark of a list's item inside of a paragraph: Markdown wants an empty line before it."""


@pytest.fixture(scope="session")
def site(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; only where there is a browser to look at it."""
    if "DEATWIN_SITE" in os.environ:
        return Path(os.environ["DEATWIN_SITE"])
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed (the extra `docs`)")
    folder = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "--quiet", "-d", str(folder)], cwd=ROOT, check=True)
    return folder


def swallowed(html: str) -> list[str]:
    """Paragraphs and items of lists that hold what was meant as an item of its own."""
    prose = re.sub(r"<(pre|script|style|svg|math)\b.*?</\1>", "", html, flags=re.DOTALL)
    return [text[:80] for text in re.findall(r"<(?:p|li)>(.*?)</(?:p|li)>", prose, re.DOTALL) if SWALLOWED.search(text)]


def shown(tab: Any, page: Path, width: int, scheme: str) -> None:
    """Open a page as a reader who comes for the first time."""
    tab.size(width)
    tab.media(scheme=scheme)
    tab.open(page)
    tab.run("localStorage.clear()")
    tab.open(page)


def cut_on_paper(tab: Any) -> list[str]:
    """Tables that are wider than the page."""
    return list(
        tab.run("""
        const right = document.documentElement.clientWidth;
        return [...document.querySelectorAll("article table")]
            .filter(table => table.getBoundingClientRect().right > right + 1)
            .map(table => table.innerText.slice(0, 60));
    """)
    )


def scrolled(tab: Any, selector: str) -> list[str]:
    """What is wider than the place that the page has for it; there must be something to look at."""
    found = tab.run(
        """
        const parts = [...document.querySelectorAll(arguments[0])];
        if (!parts.length) return ["nothing"];
        return parts.filter(part => part.scrollWidth > part.clientWidth + 1).map(part => part.innerText.slice(0, 60));
    """,
        selector,
    )
    return list(found)


def test_no_list_is_swallowed_by_a_paragraph(site: Path) -> None:
    assert swallowed("<ol><li><p>one</p><p>more\n2. two</p></li></ol>") == ["more\n2. two"]
    found = {page.name: swallowed(page.read_text(encoding="utf-8")) for page in site.rglob("*.html")}
    assert {name: texts for name, texts in found.items() if texts} == {}


def defaults(page: str) -> dict[str, dict[str, str]]:
    """What a page of the reference says of the defaults of each function's or class's parameters."""
    names, tables = re.split(r'<h\d id="(deatwin\.[\w.]+)"', page)[1:], re.compile(r"<table>.*?</table>", re.DOTALL)
    row = re.compile(r'"Name">\s*<code>\W*(\w+)</code>.*?"Default">(.*?)</td>', re.DOTALL)
    shown = {name: tables.search(body) for name, body in zip(names[::2], names[1::2], strict=True)}
    return {
        name: {one: html.unescape(re.sub(r"<[^>]+>", "", said)).strip() for one, said in row.findall(table[0])}
        for name, table in shown.items()
        if table
    }


def test_each_parameter_has_its_own_default_in_the_reference(site: Path) -> None:
    packages = [(package, importlib.import_module(package)) for package in PUBLIC]
    exported = {f"{path}.{name}": getattr(package, name) for path, package in packages for name in package.__all__}
    pages = [page.read_text(encoding="utf-8") for page in (site / "reference").glob("*.html")]
    wrong, right = [], 0
    for name, said in ((name, said) for page in pages for name, said in defaults(page).items() if name in exported):
        for one, parameter in inspect.signature(exported[name]).parameters.items():
            if one not in said or type(parameter.default) not in (bool, int, type(None)):
                continue
            needed = (name, one) == ("deatwin.plant.foreign.ForeignRig", "sizes")  # None only stands for "not given"
            same = said[one] == ("required" if needed else repr(parameter.default))
            right += same
            wrong += [] if same else [(name, one, said[one], parameter.default)]
    assert wrong == []
    assert right > 300


def test_the_reference_shows_exports_instead_of_modules_of_the_same_name(site: Path) -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in (site / "reference").glob("*.html"))
    shown_names = {name.rpartition(".")[2] for name in re.findall(r'<h\d id="(deatwin\.[\w.]+)"', text)}
    assert shown_names >= {name for package in PUBLIC for name in importlib.import_module(package).__all__}
    assert "doc-module" not in text
    assert re.findall(r'<div class="doc-md-description">\s*</div>', text) == []


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_accessible_on_every_screen(name: str, site: Path, tab: Any, axe: Callable[[], list[str]]) -> None:
    page = site / f"{name}.html"
    assert page.stat().st_size < LARGEST
    for width, scheme in SCREENS:
        shown(tab, page, width, scheme)
        assert [asked for asked in tab.requests() if not asked.startswith("file:")] == []
        assert tab.overflow() == 0, (width, scheme)
        assert axe() == [], (width, scheme)


@pytest.mark.parametrize(
    "name", ["concealed-physics", "how-to/files-and-export", "how-to/own-csv", "reference/foreign"]
)
def test_no_table_is_cut_off_on_a_phone_or_a_screen(name: str, site: Path, tab: Any) -> None:
    for width in (400, 1400):
        shown(tab, site / f"{name}.html", width, "light")
        assert scrolled(tab, "article table, .md-typeset__scrollwrap") == [], width
    stacked = "[...document.querySelectorAll('article td[data-label]')].map(cell => getComputedStyle(cell).display)"
    assert set(tab.run(f"return {stacked}")) <= {"table-cell"}
    tab.size(400)
    assert set(tab.run(f"return {stacked}")) <= {"block", "none"}  # an empty cell is not shown


@pytest.mark.parametrize("name", ["index", "architecture"])
def test_a_drawing_is_not_shrunk_on_a_phone(name: str, site: Path, tab: Any) -> None:
    """Its words are legible at 36 times the size of the page's letters, and it scrolls by itself, also by the keyboard."""
    shown(tab, site / f"{name}.html", 400, "light")
    rem = tab.run("return parseFloat(getComputedStyle(document.documentElement).fontSize)")
    drawing = "document.querySelector('p > img[src$=\".svg\"]')"
    assert tab.run(f"return {drawing}.clientWidth") == pytest.approx(36 * rem, abs=1)
    assert tab.run(f"return {drawing}.parentElement.tabIndex") == 0
    assert tab.overflow() == 0


def test_what_deatwin_prints_is_not_cut_off(site: Path, tab: Any) -> None:
    for width in (400, 1400):
        shown(tab, site / "tutorial.html", width, "light")
        assert scrolled(tab, ".language-text pre > code, .language-sh pre > code") == [], width


@pytest.mark.parametrize("name", ["validation", "gallery", "reference/effects", "how-to/run-a-study"])
def test_a_page_is_printed_whole_and_in_the_colours_of_paper(name: str, site: Path, tab: Any) -> None:
    shown(tab, site / f"{name}.html", 700, "dark")  # an A4 page within its margins
    tab.media("print", "dark")
    assert cut_on_paper(tab) == []
    series = tab.run(
        "const one = document.querySelector('.gallery .series1'); return one && getComputedStyle(one).color"
    )
    assert series in (None, "rgb(194, 65, 12)")
    schemes = "return [document.documentElement, document.body].map(part => getComputedStyle(part).colorScheme)"
    assert tab.run(schemes) == ["light", "light"]  # also that of figures, and of the paper around the page
    first = tab.browser.execute_cdp_cmd("Page.printToPDF", {"pageRanges": "1"})
    assert len(base64.b64decode(first["data"])) > 10_000  # an empty page has fewer


def test_no_option_is_broken_in_code(site: Path, tab: Any) -> None:
    shown(tab, site / "how-to/machines.html", 400, "light")
    lines = "[...document.querySelectorAll('pre .option')].map(option => option.getClientRects().length)"
    assert set(tab.run(f"return {lines}")) == {1}

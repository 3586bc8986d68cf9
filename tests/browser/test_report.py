"""Reports as a reader has them: on a screen and on a phone, light and dark, on paper, and without a net.

Those of commands and of three scenarios that are made small here. ``-m study`` looks at those of all scenarios, which
take an hour and a half to run; with ``DEATWIN_REPORTS=FOLDER`` they are kept there, and read from there the next time.
"""

from __future__ import annotations

import base64
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from strips import COLUMNS, MODULE, pulled, strip, write

from deatwin.app.stories import stories
from deatwin.plant import Creep
from deatwin.plant.recording import Experiment
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.story import StoryPage, Table, write_story

pytestmark = pytest.mark.extras

SCREENS = ((400, "light", True), (1400, "dark", True), (400, "dark", False), (1400, "light", False))
"""Width, scheme, and whether axe-core looks too: what it looks at differs by width or by scheme, not by both."""
LARGEST = 5_000_000
LESSENED = ("regression-lessons", "prestretch-sweep", "svb-benchmark")
REPORTS = ("diagnose", "identify", "check", "frequency", *LESSENED)


def commands(folder: Path) -> None:
    """Run the commands that write reports, on a strip whose creep its plant does not have."""
    from deatwin.app.cli import main
    from deatwin.studies.diagnosing import DiagnosisTask
    from deatwin.studies.folder import ResultFolder

    nominal = strip()
    (folder / "strip_of_mine.py").write_text(MODULE, encoding="utf-8")
    creeps = nominal.with_effects(Creep(modulus=60e3, time=25.0))
    made = {"noise": pulled(nominal, 1, 10), "creeping": pulled(creeps, 2, 10)}
    for name, record in made.items():
        write(folder / f"{name}.csv", record)
    task = DiagnosisTask(
        plant=nominal,
        experiments=[Experiment(recordings=(made["creeping"],))],
        files=[folder / "creeping.csv"],
        command=["deatwin", "diagnose", "strip_of_mine:strip", "creeping.csv"],
        effects=[Creep()],
    )
    task.run(ResultFolder(folder / "diagnose"), lambda *_: None)
    for line in (
        ["identify", "noise.csv", *COLUMNS, "--method", "frols", "--out", "narx.json", "--report", "identify"],
        ["check", "narx.json", "--plant", "strip_of_mine:strip", "--out", "check"],
        ["frequency", "narx.json", "--order", "2", "--out", "frequency"],
    ):
        assert main([*line, "--quiet"]) == 0


def told(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """Run three stories, with less work where they can be had with less."""
    from deatwin.app.stories import story
    from deatwin.scenarios import prestretch, svb_benchmark
    from deatwin.scenarios.regression_lessons import occam, variance
    from deatwin.scenarios.svb_benchmark import draws
    from deatwin.scenarios.svb_benchmark.study import Plan
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.stories import Setting

    small = Plan(systems=("S2", "E1"), methods=("fro", "svb"), draws=1, swept_draws=1, sampled_draws=1, levels=(0.004,))
    for module, name, less in (
        (variance, "DRAWS", 10),
        (occam, "DRAWS", 20),
        (occam, "JUDGED", 4),
        (prestretch, "PRESTRETCHES", np.linspace(1.0, 5.0, 3)),
        (prestretch, "RATIOS", np.linspace(1.0, 3.0, 2)),
        (svb_benchmark, "PLAN", small),
        (draws, "FLIPS", 300),
    ):
        patch.setattr(module, name, less)
    for name in LESSENED:
        story(name).run(
            Setting(
                folder=ResultFolder(folder / name),
                data=None,
                command=["deatwin", "scenario", name],
                jobs=1,
                seed=0,
                progress=lambda *_: None,
            )
        )


@pytest.fixture(scope="session")
def reports(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a folder for each report; made only where there is a browser to look at them."""
    folder = tmp_path_factory.mktemp("reports")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        commands(folder)
        told(folder, patch)
    return folder


@pytest.fixture(params=[*REPORTS, *(pytest.param(f"scenario {name}", marks=pytest.mark.study) for name in stories())])
def report(request: pytest.FixtureRequest) -> Path:
    """One of the reports; in a study those of all scenarios too."""
    kind = str(request.param)
    if kind in REPORTS:
        return Path(request.getfixturevalue("reports")) / kind / "report.html"
    return Path(request.getfixturevalue("scenario")(kind.removeprefix("scenario "))) / "report.html"


# Each of these looks at the page that is open and returns what is wrong with it.


def troubles(tab: Any) -> list[str]:
    """Errors of scripts and policy, requests, and what stands out of the page to the right."""
    wide = [f"{tab.overflow()} pixels too wide"] if tab.overflow() > 0 else []
    return [*tab.errors(), *(f"asks for {address}" for address in tab.requests()), *wide]


def figures_missing(tab: Any, folder: Path) -> list[str]:
    """Figures that are not drawn, have no data, or data of the folder that no figure leads to."""
    found = tab.run("""return [...document.querySelectorAll("figure")].map(figure => {
        const svg = figure.querySelector("svg"), box = svg?.getBoundingClientRect();
        return {title: figure.querySelector("h3")?.textContent, width: box?.width ?? 0, height: box?.height ?? 0,
                strokes: svg?.querySelectorAll("path").length ?? 0,
                data: [...figure.querySelectorAll("a.data")].map(link => link.getAttribute("href"))};
    })""")
    wrong = [f"{f['title']}: not drawn" for f in found if f["width"] < 200 or f["height"] < 80 or f["strokes"] < 10]
    wrong += [f"{f['title']}: no data" for f in found if not f["data"]]
    linked = {name for f in found for name in f["data"]}
    there = {p.relative_to(folder).as_posix() for p in (folder / "figures").glob("*.csv")}
    wrong += [f"{name}: a figure's data, but no figure" for name in sorted(there - linked)]
    return wrong + [f"{name}: no such file" for name in sorted(linked) if not (folder / name).is_file()]


def illegible(tab: Any) -> list[str]:
    """Words (4.5 to 1) and opaque lines (3 to 1) of figures that do not stand out from what is behind them."""
    return list(
        tab.run("""
        const canvas = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
        const light = (colour) => {
            canvas.fillStyle = colour; canvas.fillRect(0, 0, 1, 1);
            const [r, g, b] = [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3).map(v => v / 255)
                .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
            return 0.2126 * r + 0.7152 * g + 0.0722 * b;
        };
        const known = new Map(), level = (colour) => {
            if (!known.has(colour)) known.set(colour, light(colour));
            return known.get(colour);
        };
        const over = (words, image) => {  // the shade of a map below the middle of words, or null beside it
            const text = words.getBoundingClientRect(), map = image.getBoundingClientRect();
            const x = text.x + text.width / 2 - map.x, y = text.y + text.height / 2 - map.y;
            if (x < 0 || y < 0 || x >= map.width || y >= map.height) return null;
            const flipped = image.getCTM().d < 0, shot = document.createElement("canvas").getContext("2d");
            shot.canvas.width = Math.ceil(map.width); shot.canvas.height = Math.ceil(map.height);
            shot.drawImage(image, 0, 0, map.width, map.height);
            const place = [Math.floor(x), Math.floor(flipped ? map.height - 1 - y : y)];
            const [r, g, b, a] = shot.getImageData(...place, 1, 1).data;
            return a === 255 ? `rgb(${r} ${g} ${b})` : null;
        };
        const faint = new Set();
        for (const figure of document.querySelectorAll("figure")) {
            const behind = level(getComputedStyle(figure).backgroundColor);
            const title = figure.querySelector("h3").textContent;
            const contrast = (colour, ground = behind) => {
                const [low, high] = [ground, level(colour)].sort((a, b) => a - b);
                return (high + 0.05) / (low + 0.05);
            };
            const images = [...figure.querySelectorAll("svg image")];
            for (const words of figure.querySelectorAll("svg text")) {
                const map = images.map(image => over(words, image)).find(Boolean);
                const found = contrast(getComputedStyle(words).fill, map ? level(map) : behind);
                if (found < 4.5) faint.add(`${title}: "${words.textContent.trim()}" ${found.toFixed(2)}`);
            }
            for (const line of figure.querySelectorAll("svg [id*=line2d_] > path")) {
                const style = getComputedStyle(line);
                if (style.stroke === "none" || style.strokeOpacity < 1) continue;
                const written = line.getAttribute("style") ?? "", share = written.match(/--ink\\) (\\d+)%/)?.[1] ?? 100;
                if (written.includes("var(--grid)") || share <= 20) continue;  // guides: faint on purpose
                const found = contrast(style.stroke);
                if (found < 3) faint.add(`${title}: a line in ${style.stroke} ${found.toFixed(2)}`);
            }
        }
        return [...faint];
    """)
    )


def too_small(tab: Any) -> list[str]:
    """Words of figures whose letters are less than half as large as those of the page."""
    return list(
        tab.run("""
        const least = parseFloat(getComputedStyle(document.body).fontSize) / 2, wrong = new Set();
        for (const words of document.querySelectorAll("figure svg text")) {
            const { a, b } = words.getScreenCTM(), size = parseFloat(getComputedStyle(words).fontSize) * Math.hypot(a, b);
            if (words.textContent.trim() && size < least) wrong.add(`"${words.textContent.trim()}" ${size.toFixed(1)}`);
        }
        return [...wrong];
    """)
    )


def lost_on_paper(tab: Any) -> list[str]:
    """What is hidden, dark or cut when the page is printed; the print's look is on."""
    return list(
        tab.run("""
        const wrong = [], right = document.documentElement.clientWidth;
        for (const figure of document.querySelectorAll("figure")) {
            const box = figure.querySelector("svg").getBoundingClientRect();
            const title = figure.querySelector("h3").textContent;
            if (box.width < 200 || box.height < 80) wrong.push(`${title}: not printed`);
            if (box.right > right + 1) wrong.push(`${title}: cut`);
            if (getComputedStyle(figure).breakInside !== "avoid") wrong.push(`${title}: breaks over pages`);
        }
        if (getComputedStyle(document.body).backgroundColor !== "rgb(255, 255, 255)") wrong.push("dark paper");
        for (const tools of document.querySelectorAll(".tools, a.data"))
            if (tools.getClientRects().length) wrong.push("buttons or links to data are printed");
        for (const more of document.querySelectorAll("details > :not(summary)"))
            if (!more.checkVisibility({contentVisibilityAuto: true})) wrong.push("a closed part is not printed");
        for (const table of document.querySelectorAll("table"))
            if (table.getBoundingClientRect().right > right + 1) wrong.push("a table is cut");
        return wrong;
    """)
    )


def provenance_missing(tab: Any) -> list[str]:
    """What the end of the page does not say."""
    end = str(
        tab.run("""const last = [...document.querySelectorAll("h2")].pop();
        return last?.textContent === "Provenance" ? last.nextElementSibling.textContent : "" """)
    )
    rows = {"command": r"command\s*deatwin \w+", "seed": r"seed\s*\d", "versions": r"numpy \d+\.\d+"}
    return [name for name, pattern in rows.items() if not re.search(pattern, end)]


def view_boxes(tab: Any) -> list[str]:
    return list(tab.run("return [...document.querySelectorAll('figure svg')].map(s => s.getAttribute('viewBox'))"))


ARROW = "frame.dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowRight', bubbles: true}))"


def zoom_fails(tab: Any) -> list[str]:
    """Ways to zoom that leave a figure as it is, and ways back that do not lead back."""
    whole, wrong = view_boxes(tab), []
    ways = {
        "button": "figure.querySelector('.tools button').click()",
        "key": "frame.dispatchEvent(new KeyboardEvent('keydown', {key: '+', bubbles: true, cancelable: true}))",
        "wheel": "svg.dispatchEvent(new WheelEvent('wheel', {deltaY: -200, ctrlKey: true, bubbles: true, "
        "cancelable: true, clientX: box.x + 9, clientY: box.y + 9}))",
        "pinch": "touch('pointerdown', 1, 100); touch('pointerdown', 2, 200); touch('pointermove', 2, 300); "
        "touch('pointerup', 1, 100); touch('pointerup', 2, 300)",
    }
    begin = """const figure = document.querySelectorAll('figure')[arguments[0]], svg = figure.querySelector('svg');
        const frame = figure.querySelector('.view'), box = svg.getBoundingClientRect();
        svg.setPointerCapture = () => {};
        const touch = (kind, id, x) => svg.dispatchEvent(new PointerEvent(kind,
            {pointerId: id, pointerType: 'touch', clientX: box.x + x, clientY: box.y + 60, bubbles: true}));
    """
    back = "[...figure.querySelectorAll('.tools button')].find(b => b.title === 'whole figure').click()"
    for number in range(len(whole)):
        for name, way in ways.items() if number == 0 else [("button", ways["button"])]:
            try:
                tab.run(begin + way, number)
                if view_boxes(tab)[number] == whole[number]:
                    wrong.append(f"figure {number}: the {name} does not zoom")
                width = float(view_boxes(tab)[number].split()[2])
                tab.run(begin + ARROW, number)
                moved = view_boxes(tab)[number].split()
                if float(moved[2]) != width or view_boxes(tab)[number] == whole[number]:
                    wrong.append(f"figure {number}: the arrows do not move it")
                tab.run(begin + back, number)
            except Exception as error:
                wrong.append(f"figure {number}: {name}: {str(error).splitlines()[0]}")
            if [float(v) for v in view_boxes(tab)[number].split()] != [float(v) for v in whole[number].split()]:
                wrong.append(f"figure {number}: it is not restored")
    return wrong


def downloads_wrong(tab: Any, folder: Path, into: Path) -> list[str]:
    """Data that a click does not give, or gives otherwise than in the folder."""
    tab.browser.execute_cdp_cmd("Browser.setDownloadBehavior", {"behavior": "allow", "downloadPath": str(into)})
    wrong = []
    links = "[...document.querySelectorAll('a.data')]"
    for number, name in enumerate(dict.fromkeys(tab.run(f"return {links}.map(a => a.getAttribute('href'))"))):
        if number and number % 10 == 0:  # Chromium gives scripts no more of one page
            tab.browser.get(tab.browser.current_url)
        got = into / Path(name).name
        tab.run(f"{links}.find(a => a.getAttribute('href') === arguments[0]).click()", name)
        limit = time.monotonic() + 10
        while wrongly := not got.is_file() or got.read_bytes() != (folder / name).read_bytes():
            if time.monotonic() > limit:
                break
            time.sleep(0.02)
        if wrongly:
            wrong.append(f"{name}: not what the folder has")
    return wrong


def test_a_report_is_sound_on_every_screen(report: Path, tab: Any, axe: Callable[[], list[str]]) -> None:
    assert report.stat().st_size < LARGEST
    for width, scheme, rules in SCREENS:
        tab.size(width)
        tab.media(scheme=scheme)
        tab.open(report)
        assert troubles(tab) == [], (width, scheme)
        assert figures_missing(tab, report.parent) == [], (width, scheme)
        assert illegible(tab) == [], (width, scheme)
        assert too_small(tab) == [], (width, scheme)
        if rules:
            assert axe() == [], (width, scheme)
    assert provenance_missing(tab) == []


def test_on_a_phone_labels_that_are_longer_than_their_values_get_more_room(tab: Any, tmp_path: Path) -> None:
    """A screen of 400 pixels has lines of about 50 letters, so a label of 52 letters beside a short value takes two."""
    columns = [
        "effect",
        "smallest detected strength",
        "change of the reading at the typical strength (µm rms)",
        "outcome",
    ]
    table = Table(title="Effects", columns=columns, rows=[["creep", "20.6 kPa", "34.2", "not detected"]])
    page = StoryPage(title="plan", sentence="So.", rows=[], notes=[], figures=[], tables=[table])
    write_story(ResultFolder(tmp_path), page, RunRecord(command=["deatwin"], inputs=[], seed=3, jobs=1))
    tab.size(400)
    tab.open(tmp_path / "report.html")
    heights = tab.run("return [...document.querySelectorAll('.stacks td')].map(cell => cell.clientHeight)")
    assert len(heights) == 4
    assert max(heights) < 2.5 * min(heights)


def test_figures_are_zoomed_and_their_data_downloaded(report: Path, tab: Any, tmp_path: Path) -> None:
    tab.open(report)
    assert zoom_fails(tab) == []
    assert downloads_wrong(tab, report.parent, tmp_path) == []
    assert troubles(tab) == []


def test_a_report_can_be_printed(report: Path, tab: Any) -> None:
    tab.size(700)  # an A4 page within its margins
    tab.media("print", "dark")
    tab.open(report)
    assert lost_on_paper(tab) == []
    assert figures_missing(tab, report.parent) == []
    printed = tab.browser.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})
    assert base64.b64decode(printed["data"]).startswith(b"%PDF")


def test_without_scripts_figures_are_shown_and_links_lead_to_the_files(report: Path, tab: Any) -> None:
    text = report.read_text(encoding="utf-8")
    silent = report.with_name("silent.html")
    silent.write_text(re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL), encoding="utf-8")
    tab.open(silent)
    assert figures_missing(tab, report.parent) == []
    assert not tab.run("return document.querySelectorAll('.tools').length")


def page(body: str, head: str = "<title>x</title>") -> str:
    return f'<!doctype html><html lang="en"><head><meta charset="utf-8">{head}</head><body>{body}</body></html>'


FIGURE = (
    '<figure style="background: #fff"><h3>A</h3><div class="view">'
    '<svg viewBox="0 0 300 100" width="300" height="100" aria-label="A">'
    + '<path d="M0 0L9 9"/>' * 10
    + '<text fill="#ddd" y="50">faint</text></svg></div>'
    + '<a class="data" href="figures/a.csv" download>Data</a></figure>'
)
OTHERWISE = """<script>document.querySelector("a.data").addEventListener("click", event => {
    event.preventDefault();
    Object.assign(document.createElement("a"), {href: "data:text/csv,y", download: "a.csv"}).click();
})</script>"""


def test_every_check_can_fail(tab: Any, axe: Callable[[], list[str]], words_on_a_map: str, tmp_path: Path) -> None:
    (tmp_path / "figures").mkdir()
    for name in ("a.csv", "b.csv"):
        (tmp_path / "figures" / name).write_text("x\n1\n", encoding="utf-8")

    def opened(text: str) -> None:
        (tmp_path / "page.html").write_text(text, encoding="utf-8")
        tab.open(tmp_path / "page.html")

    opened(page("<script>absent()</script>"))
    assert any("absent is not defined" in trouble for trouble in troubles(tab))
    opened(page('<img alt="x" src="elsewhere.png">'))
    assert any(trouble.endswith("elsewhere.png") for trouble in troubles(tab) if trouble.startswith("asks for"))
    tab.size(400)
    opened(page('<p style="width: 900px">wide</p>'))
    assert troubles(tab) == ["508 pixels too wide"]
    tab.size(1400)
    opened(page("<figure><h3>A</h3></figure>"))
    assert figures_missing(tab, tmp_path) == [
        "A: not drawn",
        "A: no data",
        "figures/a.csv: a figure's data, but no figure",
        "figures/b.csv: a figure's data, but no figure",
    ]
    opened(page(FIGURE))
    assert figures_missing(tab, tmp_path) == ["figures/b.csv: a figure's data, but no figure"]
    assert [line[:11] for line in illegible(tab)] == ['A: "faint" ']
    assert too_small(tab) == []
    opened(page(FIGURE.replace('width="300" height="100"', 'width="120" height="40"')))
    assert too_small(tab) == ['"faint" 6.4']
    opened(page(words_on_a_map))
    assert [line[:12] for line in illegible(tab)] == ['A: "on black', 'A: "on white']
    opened(page(FIGURE))
    assert "figure 0: the key does not zoom" in zoom_fails(tab)
    assert provenance_missing(tab) == ["command", "seed", "versions"]
    tab.media("print", "dark")
    opened(page('<details><summary>s</summary><p>more</p></details><table style="width: 3000px"></table>' + FIGURE))
    assert set(lost_on_paper(tab)) == {
        "A: breaks over pages",
        "dark paper",
        "buttons or links to data are printed",
        "a closed part is not printed",
        "a table is cut",
    }
    tab.media()
    opened(page(FIGURE + OTHERWISE))
    into = tmp_path / "got"
    into.mkdir()
    assert downloads_wrong(tab, tmp_path, into) == ["figures/a.csv: not what the folder has"]
    opened(page("<h1>one</h1><h3>three</h3><p style='color: #ccc'>faint</p>"))
    found = "\n".join(axe())
    assert "heading-order" in found and "color-contrast" in found

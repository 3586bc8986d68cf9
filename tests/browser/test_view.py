"""The live view in a browser: drop a recording, diagnose it, watch, compare verdicts, open the report."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from made_diagnoses import DIAGNOSIS
from strips import pulled, strip, write

from deatwin.plant import CalibratedPlant

pytestmark = pytest.mark.extras

PROGRAM = "import sys; from deatwin.app.cli import main; sys.exit(main(sys.argv[1:]))"
DROP = """
const transfer = new DataTransfer();
transfer.items.add(new File([arguments[0]], arguments[1], {type: "text/csv"}));
const send = (where, what) => where.dispatchEvent(
    new DragEvent(what, {bubbles: true, cancelable: true, dataTransfer: transfer}));
const box = document.querySelector(".q-uploader");
send(box, "dragover");
const done = arguments[arguments.length - 1];
const wait = setInterval(() => {
    const target = document.querySelector(".q-uploader__dnd");
    if (target) { clearInterval(wait); send(target, "drop"); done(); }
}, 20);
"""


def write_lab(folder: Path) -> str:
    """Write a model, and a result of former days; return a recording that is nowhere yet."""
    from deatwin.plant import Creep

    CalibratedPlant.nominal(strip()).save(folder / "strip.json")
    (folder / "strip.json").rename(folder / "model.json")
    for name, plant in (("new.csv", strip()), ("old.csv", strip().with_effects(Creep(modulus=60e3, time=25.0)))):
        write(folder / name, pulled(plant, 3, 7))
    recording = (folder / "new.csv").read_text(encoding="utf-8")
    (folder / "new.csv").unlink()
    former = DIAGNOSIS | {
        "output": {"name": "force", "unit": "N"},
        "sentence": "The film keeps creeping with a relaxation time of 25 s.",
        "fit": {
            "fitted": {"before": 0.17, "after": 0.002},
            "unseen": {"before": 0.14, "after": 0.002, "gain_low": 0.1},
        },
    }
    (folder / "former").mkdir()
    (folder / "former" / "diagnosis.json").write_text(json.dumps(former), encoding="utf-8")
    return recording


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[tuple[Path, str, str]]:
    """A folder that is shown, the page's address, and a recording to drop."""
    if os.environ.get("DEATWIN_BROWSER") != "required":
        pytest.importorskip("nicegui", reason="the live view needs the extra `view`")
    recording = write_lab(tmp_path)
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "view", str(tmp_path), "--no-browser", "--json"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    lines = iter(process.stdout.readline, "")
    text = "".join(line for line in iter(lambda: next(lines, "}\n"), "}\n"))
    try:
        yield tmp_path, json.loads(text + "}")["address"], recording
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    finally:
        process.kill()
        process.communicate()


BACKSPACE = "\ue003"
"""As WebDriver codes that key (W3C, section 17.4.2)."""


def clicked(text: str) -> str:
    """A script that clicks what bears a text, and says whether there was any."""
    return (
        f"const found = [...document.querySelectorAll('button, .q-item__label, [role=option]')]"
        f".find(e => e.innerText.trim() === {json.dumps(text)}); if (found) found.click(); return !!found"
    )


class Page:
    """What a test does on the page."""

    def __init__(self, tab: Any) -> None:
        self.tab = tab

    def until(self, script: str, seconds: float = 60) -> Any:
        """Wait until a script returns something."""
        end = time.monotonic() + seconds
        while not (found := self.tab.run(script)):
            if time.monotonic() > end:
                pytest.fail(f"{script}: {self.tab.run('return document.body.innerText')}")
            time.sleep(0.1)
        return found

    def click(self, text: str) -> None:
        """Click what bears a text."""
        self.until(clicked(text))

    def choose(self, label: str, beginning: str, option: str) -> None:
        """Type the beginning of an option in the field of a label, and take it.

        A page that answers the choice before takes the focus, and with it the list: it is typed again then.
        """
        for _ in range(6):
            self.field(label).send_keys(beginning)
            end = time.monotonic() + 5
            while time.monotonic() < end:
                if self.tab.run(clicked(option)):
                    return
                time.sleep(0.1)
            self.field(label).send_keys(BACKSPACE * len(beginning))
        pytest.fail(f"{label} offers no {option}: {self.tab.run('return document.body.innerText')}")

    def field(self, label: str) -> Any:
        """The field of a label."""
        return self.until(f"return document.querySelector('input[aria-label^={json.dumps(label)}]')")

    def drop(self, text: str, name: str) -> None:
        """Drop a file on the page."""
        self.tab.browser.execute_async_script(DROP, text, name)

    def says(self, selector: str, text: str, seconds: float = 60) -> str:
        """Wait until something says a text."""
        words = f"[...document.querySelectorAll({json.dumps(selector)})].map(e => e.innerText).join('\\n')"
        return str(self.until(f"const t = {words}; return t.includes({json.dumps(text)}) ? t : ''", seconds))


def uncut(page: Page) -> None:
    """No label of a field is cut off on a phone or a screen, whether its field is empty or not."""
    page.until("const field = document.querySelector('.fields input'); return field && field.offsetHeight")
    cut = "return [...document.querySelectorAll('.q-field__label')].filter(e => e.scrollWidth > e.clientWidth).length"
    for width in (400, 1400):
        page.tab.size(width)
        assert page.tab.run(cut) == 0, width


def test_a_recording_is_dropped_diagnosed_and_compared(
    lab: tuple[Path, str, str], tab: Any, axe: Callable[[], list[str]]
) -> None:
    folder, address, recording = lab
    tab.open(address)
    page = Page(tab)
    page.says(".compared", "The film keeps creeping")  # what lies there is shown
    page.click("Columns, clock, units")
    uncut(page)
    page.click("Columns, clock, units")

    page.drop(recording, "../new.csv")  # with columns of names that nobody knows: it is kept, and they are asked for
    page.says("section", 'new.csv: no column "command_V"; the file has "time_s", "stretch", "force_N"')
    page.says(".q-chip", "new.csv")
    assert (folder / "new.csv").read_text(encoding="utf-8") == recording
    assert page.until("return document.querySelector('.glance svg')")
    page.says(".columns", "stretch")
    assert page.field("Input,").get_attribute("value") == "stretch"
    assert page.field("Output,").get_attribute("value") == "force_N"
    uncut(page)

    page.choose("Rig file", "model", "model.json")
    page.click("Diagnose")
    page.says(".job", "running")
    page.says(".job", "calibrating the model", 120)
    page.says(".job .verdict", "done", 180)
    table = page.says(".compared", "result-1")
    assert "no missing physics" in table and "The film keeps creeping" in table and "0.140 → 0.00200 N" in table
    assert (folder / "result-1" / "run.json").is_file()
    page.until("return document.querySelectorAll('.compared svg').length === 2")
    look_at(tab, axe)

    assert tab.errors() == []
    own = re.match(r"http://127\.0\.0\.1:\d+/", address)[0]  # type: ignore[index]
    asked = tab.requests()
    assert asked and [url for url in asked if not url.startswith((own, own.replace("http", "ws")))] == []
    tab.open(page.until("return document.querySelector('.job a').href"))
    assert "no missing physics" in tab.run("return document.querySelector('h1').innerText")
    assert tab.errors() == []


def look_at(tab: Any, axe: Callable[[], list[str]]) -> None:
    """The page is as wide as the view in light and dark, and readable."""
    pictures = os.environ.get("DEATWIN_PICTURES")
    for scheme in ("light", "dark"):
        tab.media(scheme=scheme)
        for width in (400, 1400):
            tab.size(width)
            time.sleep(0.5)  # Quasar's transitions of colour
            assert tab.overflow() <= 0, (scheme, width)
            if pictures:
                tab.browser.save_screenshot(f"{pictures}/view-{scheme}-{width}.png")
        assert axe() == [], scheme


def test_a_running_diagnosis_is_cancelled(lab: tuple[Path, str, str], tab: Any) -> None:
    folder, address, _ = lab
    tab.open(address)
    page = Page(tab)
    page.choose("Recordings", "old", "old.csv")
    page.says(".q-chip", "old.csv")
    page.until("return document.querySelector('input[aria-label^=\"Output,\"]').value === 'force_N'")
    page.choose("Rig file", "model", "model.json")
    page.click("Diagnose")
    page.click("Cancel")
    page.says(".job .verdict", "cancelled")
    assert not (folder / "result-1").exists() and (folder / "former" / "diagnosis.json").is_file()

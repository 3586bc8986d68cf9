"""Headless Chromium for the tests of this folder, what it logs, and the accessibility check that runs in it.

Without Chromium, its driver or the extra ``browser`` the tests are skipped. With ``DEATWIN_BROWSER=required`` in the
environment, as in ``.ci/run``, they fail instead.
"""

from __future__ import annotations

import base64
import importlib.util
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from matplotlib.image import imsave

from deatwin.app.stories import stories

NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)
AXE_PACKAGE = "axe_playwright_python"
"""Carries a current axe.min.js; nothing of it is imported."""
LEVELS = ["wcag2a", "wcag2aa"]
HEADINGS = ["heading-order", "empty-heading", "page-has-heading-one"]
RESULTS = "DEATWIN_REPORTS"
"""Names a folder with a folder of results for each scenario, as ``deatwin scenario NAME --out FOLDER/NAME`` leaves it;
the study reads those that are there, and runs the others into it."""
RAW = ("cases", "trials", "running")
"""Folders of results that no report leads to."""


def _without(reason: str) -> NoReturn:
    if os.environ.get("DEATWIN_BROWSER") == "required":
        pytest.fail(f"DEATWIN_BROWSER=required, but {reason}", pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A selenium WebDriver of headless Chromium, 1400 by 1000 pixels, that logs console and network."""
    binary = next(filter(None, map(shutil.which, NAMES)), None)
    driver = shutil.which("chromedriver")
    if importlib.util.find_spec("selenium") is None:
        _without("selenium is not installed (the extra `browser`)")
    if binary is None or driver is None:
        _without("Chromium or its driver is not installed (Debian: chromium, chromium-driver)")
    from selenium import webdriver

    with tempfile.TemporaryDirectory(prefix="deatwin-browser-", ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = binary
        for text in (*OPTIONS, "--window-size=1400,1000", f"--user-data-dir={profile}"):
            options.add_argument(text)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        chromium = webdriver.Chrome(options=options, service=webdriver.ChromeService(executable_path=driver))
        try:
            chromium.set_page_load_timeout(60)
            chromium.set_script_timeout(60)
            yield chromium
        finally:
            chromium.quit()


class Tab:
    """The browser's tab: goes to a page, and says what happened since."""

    def __init__(self, browser: Any) -> None:
        self.browser = browser
        self._events: list[dict[str, Any]] = []

    def open(self, address: str | Path) -> None:
        """Go to an address or to a file, with logs empty and the emulation of sizes and media as it stands."""
        self.browser.get("about:blank")
        self.forget()
        self.browser.get(address.resolve().as_uri() if isinstance(address, Path) else address)

    def forget(self) -> None:
        """Empty the logs."""
        self.browser.get_log("browser")
        self.browser.get_log("performance")
        self._events = []

    def errors(self) -> list[str]:
        """Return script errors, refused loads and violations of the page's policy since the logs were emptied."""
        return [entry["message"] for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]

    def requests(self) -> list[str]:
        """Return the addresses asked for since the page was opened, without data:, blob: and the page itself."""
        lines = self.browser.get_log("performance")
        self._events += [json.loads(line["message"])["message"] for line in lines]
        asked = [event["params"] for event in self._events if event["method"] == "Network.requestWillBeSent"]
        own = asked[0]["frameId"] if asked else ""  # the first request is that of the page itself
        return [
            params["request"]["url"]
            for params in asked
            if not (params.get("type") == "Document" and params["frameId"] == own)
            and not params["request"]["url"].startswith(("data:", "blob:"))
        ]

    def size(self, width: int, height: int = 900) -> None:
        """Make the view as wide and high as a screen, in pixels."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def media(self, kind: str = "", scheme: str = "light") -> None:
        """Show the page as on ``print`` or a screen (empty), for readers who prefer ``light`` or ``dark``."""
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": kind, "features": features})

    def overflow(self) -> int:
        """Return by how many pixels the page is wider than its view."""
        return int(
            self.browser.execute_script(
                "const page = document.documentElement; return page.scrollWidth - page.clientWidth"
            )
        )

    def run(self, script: str, *arguments: Any) -> Any:
        """Run a script of one's own in the page and return what it returns."""
        return self.browser.execute_script(script, *arguments)


@pytest.fixture
def tab(browser: Any) -> Iterator[Tab]:
    """The browser's tab at 1400 pixels on a light screen, with empty logs; afterwards blank."""
    tab = Tab(browser)
    tab.size(1400)
    tab.media()
    yield tab
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    browser.get("about:blank")


@pytest.fixture(scope="session")
def axe(browser: Any) -> Callable[[], list[str]]:
    """Checks the open page by axe-core's rules of WCAG 2, A and AA, and of headings; returns what violates them."""
    found = importlib.util.find_spec(AXE_PACKAGE)
    if found is None or found.origin is None:
        _without("axe-core is not installed (the extra `browser`)")
    source = (Path(found.origin).parent / "axe.min.js").read_text(encoding="utf-8")

    def check() -> list[str]:
        browser.execute_script(source)
        result = browser.execute_async_script(
            "const done = arguments[arguments.length - 1];"
            "const stable = axe.getRules(arguments[0]).filter(rule => !rule.tags.includes('experimental'));"
            "const rules = stable.map(rule => rule.ruleId).concat(arguments[1]);"
            "axe.run(document, {runOnly: {type: 'rule', values: rules}, resultTypes: ['violations']})"
            ".then(found => done(found), problem => done({error: String(problem)}))",
            LEVELS,
            HEADINGS,
        )
        assert "error" not in result, result["error"]
        assert result["passes"], "axe-core judged nothing"
        return [
            f"{rule['id']}: {node['html'][:160]}: {node['failureSummary']}"
            for rule in result["violations"]
            for node in rule["nodes"]
        ]

    return check


@pytest.fixture(scope="session")
def scenario(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Gives the results of a scenario at its smallest size: those of a former run, or its own."""
    given = os.environ.get(RESULTS)
    kept = Path(given).resolve() if given else tmp_path_factory.mktemp("scenarios")
    shown = tmp_path_factory.mktemp("shown")

    @cache
    def complaint(name: str) -> str:
        return "" if (kept / name / "report.html").is_file() else run_scenario(name, kept / name)

    @cache
    def copied(name: str) -> Path:  # the tests write beside the report
        return shutil.copytree(kept / name, shown / name, ignore=shutil.ignore_patterns(*RAW))

    def results(name: str) -> Path:
        if "needs the recordings" in complaint(name):
            pytest.skip(complaint(name))
        assert not complaint(name)
        return copied(name)

    return results


def run_scenario(name: str, folder: Path) -> str:
    """Run a scenario as a user would, in its smallest size, and return its complaint."""
    size = [word for least in stories()[name].sizes[:1] for word in ("--size", least)]
    program = "import sys; from deatwin.app.cli import main; sys.exit(main(sys.argv[1:]))"
    line = ["scenario", name, *size, "--out", str(folder), "--jobs", "1", "--quiet"]
    done = subprocess.run([sys.executable, "-c", program, *line], capture_output=True, text=True, check=False)
    return done.stderr.strip() or f"it ended with the status {done.returncode}" if done.returncode else ""


@pytest.fixture
def words_on_a_map() -> str:
    """Words on a map, black above white, that is drawn upside down as matplotlib draws them."""
    stream = io.BytesIO()
    imsave(stream, np.array([[1.0], [0.0]]), cmap="gray", format="png")
    address = f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}"
    words = "".join(
        f'<text x="5" y="{y}" font-size="8" fill="{ink}">{name}</text>'
        for y, ink, name in (
            (20, "#000", "on black"),
            (35, "#fff", "legible"),
            (70, "#fff", "on white"),
            (85, "#000", "legible"),
        )
    )
    return (
        '<figure style="background: #888"><h3>A</h3><svg viewBox="0 0 300 100" width="300" height="100">'
        f'<image href="{address}" transform="scale(1 -1) translate(0 -100)" width="300" height="100" '
        f'preserveAspectRatio="none" style="image-rendering: pixelated"/>{words}</svg></figure>'
    )

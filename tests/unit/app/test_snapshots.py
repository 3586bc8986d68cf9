"""What the command line prints, compared with the text files in `snapshots/`.

After a wanted change renew them, and read the difference before it is committed:
``DEATWIN_RENEW_SNAPSHOTS=1 python -m pytest tests/unit/app/test_snapshots.py``
"""

import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rig_files import RIG
from typer.main import get_command

from deatwin.app.cli import app
from deatwin.ident.narx import NarxModel
from deatwin.plant.files import write_csv

SNAPSHOTS = Path(__file__).with_name("snapshots")
MADE_WITH = "made_with.txt"
RENEW = "DEATWIN_RENEW_SNAPSHOTS"
WIDTH = 100
CASES = {
    "help": "--help",
    **{f"help_{name}": f"{name} --help" for name in get_command(app).commands},
    "version": "--version",
    "scenarios": "scenarios",
    "doctor": "doctor",
    "simulate": "simulate rig.toml input.csv --effect creep --out out.csv",
    "simulate_json": "simulate rig.toml input.csv --out out.csv --json",
    "frequency": "frequency narx.json --out response",
    "export_narx": "export narx.json --to c --out narx.c",
    "export_plant": "export rig.toml --to c --out rig.c",
    "error_mistakes": "simulate mistakes.toml input.csv --out out.csv",
    "error_usage": "simulate rig.toml",
}
"""Files by what is typed."""
MASKS = {
    "what pads a line to the width": (r"[ ]+$", ""),
    "version of deatwin": (r"^(deatwin +)\d+\.\d+\S*$", r"\1VERSION"),
    "versions of what must be there": (r"^(\S+ +)\d+\.\d+\S*$", r"\1VERSION"),
    "what may be there": (r"^(\S+ +)(?:\d+\.\d+\S*|absent: pip install .+) (\([^()]+\))$", r"\1VERSION OR ABSENT \2"),
    "the machine's compiler": (r"^(compiler +).+$", r"\1COMPILER"),
    "whether there is one": (r"^( +)(?:without it|until then)(?= slower)", r"\1IF ABSENT"),
    "folders of the user": (r"^((?:cache|data) +).+$", r"\1FOLDER"),
}
"""What differs between machines, and what stands there instead: by the names of the rules, in their order."""
RUN = """
import contextlib, io, json, sys
from deatwin.app.cli import main
found = []
for words in json.load(sys.stdin):
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        status = main(words)
    found.append((status, out.getvalue(), error.getvalue()))
json.dump(found, sys.stdout)
"""
NOT_FROM_OUTSIDE = {"FORCE_COLOR", "PY_COLORS", "GITHUB_ACTIONS", "FORCE_TERMINAL", "TERMINAL_WIDTH", "DEATWIN_DATA"}
"""Variables by which a terminal or a build server changes how helps look."""


def masked(text: str) -> str:
    """The text without what differs between machines."""
    for pattern, instead in MASKS.values():
        text = re.sub(pattern, instead, text, flags=re.MULTILINE)
    return text


def shown(line: str, status: int, out: str, error: str) -> str:
    """As in a terminal, with the exit status."""
    return masked(f"$ deatwin {line}\n{out}{error}[exit status {status}]\n")


def made_with() -> str:
    return "".join(f"{name} {version(name)}\n" for name in ("typer", "rich"))


def renew(folder: Path, texts: dict[str, str]) -> None:
    """Write all snapshots, and remove those of no case."""
    folder.mkdir(exist_ok=True)
    for path in folder.glob("*.txt"):
        path.unlink()
    for name, text in {**texts, Path(MADE_WITH).stem: made_with()}.items():
        (folder / f"{name}.txt").write_text(text, encoding="utf-8", newline="\n")


def desk(folder: Path) -> None:
    """The files of the cases."""
    (folder / "rig.toml").write_text(RIG, encoding="utf-8")
    wrong = RIG.replace("prestretch =", "prestrech =").replace("gain = 800.0\n", "").replace("= 2.0\n", "= -2.0\n")
    (folder / "mistakes.toml").write_text(wrong, encoding="utf-8")
    time = 0.02 * np.arange(100)
    write_csv(folder / "input.csv", {"time_s": time.round(6), "command_V": (2.4 + 0.8 * np.sin(3 * time)).round(5)})
    NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 0.25}, sample_time=0.02).save(folder / "narx.json")


@pytest.fixture(scope="module")
def texts(tmp_path_factory):
    """What is printed now, each by its name; the snapshots are renewed here where that is asked for."""
    folder = tmp_path_factory.mktemp("desk")
    desk(folder)
    clean = {name: value for name, value in os.environ.items() if name not in NOT_FROM_OUTSIDE}
    fixed = {"COLUMNS": str(WIDTH), "LINES": "60", "TERM": "xterm", "NO_COLOR": "1", "PYTHONUTF8": "1"}
    done = subprocess.run(
        [sys.executable, "-c", RUN],
        input=json.dumps([shlex.split(line) for line in CASES.values()]),
        cwd=folder,
        env={**clean, **fixed},
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=True,
    )
    results: list[Any] = json.loads(done.stdout)
    found = {name: shown(line, *result) for (name, line), result in zip(CASES.items(), results, strict=True)}
    if os.environ.get(RENEW):
        renew(SNAPSHOTS, found)
    return found


@pytest.mark.parametrize("name", CASES)
def test_the_command_line_prints_its_snapshot(name, texts):
    before = (SNAPSHOTS / MADE_WITH).read_text(encoding="utf-8")
    hint = f"renew by {RENEW}=1, see the head of this file; they were made with {before}, here is {made_with()}"
    assert texts[name] == (SNAPSHOTS / f"{name}.txt").read_text(encoding="utf-8"), " ".join(hint.split())


def test_each_case_has_its_snapshot_and_each_snapshot_its_case(texts):
    assert {path.name for path in SNAPSHOTS.iterdir()} == {MADE_WITH, *(f"{name}.txt" for name in CASES)}


def test_a_release_is_found_in_both_places(capsys):
    from deatwin.app.cli import main

    assert main(["--version"]) == 0
    assert capsys.readouterr() == (f"deatwin {version('deatwin')}\n", "")
    assert main(["--version", "simulate"]) == 0  # as others have it: what stands behind it does not matter
    capsys.readouterr()
    assert main(["doctor", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["versions"]["deatwin"] == version("deatwin")

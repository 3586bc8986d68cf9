"""A command that fails leaves no empty folder behind, and one that has written something keeps it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from deatwin.app.cli import main
from deatwin.app.demo import RIG
from deatwin.ident.narx import NarxModel
from deatwin.plant.files import write_csv


@pytest.fixture
def at_desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig, a model of another sample time, and a recording that is too short to be judged."""
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(RIG, encoding="utf-8")
    NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=0.1).save("narx.json")
    clock, command = 0.02 * np.arange(12), np.linspace(1.0, 2.0, 12)
    write_csv(Path("short.csv"), {"time_s": clock, "command_V": command, "displacement_mm": np.zeros(12)})
    return tmp_path


@pytest.mark.parametrize(
    "given",
    [
        ["diagnose", "rig.toml", "short.csv"],
        ["check", "narx.json", "--plant", "rig.toml"],  # 0.1 s is not the rig's 0.02 s: told when work has begun
        ["demo", "--effect", "crep"],
        ["frequency", "narx.json", "--band", "4", "9"],
    ],
    ids=lambda given: given[0],
)
def test_bad_data_leaves_no_folder(at_desk: Path, given: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(at_desk.iterdir())
    assert main([*given, "--out", "results/new"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert sorted(at_desk.iterdir()) == before
    (at_desk / "results").mkdir()  # not made by the command: it stays
    assert main([*given, "--out", "results/new"]) == 1
    assert not list((at_desk / "results").iterdir())


def test_an_identification_that_fails_leaves_no_folder_for_its_report(at_desk: Path) -> None:
    assert main(["identify", "short.csv", "--out", "found.json", "--report", "new/report", "--quiet"]) == 1
    assert not (at_desk / "new").exists() and not (at_desk / "found.json").exists()

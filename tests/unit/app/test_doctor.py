"""``deatwin doctor``: what is installed, what is missing and how it comes, what is slower without a compiler."""

import json
import os
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest

from deatwin.app.cli import main
from deatwin.app.commands import doctor as command
from deatwin.app.commands.doctor import OPTIONAL, SLOWER
from deatwin.ident.mismatch.refit.base import FEWER
from deatwin.plant import Plant, Rig, effects
from deatwin.plant.integrator import compiled

ROOT = Path(__file__).parents[3]
FOR_DEVELOPERS = {"test", "docs", "browser", "fuzz"}


def told(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["doctor", "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_every_package_of_an_extra_is_named_with_its_versions():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = {
        re.sub(r"\[.*?\]", "", text)
        for extra, packages in project["optional-dependencies"].items()
        if extra not in FOR_DEVELOPERS
        for text in packages
    }
    others = {re.split(r"[\[><=]", text)[0] for text in project["dependencies"]} | {"distributed"}  # which dask brings
    named = {part.package + part.versions for part in OPTIONAL if part.versions and part.package not in others}
    assert named == {text for text in stated if re.split(r"[><=]", text)[0] not in others}


def test_no_advice_needs_an_index_that_has_deatwin():
    for part in OPTIONAL:
        (requirement,) = shlex.split(part.command)[2:]
        assert requirement == part.package + part.versions
    for path in (file for part in ("plant", "ident", "control", "scenarios") for file in (ROOT / part).rglob("*.py")):
        assert not re.search(r"pip install \W*deatwin", path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize(("rig", "variants", "finer"), [(None, 2, 1), ("mine:disc", 1, 0)])
def test_the_plants_that_a_diagnosis_asks_for_are_compiled(rig, variants, finer, monkeypatch, capsys, tmp_path):
    """With the ball bonded and sliding, if that is not known: the film in two numbers of stages, a finer one if there is
    one, and the film with each effect in the smaller number of stages.
    """
    made: list[Plant] = []
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(
        "from deatwin.plant import Disc, Plant\n\ndef disc():\n    return Plant(rig=Disc())\n"
    )
    monkeypatch.setattr(Rig, "effects", lambda self: (effects.Creep(),))
    monkeypatch.setattr(command, "_compile", made.append)
    assert main(["doctor", "--warm", "--jobs", "1", *(["--rig", rig] if rig else [])]) == 0
    each = [((), 5), ((), FEWER), *[((), 5)] * finer, (("creep",), FEWER)]
    assert [(plant.effect_names, plant.stages) for plant in made] == each * variants
    assert f"{len(made)} plants are compiled" in capsys.readouterr().out


def test_what_is_absent_comes_with_its_command(monkeypatch, capsys):
    part = command.Part(package="no_such_package", use="nothing at all", versions=">=1")
    monkeypatch.setattr(command, "OPTIONAL", (part, command.Part(package="numpy", use="numbers")))
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert re.search(r'no_such_package +absent: pip install "no_such_package>=1" \(nothing at all\)', said)
    assert re.search(r"numpy +\d+\.\S+ \(numbers\)", said)
    found = told(capsys)["optional"]
    assert found["no_such_package"]["version"] is None and found["numpy"]["install"] == "pip install numpy"


def test_a_compiler_is_named_or_asked_for(monkeypatch, capsys):
    monkeypatch.setenv("DEATWIN_COMPILER", "")
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"compiler +no compiler was found on the path: install gcc or clang", said)
    for what, times, script in SLOWER:
        assert f"{what} {times} times" in said and script in said
        assert (ROOT / "tests/benchmarks" / script).is_file()
    assert told(capsys)["compiler"] is None
    monkeypatch.delenv("DEATWIN_COMPILER")
    assert told(capsys)["compiler"] == compiled.compiler()


def test_the_cache_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cache").mkdir()
    (tmp_path / "cache" / "a.so").write_bytes(bytes(1_500_000))
    (tmp_path / "cache" / "b.so").write_bytes(bytes(1_000_000))
    found = told(capsys)
    assert (found["cache"], found["cache_files"], found["cache_bytes"]) == (str(tmp_path / "cache"), 2, 2_500_000)
    assert main(["doctor"]) == 0
    assert f"{tmp_path / 'cache'}: 2 files, 2.5 MB" in capsys.readouterr().out


def test_a_cache_that_cannot_be_is_said(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path / "file" / "cache"))
    assert main(["doctor"]) == 0
    assert "Not a directory: without a cache folder nothing is compiled" in capsys.readouterr().out


def test_the_folder_of_public_recordings_is_looked_into(tmp_path, monkeypatch, capsys):
    for name in ("silverbox", "emps"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("DEATWIN_DATA", str(tmp_path))
    assert told(capsys)["data"] == {"variable": "DEATWIN_DATA", "folder": str(tmp_path), "holds": ["emps", "silverbox"]}
    monkeypatch.setenv("DEATWIN_DATA", str(tmp_path / "gone"))
    assert main(["doctor"]) == 0
    assert "gone: no such folder" in capsys.readouterr().out
    monkeypatch.delenv("DEATWIN_DATA")
    assert main(["doctor"]) == 0
    assert "DEATWIN_DATA is not set" in capsys.readouterr().out


def test_the_cache_is_counted_while_another_process_removes_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "compiling").mkdir()
    (tmp_path / "kept.so").write_bytes(b"code")
    monkeypatch.setenv("DEATWIN_CACHE", str(tmp_path))
    listing = os.scandir

    def late(place: Any) -> Any:
        if Path(place).name == "compiling":
            Path(place).rmdir()
        return listing(place)

    monkeypatch.setattr("os.scandir", late)
    assert told(capsys)["cache_bytes"] >= len(b"code")

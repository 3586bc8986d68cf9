"""The oracle: it finds a number that changed, and says equal where only provenance did."""

import gzip
import importlib
import json
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("fcntl", reason="the oracle's locks are those of Unix")

PYPROJECT = """
[project]
name = "deatwin"
version = "1"
[project.scripts]
deatwin = "toy:main"
[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]
[tool.hatch.build.targets.wheel]
sources = ["toy"]
"""
BACKEND = """
import zipfile

def build_wheel(folder, config_settings=None, metadata_directory=None):
    name = "deatwin-1-py3-none-any.whl"
    with zipfile.ZipFile(f"{folder}/{name}", "w") as wheel:
        wheel.write("toy/toy.py", "toy.py")
        about = "deatwin-1.dist-info"
        wheel.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\\nName: deatwin\\nVersion: 1\\n")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\\nGenerator: toy\\nRoot-Is-Purelib: true\\nTag: py3-none-any\\n")
        wheel.writestr(f"{about}/entry_points.txt", "[console_scripts]\\ndeatwin = toy:main\\n")
        wheel.writestr(f"{about}/RECORD", "")
    return name
"""
TOY = """
import json, pathlib, sys

def main():
    out = pathlib.Path(sys.argv[-1])
    if sys.argv[1] == "identify":
        out.write_text(json.dumps({"gain": GAIN, "rows": pathlib.Path("noise.csv").read_text()}))
        return
    out.mkdir()
    for name in ("diagnosis", "model", "check"):
        (out / f"{name}.json").write_text(json.dumps({"deatwin": VERSION, "verdict": "none"}))
"""


oracle = importlib.import_module("oracle")


@pytest.mark.parametrize(
    ("base", "head", "said"),
    [
        ({"a": [1, {"b": "2.0"}]}, {"a": [1, {"b": "2.1"}]}, '/a/1/b: "2.0" -> "2.1"'),
        ({"a": 1, "b": 2}, {"a": 1}, "/b: only in BASE"),
        ({"a": 1}, {"a": 1, "b": 2}, "/b: only in HEAD"),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, '/: the order of ["a", "b"]'),
        ([1, 2], [1, 2, 3], "/: 2 -> 3 entries"),
        ({"a": None}, {"a": 0}, "/a: null -> 0"),
        ({"a": [1, None]}, {"a": [1, None]}, ""),
    ],
)
def test_the_first_difference_has_its_path(base, head, said):
    assert oracle.first_difference(base, head) == said


@pytest.mark.parametrize(
    ("base", "head", "exempt", "said"),
    [
        ('{"x": 1.0}', '{"x": 1.0}', (), ""),
        ('{"x": 1.0}', '{"x": 1.00}', (), '/x: "1.0" -> "1.00"'),
        ('{"x": 1.0}', '{"x":1.0}', (), "/: the same values, written otherwise"),
        ('{"seal": "a", "x": 1}', '{"seal": "b", "x": 1}', ("/seal",), ""),
        ('{"seal": "a", "x": 1}', '{"seal": "b", "x": 2}', ("/seal",), "/x: 1 -> 2"),
        ('{"x": {"seal": 1}}', '{"x": {"seal": 2}}', ("/seal",), "/x/seal: 1 -> 2"),
        (None, "{}", (), "/: only in HEAD"),
        (None, None, (), "/: in neither"),
    ],
)
def test_files_are_equal_byte_for_byte_but_for_exempt_paths(tmp_path, base, head, exempt, said):
    for name, text in (("base", base), ("head", head)):
        if text is not None:
            (tmp_path / name).write_text(text)
    assert oracle.compare(tmp_path / "base", tmp_path / "head", exempt) == said


def test_what_fails_while_it_is_made_is_made_again(tmp_path):
    with pytest.raises(RuntimeError), oracle.made_once(tmp_path / "kept") as fresh:
        (fresh / "half").touch()
        raise RuntimeError
    with oracle.made_once(tmp_path / "kept") as fresh:
        assert list(fresh.iterdir()) == []
        (fresh / "whole").touch()
    with oracle.made_once(tmp_path / "kept") as fresh:
        assert fresh is None
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["whole"]


def git(folder: Path, *arguments: str) -> str:
    own = ("-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", *own, *arguments], cwd=folder, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def committed(folder: Path, **files: str) -> str:
    for name, text in files.items():
        path = folder / name.replace("__", ".").replace("_IN_", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "change")
    return git(folder, "rev-parse", "HEAD")


def test_two_commits_are_installed_run_and_compared(tmp_path, capsys):
    """A toy project with a build backend of its own, so that nothing is fetched from the network."""
    project, recordings = tmp_path / "project", tmp_path / "recordings"
    project.mkdir()
    git(project, "init", "-q")
    product = "GAIN, VERSION = {}, {}\n" + TOY.replace("{", "{{").replace("}", "}}")
    base = committed(
        project, pyproject__toml=PYPROJECT, backend__py=BACKEND, toy_IN_toy__py=product.format(0.1 + 0.2, "'1'")
    )
    page = committed(project, README__md="A page.")
    changed = committed(project, toy_IN_toy__py=product.format(0.3, "'2'"))
    for name in ("one", "torn"):
        (recordings / name).mkdir(parents=True)
        (recordings / name / "rig.toml").touch()
        (recordings / name / "noise.csv.gz").write_bytes(gzip.compress(b"0,1"))
        (recordings / name / "steps.csv").write_text("0,1\n")
    (recordings / "one" / "check.csv").write_text("0,1\n")
    places = [f"--repository={project}", f"--recordings={recordings}", f"--cache={tmp_path / 'cache'}"]

    def run(head: str) -> tuple[int, str]:
        status = oracle.main([base, head, *places, "--only", "one", "torn"])
        return status, capsys.readouterr().out

    status, said = run(page)
    assert status == 0 and "it is run once" in said and "torn" in said and "skipped: check.csv is absent" in said
    (found,) = (tmp_path / "cache").glob("results-*/one-*/narx.json")
    assert json.loads(found.read_text()) == {"gain": 0.1 + 0.2, "rows": "0,1"}

    status, said = run(changed)
    assert status == 1
    assert 'narx.json                              differs at /gain: "0.30000000000000004" -> "0.3"' in said
    assert "model.json                             equal" in said  # but for the version
    assert 'diagnosis.json                         differs at /deatwin: "1" -> "2"' in said  # where none belongs
    assert base not in said  # what it made is kept

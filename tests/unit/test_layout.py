"""The rules that keep four source roots one namespace package beside python-control."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE_ROOTS = ("plant", "ident", "control", "scenarios")


def run_python(code: str) -> str:
    """Run code in a fresh interpreter that starts in the repository root, and return what it prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("root", [*SOURCE_ROOTS, *(f"{root}/deatwin" for root in SOURCE_ROOTS), "tests"])
def test_no_module_in_a_source_root(root: str) -> None:
    assert [path.name for path in (ROOT / root).glob("*.py") if path.name != "conftest.py"] == []


@pytest.mark.parametrize("name", [*SOURCE_ROOTS, "studies", "app"])
def test_each_package_is_typed_and_described(name: str) -> None:
    package = ROOT / (name if name in SOURCE_ROOTS else "scenarios") / "deatwin" / name
    assert (package / "py.typed").is_file()
    assert (package / "__init__.py").read_text(encoding="utf-8").startswith('"""')


def test_import_control_from_the_root_is_python_control() -> None:
    assert run_python("import control; print(hasattr(control, 'tf'))") == "True"


def test_no_path_of_one_machine() -> None:
    own = re.compile(r"(?<![A-Za-z0-9_.])/(?:home|root|work|farm|Users)/")
    files = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "pyproject.toml", "CHANGELOG.md", ".ci/run")]
    for folder in (*SOURCE_ROOTS, "tests"):
        files += [path for path in (ROOT / folder).rglob("*") if path.suffix in {".py", ".toml", ".json", ".md"}]
    found = [str(path.relative_to(ROOT)) for path in files if own.search(path.read_text(encoding="utf-8"))]
    assert [name for name in found if name != "tests/unit/test_layout.py"] == []


def test_readme_has_the_command_that_continuous_integration_runs() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    between = re.search(r"<!-- test -->\n```sh\n(.+)\n```\n<!-- /test -->", readme)
    assert between is not None
    assert re.search(r"-m pytest( -n auto --dist loadfile)?$", between[1])

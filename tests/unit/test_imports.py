"""What an import loads: a part of deatwin loads what it cannot do without, and few packages are needed at all."""

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_DEPENDENCIES = 12
HEAVY = {"control", "pysindy", "sklearn", "matplotlib", "xarray", "pandas", "joblib", "jinja2", "rich", "typer"}

# In the order in which they are imported: each may use what the ones before it loaded.
PARTS = {
    "deatwin.plant": {"numpy", "casadi"},
    "deatwin.ident": {"numpy", "casadi"},
    "deatwin.ident.narx": {"numpy", "casadi", "scipy.linalg", "scipy.special"},
    "deatwin.ident.frequency": {"numpy", "casadi", "scipy.linalg", "scipy.special"},
    # scipy.optimize fits plants, and loads the last four.
    "deatwin.ident.greybox": {
        "numpy",
        "casadi",
        "scipy.linalg",
        "scipy.special",
        "scipy.optimize",
        "scipy.sparse",
        "scipy.spatial",
        "scipy.fft",
        "scipy.constants",
    },
}
# Not even a diagnosis needs a law's whole class to look up its quantile, nor filters before there is a signal.
PARTS |= {part: PARTS["deatwin.ident.greybox"] for part in ("deatwin.ident.mismatch", "deatwin.control")}
BROUGHT_ALONG = {"cython_runtime", "swig_runtime_data5", "charset_normalizer", "sitecustomize", "usercustomize"}
"""What compiled packages make themselves, what numpy.f2py takes where it happens to be installed, and what a system's
Python starts with."""
COUNT = """
import importlib, json, sys
loaded = {}
for part in %r:
    importlib.import_module(part)
    loaded[part] = sorted(sys.modules)
print(json.dumps(loaded))
"""
HELP = """
import sys
from deatwin.app.cli import app, main
for command in app.registered_commands:
    assert main([command.callback.__name__, "--help"]) == 0
print("LOADED", *sys.modules)
"""


def run_python(code: str) -> str:
    """Run code in a fresh interpreter and return what it prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def loaded() -> dict[str, set[str]]:
    """Packages that each part has loaded, and public subpackages of SciPy as ``scipy.linalg``."""
    modules = json.loads(run_python(COUNT % list(PARTS)))
    return {part: {package(name) for name in names} - {""} for part, names in modules.items()}


def package(module: str) -> str:
    """A module's package, if it is somebody else's and public."""
    first, _, rest = module.partition(".")
    second = rest.partition(".")[0]
    if first == "scipy":
        return f"scipy.{second}" if second and not second.startswith("_") and second != "version" else ""
    own = first in sys.stdlib_module_names or first == "deatwin" or first.startswith("_")
    return "" if own or first in BROUGHT_ALONG else first


@pytest.mark.parametrize("part", PARTS)
def test_a_part_loads_what_it_cannot_do_without(part: str, loaded: dict[str, set[str]]) -> None:
    assert loaded[part] <= PARTS[part], loaded[part] - PARTS[part]


def test_the_file_readers_load_none_of_the_packages_of_formats() -> None:
    names = set(run_python("import sys, deatwin.plant.files; print(*sys.modules)").split())
    assert (HEAVY | {"scipy", "nptdms"}).isdisjoint(names), names & HEAVY


def test_no_command_loads_numbers_to_show_its_help() -> None:
    names = run_python(HELP).partition("LOADED")[2].split()
    assert {"typer", "deatwin.app.cli"} <= set(names)
    assert {"numpy", "scipy", "casadi", "deatwin.plant", *HEAVY - {"rich", "typer"}}.isdisjoint(names)


def test_at_most_a_dozen_packages_are_needed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert 0 < len(project["dependencies"]) <= MOST_DEPENDENCIES


def test_every_package_that_is_needed_is_imported_somewhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    called = {"scikit-learn": "sklearn"}
    names = [re.split(r"[\[><=]", text)[0] for text in project["dependencies"]]
    pattern = re.compile(r"^\s*(?:import|from) (\w+)", re.MULTILINE)
    imported: set[str] = set()
    for folder in ("plant", "ident", "control", "scenarios"):
        for path in (ROOT / folder).rglob("*.py"):
            imported |= set(pattern.findall(path.read_text(encoding="utf-8")))
    assert {called.get(name, name) for name in names} <= imported

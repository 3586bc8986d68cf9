"""Commands of other programs on the pages: each is run here, by a step of .ci/run, or has its reason.

Those of ``deatwin`` itself are run by tests/unit/app/test_documented_commands.py.
"""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from documents import PAGES, ROOT

BLOCK = re.compile(r"^```sh\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
FENCE = re.compile(r"^ *```.*?^ *```$", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`((?:python3?|mkdocs|pip|jupyter)\s[^`]+)`")
PLACES = {
    "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/deatwin demo": "tests/unit/app/test_demo.py runs the demo, .ci/run the rest",
    'python3 -m venv .venv-test && .venv-test/bin/pip install -e ".[test]" && OMP_NUM_THREADS=1 '
    ".venv-test/bin/python -m pytest -n auto --dist loadfile": ".ci/run, word for word",
    "jupyter nbconvert --to notebook --execute --inplace docs/notebooks/simulate_and_identify.ipynb": ".ci/run executes the notebooks",
    "python3 -m venv .venv && . .venv/bin/activate": ".ci/run makes an environment in the same way",
    'pip install -e ".[test]" -c requirements-dev.lock': ".ci/run installs the newest releases instead",
    "pip install pre-commit && pre-commit install": "a convenience: .ci/run runs the same two commands of ruff",
    "OMP_NUM_THREADS=1 python -m pytest -q tests/unit/plant/effects": "a part of what .ci/run tests",
    "python -m pytest tests/property/test_effects_together.py": "a part of what .ci/run tests",
    "ruff check . && ruff format --check . && python -m mypy": ".ci/run",
    ".ci/run": ".ci/run",
    "python tests/tools/oracle.py BASE HEAD": "tests/unit/tools/test_oracle.py, on a toy project",
    "python tests/tools/signatures.py docs": "tests/unit/tools/test_signatures.py checks what it wrote",
    "python tests/tools/size.py": "tests/unit/tools/test_size.py, on a toy project",
    "mkdocs serve": ".ci/run builds the site that it would serve",
    "python tests/benchmarks/bench_diagnose.py --case CASE --jobs 2": "a benchmark takes minutes, and no timing decides a test",
    "python tests/benchmarks/bench_plant.py": "a benchmark takes minutes, and no timing decides a test",
    "python tests/benchmarks/bench_sweep.py": "a benchmark takes minutes, and no timing decides a test",
    "python tests/fuzz/fuzz.py recordings --seconds 300": "tests/property/test_readers_fuzzed.py, for ten seconds",
    "python tests/tools/membrane_rig.py OUT --seed 9001 --seconds 270 --effect electrode_rc:time=0.05 --effect "
    "creep:modulus=40e3,time=20": "tests/unit/tools/test_membrane_rig.py, for some seconds",
    "python tests/tools/evidence.py docs": "tests/unit/tools/test_evidence.py",
    "python tests/tools/evidence.py docs --scenarios results": "tests/unit/tools/test_evidence.py",
    "python -m pytest -m study": "the long studies, which are run by hand",
}
"""Where each is run, or why it is not."""
RUN_HERE = re.compile(r"(gunzip|cp) .*tests/recordings/")
INSTALLED = re.compile(
    r'pip install (?:-e )?"?(?:\.|deatwin)(?:\[([a-z,]+)\])?"?(?: jupyterlab)?|pip install nonlinear_benchmarks'
)


def lines() -> set[str]:
    """Lines of shell blocks, and commands in running text."""
    found: set[str] = set()
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        found |= {line.strip() for block in BLOCK.findall(text) for line in block.splitlines()}
        found |= {" ".join(span.split()) for span in SPAN.findall(FENCE.sub("", text))}
    return {line for line in found if line and not line.startswith(("deatwin", "#"))}


LINES = sorted(lines())


def test_each_is_run_somewhere_or_has_its_reason() -> None:
    others = {line for line in LINES if not RUN_HERE.match(line) and not INSTALLED.fullmatch(line)}
    assert others == set(PLACES)
    for place in PLACES.values():
        for word in place.replace(",", "").split():
            assert not word.startswith((".ci/", "tests/")) or (ROOT / word).is_file(), word


def test_every_extra_that_a_page_installs_exists() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    matches = [found for line in LINES if (found := INSTALLED.fullmatch(line))]
    named = {extra for found in matches if found[1] for extra in found[1].split(",")}
    assert named and named <= set(project["optional-dependencies"])


@pytest.mark.skipif(shutil.which("gunzip") is None, reason="there is no gunzip")
def test_the_tutorial_unpacks_its_recordings(tmp_path: Path) -> None:
    chosen = [line for line in LINES if RUN_HERE.match(line)]
    assert len(chosen) == 4
    try:
        (tmp_path / "tests").symlink_to(ROOT / "tests", target_is_directory=True)
    except OSError as error:
        pytest.skip(f"no symbolic links here: {error}")
    for line in chosen:
        subprocess.run(["sh", "-c", line], cwd=tmp_path, check=True)
    names = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert names == {"noise.csv", "steps.csv", "check.csv", "rig.toml"}
    assert all((tmp_path / name).stat().st_size > 100 for name in names)

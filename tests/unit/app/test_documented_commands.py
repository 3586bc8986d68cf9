"""Every command and every block of Python in README and documents is run, on files of its own.

What takes long has the mark `study`: ``python -m pytest -m study tests/unit/app/test_documented_commands.py``.
What another test or a step of the gate runs is listed with its place. A command that is none of these fails a test.
"""

import importlib.util
import json
import os
import shlex
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from types import ModuleType

import documents
import numpy as np
import pytest
from made_coupons import dynamic, gent_pull, held
from needs import COMPILED

from deatwin.app.cli import main
from deatwin.plant import Experiment, Recording, load_plant
from deatwin.plant.excitation import band_limited_noise, random_holds
from deatwin.plant.files import write_csv
from deatwin.scenarios.concealed_physics.generator import specimens

ROOT = Path(__file__).parents[3]
STEP = 0.02


# Where things are run ------------------------------------------------------------------------------------------------

SHAKER = "docs/how-to/own-plant.md"
"""Its commands are for a plant with another sample time."""
ELSEWHERE = {
    "doctor --warm --rig rig.toml": "tests/unit/app/test_doctor.py, with one effect of the catalogue",
    "view measurements": "tests/browser/test_view.py, a step of .ci/run, with the extra `view`",
    "diagnose rig.toml noise.csv --out found": "here, with steps.csv: one recording less is no other command",
    "diagnose motor:plant recording.csv --out found": "tests/unit/app/test_worked_rigs.py, in Python, with the other rigs",
    "diagnose plate:plant heated.csv --out plate": "tests/unit/ident/mismatch/test_foreign.py, in Python, with another model",
    "diagnose motor.fmu recording.csv --out found": "tests/unit/plant/foreign/test_fmu.py, which simulates with such a file",
    "check narx.json --plant found/model.json --out control": "tests/unit/app/test_check_command.py, on a strip",
    "check narx.json --plant found/model.json --diagnosis found --out control": "here, with a recording to predict as well",
    "frequency narx.json --order 2 --out response": "here, with the order 3, which has the second one as well",
    "scenario NAME": "a placeholder: each scenario has commands of its own",
    "scenario NAME --out results/NAME": "the same placeholder",
}
PUBLISHED = [
    json.loads((ROOT / f"docs/data/{name}.json").read_text(encoding="utf-8"))
    for name in ("concealed-physics", "concealed-physics-long")
]
STUDIES = [f"scenario concealed-physics --size {study['size']} --seed {study['seed']}" for study in PUBLISHED]
"""The studies of the published tables: each page tells the command that made it, whatever its seed."""
DATA = (
    "scenario silverbox --data recordings --out silverbox",
    "scenario standard-tasks --task emps --data recordings --out tasks",
)
"""Public recordings, which a user downloads: run where DEATWIN_DATA names their folder."""
LONG = {
    "demo": [],
    "demo --out deatwin-demo": [],
    "check narx.json --plant found/model.json --diagnosis found --recording noise.csv --design inverse "
    "--operating-range 1.5 3.2 --out control": [],
    "diagnose rig.toml lab.csv --input-column '#2' --output-column '#3' --out found": [],
    "diagnose rig.toml --experiment monday_1.csv monday_2.csv --experiment tuesday.csv --out found": [],
    "diagnose shaker:plant shaken.csv --out spring": [],
    "scenario concealed-physics": ["--size", "tiny", "--jobs", "-1"],
    **{study: ["--size", "tiny"] for study in STUDIES},
    "scenario concealed-physics --size tiny --jobs -1 --out concealed": [],
    "scenario control-check": [],
    "scenario svb-benchmark": [],
    "scenario thesis-data": [],
    "scenario thesis-data --out thesis-data": [],
    "scenario your-own-rig": [],
    "scenario your-own-rig --out quarter-car": [],
    **{command: [] for command in DATA},
}
"""Under the mark `study`, with the options that are added to make them shorter: tiny studies in place of days."""
STAGES = (
    "doctor",
    "scenarios",
    "look",
    "material",
    "identify",
    "frequency",
    "diagnose",
    "plan",
    "simulate",
    "check",
    "export",
    "demo",
    "scenario",
)
MADE_BY = {
    "narx.json": "identify noise.csv --method svb --out narx.json",
    "found": "diagnose rig.toml noise.csv steps.csv --out found",
    "control": "check narx.json --plant found/model.json --diagnosis found --recording test.csv --out control",
}
"""What other commands take, by the documented command that writes it."""
PREDICTED = "simulate found/model.json check.csv --history noise.csv --history steps.csv --out predicted.csv"
LONG_BLOCKS = {
    ("README.md", 0),
    ("docs/how-to/check-a-controller.md", 0),
    ("docs/how-to/foreign-models.md", 1),
    ("docs/how-to/own-effect.md", 1),
    ("docs/how-to/which-experiment.md", 1),
}
BLOCKS_ELSEWHERE = {
    ("docs/how-to/run-a-study.md", 0): "tests/unit/studies/test_sweep_studies.py",
    ("docs/how-to/run-a-study.md", 1): "a form, not a program: `...` stands for the reader's own call",
    ("docs/how-to/own-identifier.md", 1): "a test for pytest, with the checks of tests/unit/ident/test_testing.py",
}


def shown() -> dict[str, str]:
    """Each command once, with the page on which it stands first; one only mentioned by its name is no call."""
    found: dict[str, str] = {}
    for page in documents.PAGES:
        for arguments in documents.commands(page):
            alone = len(arguments) == 1 and arguments[0] not in ("demo", "doctor", "scenarios")
            if not alone:
                found.setdefault(shlex.join(arguments), documents.name_of(page))
    return found


def code_blocks() -> dict[tuple[str, int], tuple[str | None, str]]:
    """Title and text of each block of Python, by page and number."""
    return {
        (documents.name_of(page), number): block
        for page in documents.PAGES
        for number, block in enumerate(documents.blocks(page, "python"))
    }


SHOWN, BLOCKS = shown(), code_blocks()
SHORT = sorted((c for c in SHOWN if c not in {*LONG, *ELSEWHERE}), key=lambda c: STAGES.index(c.split()[0]))


# Files ---------------------------------------------------------------------------------------------------------------


def table(path: Path, record: Recording) -> None:
    write_csv(
        path,
        {
            "time_s": record.timepts.round(6),
            "command_V": record.inputs[0].round(6),
            "displacement_mm": (1e3 * record.outputs[0]).round(6),
        },
    )


def measured(folder: Path, commands: Sequence[np.ndarray], start: float = 0.0) -> tuple[Recording, ...]:
    """Records that follow one another, by the plant of the rig file with a softer film."""
    plant, silent = load_plant(str(folder / "rig.toml")).plant, []
    for command in commands:
        silent.append(Recording.from_arrays(command, np.zeros_like(command), STEP, start=start))
        start += STEP * command.size
    made = plant.with_values({"shear_modulus": 0.95 * plant.parameters["shear_modulus"].value})
    return made.record(Experiment(recordings=tuple(silent)), np.random.default_rng(1)).recordings


def german(path: Path, record: Recording) -> None:
    """The same as a laboratory writes it: semicolons, decimal commas, a line above the header."""
    lines = ["Film 7, second visit", "Zeit (ms);U_cmd (V);Weg (mm)"]
    rows = zip(1e3 * record.timepts, record.inputs[0], 1e3 * record.outputs[0], strict=True)
    lines += [f"{time:.0f};{command:.5f};{reading:.5f}".replace(".", ",") for time, command, reading in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def coupons(folder: Path) -> None:
    """The tests of a silicone that their page lists."""
    listed, *_ = documents.blocks(ROOT / "docs/how-to/material-from-tests.md", "toml")
    (folder / "tests.toml").write_text(listed[1], encoding="utf-8")
    rng, area = np.random.default_rng(0), 10e-6
    pulled, times = np.linspace(0.1, 1.5, 60), np.r_[0.0, np.geomspace(0.1, 400.0, 60)]
    frequencies = np.geomspace(1e-3, 10.0, 20)

    def read(values: np.ndarray) -> np.ndarray:
        return values * (1 + 0.01 * rng.normal(size=values.size))

    slow = {"time_s": 1e4 * pulled, "crosshead_mm": 80 * pulled, "force_N": area * read(gent_pull(1 + pulled))}
    write_csv(folder / "pull.csv", slow)
    write_csv(folder / "relaxation.csv", {"time_s": times, "force_N": area * read(held(times, 2.0))})
    storage, loss = (read(values) / 3e3 for values in dynamic(frequencies))
    write_csv(folder / "dma.csv", {"f_Hz": frequencies, "G1": storage, "G2": loss})


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with the files that the pages speak of: short recordings of one film, and the files shown as code."""
    folder, rng = tmp_path_factory.mktemp("desk"), np.random.default_rng(0)
    rig, *_ = [text for _, text in documents.blocks(ROOT / "docs/how-to/own-rig-file.md", "toml") if "[film]" in text]
    (folder / "rig.toml").write_text(rig, encoding="utf-8")
    noise, other = band_limited_noise(rng, 18.0, STEP), band_limited_noise(rng, 10.0, STEP)
    for name, record in zip(
        ("noise", "steps", "check"),
        measured(folder, [noise, random_holds(rng, 12.0, STEP, 1.4, 3.0), other]),
        strict=True,
    ):
        table(folder / f"{name}.csv", record)
    monday = measured(folder, [noise, other])
    for name, record in (
        ("monday_1", monday[0]),
        ("monday_2", monday[1]),
        ("train", monday[0]),
        ("test", monday[1]),
        ("tuesday", measured(folder, [noise[::-1]])[0]),
    ):
        table(folder / f"{name}.csv", record)
    german(folder / "lab.csv", monday[0])
    coupons(folder)
    rows = np.c_[monday[0].timepts.round(6), monday[0].inputs[0], 1e3 * monday[0].outputs[0]]
    np.savetxt(folder / "a.dat", rows, "%.6f")
    np.savetxt(folder / "log.csv", rows * [1e3, 1.0, 1.0], "%.6f", ",", header="clock,u,y", comments="")
    write_csv(folder / "input.csv", {"time_s": STEP * np.arange(other.size), "command_V": other})
    for title, code in BLOCKS.values():
        if title is not None:
            (folder / title).write_text(code, encoding="utf-8")
    return folder


@pytest.fixture
def at_desk(desk, monkeypatch):
    """The same, as the working folder; modules that lie in it are forgotten afterwards."""
    monkeypatch.chdir(desk)
    monkeypatch.syspath_prepend(str(desk))
    before = set(sys.modules)
    yield desk
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(desk) in str(sys.modules[name].__file__):
            del sys.modules[name]


def run(arguments: Sequence[str]) -> int:
    """Run a command as it is shown, after those that write what it takes."""
    for path, maker in MADE_BY.items():
        taken = any(word == path or word.startswith(f"{path}/") for word in arguments)
        if taken and maker != shlex.join(arguments) and not Path(path).exists():
            assert run(shlex.split(maker)) == 0
    return main(list(arguments))


def outputs(arguments: Sequence[str]) -> list[Path]:
    """What ``--out`` names."""
    return [Path(arguments[k + 1]) for k, word in enumerate(arguments[:-1]) if word == "--out"]


# Tests ---------------------------------------------------------------------------------------------------------------


def test_every_command_and_block_is_run_somewhere():
    assert {*LONG, *ELSEWHERE, *MADE_BY.values()} <= set(SHOWN)
    assert {*LONG_BLOCKS, *BLOCKS_ELSEWHERE} <= set(BLOCKS)
    assert all(command.split()[0] in STAGES for command in SHORT)
    for place in [*ELSEWHERE.values(), *BLOCKS_ELSEWHERE.values()]:
        for word in place.replace(",", "").split():
            assert not word.startswith("tests/") or (ROOT / word).is_file(), word


@COMPILED
@pytest.mark.parametrize("command", SHORT)
def test_a_command_does_what_its_page_says(command, at_desk, tmp_path, monkeypatch, capsys):
    arguments = shlex.split(command)
    if SHOWN[command] == SHAKER:
        arguments = at_the_shaker(arguments, tmp_path, at_desk, monkeypatch)
    status, told = run(arguments), capsys.readouterr()
    if "fmu" in command and importlib.util.find_spec("fmpy") is None:
        assert status == 1 and 'pip install "fmpy' in told.err
        return
    assert status == 0, told.err
    assert all(path.exists() for path in outputs(arguments))
    if "--json" in arguments:
        json.loads(told.out)


@pytest.mark.study
@pytest.mark.parametrize("command", LONG)
def test_a_long_command_does_what_its_page_says(command, at_desk, tmp_path, monkeypatch):
    if command in DATA and "DEATWIN_DATA" not in os.environ:
        pytest.skip("public recordings: DEATWIN_DATA names no folder")
    arguments = shlex.split(command)
    if SHOWN[command] == SHAKER:
        arguments = at_the_shaker(arguments, tmp_path, at_desk, monkeypatch)
    if command in DATA:
        arguments[arguments.index("recordings")] = os.environ["DEATWIN_DATA"]
    added = LONG[command]
    for option in added[::2]:  # one that is shown gives way
        if option in arguments:
            at = arguments.index(option)
            del arguments[at : at + 2]
    assert run([*arguments, *added]) == 0
    assert all(path.exists() for path in outputs(arguments))


def at_the_shaker(arguments: list[str], folder: Path, desk: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The working folder for a plant with a sample time of its own, with the recording that its page makes."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    for name in ("shaker.py", "record.py"):
        (folder / name).write_bytes((desk / name).read_bytes())
    exec(compile((folder / "record.py").read_text(encoding="utf-8"), "record.py", "exec"), {"__name__": "__main__"})
    (folder / "input.csv").write_bytes((folder / "shaken.csv").read_bytes())
    return arguments


def block_params() -> list[object]:
    return [
        pytest.param(at, id=f"{at[0]}-{at[1]}", marks=[pytest.mark.study] if at in LONG_BLOCKS else [])
        for at in BLOCKS
        if at not in BLOCKS_ELSEWHERE
    ]


@COMPILED
@pytest.mark.parametrize("at", block_params())
def test_a_block_of_python_runs(at, at_desk, monkeypatch):
    title, code = BLOCKS[at]
    if "to_arviz" in code:
        pytest.importorskip("arviz", reason="the extra bayes is not installed")
    for path, maker in MADE_BY.items():
        if f'"{path}' in code and not Path(path).exists():
            assert run(shlex.split(maker)) == 0
    if "predicted.csv" in code:
        assert run(shlex.split(PREDICTED)) == 0
    if at[0] == "CONTRIBUTING.md":  # on recordings of some seconds
        monkeypatch.setattr(specimens, "make", partial(specimens.make, seconds=12.0, check_seconds=6.0))
    module = ModuleType("__main__")
    monkeypatch.setitem(sys.modules, "__main__", module)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    exec(compile(code, title or f"{at[0]}, block {at[1]}", "exec"), vars(module))

"""Ctrl-C and SIGTERM: what is kept of a diagnosis, what is said, and what the next run makes of it."""

import gzip
import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from made_diagnoses import DIAGNOSIS
from stopping import interrupted

from deatwin.app import cli
from deatwin.app.cli import main
from deatwin.ident.mismatch import Diagnosis, Step
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.files import read_experiment
from deatwin.studies import diagnosing, partial
from deatwin.studies.folder import ResultFolder

EMPTY: Any = None
ROOT = Path(__file__).parents[3]
CASE = ROOT / "tests" / "recordings" / "open_creep"
SAMPLES = 800
PROGRAM = """
import signal, sys
from deatwin.app.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background jobs ignore, these tests too
sys.exit(main())
"""
WAITING = (
    """
import importlib, time
importlib.import_module("deatwin.ident.mismatch.diagnose").detect = lambda *_, **__: time.sleep(60)
"""
    + PROGRAM
)  # the step that is interrupted lasts until it is: however slow the machine, no next one begins
SCHEMA = json.loads((ROOT / "scenarios/deatwin/studies/schemas/partial.schema.json").read_text(encoding="utf-8"))
DIAGNOSE = ["diagnose", "strip_of_mine:strip", "pulls.csv", "--jobs", "1", "--quiet", "--out"]

pytestmark = pytest.mark.usefixtures("few_effects")


def kept(folder: Path) -> dict[str, Any]:
    """What ``steps.json`` holds; it follows its schema."""
    data: dict[str, Any] = json.loads((folder / "partial" / "steps.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.validate(data, SCHEMA)
    return data


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def by_ctrl_c(program: int) -> None:
    """What a terminal does: all that the program started hears of it."""
    os.killpg(program, signal.SIGINT)


def by_a_batch_system(program: int) -> None:
    """What comes before a kill."""
    os.kill(program, signal.SIGTERM)


def interrupted_at_a_terminal(
    program: str, arguments: list[str], folder: Path, sign: str, interrupt: Callable[[int], None] = by_ctrl_c
) -> tuple[int, str, str]:
    """Status, stdout and stderr of a program that is interrupted once the terminal shows a text."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "500"},
        text=True,
        start_new_session=True,
    )
    os.close(theirs)
    said, end, sent = b"", time.monotonic() + 120, False
    try:
        while time.monotonic() < end:
            if select.select([ours], [], [], 1.0)[0]:
                try:
                    said += os.read(ours, 65536)
                except OSError:  # the other side is closed
                    break
            if not sent and sign.encode() in said:
                interrupt(process.pid)
                sent = True
        out = process.communicate(timeout=30)[0]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        os.close(ours)
    assert sent, said[-2000:]
    return process.returncode, out, said.decode(errors="replace")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The opening of a recording of an independent rig, and what its experimenter knows."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "rig.toml").write_bytes((CASE / "rig.toml").read_bytes())
    with gzip.open(CASE / "noise.csv.gz", "rt", encoding="utf-8") as table:
        rows = table.read().splitlines()[: SAMPLES + 1]
    (folder / "noise.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def test_ctrl_c_keeps_the_calibrated_plant(recorded, validate):
    arguments = ["diagnose", "rig.toml", "noise.csv", "--jobs", "1", "--json", "--out", "result"]
    status, out, err = interrupted_at_a_terminal(WAITING, arguments, recorded, "looking for a mismatch")
    assert (status, out) == (130, ""), err
    assert files(recorded / "result") == {"partial/steps.json", "partial/base_model.json"}
    line = err.splitlines()[-1]
    assert "error: interrupted while looking for a mismatch; there is no verdict" in line
    assert "result/partial keeps the finished steps: check of the recordings, calibration of the model" in line
    assert "Traceback" not in err

    steps = kept(recorded / "result")
    assert [step["step"] for step in steps["steps"]][:2] == ["gate", "base"]
    assert steps["run"]["command"] == ["deatwin", *arguments]
    assert {"diagnosis", "verdict", "sentence"}.isdisjoint(steps)
    base = steps["steps"][1]
    document = validate("plant", recorded / "result" / "partial" / "base_model.json")
    assert document["provenance"] == {"step": "base"}

    # The plant that was kept does what the file says of it: 70 % of the samples were fitted, the rest was not.
    model = CalibratedPlant.load(recorded / "result" / "partial" / "base_model.json")
    for name, parameter in base["result"]["parameters"].items():
        assert model.plant.parameters[name].value == parameter["value"]
        assert parameter["low"] <= parameter["value"] <= parameter["high"]
    experiment = read_experiment([recorded / "noise.csv"])
    wrong = model.plant.simulate(experiment).require().outputs[0][0] - experiment.recordings[0].outputs[0]
    fitted = round(0.7 * SAMPLES)
    assert steps["output"]["unit"] == "um"
    assert base["result"]["fitted"] == pytest.approx(1e6 * np.sqrt(np.mean(wrong[:fitted] ** 2)), rel=1e-2)
    assert base["result"]["unseen"] == pytest.approx(1e6 * np.sqrt(np.mean(wrong[fitted:] ** 2)), rel=1e-2)


@pytest.mark.parametrize("interrupt", [by_ctrl_c, by_a_batch_system])
def test_workers_are_interrupted_without_a_trace(bench, interrupt):
    folder = interrupt.__name__
    arguments = ["diagnose", "strip_of_mine:strip", "pulls.csv", "--jobs", "2", "--out", folder]
    status, _, err = interrupted_at_a_terminal(
        PROGRAM, arguments, bench, "fitting the model with added effects", interrupt
    )
    assert status == 130
    assert "Traceback" not in err
    assert {"gate", "base", "detect"} <= {step["step"] for step in kept(bench / folder)["steps"]}
    assert not (bench / folder / "diagnosis.json").exists()


@pytest.fixture
def ends_after(monkeypatch):
    """Lets Ctrl-C come just after a step was finished so many times."""
    take = partial.FinishedSteps.take

    def set_up(name: str, times: int) -> None:
        left = [times]

        def interrupted(self: partial.FinishedSteps, step: Step) -> None:
            take(self, step)
            left[0] -= step.name == name
            if step.name == name and left[0] == 0:
                raise KeyboardInterrupt

        monkeypatch.setattr(partial.FinishedSteps, "take", interrupted)

    return set_up


def test_fits_are_kept_and_the_next_run_starts_anew(on_bench, ends_after, monkeypatch, capsys, validate):
    take = partial.FinishedSteps.take
    ends_after("fit", 3)
    assert main([*DIAGNOSE, "again"]) == 130
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "location of the mismatch, 3 fits with effects (base_model.json, steps.json)" in error
    steps = kept(on_bench / "again")["steps"]
    fits = {step["subject"]: step["result"] for step in steps if step["step"] == "fit"}
    assert len(fits) == 3
    base = next(step["result"] for step in steps if step["step"] == "base")
    for subject, fit in fits.items():
        assert fit["effects"] == [subject]
        assert fit["unseen"] is None  # they were not judged there yet
        assert fit["fitted"] < 1.02 * base["fitted"]  # each is a generalisation of the base plant
        assert any(name.startswith(f"{subject}.") for name in fit["parameters"])

    monkeypatch.setattr(partial.FinishedSteps, "take", take)
    ends_after("gate", 1)
    assert main([*DIAGNOSE, "again"]) == 130
    assert files(on_bench / "again") == {"partial/steps.json"}  # the former run's plant is not taken for this one's
    assert [step["step"] for step in kept(on_bench / "again")["steps"]] == ["gate"]

    monkeypatch.setattr(partial.FinishedSteps, "take", take)
    (on_bench / "again" / "mine.txt").write_text("notes", encoding="utf-8")
    with monkeypatch.context() as patch:  # whatever it finds: tests/unit/app/test_diagnose.py runs it to its end
        patch.setattr(diagnosing, "diagnose", lambda *_, **__: Diagnosis.from_dict(DIAGNOSIS))
        assert main([*DIAGNOSE, "again"]) == 0
    assert not (on_bench / "again" / "partial").exists()
    assert (on_bench / "again" / "mine.txt").exists()
    assert validate("diagnosis", on_bench / "again" / "diagnosis.json")["causes"][0]["effect"] == "creep"
    outputs = validate("run", on_bench / "again" / "run.json")["outputs"]
    assert {*outputs, "mine.txt"} == files(on_bench / "again")

    capsys.readouterr()
    ends_after("detect", 1)
    before = (on_bench / "again" / "diagnosis.json").read_bytes()
    assert main([*DIAGNOSE, "again"]) == 130
    assert "the diagnosis.json there is from an earlier run" in capsys.readouterr().err
    assert (on_bench / "again" / "diagnosis.json").read_bytes() == before


def test_a_judged_fit_replaces_the_rough_one(on_bench, ends_after, capsys):
    ends_after("verify", 1)
    assert main([*DIAGNOSE, "judged"]) == 130
    fits = [step for step in kept(on_bench / "judged")["steps"] if step["step"] == "fit"]
    assert len({fit["subject"] for fit in fits}) == len(fits)
    assert all(fit["result"]["unseen"] > 0 for fit in fits)
    best = min(fits, key=lambda fit: fit["result"]["unseen"])
    assert best["subject"] == "creep"  # what was concealed; the strip is 2 mN noisy
    assert best["result"]["unseen"] == pytest.approx(2e-3, rel=0.2)


def test_a_fit_is_shown_where_no_share_is_told_and_kept_where_it_is_interrupted_then():
    said: list[tuple[float, str]] = []

    def progress(share: float, doing: str) -> None:
        said.append((share, doing))
        if "slip" in doing:
            raise KeyboardInterrupt

    finished = partial.FinishedSteps(progress)
    finished.tell(0.3, "fitting the model with added effects")
    finished.take(Step(name="verify", result=EMPTY))
    finished.take(Step(name="fit", subject="creep", result=EMPTY))
    with pytest.raises(KeyboardInterrupt):
        finished.take(Step(name="fit", subject="creep+slip", result=EMPTY))
    assert said == [
        (0.3, "fitting the model with added effects"),
        (0.3, "fitting the model with added effects (creep)"),
        (0.3, "fitting the model with added effects (creep+slip)"),
    ]
    assert "tests of the explanation, 2 fits with effects" in finished._listed()


def test_before_the_first_step_nothing_is_written(on_bench, monkeypatch, capsys):
    monkeypatch.setattr(partial.FinishedSteps, "tell", interrupted)
    assert main([*DIAGNOSE, "early"]) == 130
    assert "no step was finished" in capsys.readouterr().err
    assert not (on_bench / "early").exists()


def test_what_casadi_makes_of_an_interrupt_is_one(on_bench, mistaken, monkeypatch, capsys):
    take = partial.FinishedSteps.take

    def taken_for_an_error(self: partial.FinishedSteps, step: Step) -> None:
        take(self, step)
        mistaken()

    monkeypatch.setattr(partial.FinishedSteps, "take", taken_for_an_error)
    assert main([*DIAGNOSE, "mistaken"]) == 130
    assert "mistaken/partial keeps the finished steps: check of the recordings" in capsys.readouterr().err
    assert files(on_bench / "mistaken") == {"partial/steps.json"}


def test_files_of_others_in_the_folder_stay(tmp_path):
    place = tmp_path / "partial"
    place.mkdir()
    for name in ("steps.json", "base_model.json", "mine.json"):
        (place / name).write_text("{}", encoding="utf-8")
    partial.remove_partial(ResultFolder(tmp_path))
    assert files(tmp_path) == {"partial/mine.json"}


@pytest.mark.parametrize(("words", "said"), [((), "interrupted"), (("5 of 7 are through",), "5 of 7 are through")])
def test_every_command_says_that_it_was_interrupted(words, said, on_bench, monkeypatch, capsys):
    from deatwin.app import given

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt(*words)

    monkeypatch.setattr(given.GivenPlant, "load", stop)
    assert main([*DIAGNOSE, "never"]) == cli.INTERRUPTED == 130
    assert capsys.readouterr() == ("", f"error: {said}\n")

"""The command line: exit statuses, error lines, files."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deatwin.app.cli import main
from deatwin.app.options import fold_experiments, unfold_experiment
from deatwin.plant import Diaphragm
from deatwin.plant.files import read_csv


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from deatwin.app.cli import main; status = main(['--help']); "
        "print('LOADED', *sys.modules); sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    text, _, loaded = done.stdout.partition("LOADED")
    for command in ("demo", "simulate", "identify", "frequency", "diagnose", "check", "scenario", "doctor"):
        assert command in text
    heavy = {"numpy", "scipy", "casadi", "matplotlib", "jinja2", "control", "sklearn", "deatwin.plant", "deatwin.ident"}
    assert heavy.isdisjoint(loaded.split())


@pytest.mark.parametrize(
    ("arguments", "status", "line"),
    [
        (["simulate", "absent.toml", "first.csv", "--out", "o.csv"], 1, "absent.toml: the rig file"),
        (["simulate", "rig.toml", "absent.csv", "--out", "o.csv"], 1, "absent.csv: no such file"),
        (["simulate", "rig.toml", "first.csv", "--effect", "crep", "--out", "o.csv"], 1, "creep"),
        (
            ["simulate", "rig.toml", "first.csv", "--history", "second.csv", "--out", "o.csv"],
            1,
            "a history record comes before the input file",
        ),
        (["diagnose", "strip_of_mine:nothing", "pulls.csv", "--out", "d"], 1, "give module:function"),
        (["identify", "pulls.csv", "--out", "n.json"], 1, 'no column "command_V"'),
        (["frequency", "absent.json", "--out", "f"], 1, "absent.json"),
        (["scenario", "vhb491"], 1, 'did you mean "vhb4910"?'),
        (["demo", "--effect", "crepe", "--out", "demo"], 1, 'did you mean "creep"?'),
        (["diagnose", "rig.toml", "--out", "d"], 2, "give at least one recording"),
        (["diagnose", "rig.toml", "first.csv"], 2, "--out"),
        (["simulate", "rig.toml", "first.csv", "--outt", "o.csv"], 2, "--outt"),
        (["nonsense"], 2, "nonsense"),
    ],
)
def test_errors(
    on_bench: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], status: int, line: str
) -> None:
    assert main(arguments) == status
    error = capsys.readouterr().err
    assert line in error
    assert "Traceback" not in error
    if status == 1:
        assert error.startswith("error: ")
        assert error.count("\n") == 1


def test_an_experiment_takes_the_files_up_to_the_next_option() -> None:
    given = "diagnose rig --experiment a b --seed 1 --experiment=c d --quiet".split()
    folded = fold_experiments(given)
    assert folded[:3] == ["diagnose", "rig", "--experiment"]
    assert unfold_experiment(folded[3]) == ["a", "b"]
    assert folded[4:7] == ["--seed", "1", "--experiment"]
    assert unfold_experiment(folded[7]) == ["c", "d"]
    assert folded[8:] == ["--quiet"]


def test_simulate_goes_through_the_history(on_bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "rig.toml", "second.csv", "--out", "alone.csv", "--quiet"]) == 0
    with_history = ["simulate", "rig.toml", "second.csv", "--history", "first.csv", "--out", "after.csv", "--quiet"]
    assert main(with_history) == 0
    assert capsys.readouterr().out == ""
    tables = [np.genfromtxt(name, delimiter=",", names=True) for name in ("alone.csv", "after.csv")]
    for table in tables:
        assert table.dtype.names == ("time_s", "displacement_mm", "low_mm", "high_mm")
        np.testing.assert_allclose(table["time_s"], np.arange(200) * 0.02 + 6)
        # a nominal plant: the band is that of noise and model error
        deviation = np.hypot(2e-3, 1e3 * Diaphragm.model_error)
        np.testing.assert_allclose(table["high_mm"] - table["low_mm"], 2 * 1.959964 * deviation, rtol=1e-3)
    difference = np.abs(tables[0]["displacement_mm"] - tables[1]["displacement_mm"])
    assert difference[0] > 1e-3  # the start procedure ends at the first command; the history does not
    assert difference[-1] < 0.1 * difference.max()


def test_an_effect_is_added(on_bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "rig.toml", "first.csv", "--effect", "electrode_rc", "--out", "rc.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["effects"] == ["electrode_rc"]
    assert read_csv("rc.csv", input_column="low_mm")[0].n_samples == 200


def test_pull_in_ends_with_one_line(on_bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "soft.toml", "high.csv", "--out", "never.csv"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: the simulation stopped at ")
    assert "V on the film" in error
    assert "pull-in" in error
    assert error.count("\n") == 1
    assert not Path("never.csv").exists()


@pytest.mark.parametrize("method", ["svb", "frols", "lasso", "semp", "grow"])
def test_identify(on_bench: Path, capsys: pytest.CaptureFixture[str], method: str) -> None:
    columns = ["--input-column", "stretch", "--output-column", "force_N"]
    assert main(["identify", "pulls.csv", *columns, "--method", method, "--out", "narx.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["terms"]
    assert 0 < found["unseen"][0]["one_step"] < 0.1
    assert found["complete"] and found["unseen"][0]["validation"]
    assert main(["identify", "pulls.csv", *columns, "--method", method, "--out", "narx.json"]) == 0
    assert "free run" in capsys.readouterr().out


def test_lists(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenarios"]) == 0
    assert "vhb4910" in capsys.readouterr().out
    assert main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["versions"]["deatwin"]
    assert "compiler" in found


def test_check_follows_its_schema(
    on_bench: Path, capsys: pytest.CaptureFixture[str], validate: Callable[[str, Path], dict[str, Any]]
) -> None:
    columns = ["--input-column", "stretch", "--output-column", "force_N"]
    assert main(["identify", "pulls.csv", *columns, "--method", "frols", "--out", "strip.json", "--quiet"]) == 0
    assert main(["check", "strip.json", "--plant", "strip_of_mine:strip", "--out", "control"]) == 0
    assert validate("check", on_bench / "control" / "check.json")["sentence"] in capsys.readouterr().out
    validate("run", on_bench / "control" / "run.json")

"""``deatwin export``."""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from designed import DESIGNED

from deatwin.app.cli import main
from deatwin.ident.narx import NarxModel
from deatwin.plant import Coupon, Creep, Plant
from deatwin.plant.calibrated import CalibratedPlant

Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command in a folder with a model of each kind: exit status and what it said."""
    monkeypatch.chdir(tmp_path)
    NarxModel.from_terms({"y(k-1)": 0.5, "u(k)": 1.0}, sample_time=0.1).save("narx.json")
    strip = Plant(rig=Coupon(sample_time=0.1)).with_effects(Creep())
    CalibratedPlant.nominal(strip).save("model.json")
    Path("check.json").write_text(json.dumps(DESIGNED), encoding="utf-8")

    def run(*arguments: str) -> tuple[int, str]:
        status = main(["export", *arguments])
        said = capsys.readouterr()
        return status, said.out + said.err

    return run


@pytest.mark.parametrize(
    ("model", "said"),
    [
        ("narx.json", "C99, NARX model of 2 terms from input to output, 0.1 s per sample"),
        ("model.json", "C99, coupon with creep, 0.1 s per sample"),
        ("check.json", "C99, PI controller (linear), 0.02 s per sample"),
    ],
)
def test_each_kind_of_model_becomes_a_file_of_c(run: Run, model: str, said: str) -> None:
    status, text = run(model, "--to", "c", "--out", "drive-2.c")
    assert (status, text) == (0, f"drive-2.c: {said}\n")
    assert "int drive_2_step(drive_2_state *state" in Path("drive-2.c").read_text(encoding="utf-8")


def test_units_of_a_check_are_in_the_source(run: Run) -> None:
    run("check.json", "--to", "c", "--out", "pi.c")
    head = Path("pi.c").read_text(encoding="utf-8").split("*/")[0]
    assert "u[0] is the reference (mm)" in head and "between 1 and 4 V" in head


def test_the_result_for_machines_names_inputs_and_outputs(run: Run) -> None:
    status, text = run("narx.json", "--to", "c", "--out", "n.c", "--name", "mine", "--json")
    found = json.loads(text)
    assert status == 0
    assert {key: found[key] for key in ("name", "form", "inputs", "outputs", "sample_time_s")} == {
        "name": "mine",
        "form": "c",
        "inputs": ["input"],
        "outputs": ["output"],
        "sample_time_s": 0.1,
    }


@pytest.mark.extras
@pytest.mark.parametrize(
    ("model", "to", "interface"),
    [
        ("model.json", "fmu", "ModelExchange"),
        ("model.json", "fmu-cs", "CoSimulation"),
        ("narx.json", "fmu", "CoSimulation"),
    ],
)
def test_plants_and_narx_models_become_fmus(run: Run, model: str, to: str, interface: str) -> None:
    pytest.importorskip("fmpy", reason="FMUs need pip install fmpy")
    status, text = run(model, "--to", to, "--out", "made.fmu")
    assert status == 0, text
    with zipfile.ZipFile("made.fmu") as archive:
        assert f'<{interface} modelIdentifier="made"' in archive.read("modelDescription.xml").decode()
        assert {"sources/made.c", "sources/buildDescription.xml"} <= set(archive.namelist())

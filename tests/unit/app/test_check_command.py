"""`deatwin check` from files to files: designs, rivals, errors, and what is written."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import report_alone
from stopping import interrupted
from strips import COLUMNS, MODULE, pulled, record, strip, write

from deatwin.app import checking
from deatwin.app.check_report.page import write_check_report
from deatwin.app.check_report.view import View
from deatwin.app.cli import main
from deatwin.control import Check, Specification, linearise
from deatwin.control.controllers.scheduled import ScheduledController
from deatwin.control.design.named import Wanted, design_named
from deatwin.ident.narx import Frols, NarxModel, assessed, excited_band, free_run_residual, hold_out
from deatwin.plant import Creep, Plant, PrestretchRelaxation
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.files import read_recordings
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.sources import load_plant
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.rendering import Origin

PLANT = ["--plant", "strip_of_mine:strip"]
FURTHER = """
from deatwin.plant import Coupon, Plant
from deatwin.plant.effects.delay import Delay

def late():
    return Plant(rig=Coupon(sample_time=0.1, noise=2e-3)).with_effects(Delay(time=0.08))

def seldom():
    return Plant(rig=Coupon(sample_time=0.2))
"""
FIGURES = {"steps.csv", "rivals.csv", "margins.csv", "nyquist.csv", "sine.csv"}


def noisy(seed: int, plant: Plant) -> Recording:
    """Two minutes of noise up to 1 Hz about a stretch of 1.5."""
    rng = np.random.default_rng(seed)
    noise = band_limited_noise(rng, 120.0, 0.1)
    return record(plant, 1.5 + 0.4 * (noise - noise.mean()) / np.abs(noise - noise.mean()).max(), rng)


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with recordings of a strip, a model of it, further plants, and a diagnosis with a rival."""
    folder = tmp_path_factory.mktemp("desk")
    (folder / "strip_of_mine.py").write_text(MODULE, encoding="utf-8")
    (folder / "further.py").write_text(FURTHER, encoding="utf-8")
    write(folder / "noise.csv", noisy(1, strip()))
    write(folder / "other.csv", noisy(2, strip()))
    rival = CalibratedPlant.nominal(strip().with_effects(Creep(modulus=2e3, time=25.0)))
    (folder / "found" / "rivals").mkdir(parents=True)
    (folder / "found" / "diagnosis.json").write_text('{"schema": "deatwin/diagnosis/2", "causes": []}')
    rival.save(folder / "found" / "rivals" / "creep.json")
    (folder / "spoilt").mkdir()
    (folder / "spoilt" / "diagnosis.json").write_text("{}")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["identify", "noise.csv", *COLUMNS, "--method", "frols", "--out", "narx.json", "--quiet"]) == 0
    return folder


@pytest.fixture
def at_desk(desk, monkeypatch):
    """The same, as the working folder."""
    monkeypatch.chdir(desk)
    return desk


@pytest.fixture(scope="module")
def results(desk):
    """What a check with all options wrote."""
    options = (
        "--design shaped --closed-loop-time 1.2 --operating-input 1.44 --operating-range 1.3 1.6 --recording other.csv "
        "--diagnosis found --rival further:late --seed 3"
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(desk)
        assert main(["check", "narx.json", *PLANT, *COLUMNS, *options.split(), "--out", "c", "--quiet"]) == 0
    return desk / "c"


def table(path: Path) -> Any:
    return np.genfromtxt(path, delimiter=",", names=True, deletechars="")


def test_all_files_are_written_and_follow_their_schemas(results, validate):
    assert {path.name for path in results.iterdir()} == {"check.json", "report.html", "run.json", "figures"}
    assert {path.name for path in (results / "figures").iterdir()} == FIGURES
    run = validate("run", results / "run.json")
    assert run["seed"] == 3
    assert [Path(entry["file"]).name for entry in run["inputs"]] == ["narx.json", "other.csv", "creep.json"]
    assert set(run["outputs"]) == {p.relative_to(results).as_posix() for p in results.rglob("*") if p.is_file()}


def test_every_option_is_heard(results, validate, desk):
    found = validate("check", results / "check.json")
    assert found["operating"]["input"] == 1.44
    assert found["controller"]["closed_loop_time"] == pytest.approx(1.2, rel=0.05)  # the crossover is at one by it
    assert found["excited_band_Hz"] == pytest.approx(excited_band(noisy(2, strip())), rel=1e-6)
    assert set(found["others"]) == {"creep", "further:late"}
    for source in ("model", "plant", "creep", "further:late"):  # at the operating input of the controller as well
        points = [row["operating_input"] for row in found["table"] if row["source"] == source]
        np.testing.assert_allclose(points, sorted([*np.linspace(1.3, 1.6, 9), 1.44]), rtol=1e-12)
    assert {"stability (creep)", "overshoot (further:late)", "prediction"} <= {f["subject"] for f in found["findings"]}


def test_a_loop_with_a_dead_time_has_less_phase_by_its_crossover(results):
    """A delay of 0.08 s takes as much of the delay margin: without other dynamics, the same loop otherwise."""
    rows = Check.load(results / "check.json").table
    delay = {row.source: row.delay for row in rows if row.operating_input == rows[0].operating_input}
    assert delay["plant"] - delay["further:late"] == pytest.approx(0.08, abs=0.002)


def test_the_report_needs_nothing_else(results):
    page, text = report_alone(results)
    assert page.tags.count("svg") == page.tags.count("figure") == len(FIGURES)
    assert re.search(r">predicted 95 % band<", text) and re.search(r">command \(|>stretch<", text)


def test_the_report_shows_every_finding_beside_its_limit(results):
    text = (results / "report.html").read_text(encoding="utf-8")
    found = json.loads((results / "check.json").read_text(encoding="utf-8"))
    heads = text[text.index('aria-label="Findings"') :].partition("</thead>")[0].count("<th ")
    row = r'<tr><td>([^<]*)</td>(?:<td class="n">[^<]*</td>)+<td class="(good|doubt|bad)">(\w+)</td>'
    rows = re.findall(row, text)
    assert len(rows) == len(found["findings"])
    assert sorted(verdict for _, _, verdict in rows) == sorted(f["verdict"] for f in found["findings"])
    assert {"pass": "good", "marginal": "doubt", "fail": "bad"}[found["verdict"]] in text
    for title in (
        "Margins of the model",
        "Margins of creep",
        "Simulation with the plant model",
        "Simulation with further:late",
        "Prediction",
        "Film",
        "Limit cycles",
        "Excitation",
    ):
        assert f'colspan="{heads}">{title}</th>' in text, title
    assert "<td>phase margin</td>" in text and "≥\xa045°" in text and "≥\xa030°" in text


def test_the_margins_at_the_operating_point_stand_beside_their_linearised_limits(results):
    text = (results / "report.html").read_text(encoding="utf-8")
    check = Check.load(results / "check.json")
    (band,) = (row for row in check.table if row.source == "model, linearised")
    part = text[text.index('aria-label="Margins of the model at the operating point"') :].partition("</table>")[0]
    heads = re.findall(r'<th scope="col"[^>]*>([^<]*)</th>', part)
    rows = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in part.split("<tr>")[2:]]
    shown = {row[0]: row[heads.index("lower end of the 95 % interval, linearised")] for row in rows}
    lows = band.gain_low, band.phase_low_deg, band.delay_low / check.operating.sample_time, band.disk_low
    for name, low in zip(("gain", "phase", "delay", "disk"), lows, strict=True):
        assert float(re.split("[° \xa0]", shown[name])[0]) == pytest.approx(low, rel=5e-3), name
    assert "Margins of the model, linearised" in text


def test_the_data_of_the_figures_are_those_of_the_check(results):
    found = Check.load(results / "check.json")
    assert found.steps is not None and found.controller is not None
    steps = table(results / "figures/steps.csv")
    np.testing.assert_allclose(steps["achieved_N"], found.steps.output, rtol=1e-12)
    document = json.loads((results / "check.json").read_text(encoding="utf-8"))
    np.testing.assert_allclose(0.5 * (steps["high_N"] - steps["low_N"]), document["predicted"]["half_width"], rtol=1e-9)
    rivals = table(results / "figures/rivals.csv")
    np.testing.assert_allclose(rivals["achieved_creep_N"], found.others["creep"].output, rtol=1e-12)
    margins = table(results / "figures/margins.csv")
    late = [row for row in found.table if row.source == "further:late"]
    column = margins["further_late_phase_deg"]
    np.testing.assert_allclose(column[np.isfinite(column)], [row.phase_deg for row in late], rtol=1e-12)
    loop = table(results / "figures/nyquist.csv")
    at = np.argmin(np.abs(np.hypot(loop["model_real"], loop["model_imag"]) - 1.0))
    assert found.margins is not None
    assert loop["frequency_Hz"][at] == pytest.approx(found.margins.crossover_Hz, rel=0.02)


def test_json_is_the_file_and_the_model_tells_the_band(at_desk, capsys, validate):
    (at_desk / "d" / "figures").mkdir(parents=True)
    (at_desk / "d" / "figures" / "rivals.csv").write_text("of a former run")
    (at_desk / "d" / "figures" / "mine.csv").write_text("somebody's own")
    (at_desk / "d" / "run.json").write_text(json.dumps({"outputs": ["figures/rivals.csv", "run.json"]}))
    assert main(["check", "narx.json", *PLANT, "--out", "d", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said == validate("check", at_desk / "d" / "check.json")
    assert said["predicted"] is not None and said["excited_band_Hz"] is not None
    left = {path.name for path in (at_desk / "d" / "figures").iterdir()}
    assert left == FIGURES - {"rivals.csv"} | {"mine.csv"}
    assert "The same steps on the rivals" not in (at_desk / "d" / "report.html").read_text(encoding="utf-8")
    assert main(["check", "narx.json", *PLANT, "--out", "d2", "--quiet"]) == 0
    for path in (at_desk / "d2").rglob("*"):  # equal runs differ in nothing but the record of the run
        if path.is_file() and path.name != "run.json":
            assert path.read_bytes() == (at_desk / "d" / path.relative_to(at_desk / "d2")).read_bytes(), path.name


def test_what_cannot_be_met_is_an_answer(at_desk, capsys, validate):
    """The strip has no second lag for a derivative to cancel; exit status 0, since the job was done."""
    assert main(["check", "narx.json", *PLANT, "--design", "pid", "--out", "e"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("fail: no controller could be designed: ")
    found = validate("check", at_desk / "e" / "check.json")
    assert found["controller"] is None and found["steps"] is None and found["table"] == []
    page = (at_desk / "e" / "report.html").read_text(encoding="utf-8")
    assert "<svg" not in page and "No controller could be designed" in page and 'class="verdict bad"' in page


def test_an_interrupt_leaves_nothing_half_written(at_desk, capsys, monkeypatch):
    monkeypatch.setattr(checking, "check_design", interrupted)
    assert main(["check", "narx.json", *PLANT, "--out", "cut"]) == 130
    assert "error: interrupted; nothing was written to cut" in capsys.readouterr().err
    assert not (at_desk / "cut").exists()


def test_the_schedule_spans_the_range_that_is_asked_for(at_desk):
    model = NarxModel.load(at_desk / "narx.json").deterministic
    reading = strip().rig.reading
    linear = linearise(model, 1.5).in_loop(reading)
    wanted = Wanted(model=model, reading=reading, closed_loop_time=1.0, band_Hz=None, operating_range=(1.3, 1.6))
    found = design_named("scheduled", wanted)(linear, command_limits=(1.0, 2.0))
    assert isinstance(found, ScheduledController)
    np.testing.assert_allclose(found.points, [1.3, 1.375, 1.45, 1.5, 1.525, 1.6])
    curve = design_named("inverse", wanted)(linear, command_limits=(1.0, 2.0))
    assert (curve.command_min, curve.command_max) == (1.3, 1.6)


def test_identify_tells_the_largest_residual(at_desk):
    """The free run leaves more of a strip that creeps; held-out parts of 360 samples are too short to tell."""
    write(at_desk / "creeps.csv", noisy(5, strip().with_effects(Creep(modulus=2e3, time=25.0))))
    options = [*COLUMNS, "--method", "frols", "--quiet", "--out", "both.json"]
    assert main(["identify", "noise.csv", "creeps.csv", *options]) == 0
    model = NarxModel.load(at_desk / "both.json")
    left = {}
    for name in ("noise.csv", "creeps.csv"):
        record = read_recordings(at_desk / name, input_column="stretch", output_column="force_N")[0]
        left[name] = free_run_residual(model, record)
    largest = left["creeps.csv"]
    assert largest.rms > left["noise.csv"].rms
    assert float(model.provenance["free_run_residual_rms"]) == pytest.approx(largest.rms, rel=1e-5)
    assert float(model.provenance["free_run_residual_time_s"]) == pytest.approx(largest.correlation_time, rel=1e-5)


def test_a_model_whose_free_run_diverges_says_so():
    wild = NarxModel.from_terms({"y(k-1)": 1.2, "u(k)": 1.0}, sample_time=0.1)
    record = noisy(1, strip())
    assert assessed(wild, record, record.section(800, 1200)).provenance["free_run"] == "diverged"


def test_python_saves_the_file_that_the_command_saves(at_desk):
    assert main(["identify", "noise.csv", *COLUMNS, "--method", "frols", "--quiet", "--out", "told.json"]) == 0
    records = read_recordings("noise.csv", input_column="stretch", output_column="force_N")
    training, held_out = hold_out(records)
    model = Frols(input_lags=(0, 1, 2)).fit(training).model_
    assessed(model, records, held_out).save("own.json")
    assert Path("own.json").read_bytes() == Path("told.json").read_bytes()


def test_a_diagnosis_keeps_its_rivals(tmp_path, validate, monkeypatch):
    """Twelve seconds under ten times the usual noise do not tell creep from a relaxation of the prestretch."""
    plant = strip().with_rig(replace(strip().rig, noise=0.02))
    creeping = plant.with_effects(Creep(modulus=60e3, time=25.0))
    task = DiagnosisTask(
        plant=plant,
        experiments=[Experiment(recordings=(pulled(creeping, 1, 13).section(0, 120),))],
        files=[],
        command=["deatwin", "diagnose"],
        effects=(Creep(), PrestretchRelaxation()),
    )
    (tmp_path / "rivals").mkdir()
    (tmp_path / "rivals" / "delay.json").write_text("of a former run")
    (tmp_path / "run.json").write_text(json.dumps({"outputs": ["rivals/delay.json"]}))
    diagnosis = task.run(ResultFolder(tmp_path), lambda share, text: None)
    assert diagnosis.verdict.value == "ambiguous" and diagnosis.rival_models
    (name,) = diagnosis.rival_models
    assert {name, *(cause.effect for cause in diagnosis.causes)} == {"creep", "prestretch_relaxation"}
    assert [path.name for path in (tmp_path / "rivals").iterdir()] == [f"{name}.json"]
    assert validate("plant", tmp_path / "rivals" / f"{name}.json")["effects"] == [name]
    assert f"rivals/{name}.json" in validate("run", tmp_path / "run.json")["outputs"]
    best = "+".join(cause.effect for cause in diagnosis.causes)
    model, rival = str(tmp_path / "model.json"), str(tmp_path / "rivals" / f"{name}.json")
    files = checking.rival_files("strip.toml", tmp_path, ["further:late"])
    assert files == {best: model, name: rival, "further:late": "further:late"}
    assert set(checking.rival_files(model, tmp_path, [])) == {name}  # the plant to control is no other one
    monkeypatch.chdir(tmp_path)
    assert set(checking.rival_files("model.json", tmp_path, [])) == {name}
    again, kept = load_plant(files[name]), diagnosis.rival_models[name]
    np.testing.assert_array_equal(again.plant.free_values, kept.plant.free_values)
    np.testing.assert_array_equal(again.covariance, kept.covariance)


def test_margins_along_time_have_their_figure(results, desk, tmp_path):
    loaded = Check.load(results / "check.json")
    along = tuple(replace(row, time=60.0 * n) for n, row in enumerate(loaded.table[:4]))
    check = replace(loaded, table=(*loaded.table, *along), others={})
    model = NarxModel.load(desk / "narx.json").deterministic
    view = View(check=check, model=model, plants={"plant": strip()}, specification=Specification())
    write_check_report(ResultFolder(tmp_path), view, Origin(inputs=[], seed=0))
    found = table(tmp_path / "figures/margins_time.csv")
    np.testing.assert_array_equal(found["time_s"], [0.0, 60.0, 120.0, 180.0])
    assert "Margins over time" in (tmp_path / "report.html").read_text(encoding="utf-8")

"""`deatwin diagnose` from files to files, and what it writes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pages import report_alone
from stopping import interrupted

from deatwin.app.cli import main
from deatwin.ident.mismatch import Diagnosis, how_sure, next_step
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.studies.diagnosing import DiagnosisTask

FILES = {"diagnosis.json", "model.json", "report.html", "run.json", "figures"}


@pytest.fixture(scope="module")
def results(bench, few_effects):
    """The results of one diagnosis of two experiments."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(bench)
        arguments = (
            "diagnose strip_of_mine:strip --experiment pulls.csv --experiment again.csv --out d --jobs 2 --quiet"
        )
        assert main(arguments.split()) == 0
    return bench / "d"


def test_every_file_is_written_and_follows_its_schema(results, validate):
    assert {path.name for path in results.iterdir()} == FILES
    diagnosis = validate("diagnosis", results / "diagnosis.json")
    assert diagnosis["verdict"] == "named"
    assert [cause["effect"] for cause in diagnosis["causes"]] == ["creep"]
    assert validate("plant", results / "model.json")["effects"] == ["creep"]
    run = validate("run", results / "run.json")
    assert run["command"][:2] == ["deatwin", "diagnose"]
    assert [entry["file"] for entry in run["inputs"]] == ["pulls.csv", "again.csv"]
    assert set(run["outputs"]) == {str(p.relative_to(results)) for p in results.rglob("*") if p.is_file()}


def test_equal_runs_in_any_number_of_processes_differ_in_nothing_but_the_record_of_the_run(results, on_bench, capsys):
    arguments = "diagnose strip_of_mine:strip --experiment pulls.csv --experiment again.csv --out e --jobs 1 --json"
    assert main(arguments.split()) == 0
    assert json.loads(capsys.readouterr().out) == json.loads((results / "diagnosis.json").read_text(encoding="utf-8"))
    for path in results.rglob("*"):
        if path.is_file() and path.name != "run.json":
            assert path.read_bytes() == (on_bench / "e" / path.relative_to(results)).read_bytes(), path.name


def test_the_command_line_says_how_sure_the_verdict_is(results, on_bench, monkeypatch, capsys):
    diagnosis = Diagnosis.load(results / "diagnosis.json")
    (explanation,) = diagnosis.explanations
    assert (explanation.effects, explanation.probability) == (("creep",), diagnosis.causes[0].probability)
    monkeypatch.setattr(DiagnosisTask, "run", lambda *_: diagnosis)
    assert main(["diagnose", "strip_of_mine:strip", "pulls.csv", "--out", "again"]) == 0
    verdict, sure, then, *_ = capsys.readouterr().out.split("named: ")[1].splitlines()
    assert (verdict, sure) == (diagnosis.sentence, f"how sure: {how_sure(diagnosis)}")
    assert "creep is 95 % likely" in sure
    assert then == f"next: {next_step(diagnosis)}"


def test_the_amended_model_can_be_simulated(results, on_bench):
    assert main(["simulate", "d/model.json", "again.csv", "--out", "predicted.csv", "--quiet"]) == 0
    table = np.genfromtxt("predicted.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "force_N", "low_N", "high_N")
    measured = np.genfromtxt("again.csv", delimiter=",", names=True)["force_N"]
    assert np.sqrt(np.mean((table["force_N"] - measured) ** 2)) < 3e-3
    inside = (table["low_N"] <= measured) & (measured <= table["high_N"])
    assert inside.mean() > 0.9


def test_the_report_needs_nothing_else(results):
    page, text = report_alone(results)
    assert page.tags.count("svg") >= 6  # four of the recordings, and one of each step that draws itself
    diagnosis = json.loads((results / "diagnosis.json").read_text(encoding="utf-8"))
    finding, _, details = diagnosis["sentence"].partition(". ")
    assert f"<h1>{finding}." in text and details in text


def test_the_data_of_the_figures(results):
    table = np.genfromtxt(results / "figures" / "time.csv", delimiter=",", names=True)
    assert table.size == 2400
    diagnosis = json.loads((results / "diagnosis.json").read_text(encoding="utf-8"))
    unseen = table[table["unseen"] == 1]
    before = np.sqrt(np.mean((unseen["measured_N"] - unseen["base_N"]) ** 2))
    assert before == pytest.approx(diagnosis["fit"]["unseen"]["before"], rel=1e-3)
    spectrum = np.genfromtxt(results / "figures" / "frequency.csv", delimiter=",", names=True)
    assert (np.diff(spectrum["frequency_Hz"]) > 0).all()
    assert spectrum["base_N_per_sqrtHz"][0] > 10 * spectrum["amended_N_per_sqrtHz"][0]


def test_an_interrupt_says_what_exists(results, on_bench, monkeypatch, capsys):
    from deatwin.studies import diagnosing

    model = CalibratedPlant.load(results / "model.json")
    diagnosis = replace(Diagnosis.load(results / "diagnosis.json"), model=model)
    monkeypatch.setattr(diagnosing, "diagnose", lambda *_, **__: diagnosis)
    monkeypatch.setattr(diagnosing, "write_report", interrupted)
    assert main(["diagnose", "strip_of_mine:strip", "pulls.csv", "--out", "cut", "--quiet"]) == 130
    error = capsys.readouterr().err
    assert "cut holds diagnosis.json, model.json" in error

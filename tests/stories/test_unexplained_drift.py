"""The story of the concealed drifts: its seal, its marks, and what it calls repeatable."""

import json
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from deatwin.ident.mismatch import Cause, DetectionSummary, Diagnosis, FitSummary, Interval, Verdict, excess
from deatwin.ident.mismatch.result import Errors, Output, UnseenErrors
from deatwin.plant.effects import PrestretchRelaxation
from deatwin.plant.errors import DataError
from deatwin.plant.fleet import fleet, specification
from deatwin.plant.model import Plant
from deatwin.scenarios import unexplained_drift
from deatwin.scenarios.unexplained_drift import repeatability, sealed, study
from deatwin.scenarios.unexplained_drift.repeatability import FRESH, Drift, Group, History, between, drift_of
from deatwin.scenarios.unexplained_drift.score import Mark, judged, measures
from deatwin.scenarios.unexplained_drift.sealed import Key, opened
from deatwin.scenarios.unexplained_drift.study import VISITS, Answers, Case, Finding, Study, Track, carry_out, case_of
from deatwin.studies.folder import ResultFolder
from deatwin.studies.sweep.seal import SweepSeal


def diagnosis(verdict: Verdict, causes: dict[str, dict[str, Interval]], names: tuple[str, ...] = ()) -> Diagnosis:
    after = (1.0, 1.0, 0.5) if causes else (None, None, None)
    return Diagnosis(
        output=Output(name="displacement", unit="um"),
        verdict=verdict,
        noise=0.6,
        model_error=1.0,
        detection=DetectionSummary(p_value=None, excess=None, smallest_detectable={}),
        location=None,
        sentence="",
        names=names or tuple(causes),
        fit=FitSummary(
            fitted=Errors(before=4.0, after=after[0]),
            unseen=UnseenErrors(before=5.0, after=after[1], gain_low=after[2]),
        ),
        causes=tuple(
            Cause(effect=n, family="film", probability=0.9, share_explained=0.9, parameters=p)
            for n, p in causes.items()
        ),
    )


def finding(answer: Diagnosis, name: str = "DEA 2") -> Finding:
    time = 0.02 * np.arange(1000)
    track = Track(
        timepts=time, measured=1e-6 * time, base=0 * time, answer=0.9e-6 * time, deviation=np.full(1000, 1e-6)
    )
    return Finding(name=name, diagnosis=answer, tracks=(track, track))


def interval(value: float, reach: float, unit: str) -> Interval:
    return Interval(value=value, low=value - reach, high=value + reach, unit=unit)


RELAXED = {"prestretch_relaxation": {"relative_loss": interval(0.05, 0.02, "1"), "time": interval(700.0, 100.0, "s")}}


def test_what_the_diagnosis_is_given_says_nothing_of_the_drift():
    actuator = fleet(5)[5]
    case = case_of(actuator)
    assert case.plant.effect_names == ("hysteresis",)
    assert case.plant.parameters == specification().parameters
    assert case.plant.rig == specification().rig
    assert [(e.start, round(e.end - e.start)) for e in case.experiments] == [(s, round(d)) for s, d in VISITS]
    # The electrode's rim is lost at 45 s, 13 s into the recording, so it is the drifting actuator that was recorded.
    sound = actuator.plant.without_effects("electrode_loss").record(case.experiments[0], np.random.default_rng(1))
    departure = case.experiments[0].recordings[0].outputs[0] - sound.recordings[0].outputs[0]
    early, late = np.abs(departure[: round(12 / 0.02)]), np.abs(departure[round(14 / 0.02) :])
    # Noise of 0.61 µm in each of the two: 5 standard deviations of their difference.
    assert early.max() < 5 * np.sqrt(2) * 0.7e-6 < late.max()


def sealed_folder(folder: Path, seed: int = 5, **changed: Any) -> Path:
    sealing = Key.of(fleet(seed)).seal(seed)
    content = replace(sealing, parts={**sealing.parts, **changed}).to_dict()
    (folder / "seal.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def test_a_sealed_key_says_nothing_and_is_opened_from_its_seed(tmp_path):
    key = Key.of(fleet(5))
    text = (sealed_folder(tmp_path) / "seal.json").read_text(encoding="utf-8")
    assert {len(json.loads(text)["parts"][part]) for part in ("key", "thresholds", "code")} == {64}
    assert not [effect for drift in key.drifts.values() for effect in drift if effect in text]
    assert opened(tmp_path, 5).drifts == key.drifts
    path = tmp_path / "seal.json"
    path.write_text("{", encoding="utf-8")
    with pytest.raises(DataError, match="line 1"):
        opened(tmp_path, 5)
    path.write_text('{"schema": "deatwin/drift-seal/2", "seed": 5}', encoding="utf-8")
    with pytest.raises(DataError, match="this version cannot continue a study with this seal"):
        opened(tmp_path, 5)
    path.unlink()
    with pytest.raises(DataError, match="seal"):
        opened(tmp_path, 5)


def test_drifts_thresholds_and_code_that_change_break_the_seal(tmp_path, monkeypatch):
    sealed_folder(tmp_path)
    first, second, *others = fleet(5)
    sound = second.plant.without_effects("prestretch_relaxation")
    other = replace(second, plant=sound.with_effects(PrestretchRelaxation(relative_loss=0.0601, time=1000.0)))
    with monkeypatch.context() as patch:
        patch.setattr(sealed, "fleet", lambda seed: (first, other, *others))
        with pytest.raises(DataError, match=r"another seal \(key: "):
            opened(tmp_path, 5)
    with monkeypatch.context() as patch:
        patch.setattr(excess, "SIGNIFICANCE", 0.5)
        with pytest.raises(DataError, match=r"another seal \(thresholds: "):
            opened(tmp_path, 5)
    with monkeypatch.context() as patch:
        patch.setattr(sealed, "PACKAGES", sealed.PACKAGES[:1])
        with pytest.raises(DataError, match=r"another seal \(code: "):
            opened(tmp_path, 5)
    copied = tmp_path / "story" / "sealed.py"  # as if a source of the story had been edited
    copied.parent.mkdir()
    copied.write_text("", encoding="utf-8")
    monkeypatch.setattr(sealed, "__file__", str(copied))
    with pytest.raises(DataError, match=r"another seal \(code: "):
        opened(tmp_path, 5)


def test_the_story_is_sealed_before_the_first_diagnosis_and_opened_from_the_file(setting, tmp_path, monkeypatch):
    def tampering(answers: Answers, *_: Any) -> Study:
        sealed_folder(answers.folder, seed=0, key="0" * 64)
        return made([finding(diagnosis(Verdict.NAMED, RELAXED), name) for name in Key.of(fleet(0)).drifts])

    monkeypatch.setattr(unexplained_drift, "carry_out", tampering)
    with pytest.raises(DataError, match=r"another seal \(key: 000000000000 there, "):
        unexplained_drift.run(setting)
    assert not (tmp_path / "key.json").exists()


def made(findings: list[Finding]) -> Study:
    return Study(findings=tuple(findings), groups=five(unlike=20e-6), files=())


@pytest.mark.parametrize(
    ("name", "answer", "mark"),
    [
        ("DEA 2", diagnosis(Verdict.NAMED, RELAXED), Mark.RIGHT),
        ("DEA 5", diagnosis(Verdict.NAMED, RELAXED), Mark.PARTLY),
        ("DEA 1", diagnosis(Verdict.NAMED, {"permittivity_drift": {}}), Mark.RIGHT),  # the ridge is not asked for
        ("DEA 2", diagnosis(Verdict.NAMED, {"creep": {}}), Mark.WRONG),
        ("DEA 2", diagnosis(Verdict.NAMED, {**RELAXED, "creep": {}}), Mark.WRONG),
        ("DEA 2", diagnosis(Verdict.AMBIGUOUS, {"creep": {}}, ("creep", "prestretch_relaxation")), Mark.IN_THE_SET),
        ("DEA 2", diagnosis(Verdict.AMBIGUOUS, {"creep": {}}, ("creep", "sensor_drift")), Mark.OPEN),
        ("DEA 2", diagnosis(Verdict.UNKNOWN, {}), Mark.OPEN),
        ("DEA 2", diagnosis(Verdict.NONE, {}), Mark.OPEN),
    ],
)
def test_marks(name, answer, mark):
    (score,) = judged([finding(answer, name)], Key.of(fleet(5)))
    assert score.mark is mark
    assert mark.advice


def test_intervals_are_held_against_the_truth():
    (score,) = judged([finding(diagnosis(Verdict.NAMED, RELAXED))], Key.of(fleet(5)))
    assert {e.name: (e.truth, e.covered) for e in score.estimates} == {
        "relative_loss": (0.06, True),
        "time": (1000.0, False),
    }
    assert [row.passed for row in measures([score])] == [True, True, True, True, True]
    (wrong,) = judged([finding(diagnosis(Verdict.NAMED, {"creep": {}}))], Key.of(fleet(5)))
    assert [row.passed for row in measures([wrong])] == [False, False, False, True, True]


def drift(shift: float, error: float = 0.0) -> Drift:
    return Drift(shift=shift, shift_error=error, gain=0.1, gain_error=0.01)


def group(sizes: Any, name: str = "creep") -> Group:
    return Group(name=name, assumption="as made up", histories=FRESH, drifts=tuple(map(drift, sizes)))


def test_intervals_of_spread_and_of_one_more_hold_what_they_should():
    # Normal shifts: of 2000 trials each interval holds the truth in 95 %, to within three binomial standard
    # deviations (1.5 %).
    rng = np.random.default_rng(8)
    inside, excluded = 0, 0
    for _ in range(2000):
        sample = group(rng.normal(20e-6, 3e-6, 6))
        _, low, high = sample.spread
        inside += low <= 3e-6 <= high
        excluded += sample.rules_out(drift(rng.normal(20e-6, 3e-6)))
    assert inside / 2000 == pytest.approx(0.95, abs=0.015)
    assert excluded / 2000 == pytest.approx(0.05, abs=0.015)


def test_an_uncertain_shift_is_not_ruled_out():
    sample = group([19e-6, 20e-6, 21e-6, 20e-6, 19e-6, 21e-6])
    assert sample.rules_out(drift(30e-6, 1e-6))
    assert not sample.rules_out(drift(30e-6, 5e-6))


def test_relaxation_repeats_less_with_age_as_its_exponential_says(monkeypatch):
    # A loss that is small moves the mean in proportion: what an experiment sees of a exp(-t/τ) falls by exp(-T/τ) when
    # it begins T later. Of 0.5 % the first 500 s take 0.2 %; the stroke goes with up to the fifth power of the
    # tension, so the second shift is up to 1 % larger than in proportion. Neither has noise.
    monkeypatch.setattr(repeatability, "SPAN", 60.0)
    plant = specification().with_effects(PrestretchRelaxation(relative_loss=5e-3, time=1000.0))
    fresh, aged = (drift_of(plant, History(age=age), None).shift for age in (0.0, 500.0))
    assert fresh > 0
    assert aged / fresh == pytest.approx(np.exp(-0.5), rel=0.02)


def test_without_a_drift_nothing_shifts_but_by_the_sensor(monkeypatch):
    monkeypatch.setattr(repeatability, "SPAN", 60.0)
    found = drift_of(specification(), History(), (1, 2))
    # The sensor: 0.61 µm of noise and rounding in each of the 750 differences.
    assert found.shift_error == pytest.approx(np.sqrt(2 / 750) * specification().rig.noise, rel=0.15)
    assert abs(found.shift) < 3 * found.shift_error
    assert abs(found.gain) < 3 * found.gain_error


def test_shift_and_gain_of_a_line_with_known_noise():
    # y₂ = 1.1 y₁ + 5 µm: mean and slope in closed form; errors against the scatter of 400 repeats, which is known to
    # 1/√800 = 3.5 %: three times that.
    rng = np.random.default_rng(4)
    shape = 100e-6 * np.sin(0.01 * np.arange(2000))
    found = [
        between(shape + rng.normal(0, 1e-6, 2000), 1.1 * shape + 5e-6 + rng.normal(0, 1e-6, 2000)) for _ in range(400)
    ]
    shifts, gains = np.array([[d.shift, d.gain] for d in found]).T
    assert shifts.mean() == pytest.approx(5e-6 + 0.1 * shape.mean(), abs=4 * shifts.std() / 20)
    assert gains.mean() == pytest.approx(0.1, abs=4 * gains.std() / 20 + 1.1e-4)  # noise in y₁ flattens by (1/71)²/2
    assert found[0].shift_error == pytest.approx(shifts.std(), rel=0.11)
    # For the slope the noise of y₁ counts 1.1 times: √(1 + 1.21) against √2, 5 % more.
    assert found[0].gain_error == pytest.approx(gains.std(), rel=0.16)


def five(unlike: float) -> tuple[Group, ...]:
    base = np.array(norm.ppf((np.arange(6) + 0.5) / 6))
    return (
        group([-20e-6, 70e-6, 30e-6, 0.0, -10e-6, 5e-6], "six actuators"),
        group(20e-6 + 2e-6 * base, "creep"),
        group(20e-6 + unlike * base, "creep"),
        group(70e-6 + 4e-6 * base, "relaxation"),
        group(70e-6 + 2 * unlike * base, "relaxation"),
    )


def test_the_argument_holds_or_fails_with_the_histories():
    assert [row.passed for row in repeatability.rows_of(five(unlike=20e-6))] == [True] * 4
    assert [row.passed for row in repeatability.rows_of(five(unlike=2e-6))] == [True, False] * 2
    assert "creep of a known size in 6 and relaxation in 5 of the six" in repeatability.sentence_of(five(unlike=20e-6))
    excluded = [row[-1] for row in repeatability.table_of(five(unlike=2e-6)).rows]
    # 95 % of further actuators lie within 20 ± 5 µm and 70 ± 11 µm.
    assert excluded[1] == "DEA 1, DEA 2, DEA 3, DEA 4, DEA 5, DEA 6"
    assert excluded[3] == "DEA 1, DEA 3, DEA 4, DEA 5, DEA 6"


def test_the_page_is_whole(setting, tmp_path, monkeypatch):
    key = Key.of(fleet(0))
    answers = [finding(diagnosis(Verdict.NAMED, RELAXED), name) for name in key.drifts]
    answers[3] = finding(diagnosis(Verdict.UNKNOWN, {}), "DEA 4")
    monkeypatch.setattr(unexplained_drift, "carry_out", lambda *_: made(answers))
    result = unexplained_drift.run(setting)
    assert [a["mark"] for a in result["answers"]] == ["wrong", "right", "wrong", "left open", "partly", "wrong"]
    written = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    assert {"seal.json", "key.json", "report.html", "unexplained-drift.json", "figures/drifts.csv"} <= written
    page = (tmp_path / "report.html").read_text().replace("\xa0", " ")
    assert page.count("<svg") == 1
    assert not re.search(r"\bnan\b", page)


NAMES = {*(f"dea{n}" for n in range(1, 7)), *(f"argument-{n:02d}" for n in range(30))}


def noted(folder: Path, refused: tuple[str, ...] = ()) -> Study:
    """Run all cases in this process, noting which is begun, with answers that cost nothing."""

    def note(name: str) -> None:
        assert name not in refused, "a case that is through is run again"
        with (folder / "begun.log").open("a") as log:
            log.write(f"{name}\n")

    def answered(case: Case, own: Path, command: tuple[str, ...], seed: int) -> tuple[Finding, list[str]]:
        note(own.name)
        ResultFolder(own).text("report.html", case.name)
        return finding(diagnosis(Verdict.NAMED, RELAXED), case.name), ["report.html"]

    def driven(plant: Plant, history: History, noise: tuple[int, ...]) -> Drift:
        number = next(n for n, run in enumerate(every) if run[:2] == (plant, history))
        note(f"argument-{number:02d}")
        return drift(1e-6 / (1 + number))

    folder.mkdir(exist_ok=True)
    every = repeatability.runs(0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "case_of", lambda actuator: Case(name=actuator.name, plant=actuator.plant, experiments=()))
        patch.setattr(study, "examine", answered)
        patch.setattr(study, "drift_of", driven)
        patch.setattr(study, "runs", lambda seed: every)
        answers = Answers(folder, SweepSeal(schema="deatwin/test-case/1", parts={"seed": 0}))
        return carry_out(answers, 0, ("deatwin",), 1, lambda *_: None)


def begun(folder: Path) -> Counter[str]:
    return Counter((folder / "begun.log").read_text().split())


def test_a_story_is_gone_on_with_and_no_case_is_repeated(tmp_path):
    """Of two cases nothing is kept, and of one the report is gone: they are run again, and no other one is."""
    expected = noted(tmp_path)
    assert begun(tmp_path) == dict.fromkeys(NAMES, 1)
    again = {"dea2", "argument-07"}
    for path in (tmp_path / "cases").iterdir():
        if path.stem in again:
            path.unlink()
    (tmp_path / "diagnoses" / "dea4" / "report.html").unlink()
    found = noted(tmp_path, refused=tuple(NAMES - again - {"dea4"}))
    assert begun(tmp_path) == dict.fromkeys(NAMES, 1) | dict.fromkeys([*again, "dea4"], 2)
    assert (tmp_path / "diagnoses" / "dea4" / "report.html").read_text() == "DEA 4"
    assert [g.to_dict() for g in found.groups] == [g.to_dict() for g in expected.groups]
    assert [f.to_dict() for f in found.findings] == [f.to_dict() for f in expected.findings]
    assert found.files == expected.files == tuple(f"diagnoses/dea{n}/report.html" for n in range(1, 7))


@pytest.mark.study
def test_the_story(setting, tmp_path):
    result = unexplained_drift.run(replace(setting, jobs=2))
    assert len(result["answers"]) == 6
    assert not [a for a in result["answers"] if a["mark"] == "wrong"]
    assert (tmp_path / "diagnoses" / "dea6" / "report.html").is_file()

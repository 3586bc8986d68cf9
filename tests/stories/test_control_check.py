"""The story of the check: its trials on the disk, its rates, and each of its measures on hand-made studies."""

import json
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_models import finished

from deatwin.app.stories import stories
from deatwin.control.checking.specification import Verdict
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.stability.margins import Margins
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.fleet import Actuator
from deatwin.plant.simulate import RunStatus
from deatwin.scenarios import control_check
from deatwin.scenarios.control_check import study as running
from deatwin.scenarios.control_check import trials
from deatwin.scenarios.control_check.matters import QUANTITIES, Interval, Matter, Matters, Promise
from deatwin.scenarios.control_check.page import _rates, judge
from deatwin.scenarios.control_check.study import Study
from deatwin.scenarios.control_check.tracking import FleetRun, Tracked, Tracking
from deatwin.scenarios.control_check.trials import (
    NO_MODEL,
    Outcome,
    Trials,
    broken,
    caught,
    in_words,
    inside,
    name_of,
    sound,
    try_one,
)
from deatwin.studies.rates import Rate

H = 0.02
PASS, MARGINAL, FAIL = Verdict.PASS, Verdict.MARGINAL, Verdict.FAIL

# Trials --------------------------------------------------------------------------------------------------------------


def outcome(number=0, verdict="pass", inside=1.0, sound=True, *, design="LQG", concealed="") -> Outcome:
    return Outcome(
        number=number,
        concealed=concealed,
        design=design,
        closed_loop_time=0.2,
        band_Hz=2.0,
        verdict=verdict,
        reason="a reason, with a comma",
        inside=inside,
        sound=sound,
        truth="steps overshoot by 2 %",
    )


def put(trials: Trials, one: Outcome) -> None:
    trials.put(name_of(one.number), asdict(one))


def test_a_study_goes_on_where_it_stopped(tmp_path, monkeypatch):
    first = Trials(tmp_path, seed=0)
    for number in (0, 2):
        put(first, outcome(number))
    assert first.missing([name_of(number) for number in range(4)]) == ["001", "003"]
    run = []

    def fake(number, seed):
        run.append((number, seed))
        return outcome(number, "fail", sound=False)

    monkeypatch.setattr(running, "try_one", fake)
    told = []
    found = running._trials(tmp_path, 4, 0, 1, lambda share, text: told.append((share, text)))
    assert run == [(1, 0), (3, 0)]
    assert [o.verdict for o in found] == ["pass", "fail", "pass", "fail"]
    assert [share for share, _ in told] == pytest.approx([0.5, 0.75, 1.0])
    assert [text.split(",")[0] for _, text in told] == ["trial 2 of 4", "trial 3 of 4", "trial 4 of 4"]


def test_trials_of_another_seed_or_code_are_refused_before_any_is_run(tmp_path, monkeypatch):
    put(Trials(tmp_path, seed=1), outcome(0))
    monkeypatch.setattr(running, "try_one", lambda *_: pytest.fail("a trial was run"))
    with pytest.raises(DataError, match=r"another seal \(seed: 1 there, 0 now\)"):
        running._trials(tmp_path, 4, 0, 1, lambda *_: None)
    monkeypatch.setattr(trials, "sources_digest", lambda *_: "another")
    with pytest.raises(DataError, match=r"another seal \(code: [0-9a-f]{12} there, \"another\" now\)"):
        Trials(tmp_path, seed=1)


def test_a_recording_without_a_model_is_an_outcome(monkeypatch):
    def none(recording):
        raise ModelError("no method found a model")

    monkeypatch.setattr(trials, "identified", none)
    bench = SimpleNamespace(plant=None, concealed=("creep",), recording=None, band_Hz=1.5)
    monkeypatch.setattr(trials, "random_bench", lambda rng: bench)
    found = try_one(11, 0)
    assert (found.number, found.concealed) == (11, "creep")
    assert (found.verdict, found.reason) == (NO_MODEL, "no method found a model")
    assert found.inside is None and found.sound is None
    assert try_one(11, 0) == found != try_one(11, 1)  # what is drawn depends on the seed alone


# Rates ---------------------------------------------------------------------------------------------------------------

MIXED = (
    outcome(0),
    outcome(1),
    outcome(2, inside=0.999),
    outcome(3, inside=None),
    outcome(4, sound=False),
    outcome(5, "marginal", 0.5),
    outcome(6, "marginal", sound=False),
    outcome(7, "fail", sound=False),
    outcome(8, "fail", None, None),
    outcome(9, NO_MODEL, None, None),
)


def test_what_counts_as_kept():
    # Passed: 0, 1, 2, 3, 4. One sample outside, or no prediction, is not inside; 4 is inside and not sound.
    assert inside(MIXED) == Rate(hits=3, count=5)
    assert sound(MIXED) == Rate(hits=4, count=5)
    # Unsound: 4, 6, 7. Those without a controller have no truth.
    assert caught(MIXED) == Rate(hits=2, count=3)
    assert [o.number for o in broken(MIXED)] == [2, 3, 4]


def test_rates_are_written_with_their_exact_bound():
    assert in_words(Rate(hits=20, count=20)) == "20 of 20, 100 % (with 95 % confidence at least 86 %)"
    # 89.89 %: a bound that is printed as 90 % would promise more than was shown.
    assert in_words(Rate(hits=44, count=45)) == "44 of 45, 98 % (with 95 % confidence at least 89 %)"
    assert in_words(Rate(hits=0, count=0)) == "no trial"


def test_verdicts_are_listed_from_good_to_bad():
    assert _rates(MIXED).columns[2:-3] == ["pass", "marginal", "fail", "no model"]
    assert _rates(MIXED[:4]).columns[2:-3] == ["pass", "marginal", "fail"]


# Hand-made studies ---------------------------------------------------------------------------------------------------


def loop(error: float = 1e-6, *, status: RunStatus = RunStatus.DONE, ringing: float = 0.0, seconds: float = 24.0):
    """A run whose error is a fast square wave of that amplitude, and whose reference steps by 100 µm."""
    n = round(seconds / H)
    reference = 2e-4 + 1e-4 * (np.arange(n) // max(n // 4, 1) % 2)
    swing = np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    output = reference - error * swing - ringing * swing
    return finished(reference, output, status=status, command=np.full(n, 2.5), command_limits=(1.0, 4.0))


def tracked(rms: float, phase: float = 80.0) -> Tracked:
    one = np.ones(1)
    return Tracked(
        controller=None,
        run=loop(rms),
        margins=Margins(
            gain=5.0 * one,
            phase_deg=phase * one,
            delay=0.3 * one,
            crossover=3.0 * one,
            stable=one > 0,
            disk=one,
            modulus=one,
        ),
    )


def tracking(name: str = "nominal rig", *, phase: float = 80.0, **rms: float) -> Tracking:
    """Micrometres by the initials of PI, inverse, inverse with dynamics, and the two oracles."""
    errors = {"PI": 50.0, "I": 5.0, "D": 1.0, "oI": 4.0, "oD": 0.8} | rms
    names = ("PI", "inverse", "inverse with dynamics", "oracle: inverse", "oracle: inverse with dynamics")
    of = {
        name: tracked(1e-6 * error, phase if key == "I" else 80.0)
        for name, (key, error) in zip(names, errors.items(), strict=True)
    }
    return Tracking(name=name, tracked=of)


def six(**spoilt: ClosedLoop) -> tuple[FleetRun, ...]:
    runs = [
        FleetRun(actuator=Actuator(name=f"DEA {n}", plant=None, story="ages", seed=(n,)), steps=loop(), tones=loop())
        for n in range(1, 7)
    ]
    return (*runs[:5], replace(runs[5], **spoilt))


def concealed(base: Verdict = FAIL, amended: Verdict = PASS, effect: str = "electrode_rc"):
    designs = tuple(
        SimpleNamespace(
            source=source,
            controller=SimpleNamespace(name="PI", closed_loop_time=0.4),
            runs=SimpleNamespace(steps=loop(5e-6)),
            check=SimpleNamespace(verdict=verdict, reason="the phase margin is 22°"),
            truth=SimpleNamespace(verdict=verdict, text="in simulation with the plant model, steps overshoot by 51 %"),
        )
        for source, verdict in (("base", base), ("amended", amended))
    )
    causes = [SimpleNamespace(effect=effect)]
    diagnosis = SimpleNamespace(verdict=SimpleNamespace(value="named"), causes=causes)
    return SimpleNamespace(effect=effect, designs=designs, at_other_times=(), diagnosis=diagnosis)


def matters() -> Matters:
    predicted = ((1.0, 0.9, 1.1), (0.02, 0.01, 0.04), (5.0, 4.0, 6.0), (8e-6, 7e-6, 9e-6))
    several = zip(QUANTITIES, predicted, (1.05, 0.04, 6.5, 7.5e-6), strict=True)
    known = Matter(
        name="physics plant",
        residual=2e-6,
        promises=tuple(
            Promise.of("physics plant", quantity, Interval(value=value, low=low, high=high), achieved)
            for quantity, (value, low, high), achieved in several
        ),
    )
    lost = Matter(name="linear ARX", residual=None, reason="the model is unstable")
    return Matters(models=(lost, known), output_rms=2e-4)


GOOD = tuple(outcome(n) for n in range(9)) + tuple(outcome(n, "fail", 0.5, False) for n in range(9, 18))


def made(**parts) -> Study:
    whole = {
        "tracking": (tracking(), tracking("specification", I=30.0, D=15.0, oI=18.0, oD=14.0)),
        "fleet": six(),
        "matters": matters(),
        "concealed": (concealed(), concealed(PASS, PASS, "creep")),
        "outcomes": GOOD,
    }
    return Study(**(whole | parts))


def test_a_study_that_reaches_all():
    rows = judge(made())
    assert len(rows) == 7
    assert all(row.passed for row in rows)
    assert rows[0].reached == (
        "inverse: 10.0; inverse with dynamics: 50.0; all three controllers have a gain margin of 5 and a phase margin of 80°"
    )
    assert rows[1].reached == "inverse: 1.25; inverse with dynamics: 1.25"
    assert rows[3].reached == "`fail`; verdict on the true rig: `fail`, steps overshoot by 51 %"
    assert rows[5].reached == "9 of 9, 100 % (with 95 % confidence at least 71 %)"  # 0.05^(1/9) = 0.717


def spec() -> Tracking:
    return tracking("specification")


@pytest.mark.parametrize(
    ("row", "parts", "says"),
    [
        (0, {"tracking": (tracking(I=11.0, oI=6.0), spec())}, "inverse: 4.5"),
        (0, {"tracking": (tracking(phase=81.0), spec())}, "80°, the inverses have others"),
        (1, {"tracking": (tracking(D=1.7), spec())}, "with dynamics: 2.12"),
        (2, {"fleet": six(tones=loop(status=RunStatus.PULL_IN, seconds=3.0))}, "5 of 6 stable (not DEA 6)"),
        (2, {"fleet": six(steps=loop(ringing=3e-5))}, "5 of 6 stable (not DEA 6)"),
        (2, {"fleet": ()}, "0 of 0"),
        (3, {"concealed": (concealed(PASS, PASS),)}, "`pass`; verdict on the true rig"),
        (4, {"concealed": (concealed(FAIL, MARGINAL),)}, "`marginal`; verdict on the true rig"),
        (5, {"outcomes": (*GOOD, outcome(18, inside=0.998), outcome(19, inside=None))}, "9 of 11, 82 %"),
        (5, {"outcomes": GOOD[9:]}, "no trial"),
        (6, {"outcomes": (*GOOD, outcome(18, sound=False), outcome(19, sound=False))}, "9 of 11, 82 %"),
        (6, {"outcomes": GOOD[:9]}, "no trial"),
    ],
)
def test_each_measure_can_be_missed(row, parts, says):
    rows = judge(made(**parts))
    assert [not r.passed for r in rows] == [n == row for n in range(7)]
    assert says in rows[row].reached


def test_nine_tenths_are_enough():
    nine = (*GOOD, outcome(18, inside=0.9), outcome(19, "pass", sound=False))
    # 10 of 11 inside, 9 of 10 caught.
    assert [row.passed for row in judge(made(outcomes=nine))[5:]] == [True, True]


def test_promises_are_counted_where_there_is_a_design():
    every = matters().promises
    assert [p.quantity for p in every] == ["bandwidth", "overshoot", "gain margin", "rms error"]
    # The ends belong to an interval; the gain margin of 6.5 lies above 6.
    assert [p.kept for p in every] == [True, True, False, True]
    assert every[3].achieved == pytest.approx(7.5)  # µm
    assert every[1].predicted.high == pytest.approx(4.0)  # %


def test_the_page_is_whole(setting, tmp_path, monkeypatch):
    # It ends before errors count: its rms is infinite.
    lost = replace(tracked(1e-6), run=loop(status=RunStatus.PULL_IN, seconds=3.0))
    study = made(outcomes=MIXED)
    study = replace(
        study,
        tracking=(
            study.tracking[0],
            replace(study.tracking[1], tracked={**study.tracking[1].tracked, "inverse": lost}),
        ),
    )
    asked = []

    def fake(folder, size, seed, jobs, tell):
        asked.append((size, seed, jobs))
        return study

    monkeypatch.setattr(control_check, "carry_out", fake)
    result = control_check.run(replace(setting, seed=3))
    assert asked == [("short", 3, 1)]
    written = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    names = ("tracking", "concealed")
    assert written == {"report.html", "control-check.json", "run.json", *(f"figures/{n}.csv" for n in names)}
    text = (tmp_path / "control-check.json").read_text()
    saved = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert saved["sentence"] == result["sentence"]
    assert "check passes 5, of which 3 keep inside the predicted band; 3 break a limit" in saved["sentence"]
    tracking, _, _, _, rates, failed = saved["tables"]
    assert [row[2] for row in tracking["rows"] if row[:2] == ["specification", "inverse"]] == ["–"]
    assert rates["rows"][0][:2] == ["all", "10"] and rates["rows"][0][-1].startswith("2 of ")
    assert [row[0] for row in failed["rows"]] == ["2", "3", "4"]
    page = (tmp_path / "report.html").read_text().replace("\xa0", " ")
    assert page.count("<svg") == 2
    assert ">nan<" not in page and ">inf<" not in page


def test_the_story_has_the_sizes_of_its_study():
    assert stories()["control-check"].sizes == tuple(running.SIZES)

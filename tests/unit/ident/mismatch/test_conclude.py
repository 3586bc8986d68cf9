"""What is said beside a verdict."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import Part
from deatwin.ident.mismatch import Verdict, conclude
from deatwin.ident.mismatch.located import LocationSummary, PlaceSummary
from deatwin.plant import (
    Creep,
    Diaphragm,
    Experiment,
    Hysteresis,
    Plant,
    Recording,
    SensorDrift,
    SensorJump,
)
from deatwin.plant.effects.catalogue import effect_named


def candidate(*effects: str, rms: float) -> SimpleNamespace:
    plant = SimpleNamespace(effects=tuple(map(effect_named, effects)))
    calibration = SimpleNamespace(plant=plant)
    return SimpleNamespace(effects=effects, losses=np.full(200, rms**2), noise=2.0, calibration=calibration)


BASE, PAIR = candidate(rms=10.0), candidate("creep", "delay", rms=2.1)


@pytest.mark.parametrize(
    ("verdict", "best", "said"),
    [(Verdict.UNKNOWN, None, True), (Verdict.NAMED, None, False), (Verdict.UNKNOWN, PAIR, False)],
)
def test_what_only_the_ranges_of_the_plant_refuse_is_said(monkeypatch, verdict, best, said):
    idle, held, weaker = candidate("delay", rms=9.9), candidate("creep", rms=2.2), candidate("hysteresis", rms=2.3)
    several = [
        SimpleNamespace(**vars(c), evidence=evidence)
        for c, evidence in ((BASE, 9.0), (PAIR, 8.0), (idle, 7.0), (held, 2.0), (weaker, 1.0))
    ]
    monkeypatch.setattr(conclude, "suffices", lambda c, base: True)
    monkeypatch.setattr(conclude, "held_back_by", lambda c: ("damping", "branch_time"))
    naming = SimpleNamespace(base=BASE, best=best, candidates=several)
    found = list(conclude._held_back(SimpleNamespace(verdict=verdict, naming=naming)))
    expected = "creep would explain the recordings, but only with damping, branch_time outside the allowed range"
    assert found == [expected] * said


@pytest.mark.parametrize(("at", "causes", "said"), [(13.3, 1, True), (5.0, 1, False), (13.3, 0, False)])
def test_an_event_that_unseen_data_placed_is_said(at, causes, said):
    """What judges has told one number of what it judges."""
    plant = Plant(rig=Diaphragm()).with_effects(SensorJump(at=at))
    blank = np.zeros(1000)
    whole = Part.whole(Experiment(recordings=(Recording.from_arrays(blank, blank, 0.02),)))
    fitted = replace(whole, masks=((whole.timepts < 10.0) | (whole.timepts > 16.0),))
    findings = SimpleNamespace(
        named=causes > 0,
        problem=SimpleNamespace(fitted=(fitted,), everything=(whole,)),
        answer=SimpleNamespace(calibration=SimpleNamespace(plant=plant)),
    )
    found = list(conclude._placed_unseen(findings))
    assert [text.startswith("sensor_jump.at was fitted to held-out data") for text in found] == [True] * said


def test_a_place_is_listed_with_its_best_effect():
    effects = (Creep(), SensorDrift(), SensorDrift().placed("command_gain"), SensorDrift().placed("command"))
    _, drift, gain, offset = (effect.name for effect in effects)
    tried = [candidate(drift, rms=9.0), candidate(gain, rms=2.4), candidate(offset, rms=2.8), candidate(rms=10.0)]
    predicted = PlaceSummary(place="film", score=0.7, explained=0.7)
    located = LocationSummary(time=(), frequency=(), region=(), place=(predicted,))
    findings = SimpleNamespace(
        location=SimpleNamespace(summary=located),
        problem=SimpleNamespace(everywhere=effects),
        base=SimpleNamespace(chosen=BASE, noise=2.0),
        naming=SimpleNamespace(candidates=tried),
    )
    found = conclude._location(findings)
    rows = [(place.place, place.effect, place.score) for place in found.place]
    # shares of the power beyond noise, 100 - 4
    assert rows == [
        ("drive", gain, pytest.approx((100 - 2.4**2) / 96)),
        ("film", None, 0.7),
        ("sensor", drift, pytest.approx((100 - 81) / 96)),
    ]


@pytest.mark.parametrize("verdict", [Verdict.AMBIGUOUS, Verdict.PARTLY])
def test_the_probability_of_an_explanation_is_that_of_its_effects_at_all_places(verdict):
    """The evidence's own, less the margin; what was tried and not offered keeps its share."""
    effects = (Creep(), SensorDrift(), SensorDrift().placed("command"), Hysteresis())
    creep, drift, elsewhere, _ = (effect.name for effect in effects)
    probabilities = {(creep,): 0.5, (drift,): 0.25, (elsewhere,): 0.15, (creep, drift): 0.07, (drift, creep): 0.03}

    def tried(*own):
        plant = Plant(rig=Diaphragm(), effects=tuple(effect for effect in effects if effect.name in own))
        return SimpleNamespace(effects=own, calibration=SimpleNamespace(plant=plant))

    findings = SimpleNamespace(
        named=True,
        verdict=verdict,
        answer=tried(drift),
        naming=SimpleNamespace(
            probabilities=probabilities,
            candidates=tuple(tried(*names) for names in probabilities),
            alternatives=(tried(creep),),
        ),
    )
    found = {one.effects: one.probability for one in conclude._explanations(findings)}
    expected = {("sensor_drift",): 0.95 * 0.4, ("creep",): 0.95 * 0.5}
    assert found == ({} if verdict is Verdict.PARTLY else pytest.approx(expected))
    # one that evidence cannot compare is as likely as the answer, 0.25 of then 1.25
    findings.naming.alternatives = (tried(creep), tried("hysteresis"))
    found = {one.effects: one.probability for one in conclude._explanations(findings)}
    expected = {("sensor_drift",): 0.95 * 0.32, ("creep",): 0.95 * 0.4, ("hysteresis",): 0.95 * 0.2}
    assert found == ({} if verdict is Verdict.PARTLY else pytest.approx(expected))


@pytest.mark.parametrize(
    ("verdict", "factor", "said"),
    [(Verdict.PARAMETERS, 20.0, True), (Verdict.PARAMETERS, 1.5, False), (Verdict.NAMED, 20.0, False)],
)
def test_a_parameter_far_from_its_nominal_value_may_hide_physics(verdict, factor, said):
    """Data sheets err by 30 %, so a factor of 1.5 is usual; a factor of 20 is ten deviations."""
    plant = Plant(rig=Diaphragm())
    off = plant.with_values({"damping": factor * plant.parameters["damping"].value})
    findings = SimpleNamespace(
        verdict=verdict, problem=SimpleNamespace(nominal=plant), final=SimpleNamespace(plant=off, names=("damping",))
    )
    found = list(conclude._doubtful_values(findings))
    start = "the fitted damping, 1.00 N s/m, is far from its nominal value, 0.0500 N s/m"
    assert [text.startswith(start) for text in found] == [True] * said


@pytest.mark.parametrize(
    ("unit", "said"), [(("", 1.0), "0.72 rms"), (("1", 1.0), "0.72 rms"), (("um", 1e-6), "0.72 µm rms")]
)
def test_an_error_that_is_left_has_its_unit_if_it_has_one(unit, said):
    tests = (SimpleNamespace(size=0.72 * unit[1]), SimpleNamespace(size=0.5 * unit[1]))
    answer = SimpleNamespace(adequate=False, fitted_test=tests[0], unseen_test=tests[1])
    findings = SimpleNamespace(named=True, answer=answer, left=None, unit=unit)
    assert conclude._left_over(findings) == [
        f"the explanation leaves an error of {said}, more than the allowed model error"
    ]

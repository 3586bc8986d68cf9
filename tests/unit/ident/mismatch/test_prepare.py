"""From checked recordings to the problem, by the public steps."""

import importlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from foreign_models import Motor
from needs import COMPILED
from runs import blank

from deatwin.ident.mismatch import DataQuality, check_quality, confirm, detect, diagnose, linearised_responses, prepare
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.prepare import _motion, effects_for
from deatwin.ident.mismatch.refit.base import Base
from deatwin.ident.parallel import one_thread, spawn_generators
from deatwin.plant import (
    CoulombFriction,
    Creep,
    Diaphragm,
    ElectrodeRC,
    Experiment,
    Plant,
    Recording,
    RigError,
    SensorDrift,
    Stack,
)
from deatwin.plant.excitation import band_limited_noise

NOMINAL = Plant(rig=Diaphragm())
UNREAD = object.__new__(DataQuality)
"""Recordings at which a test does not look."""
object.__setattr__(UNREAD, "experiments", ())


def test_the_motion_is_the_same_into_however_many_records_it_is_cut():
    """By it the plant's own error is expected: a share of what moves."""
    timepts = 0.02 * np.arange(6000)
    staircase = 1e-4 * np.floor(timepts / 5.0) + 1e-6 * np.sin(timepts)
    whole = Recording.from_arrays(np.sin(timepts), staircase, 0.02)
    pieces = tuple(whole.section(first, first + 250) for first in range(0, 6000, 250))
    cut = _motion(check_quality(NOMINAL, [Experiment(recordings=pieces)]))
    assert cut == pytest.approx(_motion(check_quality(NOMINAL, [Experiment(recordings=(whole,))])), rel=1e-6)
    assert cut == pytest.approx(np.std(staircase), rel=1e-3)


def test_a_faulty_reading_does_not_show_when_a_mismatch_begins():
    """Twenty readings that are lost carry a hundred times the energy of a mismatch that begins at 50 s."""
    module = importlib.import_module("deatwin.ident.mismatch.prepare")
    command = 2.4 + 0.3 * band_limited_noise(np.random.default_rng(3), 60.0, 0.02)
    blank = Recording.from_arrays(command, np.zeros(3000), 0.02)
    record = NOMINAL.record(Experiment(recordings=(blank,)), np.random.default_rng(4)).recordings[0]
    shown = record.outputs.copy()
    shown[0, 2500:] += 2e-5
    shown[0, 500:520] += 1e-3
    checked = check_quality(NOMINAL, [Experiment(recordings=(replace(record, outputs=shown),))])
    lost = np.zeros(3000, dtype=bool)
    lost[500:520] = True
    checked = replace(checked, stuck=((lost,),), outliers=((~lost & lost,),))
    candidate = SimpleNamespace(
        calibration=SimpleNamespace(plant=NOMINAL),
        fitted_test=SimpleNamespace(mismatch=False),
        unseen_test=SimpleNamespace(mismatch=True),
    )
    base = SimpleNamespace(chosen=candidate, noise=NOMINAL.rig.noise)
    # windows last two seconds
    assert module._late_onset(base, checked) == pytest.approx(50.0, abs=2.0)


def test_a_base_plant_is_not_calibrated_again_to_the_same_samples(monkeypatch):
    """From where a mismatch begins that only the held-out part has some of it is fitted, too, unless it was."""
    module = importlib.import_module("deatwin.ident.mismatch.prepare")
    part = lambda *masks: SimpleNamespace(fitted=(SimpleNamespace(masks=masks),), nominal=NOMINAL)  # noqa: E731
    first, longer = np.arange(10) < 6, np.arange(10) < 8
    candidate = SimpleNamespace(
        calibration=SimpleNamespace(plant=replace(NOMINAL, stages=4)),
        with_floor=lambda error: candidate,
        solved_like=lambda other: candidate,
    )
    asked = []
    monkeypatch.setattr(module, "_levels", lambda base, problem, checked: None)
    monkeypatch.setattr(module, "_late_onset", lambda base, checked: 7.0)
    monkeypatch.setattr(module, "followed_plant", lambda plant, experiments: (plant, 0.0))
    monkeypatch.setattr(module, "model_error_of", lambda plant, problem: 1e-6)
    monkeypatch.setattr(
        module,
        "calibrate_base",
        lambda problem: asked.append(problem) or Base(chosen=candidate, alternatives=(), noise=2e-6),
    )
    monkeypatch.setattr(module, "replace", lambda thing, **_: thing)
    for later, times in ((part(first), 1), (part(longer), 2), (part(first, first), 2)):
        asked.clear()
        monkeypatch.setattr(
            module, "_problem_of", lambda *given, later=later: part(first) if len(given) == 4 else later
        )
        prepare(NOMINAL, UNREAD, ())
        assert len(asked) == times


def test_effects_that_are_passed_speak_of_the_rig_and_a_users_own_stay_as_they_are():
    """The rig has a rotor and reads rad/s; a film's friction has 10 mN and a ball."""

    class Rubbing(CoulombFriction):
        name = "rubbing"

    given = [CoulombFriction(), SensorDrift(), own := Rubbing()]
    friction, drift, kept = effects_for(Motor(), given)
    assert "rotor" in friction.wording and "ball" not in friction.wording
    assert friction.described("force").unit == "N m" and drift.described("change").unit == "rad/s"
    assert kept is own
    assert effects_for(Motor(), [friction])[0] is friction
    assert list(effects_for(Diaphragm(), given)) == given


def test_a_value_that_a_user_gives_an_effect_of_a_film_rig_stays():
    """A film rig has the units of the catalogue, so 50 mN are 50 mN, although a stack's usual friction is 0.7 N."""
    usual, given = effects_for(Stack(), [CoulombFriction(), CoulombFriction(force=0.05)])
    assert (usual.force, given.force) == pytest.approx((0.7, 0.05))
    assert given.slip == usual.slip and given.described("force").upper == usual.described("force").upper


@COMPILED
@one_thread  # as a diagnosis runs: with more threads, products round differently
def test_the_public_steps_one_by_one_find_what_a_diagnosis_does():
    noise = band_limited_noise(np.random.default_rng(0), 12.0, 0.02)
    experiment = NOMINAL.with_effects(ElectrodeRC(time=0.1)).record(blank(noise), np.random.default_rng(1))
    effects = [ElectrodeRC()]
    checked = check_quality(NOMINAL, experiment)
    problem, base = prepare(NOMINAL, checked, effects)
    for form in (base.chosen, *base.alternatives):
        checked = confirm(checked, readings(form.calibration.plant, checked.experiments))
    fit = base.chosen.calibration
    known = linearised_responses(problem, fit, problem.effects, fit)
    detection = detect(base.chosen, problem, spawn_generators(0, 5)[0]).beside(known)
    assert detection.mismatch
    whole = diagnose(NOMINAL, experiment, effects=effects)
    assert detection.summary == whole.detection
    assert base.chosen.unseen_test.rms == pytest.approx(whole.fit.unseen.before * 1e-6, rel=1e-12)
    assert whole.forms[0].unseen == whole.fit.unseen.before


def test_what_is_no_effect_is_refused():
    with pytest.raises(RigError, match=r"'creep' is not an effect: .*effect_named"):
        prepare(NOMINAL, UNREAD, [Creep(), "creep"])

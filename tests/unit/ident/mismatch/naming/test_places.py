"""Effects at further places in a diagnosis: named where they enter, or told as one cause whose place is open."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from needs import COMPILED
from oscillator import Oscillator

from deatwin.ident.mismatch import Verdict, diagnose
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.places import causes_of
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import (
    Creep,
    Delay,
    Diaphragm,
    Experiment,
    PeriodicDisturbance,
    Plant,
    Reading,
    Recording,
    Rig,
    SensorDrift,
    SensorJump,
    SensorLag,
)


def recorded(rig: Rig, *effects, count: int = 800, seed: int = 1, level: float = 1.8, late: int = 0) -> Experiment:
    """Steps and noise of a rig with effects; of the first reading so many samples `late`, as a camera's are."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(level * rng.uniform(0.4, 1.6, count // 80), 40)
    noise = level * (1 + 0.5 * np.convolve(rng.standard_normal(count // 2 + 19), np.ones(20) / 20, "valid"))
    commands = np.concatenate([steps, noise])
    found = rig.with_effects(*effects).record(
        Experiment(recordings=(Recording.from_arrays(commands, np.zeros((0, commands.size)), rig.sample_time),)), rng
    )
    record = found.recordings[0]
    outputs = np.array(record.outputs)
    outputs[0] = np.concatenate([np.full(late, outputs[0, 0]), outputs[0, : outputs.shape[1] - late]])
    return Experiment(recordings=(replace(record, outputs=outputs),))


@COMPILED
def test_a_force_tone_of_one_millinewton_is_named_as_a_force():
    tone = replace(PeriodicDisturbance().placed("force"), amplitude=1e-3, frequency=6.0, phase=0.7)
    found = diagnose(Plant(rig=Diaphragm()), recorded(Diaphragm(), tone), effects=[PeriodicDisturbance()])
    (cause,) = found.causes
    assert (found.verdict, cause.effect, cause.place, cause.places) == (
        Verdict.NAMED,
        "periodic_disturbance",
        "force",
        None,
    )
    amplitude = cause.parameters["amplitude"]
    assert amplitude.low < 1e-3 < amplitude.high < 1.05e-3
    assert amplitude.unit == "N"
    assert "is added to the force" in found.sentence


@COMPILED
def test_a_late_camera_beside_an_undelayed_current_is_placed_at_the_reading():
    rig = Diaphragm(further=(Reading(name="current", noise=20e-9),))
    found = diagnose(Plant(rig=rig), recorded(rig, late=5, count=480), effects=[Delay(), SensorLag()])
    (cause,) = found.causes
    assert (found.verdict, cause.effect, cause.place, cause.family) == (Verdict.NAMED, "delay", "reading", "sensor")
    assert cause.parameters["time"].low < 0.1 < cause.parameters["time"].high


@pytest.mark.usefixtures("uncompiled")
def test_a_timing_error_beside_an_effect_is_no_second_cause():
    rig = Oscillator()
    late = 0.25 * rig.sample_time
    hidden = [SensorJump(change=2e-4, at=4.0), Delay(time=late)]
    found = diagnose(Plant(rig=rig), recorded(rig, *hidden, level=40.0), effects=[SensorJump(), Delay()])
    (jump,) = found.causes
    assert (found.verdict, jump.effect, found.rivals) == (Verdict.NAMED, "sensor_jump", ())
    change = jump.parameters["change"]
    assert abs(change.value - 2e-4) < change.high - change.low  # four deviations: by chance, once in 16,000
    assert "Adding sensor jump and the timing error of the rig to the model lowers the error" in found.sentence
    # It stays in the model, whose predictions would otherwise be late.
    fitted = found.model.plant.parameters["delay.time"].value
    assert fitted == pytest.approx(late, rel=0.05)
    assert [f"a delay of {1e3 * fitted:.3g} ms" in text for text in found.warnings if "timing error" in text] == [True]


@pytest.mark.parametrize(
    ("added", "causes"),
    [
        ([SensorJump(), Delay(time=0.0059)], ("sensor_jump",)),
        ([SensorJump(), SensorLag(time=0.0059).placed("command")], ("sensor_jump",)),
        ([SensorJump(), Delay(time=0.0061)], ("sensor_jump", "delay")),
        ([Delay(time=0.0059)], ("delay",)),
    ],
)
def test_the_time_of_a_reading_is_known_to_six_milliseconds_at_fifty_samples_a_second(added, causes):
    """Two deviations of 0.15 samples; a short delay alone is weighed by the detection."""
    plant = Plant(rig=Oscillator(), effects=tuple(added))
    one = Candidate(effects=plant.effect_names, calibration=SimpleNamespace(plant=plant), unseen=np.zeros(0), noise=1.0)
    assert sorted(causes_of(one)) == sorted(causes)


@pytest.mark.usefixtures("uncompiled")
def test_what_a_linear_plant_reads_the_same_from_two_places_is_one_cause_whose_place_is_open():
    tone = replace(PeriodicDisturbance(), amplitude=0.1e-3, frequency=6.0, phase=0.7)
    found = diagnose(Plant(rig=Oscillator()), recorded(Oscillator(), tone, level=40.0), effects=[PeriodicDisturbance()])
    (cause,) = found.causes
    assert (found.verdict, cause.effect, cause.place) == (Verdict.NAMED, "periodic_disturbance", None)
    assert set(cause.places) == {"reading", "command", "force"}
    assert found.rivals == ()
    assert found.names == ("periodic_disturbance",)
    assert "these recordings cannot decide" in found.sentence


@pytest.mark.usefixtures("uncompiled")
def test_a_place_that_reads_as_another_is_tried_in_the_place_of_what_was_found():
    """To a linear plant a command whose offset drifts slowly is a sensor whose zero does."""
    drift = replace(SensorDrift().placed("command"), change=1.0, time=20.0)
    found = diagnose(Plant(rig=Oscillator()), recorded(Oscillator(), drift, level=40.0), effects=[SensorDrift()])
    (cause,) = found.causes
    assert (found.verdict, cause.effect, cause.place) == (Verdict.NAMED, "sensor_drift", None)
    assert set(cause.places) == {"reading", "command"}


@pytest.mark.usefixtures("uncompiled")
def test_one_reading_has_no_more_effects_than_before_and_two_have_the_places_that_they_tell_apart():
    effects = [Creep(), Delay(), PeriodicDisturbance(), SensorDrift(), SensorLag()]
    one, two = Oscillator(), Oscillator(further=(Reading(name="speed", noise=1e-3),))
    benches = {}
    for rig in (one, two):
        checked = check_quality(Plant(rig=rig), recorded(rig, level=40.0, count=400))
        benches[rig] = prepare(Plant(rig=rig), checked, effects)[0]
    usual = [e.name for e in effects if one.with_effects().accepts(e)]
    assert [e.name for e in benches[one].effects] == usual
    drifts = {f"sensor_drift_at_{at}" for at in ("reading_gain", "command", "command_gain")}
    tried = {"periodic_disturbance_at_command", "periodic_disturbance_at_force", "sensor_lag_at_command"}
    assert {e.name for e in benches[one].elsewhere} == tried | drifts
    assert {e.name for e in benches[two].elsewhere} == tried
    told = {"delay_at_reading", *drifts}
    assert {e.name for e in benches[two].effects} == {*usual, *told}
    # The prior of an effect is shared by its places; an effect with one place keeps the whole.
    assert benches[one].log_share(["periodic_disturbance_at_force"]) == pytest.approx(-np.log(3))
    assert benches[one].log_share(["delay"]) == 0.0
    assert benches[two].log_share(["sensor_drift", "delay"]) == pytest.approx(-np.log(4) - np.log(2))


@pytest.mark.parametrize(("change", "less"), [(0.01, 0.0), (0.08, 7.5 - np.log(4))])
def test_a_large_drift_of_a_gain_is_unlikely_and_one_of_a_zero_in_its_own_unit_is_not(change, less):
    """Twice the typical 1 % is a deviation; 8 % are four, and 4 φ(4) is that much less than φ(1)."""
    plant = Plant(rig=Oscillator())
    drift, zero = (
        replace(SensorDrift().placed("command_gain"), change=change),
        replace(SensorDrift().placed("command"), change=1.0),
    )
    problem, _ = prepare(plant, check_quality(plant, recorded(Oscillator(), level=40.0, count=400)), [SensorDrift()])
    assert problem.log_size([drift.name], plant.with_effects(drift)) == pytest.approx(-less)
    assert problem.log_size([zero.name], plant.with_effects(zero)) == 0.0

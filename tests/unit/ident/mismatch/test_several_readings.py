"""Diagnoses of recordings with several readings, made by other equations and another integrator."""

import json
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from planar_fixture import (
    INSTANT,
    NOISE,
    PAIRS,
    SERIES_RESISTANCE,
    SLOW,
    STEP,
    TAILS,
    GainStep,
    excitation,
    holds,
    recorded,
)

from deatwin.ident.mismatch import Diagnosis, Verdict, diagnose
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import (
    Creep,
    Delay,
    DielectricAbsorption,
    ElectrodeLoss,
    Experiment,
    PermittivityDrift,
    Planar,
    Plant,
    Reading,
    Recording,
)

CURRENT = Reading(name="current", noise=NOISE["current"], series_resistance=SERIES_RESISTANCE)
CAPACITANCE = Reading(name="capacitance", noise=NOISE["capacitance"])
VOLTAGE = Reading(name="film_voltage", noise=NOISE["film_voltage"])


READINGS = {reading.name: reading for reading in (CAPACITANCE, CURRENT, VOLTAGE)}


def planar(*readings: Reading, noise: float = NOISE["displacement"]) -> Plant:
    return Plant(rig=Planar(noise=noise, further=readings))


def sensors(fault: str) -> Mapping[str, float]:
    """Noise of the readings: a film that shows a slow tail is filmed by a camera, with ten times the noise.

    A finer sensor of the displacement would tell creep from absorption by itself.
    """
    camera = fault in {effect.name for effect in TAILS}
    return {**NOISE, "displacement": NOISE["displacement"] * (10.0 if camera else 1.0)}


def diagnosed(fault: str, size: float, seconds: float, seed: int, *readings: Reading) -> Diagnosis:
    """Diagnosis of a fixture by the displacement and some further readings; without any, the rig states all."""
    rng = np.random.default_rng(seed)
    effects = next(pair for pair in PAIRS if fault in {effect.name for effect in pair})
    commands = (holds if effects is TAILS else excitation)(seconds, rng)
    (record,) = recorded(fault, size, commands, rng, sensors(fault)).recordings
    record = replace(record, extras={reading.name: record.extras[reading.name] for reading in readings})
    plant = planar(*(readings or READINGS.values()), noise=sensors(fault)["displacement"])
    return diagnose(plant, Experiment(recordings=(record,)), effects=effects)


def names_right(found: Diagnosis, fault: str) -> bool:
    return (found.verdict, tuple(cause.effect for cause in found.causes)) == (Verdict.NAMED, (fault,))


@pytest.mark.parametrize(
    ("size", "effect"),
    [
        (-0.05, PermittivityDrift(relative_change=-0.05, time=30.0)),
        (-0.01, ElectrodeLoss(share=0.01, at=INSTANT * 20.0 + STEP / 2)),
        (-0.03, GainStep(relative_change=-0.03, at=INSTANT * 20.0 + STEP / 2)),
        (1e3, Creep(modulus=1e3, time=SLOW)),
        (0.01, DielectricAbsorption(share=0.01, time=SLOW)),
    ],
    ids=["permittivity drift", "electrode loss", "gain step", "creep", "dielectric absorption"],
)
def test_the_plant_follows_other_equations_in_every_reading(size, effect):
    rng = np.random.default_rng(2)
    made = recorded(effect.name, size, excitation(20.0, rng), rng)
    run = planar(CURRENT, CAPACITANCE, VOLTAGE).with_effects(effect).simulate(made).require()
    record = made.recordings[0]
    measured = np.stack([record.outputs[0], *(record.extras[name] for name in list(NOISE)[1:])])
    # Of white noise of 1000 samples: 0.022 is one deviation.
    assert np.std(measured - run.outputs[0], axis=1) == pytest.approx(list(NOISE.values()), rel=0.1)


def test_a_capacitance_tells_a_drifting_gain_from_a_drifting_permittivity():
    # From the displacement alone they are ambiguous, as the study below shows at some length.
    found = diagnosed("gain_drift", -0.04, 20.0, 1, CAPACITANCE)
    assert (found.verdict, [cause.effect for cause in found.causes]) == (Verdict.NAMED, ["gain_drift"])
    assert found.taught is not None
    first, second = found.taught
    assert (first.reading, second.reading, second.unit) == ("displacement", "capacitance", "F")
    assert first.noise == pytest.approx(NOISE["displacement"], rel=0.1)
    assert second.noise == pytest.approx(NOISE["capacitance"], rel=0.1)
    assert second.unseen.after == pytest.approx(NOISE["capacitance"], rel=0.15)  # of 300 samples
    assert second.unseen.before > 1.2 * NOISE["capacitance"]
    assert second.with_it is not None and second.with_it["gain_drift"] > 0.99
    assert second.without_it is not None and min(second.without_it.values()) > 0.05
    assert json.loads(json.dumps(found.to_dict()))["readings"][1]["reading"] == "capacitance"
    assert Diagnosis.from_dict(found.to_dict()).taught == found.taught


def test_a_reading_with_a_gap_that_is_noisier_than_stated_is_taken_as_what_it_is():
    rng = np.random.default_rng(3)
    experiment = recorded("none", 0.0, excitation(20.0, rng), rng)
    (record,) = experiment.recordings
    spotty = record.extras["capacitance"].copy()
    spotty[200:400] = np.nan
    record = replace(record, extras={"capacitance": spotty})
    plant = planar(replace(CAPACITANCE, noise=NOISE["capacitance"] / 5))
    problem, base = prepare(plant, check_quality(plant, Experiment(recordings=(record,))), effects=())
    assert problem.nominal.rig.further[0].noise == pytest.approx(NOISE["capacitance"], rel=0.2)
    first, second = problem.everything
    assert (first.size, second.size) == (1000, 800)
    ratio = NOISE["displacement"] / NOISE["capacitance"]
    assert second.weight == pytest.approx(ratio, rel=0.2)
    assert np.std(base.chosen.calibration.residuals) == pytest.approx(NOISE["displacement"], rel=0.1)
    assert base.chosen.adequate


def test_the_noise_sets_the_weight_of_a_reading_if_it_hides_the_model_error():
    rng = np.random.default_rng(4)
    noise = 10 * NOISE["displacement"]
    made = recorded("none", 0.0, excitation(8.0, rng), rng, {**NOISE, "displacement": noise})
    plant = planar(CAPACITANCE, noise=noise)
    problem, _ = prepare(plant, check_quality(plant, made), effects=())
    assert problem.everything[1].weight == pytest.approx(noise / NOISE["capacitance"], rel=0.2)


def test_a_peak_at_each_step_is_no_noise_of_the_current():
    """A command that acts late leaves one in the current at each step, in ten samples of 25.

    The median of what the others show is then twice that of the noise.
    """
    rng = np.random.default_rng(5)
    held = np.repeat(rng.uniform(0.5, 1.5, 60), 25)
    blank = Experiment(recordings=(Recording.from_arrays(held, np.zeros((0, held.size)), 0.02),))
    made = planar(CURRENT).with_effects(Delay(time=0.1)).record(blank, rng)
    problem, base = prepare(planar(CURRENT), check_quality(planar(CURRENT), made), effects=())
    assert problem.nominal.rig.further[0].noise < 2.5 * NOISE["current"]
    assert not base.chosen.adequate


STUDIED: Mapping[str, tuple[float, float, tuple[Reading, ...]]] = {
    "permittivity_drift": (-0.08, -0.02, (CAPACITANCE, CURRENT)),
    "gain_drift": (-0.08, -0.02, (CAPACITANCE, CURRENT)),
    "leakage": (1e8, 5e8, (CURRENT,)),
    "amplifier_saturation": (2000.0, 2300.0, (CURRENT,)),
    # Sizes that move the displacement by 1 to 1.5 times its noise, rms. A held command drives a current only at its
    # steps, so the capacitance shows the slow tails.
    "electrode_loss": (-0.0024, -0.0016, (CAPACITANCE, CURRENT)),
    "gain_step": (-0.003, -0.002, (CAPACITANCE, CURRENT)),
    "creep": (900.0, 1400.0, (CAPACITANCE,)),
    "dielectric_absorption": (0.01, 0.015, (CAPACITANCE,)),
}
"""Range of sizes and further readings of each fault."""


def drawn(number: int) -> tuple[str, float, Reading]:
    """Fault, size and further reading of a case: forty with one of the first four faults, forty with the others."""
    rng = np.random.default_rng(1000 + number)
    fault = list(STUDIED)[4 * (number // 40) + number % 4]
    low, high, readings = STUDIED[fault]
    return fault, float(rng.uniform(low, high)), readings[number // 4 % len(readings)]


@pytest.mark.study
@pytest.mark.parametrize(
    "first",
    [
        pytest.param(0, id="drifts and compressions"),
        pytest.param(40, id="steps and tails"),
    ],
)
def test_of_forty_faults_that_displacement_leaves_open_current_or_capacitance_names_most(first):
    with_reading, alone = [], []
    for number in range(first, first + 40):
        fault, size, reading = drawn(number)
        with_reading.append(names_right(diagnosed(fault, size, 40.0, number, reading), fault))
        alone.append(names_right(diagnosed(fault, size, 40.0, number), fault))
    print(f"named right with the reading {sum(with_reading)} of 40, from displacement alone {sum(alone)} of 40")
    assert sum(with_reading) >= 38
    assert sum(alone) < 20


@pytest.mark.study
def test_of_forty_ambiguous_cases_the_reading_that_is_advised_first_resolves_most():
    """Cases that the displacement leaves ambiguous are diagnosed again with the reading that is advised first."""
    resolved: list[bool] = []
    for number in np.arange(80).reshape(2, 40).T.ravel().tolist():
        fault, size, _ = drawn(number)
        alone = diagnosed(fault, size, 40.0, number)
        if alone.verdict is not Verdict.AMBIGUOUS:
            continue
        assert alone.advice is not None
        advised = READINGS[alone.advice.readings[0].reading]
        resolved.append(names_right(diagnosed(fault, size, 40.0, number, advised), fault))
        print(number, fault, advised.name, resolved[-1], flush=True)
        if len(resolved) == 40:
            break
    print(f"resolved {sum(resolved)} of {len(resolved)}")
    assert len(resolved) == 40
    assert sum(resolved) >= 32

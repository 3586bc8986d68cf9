"""Diagnoses of recordings with several readings, made by other equations and another integrator."""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planar_fixture import COMPRESSIONS, DRIFTS, NOISE, SERIES_RESISTANCE, excitation, recorded

from deatwin.ident.mismatch import Diagnosis, Verdict, diagnose
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import (
    Delay,
    Effect,
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


def planar(*readings: Reading) -> Plant:
    return Plant(rig=Planar(noise=NOISE["displacement"], further=readings))


def diagnosed(fault: str, size: float, seconds: float, seed: int, *readings: Reading) -> Diagnosis:
    """Diagnosis of a fixture by the displacement and some further readings."""
    rng = np.random.default_rng(seed)
    effects: Sequence[Effect] = DRIFTS if fault.endswith("drift") else COMPRESSIONS
    return diagnose(planar(*readings), recorded(fault, size, excitation(seconds, rng), rng), effects=effects)


def told(*case: Any) -> tuple[Verdict, tuple[str, ...]]:
    """Verdict and causes of a fixture, as `diagnosed` takes it."""
    found = diagnosed(*case)
    return found.verdict, tuple(cause.effect for cause in found.causes)


def test_the_plant_follows_other_equations_in_every_reading() -> None:
    rng = np.random.default_rng(2)
    made = recorded("permittivity_drift", -0.05, excitation(20.0, rng), rng)
    drift = PermittivityDrift(relative_change=-0.05, time=30.0)
    run = planar(CURRENT, CAPACITANCE, VOLTAGE).with_effects(drift).simulate(made).require()
    record = made.recordings[0]
    measured = np.stack([record.outputs[0], *(record.extras[name] for name in list(NOISE)[1:])])
    # Of white noise of 1000 samples: 0.022 is one deviation.
    assert np.std(measured - run.outputs[0], axis=1) == pytest.approx(list(NOISE.values()), rel=0.1)


def test_a_capacitance_tells_a_drifting_gain_from_a_drifting_permittivity() -> None:
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


def test_a_reading_with_a_gap_that_is_noisier_than_stated_is_taken_as_what_it_is() -> None:
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


def test_a_peak_at_each_step_is_no_noise_of_the_current() -> None:
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


def drawn(number: int) -> tuple[str, float, Reading]:
    """Fault, size and further reading of a case of the study."""
    rng = np.random.default_rng(1000 + number)
    fault = ("permittivity_drift", "gain_drift", "leakage", "amplifier_saturation")[number % 4]
    low, high = {"leakage": (1e8, 5e8), "amplifier_saturation": (2000.0, 2300.0)}.get(fault, (-0.08, -0.02))
    return fault, float(rng.uniform(low, high)), CAPACITANCE if fault.endswith("drift") and number % 8 < 4 else CURRENT


@pytest.mark.study
def test_of_forty_faults_that_displacement_leaves_open_current_or_capacitance_names_most() -> None:
    with_reading, alone = [], []
    for number in range(40):
        fault, size, reading = drawn(number)
        with_reading.append(told(fault, size, 40.0, number, reading) == (Verdict.NAMED, (fault,)))
        alone.append(told(fault, size, 40.0, number) == (Verdict.NAMED, (fault,)))
    print(f"named right with the reading {sum(with_reading)} of 40, from displacement alone {sum(alone)} of 40")
    assert sum(with_reading) >= 38
    assert sum(alone) < 20

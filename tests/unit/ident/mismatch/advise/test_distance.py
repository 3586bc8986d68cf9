"""d² between explanations, against closed forms, dense matrices and the decisions that it predicts."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare
from scipy.stats import binom

from deatwin.ident.greybox.fit import Calibration, calibrate
from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.mismatch.advise.difference import Difference
from deatwin.ident.mismatch.advise.distance import Memory, confusion, distance_squared, separation
from deatwin.plant import Delay, Experiment, Parameter, Plant, Recording, SensorCurvature, SensorLag, SimulationError
from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place

STEP, NOISE = 0.02, 1e-6


@dataclass(frozen=True, kw_only=True)
class Amplifier(Bare):
    """A first-order lag between command and reading."""

    kind: ClassVar[str] = "amplifier"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=1e-4, unit="m/V", lower=1e-6, upper=1e-2),
            Parameter(name="time", value=0.1, unit="s", lower=0.0, upper=1.0),
            Parameter(name="zero", value=0.0, unit="m", lower=-1e-3, upper=1e-3),
        )

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1e-4)
        command = build.place(Place.DRIVE, "command", build.command)
        build.rate(position, build.parameter("gain") * command - position, mass=build.parameter("time"))
        return build.place(Place.SENSOR, "reading", position + build.parameter("zero"))


class Coarse(Amplifier):
    """An amplifier whose equations err by a hundredth of the motion."""

    share_of_motion = 0.01


BASE = Plant(rig=Amplifier())


def parts(commands: np.ndarray) -> list[Part]:
    record = Recording.from_arrays(commands, np.zeros(commands.size), STEP)
    return [Part.whole(Experiment(recordings=(record,)))]


def measured(asked: list[Part], readings: np.ndarray) -> list[Part]:
    record = replace(asked[0].experiment.recordings[0], outputs=readings[None])
    return [Part.whole(Experiment(recordings=(record,)))]


def commands(count: int = 600, seed: int = 0) -> np.ndarray:
    """Noise with most of its power below 1 Hz, where a delay and a lag look alike."""
    white = np.random.default_rng(seed).standard_normal(count + 50)
    return 2.0 + np.convolve(white, np.hanning(52)[1:-1] / 5, mode="valid")[:count]


def start(plant: Plant, asked: list[Part]) -> Calibration:
    """The plant as it is, fitted to its own readings."""
    readings = simulated(plant, asked)
    assert readings is not None
    return calibrate(plant, measured(asked, readings), evaluations=1, starts=1)


def spread(readings: np.ndarray, noise: float, model_error: float) -> np.ndarray:
    """The covariance that the module states, element by element."""
    n = readings.size
    levels = np.linspace(readings.min(), readings.max(), 8)
    hats = np.array([np.interp(readings, levels, row) for row in np.eye(8)])
    apart = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    slow = np.exp(-apart / 50)
    return noise**2 * np.eye(n) + model_error**2 / 2 * (np.sqrt(hats).T @ np.sqrt(hats) + slow)


def test_white_noise_and_a_linear_plant_give_the_distance_of_the_textbook():
    asked = parts(commands())
    curved = BASE.with_effects(SensorCurvature(curvature=100.0))
    y = simulated(BASE.with_values({"time": 0.0}), asked)
    truth = curved.with_values({"time": 0.0})
    alternative = replace(start(BASE.with_values({"time": 0.0}), asked), names=("gain", "zero"))
    # reading = gain u + zero: what it cannot follow of the square is the rest of a straight line through it
    line = np.column_stack([np.ones(y.size), y])
    rest = 100 * y**2 - line @ np.linalg.lstsq(line, 100 * y**2, rcond=None)[0]
    expected = float(rest @ rest) / NOISE**2
    for steps in (0, 4):  # damping by 1 % costs 1e-4 of what the parameters take up, and they take up 100 y² nearly all
        assert distance_squared(truth, alternative, asked, NOISE, steps=steps) == pytest.approx(expected, rel=0.01)


def test_the_quick_square_form_is_that_of_the_dense_covariance():
    rng = np.random.default_rng(1)
    readings, left = np.cumsum(rng.standard_normal(300)), rng.standard_normal(300)
    known = Difference(readings=readings, left=left, model_error=np.full(300, 0.7), sizes=(300,))
    expected = (left @ left) ** 2 / (left @ spread(readings, 1.3, 0.7) @ left)
    assert known.squared_distance(1.3) == pytest.approx(expected, rel=1e-9)


def test_the_errors_of_two_readings_are_independent():
    """However alike their values and differences are, and whatever the sign of either."""
    rng = np.random.default_rng(2)
    first, other = np.cumsum(rng.standard_normal((2, 200)), axis=1)
    for sign, size in ((1.0, 1.0), (-1.0, 1.0), (1.0, 30.0)):
        readings, left = np.concatenate([first, size * other]), np.concatenate([first**2, sign * other**2])
        both = Difference(
            readings=readings, left=left, model_error=np.full(400, 0.7), sizes=(200, 200), names=("", "current")
        )
        cov = np.zeros((400, 400))
        cov[:200, :200], cov[200:, 200:] = spread(first, 1.3, 0.7), spread(size * other, 1.3, 0.7)
        assert both.squared_distance(1.3) == pytest.approx((left @ left) ** 2 / (left @ cov @ left), rel=1e-9)
        assert both.beside(both).names == ("", "current", "", "current")


def test_a_further_reading_in_units_of_its_noise_is_no_motion():
    asked = parts(commands())
    readings = simulated(BASE, asked)
    further = [*asked, replace(asked[0], reading="current", weight=1e3)]
    plant = Plant(rig=Coarse())
    alone, both = (
        Difference.between(plant, plant, values, 0.0 * values, some)
        for values, some in ((readings, asked), (np.concatenate([readings, 1e3 * readings]), further))
    )
    assert alone.model_error[0] == pytest.approx(0.01 * readings.std())
    assert both.model_error == pytest.approx(np.full(2 * readings.size, alone.model_error[0]))


def test_an_experiment_is_one_however_it_is_cut_into_records():
    """Missing rows cut an experiment into records, but neither the plant's motion nor its slow errors end there."""
    t = np.arange(1500) * STEP
    readings, left = 1e-4 * np.sin(0.4 * np.pi * t), 1e-6 * np.sin(0.1 * np.pi * t)
    plant = Plant(rig=Coarse())
    for size in (1500, 50):
        begins = STEP * np.arange(0, 1500, size)
        records = tuple(Recording.from_arrays(np.zeros(size), np.zeros(size), STEP, start=at) for at in begins)
        found = Difference.between(plant, plant, readings, left, [Part.whole(Experiment(recordings=records))])
        cov = spread(readings, NOISE, 0.01 * readings.std())
        assert found.squared_distance(NOISE) == pytest.approx((left @ left) ** 2 / (left @ cov @ left), rel=1e-9)


def test_thousands_of_samples_of_a_tenth_of_the_model_error_tell_nothing():
    t = np.arange(6000) * STEP
    readings = 200e-6 * np.sin(np.pi * t)
    slow = Difference(
        readings=readings, left=0.14e-6 * np.cos(0.2 * t), model_error=np.full(t.size, 1e-6), sizes=(t.size,)
    )
    assert slow.rms == pytest.approx(0.1e-6, rel=0.05)
    assert slow.rms**2 * t.size / (2e-6) ** 2 > 14  # what white noise alone would say
    # an error of correlation time 1 s has a power of 2 s m²/2 = 50 samples m² at low frequency: 4 + 50 µm² in place
    # of 4; the static half, which this difference averages out, only lowers d² further
    assert slow.squared_distance(2e-6) < 15 * 4 / 54 * 1.1


def test_a_fast_difference_counts_against_the_noise_alone():
    t = np.arange(6000) * STEP
    fast = Difference(
        readings=200e-6 * np.sin(np.pi * t),
        left=0.1e-6 * np.cos(np.pi * np.arange(t.size)),
        model_error=np.full(t.size, 1e-6),
        sizes=(t.size,),
    )
    # the slow half has (1 - a)/(1 + a) = 0.01 of its variance at this frequency, and a level keeps a sample or so
    assert fast.squared_distance(2e-6) == pytest.approx(6000 * 0.01 / 4, rel=0.05)


def test_repeats_do_not_average_a_static_error_out():
    t = np.arange(2000) * STEP
    readings = np.sin(np.pi * t)
    once = Difference(readings=readings, left=readings**2, model_error=np.ones(t.size), sizes=(t.size,))
    often = once
    for _ in range(9):
        often = often.beside(once)
    # a static error hides the square of the reading however often it is seen: d² ends at 2 (δ'δ)² / Σ(√h'δ)²
    sums = np.sqrt([np.interp(readings, np.linspace(-1, 1, 8), row) for row in np.eye(8)]) @ readings**2
    end = 2 * float(readings**2 @ readings**2) ** 2 / float(sums @ sums)
    assert once.squared_distance(0.1) < often.squared_distance(0.1) < end


def test_what_one_explanation_contains_is_judged_the_other_way():
    asked = parts(commands())
    small, large = start(BASE, asked), start(BASE.with_effects(SensorCurvature(curvature=20.0)), asked)
    expected = distance_squared(large.plant, small, asked, NOISE)
    assert separation(small, large, asked, NOISE) == separation(large, small, asked, NOISE) == expected
    assert expected > 1.0
    assert distance_squared(small.plant, large, asked, NOISE) < 1e-3


def test_earlier_recordings_hold_a_rival_back():
    old, new = parts(commands(seed=2)), parts(commands(200, seed=3))
    plants = [BASE.with_effects(Delay(time=0.05)), BASE.with_effects(SensorLag(time=0.05))]
    seen = measured(old, simulated(plants[0], old))
    truth, alternative = (calibrate(plant, seen, tolerance=1e-8, starts=1) for plant in plants)
    memory = Memory.of(truth, alternative, seen)
    free = distance_squared(truth.plant, alternative, new, NOISE)
    held = distance_squared(truth.plant, alternative, new, NOISE, memory=memory)
    before = memory.refitted.squared_distance(NOISE)
    both = distance_squared(truth.plant, alternative, [*seen, *new], NOISE)
    assert free + before < 1.02 * held  # one refit for both cannot do better than one for each
    assert held == pytest.approx(both, rel=0.05)  # to first order, since the fit is near


def test_a_truth_that_fails_says_so():
    asked = parts(np.full(600, 1e200))
    fit = start(BASE, parts(commands()))
    with pytest.raises(SimulationError, match="the plant of one explanation cannot be simulated"):
        distance_squared(BASE.with_effects(SensorCurvature(curvature=1e3)), fit, asked, NOISE)


def wrong_wins(asked: list[Part], plants: list[Plant], errors: tuple[float, float], trials: int) -> int:
    """How often the second plant, refitted to recordings of the first, leaves the smaller residual."""
    rng = np.random.default_rng(7)
    y = simulated(plants[0], asked)
    root = np.linalg.cholesky(spread(y, *errors))
    wins = 0
    for _ in range(trials):
        seen = measured(asked, y + root @ rng.standard_normal(y.size))
        right, wrong = (calibrate(plant, seen, evaluations=8, tolerance=1e-6, starts=1).rms for plant in plants)
        wins += wrong < right
    return wins


@pytest.mark.parametrize(
    ("share", "trials"),
    [(1.0, 120), *(pytest.param(share, 1500, marks=pytest.mark.study) for share in (0.0, 0.3, 1.0))],
)
def test_the_wrong_one_wins_as_often_as_predicted(share, trials):
    asked = parts(commands(300))

    def plants(model_error: float) -> list[Plant]:
        plant = BASE.with_rig(replace(BASE.rig, model_error=model_error))
        return [plant.with_effects(Delay(time=0.03)), plant.with_effects(SensorLag(time=0.03))]

    def squared(size: float) -> float:
        truth, alternative = plants(share * size)
        fit = calibrate(alternative, measured(asked, simulated(truth, asked)), starts=1)
        return distance_squared(truth, fit, asked, size)

    noise = NOISE * np.sqrt(squared(NOISE)) / 2  # d² goes with the square of the errors: here d is 2
    predicted = confusion(squared(noise))
    assert predicted == pytest.approx(0.159, abs=0.01)
    low, high = binom.interval(0.998, trials, predicted)
    assert low <= wrong_wins(asked, plants(share * noise), (noise, share * noise), trials) <= high

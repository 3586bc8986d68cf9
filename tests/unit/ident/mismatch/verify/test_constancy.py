"""Whether the strength of an effect changes with time: on residuals that are given, and on a clock that runs fast."""

from types import SimpleNamespace

import numpy as np
import pytest
from needs import COMPILED
from runs import blank
from scipy.interpolate import CubicSpline

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.verify.constancy import SURELY, Constancy, constancies
from deatwin.plant import Delay, Diaphragm, Experiment, Plant, Recording
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.parameters import Scale

SAMPLES, STEP = 5000, 0.02
TIMES = STEP * np.arange(SAMPLES)
EVENLY = 2.0 * (TIMES - TIMES.mean()) / TIMES.max()
NOISE = 2e-6


def fit_of(residuals: np.ndarray, *others: np.ndarray, scale: Scale = Scale.LINEAR, event: str = "") -> SimpleNamespace:
    """A fit with one effect of strength 4, by which the readings change as white noise does, and other parameters."""
    by_strength = np.random.default_rng(5).normal(size=SAMPLES)  # of the relative strength, m
    slope = scale.slope(4.0)
    effect = SimpleNamespace(name="delay", strength="time", event=event)
    return SimpleNamespace(
        plant=SimpleNamespace(effects=(effect,), parameters={"delay.time": SimpleNamespace(value=4.0, scale=scale)}),
        names=("delay.time", *("other",) * len(others)),
        residuals=residuals,
        jacobian=np.column_stack([by_strength * slope / 4.0, *others]),
    )


PARTS = (SimpleNamespace(timepts=TIMES + 7.0),)
BY_STRENGTH = np.random.default_rng(5).normal(size=SAMPLES)
WHITE = np.random.default_rng(6).normal(size=SAMPLES)


@pytest.mark.parametrize("scale", list(Scale))
def test_a_strength_that_grows_from_nothing_changes_by_twice_its_mean(scale):
    (found,) = constancies(fit_of(EVENLY * BY_STRENGTH + 0.1 * WHITE, scale=scale), PARTS, ("delay",))
    # white noise of 0.1 over 5000 samples whose derivatives have the mean square 1/3: 0.1 sqrt(3/5000), doubled
    assert found.change == pytest.approx(2.0, abs=4 * 0.2 * np.sqrt(3 / SAMPLES))
    assert found.change / found.deviation > 100
    assert found.own == pytest.approx(1.0, abs=0.01)
    assert not found.holds


def test_the_interval_of_a_change_holds_the_true_one_in_95_of_100_draws():
    rng, held = np.random.default_rng(1), []
    for _ in range(400):
        true = rng.uniform(-3.0, 3.0)
        residuals = 0.5 * true * EVENLY * BY_STRENGTH + 20.0 * rng.normal(size=SAMPLES)
        (found,) = constancies(fit_of(residuals), PARTS, ("delay",))
        held.append(abs(found.change - true) <= SURELY * found.deviation)
    # of 400 draws at 95 %, with Student's law of 19 degrees of freedom: 92 to 98 % is three deviations
    assert 0.92 <= np.mean(held) <= 0.98


def test_a_change_that_another_parameter_can_make_is_no_change():
    nearly = EVENLY * BY_STRENGTH + 0.1 * np.random.default_rng(7).normal(size=SAMPLES)
    (found,) = constancies(fit_of(2.0 * EVENLY * BY_STRENGTH, nearly), PARTS, ("delay",))
    assert found.own < 0.05
    assert found == Constancy(effect="delay", own=found.own)
    assert found.holds
    (none,) = constancies(fit_of(WHITE, EVENLY * BY_STRENGTH), PARTS, ("delay",))
    assert none.own == pytest.approx(0.0, abs=1e-12)
    assert none.holds


def test_time_begins_anew_in_each_experiment():
    half = SAMPLES // 2
    parts = (SimpleNamespace(timepts=TIMES[:half]), SimpleNamespace(timepts=TIMES[:half] + 500.0))
    anew = np.tile(TIMES[:half], 2)
    growing = 2.0 * (anew - anew.mean()) / anew.max()
    (found,) = constancies(fit_of(growing * BY_STRENGTH), parts, ("delay",))
    assert found.change == pytest.approx(2.0, rel=1e-9)


def test_events_other_effects_and_strengths_that_were_not_fitted_are_passed_over():
    assert constancies(fit_of(WHITE, event="at"), PARTS, ("delay",)) == ()
    assert constancies(fit_of(WHITE), PARTS, ("creep",)) == ()
    fixed = fit_of(WHITE)
    fixed.names = ("other",)
    assert constancies(fixed, PARTS, ("delay",)) == ()


@pytest.mark.parametrize(("too_much", "share", "mends"), [(3.0, 0.8, True), (3.0, 0.7, False), (None, 0.8, False)])
def test_a_change_mends_what_leaves_too_much_if_it_takes_most_of_that(too_much, share, mends):
    """Beside a noise of 2 a fit leaves 3, of whose square the change takes a given share."""
    change, beside = EVENLY * BY_STRENGTH, np.random.default_rng(8).normal(size=SAMPLES)
    beside -= change * (change @ beside) / (change @ change)
    sizes = [np.sqrt(np.mean(signal**2)) for signal in (change, beside)]
    residuals = 3.0 * np.sqrt(share) * change / sizes[0] + np.sqrt(9.0 * (1 - share) + 4.0) * beside / sizes[1]
    (found,) = constancies(fit_of(residuals), PARTS, ("delay",), too_much)
    assert found.mends is mends


# 95 % of Student's law with 19 degrees of freedom: 2.09 deviations; seven where the change would mend what is left, since
# residuals that remember long make up more than that law says.
@pytest.mark.parametrize(
    ("mends", "change", "deviation", "holds"),
    [
        (False, 1.5, 0.2, False),
        (False, -1.5, 0.2, False),
        (False, 1.5, 0.25, True),
        (False, 0.9, 0.01, True),
        (False, 30.0, 20.0, True),
        (False, None, None, True),
        (False, 0.4, 0.05, True),
        (True, 0.4, 0.05, False),
        (True, -0.4, 0.05, False),
        (True, 0.4, 0.06, True),
    ],
)
def test_what_speaks_against_an_effect(mends, change, deviation, holds):
    assert Constancy(effect="delay", change=change, deviation=deviation, own=0.5, mends=mends).holds is holds


@COMPILED
def test_a_clock_that_runs_fast_is_no_delay():
    plant, rng = Plant(rig=Diaphragm()), np.random.default_rng(11)
    command = band_limited_noise(rng, 120.0, STEP)
    unread = blank(command)
    times = unread.recordings[0].timepts
    noise = NOISE * rng.normal(size=times.size)
    delayed = plant.with_effects(Delay(time=0.002)).simulate(unread).outputs[0][0]
    exact = plant.simulate(unread).outputs[0][0]
    skewed = CubicSpline(times, exact)(times * (1 - 0.002 / times[-1]))  # 0 to 2 ms late, so that first order holds

    def judged(output: np.ndarray) -> tuple[Constancy, float]:
        experiment = Experiment(recordings=(Recording.from_arrays(command, output + noise, STEP),))
        parts = (Part(experiment=experiment, masks=(np.ones(times.size, dtype=bool),)),)
        fit = calibrate(plant.with_effects(Delay(time=0.003)), parts, starts=1)
        (found,) = constancies(fit, parts, ("delay",))
        return found, fit.plant.parameters["delay.time"].value

    assert judged(delayed)[0].holds
    fast, mean = judged(skewed)
    # From the beginning to the end the delay grows by 2 ms, whatever mean the membrane's own damping leaves to it. The
    # command is held from sample to sample, so that what lies between two readings is no spline.
    assert fast.change * mean == pytest.approx(2e-3, rel=0.25)
    assert not fast.holds

"""Detection against the theory of white noise, against false alarms, and on the engine's own objects."""

import importlib
import json
from dataclasses import replace

import numpy as np
import pytest
from made_fits import benched
from runs import blank
from scipy.signal import lfilter
from scipy.stats import kstwobign

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.mismatch.detect.detect import detect, detect_in
from deatwin.ident.mismatch.detect.law import Law, Power
from deatwin.ident.mismatch.detect.leftover import Leftover, leftover_of
from deatwin.ident.mismatch.detect.null import Refit, _autoregression, colour
from deatwin.ident.mismatch.detect.origin import Origin, origin_of, without_forms
from deatwin.ident.mismatch.detect.statistics import Scores
from deatwin.ident.mismatch.naming.candidate import judge
from deatwin.ident.mismatch.naming.screen import LinearisedResponse
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.repeats import find_repeats
from deatwin.ident.mismatch.thresholds import SIGNIFICANCE
from deatwin.plant import Delay, Diaphragm, Plant, SensorDrift, SensorJump, records
from deatwin.plant.excitation import band_limited_noise, random_holds

STEP, NOISE, MODEL_ERROR = 0.02, 2e-6, 1.2e-6


def lagged(signal: np.ndarray, time: float) -> np.ndarray:
    share = 1 - np.exp(-STEP / time)
    return lfilter([share], [1, share - 1], signal - signal[0]) + signal[0]


def film(n: int, seed: int, *, periods: int = 1, holds: bool = False, model_error: float = 0.0) -> Leftover:
    """A film of two lags that answers the square of the command, the derivatives by its parameters, no residual."""
    rng = np.random.default_rng(seed)
    make = (
        (lambda s: random_holds(rng, s, STEP, 1.2, 3.2, 1.0, 5.0))
        if holds
        else (lambda s: band_limited_noise(rng, s, STEP))
    )
    command = np.tile(make(n * STEP / periods)[: n // periods], periods)
    reading = 40e-6 * lagged(0.8 * lagged(command**2, 0.05) + 0.2 * lagged(command**2, 3.0), 0.03)
    columns = [
        np.full(n, 1e-4),
        reading,
        reading**2 / 1e-4,
        10 * np.gradient(reading),
        lagged(reading, 3.0),
        lagged(reading, 0.2),
        lagged(reading**2, 3.0) / 1e-4,
    ]
    return Leftover(
        residual=np.zeros(n),
        fitted=np.arange(n) < 0.7 * n,
        jacobian=np.stack(columns, axis=1),
        commands=command,
        readings=reading,
        moved=reading - reading[0],
        timepts=STEP * np.arange(n),
        record=np.zeros(n, dtype=int),
        experiment=np.zeros(n, dtype=int),
        sample_time=STEP,
        noise=NOISE,
        model_error=model_error,
    )


def after_fit(left: Leftover, residual: np.ndarray) -> np.ndarray:
    """What least squares of the parameters leaves, by a routine that the engine does not use."""
    scaled = left.jacobian / np.linalg.norm(left.jacobian, axis=0)
    estimate = np.linalg.lstsq(scaled[left.fitted], residual[left.fitted], rcond=1e-10)[0]
    return residual - scaled @ estimate


def shape_error(left: Leftover, rng: np.random.Generator, size: float) -> np.ndarray:
    """Bumps and kinks of the reading and of its past, unlike the polynomials of the engine, of a size after the fit."""
    now = (left.readings - left.readings.mean()) / left.readings.std()
    past = lagged(now, float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))))
    a, b, c = rng.standard_normal(3)
    error = (
        np.exp(-((now - a) ** 2))
        + rng.standard_normal() * np.tanh(past - b) * now
        + rng.standard_normal() * np.exp(-2 * (past - c) ** 2)
    )
    return error * size / np.sqrt(np.mean(after_fit(left, error)[left.fitted] ** 2))


def white(rng: np.random.Generator, n: int) -> np.ndarray:
    return NOISE * rng.standard_normal(n)


def slow(rng: np.random.Generator, n: int) -> np.ndarray:
    """A disturbance below about 1 Hz, of unit variance."""
    found = lfilter([1.0], np.poly([0.93, 0.9]), rng.standard_normal(n + 300))[300:]
    return (found - found.mean()) / found.std()


def rejected(law: Law, residual: np.ndarray) -> bool:
    return law.p_value(float(law.groups(law.battery(residual[None])).max())) < SIGNIFICANCE


# --- the theory of white noise -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def plain():
    left = film(1500, 0)
    bare = replace(left, jacobian=np.ones((1500, 1)), fitted=np.ones(1500, dtype=bool))
    return Law(bare, np.random.default_rng(1), 1000)


def test_the_distance_of_cumulated_periodograms_follows_kolmogorov(plain):
    # the 99 % quantile of 1000 draws scatters by sqrt(0.01 0.99 / 1000) / f(1.63) = 0.05; three of them
    assert plain.distance * np.sqrt(750) == pytest.approx(kstwobign.ppf(0.99), abs=0.15)
    np.testing.assert_allclose(plain.spectrum, np.arange(1, 751) / 750, atol=0.005)


def test_correlations_and_variances_scatter_as_theory_says(plain):
    # correlations with a fixed signal have variance 1/n; the deviation over 1000 draws is known to 2.2 %, one of 60
    # may be three and a half of these off
    varies = plain.linear[1] < np.inf
    np.testing.assert_allclose(plain.linear[1][varies], 1.0, atol=0.08)
    # the logarithm of a mean of n squares has the deviation sqrt(2/n)
    assert plain.ratios[1][0] == pytest.approx(np.sqrt(2 / 1500), rel=0.08)


def test_p_values_of_white_noise_are_uniform(plain):
    rng = np.random.default_rng(2)
    groups = plain.groups(plain.battery(white(rng, 1500 * 300).reshape(300, 1500) - 0.0)).max(axis=1)
    p_values = np.array([plain.p_value(x) for x in groups])
    # Kolmogorov's 99.9 % bound of 300 values and of the 1000 draws behind them
    grid = np.linspace(0.05, 0.95, 19)
    assert np.abs(np.array([np.mean(p_values <= g) for g in grid]) - grid).max() < 1.95 * np.sqrt(1 / 300 + 1 / 1000)


def test_the_refit_leaves_what_least_squares_leave():
    left = film(900, 3)
    residuals = np.random.default_rng(4).standard_normal((3, 900))
    expected = [after_fit(left, r) for r in residuals]
    np.testing.assert_allclose(Refit(left)(residuals), expected, atol=1e-6)


@pytest.mark.parametrize("pole", [0.0, 0.6, -0.5])
def test_the_colour_of_the_noise_is_found_above_the_motion(pole):
    left, rng = film(6000, 5), np.random.default_rng(6)
    noise = lfilter([1.0], [1.0, -pole], rng.standard_normal(6300))[300:]
    motion = 3e-6 * np.sin(2 * np.pi * 0.3 * left.timepts)
    found, deviation = colour(replace(left, residual=NOISE * noise + motion))
    impulse = lfilter([1.0], found, np.r_[1.0, np.zeros(200)])
    lag_one = impulse[1:] @ impulse[:-1] / (impulse @ impulse)
    # 6000 samples tell the correlation of neighbours to 0.013; half of the spectrum to twice that
    assert lag_one == pytest.approx(pole, abs=0.08)
    assert deviation**2 * (impulse @ impulse) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.parametrize("reflections", [(40.0,), (-40.0, 40.0), (40.0, -40.0, 40.0)])
def test_no_colour_rings_without_end(reflections):
    """A search may go where a hyperbolic tangent is 1 to the last digit: the response must stay finite there."""
    poles = np.roots(_autoregression(np.array(reflections)))
    assert (np.abs(poles) < 1.0).all()


# --- false alarms and power ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("holds", "model_error"), [(False, 0.0), (False, MODEL_ERROR), (True, MODEL_ERROR)])
def test_false_alarms_are_one_in_a_hundred_at_most(holds, model_error):
    """Two hundred clean records of four commands; the model error has exactly its stated size, in another form."""
    alarms = 0
    for seed in range(4):
        left = film(1500, 10 + seed, holds=holds, model_error=model_error)
        law, rng = Law(left, np.random.default_rng(seed), 400), np.random.default_rng(100 + seed)
        for _ in range(50):
            error = shape_error(left, rng, model_error) if model_error else 0.0
            residual = after_fit(left, white(rng, 1500) + error)
            size = max(np.mean(residual[p] ** 2) for p in (left.fitted, ~left.fitted)) - NOISE**2
            alarms += rejected(law, residual) and size >= max(model_error**2, 0.1 * NOISE**2)
    # one in a hundred makes seven or more of 200 once in 200 such tests
    assert alarms <= 6


def test_coloured_noise_is_no_alarm():
    alarms = 0
    for seed in range(8):
        left, rng = film(1500, 20 + seed), np.random.default_rng(seed)
        noise = NOISE * 0.8 * lfilter([1.0], [1.0, -0.6], rng.standard_normal(1800))[300:]
        alarms += detect_in(replace(left, residual=after_fit(left, noise)), rng, draws=200).mismatch
    assert alarms <= 1  # at one in a hundred, two of eight come three times in a thousand


def test_readings_that_the_plant_makes_itself_are_no_alarm():
    """A residual of exactly zero is smaller than all that chance makes, and has the spectrum of no other."""
    left = film(600, 5)
    found = detect_in(replace(left, residual=np.zeros(600)), np.random.default_rng(5), draws=99)
    assert (found.size, found.mismatch) == (0.0, False)
    assert found.p_value == pytest.approx(1.0, abs=0.05)
    assert np.isfinite([one.p_value for one in found.statistics]).all()


def test_a_short_loud_record_is_no_alarm_by_its_size():
    """Of 300 samples 90 are unseen, whose power scatters by 15 %: a fifth more than the noise's is nothing there."""
    alarms = 0
    for seed in range(8):
        left, rng = film(300, 40 + seed), np.random.default_rng(seed)
        for _ in range(25):
            alarms += detect_in(replace(left, residual=after_fit(left, white(rng, 300))), rng, draws=100).certain
    # Three standard deviations of a chi-squared law with 90 degrees of freedom are exceeded 4 times in 1000, and the
    # refit's own error, of seven parameters, has fewer: five times that are allowed.
    assert alarms <= 4


@pytest.mark.parametrize(
    "size, chance, certain",
    [(2.0, 0.9, False), (2.0, 0.2, True), (1.45, 0.2, True), (1.2, 0.2, False), (3.5, 0.9, True)],
)
def test_what_chance_makes_as_often_as_not_is_no_mismatch_by_its_size(size, chance, certain, monkeypatch):
    """A model error is what it is said to be on the average: in some records it is nearly twice as large."""
    left, rng = film(6000, 60, model_error=MODEL_ERROR), np.random.default_rng(6)
    monkeypatch.setattr(Law, "p_value", lambda law, largest: chance)
    residual = after_fit(left, white(rng, 6000)) + shape_error(left, rng, size * MODEL_ERROR)
    for part in (left.fitted, ~left.fitted):  # of exactly the size
        residual[part] *= np.hypot(NOISE, size * MODEL_ERROR) / np.sqrt(np.mean(residual[part] ** 2))
    found = detect_in(replace(left, residual=residual), rng, draws=20)
    assert found.size == pytest.approx(size * MODEL_ERROR)
    assert (found.certain, found.mismatch) == (certain, certain)


def test_power_grows_with_size():
    """A cubic with memory, 0.3, 1 and 3 times the noise after the fit; the plant's own error a tenth of the noise."""
    left = film(1500, 30, model_error=0.1 * NOISE)
    law, rng = Law(left, np.random.default_rng(0), 400), np.random.default_rng(1)
    missing = after_fit(left, (lagged(left.readings, 1.0) - left.readings.mean()) ** 3)
    missing = missing / np.sqrt(np.mean(missing[left.fitted] ** 2))
    rates = [
        np.mean([rejected(law, after_fit(left, white(rng, 1500)) + k * NOISE * missing) for _ in range(100)])
        for k in (0.3, 1.0, 3.0)
    ]
    # 1500 samples see a variance that is higher by 9 % at 2.4 deviations of chance, by 100 % at 27
    assert rates[0] >= 0.3
    assert rates[1] == rates[2] == 1.0


def test_the_smallest_size_is_caught_nine_times_in_ten():
    left = film(1500, 31, model_error=0.5 * NOISE)
    law, rng = Law(left, np.random.default_rng(0), 400), np.random.default_rng(1)
    change = after_fit(left, (lagged(left.readings, 1.0) - left.readings.mean()) ** 3)[left.fitted]
    practical = 0.5 * NOISE
    strength = Power(law).smallest(change, practical)
    whole = np.zeros(1500)
    whole[left.fitted] = change

    def caught(share: float) -> float:
        drawn = Law(left, rng, 100).kept + share * strength * whole  # draws that the power was not chosen on
        hit = law.groups(law.battery(drawn)).max(axis=1) >= law.critical
        return float(np.mean(hit & (np.mean(drawn[:, left.fitted] ** 2, axis=1) >= NOISE**2 + practical**2)))

    # 90 % of 100 draws, chosen on 100 others: within three deviations of the difference
    assert caught(1.0) >= 0.9 - 3 * np.sqrt(2 * 0.09 / 100)
    assert caught(0.6) < 0.75


def test_what_could_be_seen_is_told_of_effects_once_these_are_known():
    left, rng = film(1500, 31, model_error=0.5 * NOISE), np.random.default_rng(1)
    change = after_fit(left, (lagged(left.readings, 1.0) - left.readings.mean()) ** 3)[left.fitted]
    found = detect_in(replace(left, residual=after_fit(left, white(rng, 1500))), rng, draws=100)
    assert (found.smallest, found.visible) == ({}, True)
    strength = NOISE / float(np.sqrt(np.mean(change**2)))
    known = [LinearisedResponse(effect=SensorDrift(), change=size * change) for size in (strength, 1e-9 * strength)]
    one, faint = (found.beside([response]) for response in known)
    # As large in the readings, whatever the strength that makes it.
    assert 0.3 * NOISE < one.smallest["sensor_drift"] < 3.0 * NOISE
    assert faint.smallest["sensor_drift"] == pytest.approx(one.smallest["sensor_drift"])
    assert one.beside([]) is one  # it was asked


# --- whose residual is it? -----------------------------------------------------------------------------------------


def origin(left: Leftover, excess: np.ndarray, rng: np.random.Generator) -> Origin:
    noisy = replace(left, residual=after_fit(left, excess + white(rng, excess.size)))
    return Origin(origin_of(noisy, find_repeats([left.commands], STEP), MODEL_ERROR).conclusion)


@pytest.mark.parametrize("periods", [1, 6])
def test_a_disturbance_is_told_from_the_plant(periods):
    own, foreign = [], []
    for seed in range(4):
        left, rng = film(3000, 40 + seed, periods=periods), np.random.default_rng(seed)
        memory = (lagged(left.readings, 1.0) - left.readings.mean()) ** 3
        own.append(origin(left, 12e-6 * memory / memory.std(), rng))
        foreign.append(origin(left, 6e-6 * slow(rng, 3000), rng))
    assert Origin.DISTURBANCE not in own
    assert Origin.PLANT not in foreign
    if periods > 1:  # only repeats can be asked for more; chance may keep a bound on the wrong side
        assert own.count(Origin.PLANT) >= 3
        assert foreign.count(Origin.DISTURBANCE) >= 2


@pytest.mark.parametrize("periods", [1, 6])
@pytest.mark.parametrize("form", ["drift", "gain", "jump", "loss", "tone"])
def test_physics_that_does_not_come_back_is_no_disturbance(form, periods):
    left, rng = film(3000, 50, periods=periods), np.random.default_rng(0)
    t, late = left.timepts, left.timepts > 25.0
    moves = (left.readings - left.readings.mean()) / left.readings.std()
    excess = {
        "drift": 20 * np.exp(-t / 15),
        "gain": 20 * np.exp(-t / 15) * moves,
        "jump": 15.0 * late,
        "loss": 12.0 * late * moves,
        "tone": 8 * np.sin(2 * np.pi * 7.3 * t),
    }[form]
    assert origin(left, 1e-6 * excess, rng) is not Origin.DISTURBANCE


def test_drifts_within_each_experiment_are_removed_as_by_least_squares():
    """Of level and gain, with nine cosines and the largest and smallest reading so far, in each of four experiments."""
    left, rng = film(2000, 51), np.random.default_rng(1)
    left = replace(left, experiment=np.repeat(np.arange(4), 500))
    moves, columns = left.readings - left.readings.mean(), []
    for own in np.split(np.arange(2000), 4):
        shapes = [np.cos(np.pi * k * np.linspace(0.0, 1.0, 500)) for k in range(9)]
        shapes += [f.accumulate(left.readings[own]) / 1e-4 for f in (np.maximum, np.minimum)]
        for shape in shapes:
            columns += [np.zeros(2000), np.zeros(2000)]
            columns[-2][own], columns[-1][own] = shape, shape * moves[own] / moves.std()
    patterns = np.stack(columns, axis=1)
    drift = patterns @ rng.standard_normal(patterns.shape[1])
    rest = without_forms(replace(left, residual=1e-6 * drift))
    np.testing.assert_allclose(rest, 0.0, atol=1e-6 * 1e-8 * np.abs(drift).max())
    noise = white(rng, 2000)
    rest = without_forms(replace(left, residual=noise))
    np.testing.assert_allclose(
        patterns.T @ rest / np.linalg.norm(patterns, axis=0), 0.0, atol=1e-9 * np.linalg.norm(noise)
    )
    # least squares by 88 columns, two steps of two and three tones of two leaves no less than by 98 independent ones
    assert 0.8 < rest @ rest / (noise @ noise) < 1.0


@pytest.mark.parametrize(("seconds", "beside"), [(60.0, ""), (15.0, ""), (60.0, "memory"), (60.0, "mode")])
def test_noise_that_grows_with_the_motion_is_a_disturbance_and_what_a_plant_lacks_beside_it_is_none(seconds, beside):
    """Noise of 2 µm, three times as much two deviations off; 5 µm of memory or ringing are the plant's: 20 of 20 seeds."""
    for seed in range(4):
        left, rng = film(round(seconds / STEP), 60 + seed, holds=beside == "mode"), np.random.default_rng(seed)
        moves = (left.readings - left.readings.mean()) / left.readings.std()
        ringing = np.poly([0.9 * np.exp(2.2j), 0.9 * np.exp(-2.2j)]).real  # at 17.5 Hz, for half a second
        missing = {
            "": np.zeros(moves.size),
            "memory": (lagged(left.readings, 1.0) / left.readings.std() - 1.0) ** 3,
            "mode": lfilter([1.0], ringing, np.diff(left.commands**2, prepend=left.commands[0] ** 2)),
        }[beside]
        missing = after_fit(left, missing)
        noise = after_fit(left, (1.0 + np.abs(moves)) * white(rng, moves.size))
        residual = noise + 5e-6 * missing / max(missing.std(), 1e-9)
        found = origin_of(replace(left, residual=residual), None, MODEL_ERROR).conclusion
        assert (found == "disturbance") is not bool(beside)


# --- on the engine's own objects -----------------------------------------------------------------------------------

PLANT = Plant(rig=Diaphragm())


def bench_of(command: np.ndarray, seed: int, truth: Plant = PLANT) -> DiagnosisProblem:
    return benched(PLANT, truth.record(blank(command), np.random.default_rng(seed)))


def test_a_plant_that_is_its_own_truth_lacks_nothing():
    problem = bench_of(band_limited_noise(np.random.default_rng(0), 40.0, STEP), 1)
    base = judge(problem, calibrate(PLANT, problem.fitted, evaluations=4, starts=1), PLANT.rig.noise)
    left = leftover_of(base, problem)
    np.testing.assert_allclose(left.residual[left.fitted], base.calibration.residuals, atol=1e-12)
    np.testing.assert_allclose(left.residual[~left.fitted], base.unseen, atol=1e-12)
    found = detect(base, problem, np.random.default_rng(2))
    assert not found.mismatch
    assert found.testable
    assert found.moved > 20 * PLANT.rig.noise
    written = json.loads(json.dumps(records.plain(found.summary)))
    assert {"p_value", "excess", "smallest_detectable"} <= written.keys()
    assert written["excess"] == pytest.approx(found.size * 1e6)
    assert len(found.plot()) == 3


def small_then_large() -> np.ndarray:
    """Small motions in what is fitted, several times as large ones in the held-out part."""
    rng = np.random.default_rng(0)
    small, large = band_limited_noise(rng, 42.0, STEP), random_holds(rng, 18.0, STEP, 1.2, 3.2, 1.0, 3.0)
    return np.concatenate([0.84 + 0.3 * small, large])


@pytest.mark.parametrize(("late", "taken_up"), [(5e-3, True), (9e-3, False)], ids=["within timing", "a dead time"])
def test_a_rig_that_answers_a_few_milliseconds_late_lacks_nothing(late, taken_up):
    """Readings are late by 3 ms (a deviation of 0.15 samples): 6 ms are within two of them, 9 ms are not."""
    command = random_holds(np.random.default_rng(0), 30.0, STEP, 1.2, 3.4, 0.1, 0.6)
    problem = replace(bench_of(command, 1, PLANT.with_effects(Delay(time=late))), effects=(Delay(),))
    base = judge(problem, calibrate(PLANT, problem.fitted, evaluations=10, starts=1), PLANT.rig.noise)
    found = detect(base, problem, np.random.default_rng(2))
    assert replace(found, taken_up=None).mismatch
    assert found.mismatch is not taken_up
    if found.taken_up is not None:
        delay = found.taken_up.plant.parameters["delay.time"]
        assert delay.value == pytest.approx(late, rel=0.1)
        assert delay.upper < STEP  # each sample in the range of a dead time enlarges the equations


@pytest.fixture(scope="module")
def stiffening():
    """The truth has the same equations: what stiffens the film where it moves far is hardly seen where it does not."""
    problem = bench_of(small_then_large(), 1, PLANT.with_values({"stretch_limit": 200.0}))
    fit = calibrate(PLANT, problem.fitted, evaluations=20, starts=1, tolerance=1e-4)
    return problem, judge(problem, fit, PLANT.rig.noise)


def test_what_the_plant_takes_up_once_it_is_fitted_to_all_recordings_is_not_missing(stiffening):
    problem, base = stiffening
    found = detect(base, problem, np.random.default_rng(2))
    assert replace(found, taken_up=None).mismatch  # by chance and size alone it would be one
    assert found.taken_up
    assert not found.mismatch
    assert found.summary.taken_up is True


@pytest.mark.parametrize(
    "refitted",
    [
        lambda found, parts: found,  # the refit has failed, or has gone nowhere
        lambda found, parts: replace(
            calibrate(found.plant, parts, evaluations=60, starts=1), at_bound=("stretch_limit",)
        ),
    ],
    ids=["the same", "on a bound"],
)
def test_a_refit_that_fails_or_ends_on_a_bound_takes_nothing_up(stiffening, monkeypatch, refitted):
    problem, base = stiffening
    module = importlib.import_module("deatwin.ident.mismatch.detect.detect")
    monkeypatch.setattr(module, "refit", refitted)
    found = detect(base, problem, np.random.default_rng(2))
    assert found.mismatch
    assert found.taken_up is None


@pytest.mark.parametrize("at", [20.0, 50.0], ids=["fitted part", "held-out part"])
def test_what_the_plant_cannot_take_up_is_missing(at):
    problem = bench_of(small_then_large(), 1, PLANT.with_effects(SensorJump(change=20e-6, at=at)))
    base = judge(problem, calibrate(PLANT, problem.fitted, evaluations=20, starts=1, tolerance=1e-4), PLANT.rig.noise)
    found = detect(base, problem, np.random.default_rng(2))
    assert found.mismatch
    assert found.summary.taken_up is False


def test_a_level_with_a_tiny_ripple_tests_nothing():
    ripple = 2.4 + 1e-3 * np.sin(2 * np.pi * 0.5 * STEP * np.arange(2000))
    problem = bench_of(ripple, 3)
    base = judge(problem, calibrate(PLANT, problem.fitted, evaluations=4, starts=1), PLANT.rig.noise)
    assert not detect(base, problem, np.random.default_rng(4)).testable


@pytest.mark.study
def test_linearised_refits_are_as_good_as_full_ones():
    """Two hundred records of the reduced plant, fitted in full; it takes some minutes."""
    command = band_limited_noise(np.random.default_rng(5), 40.0, STEP)
    clean = replace(PLANT, rig=replace(PLANT.rig, model_error=0.0))
    problem = replace(bench_of(command, 6), nominal=clean)
    start = calibrate(clean, problem.fitted, starts=1)
    base = judge(problem, start, clean.rig.noise)
    law = Law(leftover_of(base, problem), np.random.default_rng(7), 1000)
    pieces = []
    for seed in range(200):
        again = bench_of(command, 1000 + seed)
        fit = calibrate(start.plant, again.fitted, starts=1)
        late = judge(again, fit, clean.rig.noise).unseen
        pieces.append(law.battery(np.concatenate([fit.residuals, late])[None]))
    groups = law.groups(Scores.stacked(pieces))
    largest = groups.max(axis=1)
    assert np.mean([law.p_value(x) < SIGNIFICANCE for x in largest]) <= 0.035  # seven of 200 come once in 200 at 1 %
    for drawn, full in ((law.largest, largest), *zip(law.drawn.T, groups.T, strict=True)):
        for level in (0.5, 0.9):
            # the share of full refits beyond a quantile of the linearised ones, three binomial deviations of both
            share = np.mean(full > np.quantile(drawn, level))
            bound = 3 * np.sqrt(level * (1 - level) * (1 / 200 + 1 / 1000))
            assert share == pytest.approx(1 - level, abs=bound)

"""Models of unstable plants: the pole, and how far ahead they are judged."""

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.narx import NarxModel, ValidationStatus, validate
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.linear import OutputError
from deatwin.ident.narx.unstable import poles_at, recorded_once, recorded_pole, stable_model_of_unstable
from deatwin.plant.recording import Recording


def looped(n=1500, noise=0.02, seed=0, dt=0.1):
    """y(k) = 1.1 y(k-1) + u(k-1) + e(k) under u = 0.5 (r - y): the closed loop has the pole 0.6."""
    rng = np.random.default_rng(seed)
    wanted, y, u = np.repeat(rng.uniform(-1, 1, n // 20 + 1), 20)[:n], np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 1.1 * y[k - 1] + u[k - 1] + noise * rng.normal()
        u[k] = 0.5 * (wanted[k] - y[k]) + 0.2 * rng.normal()
    return Recording.from_arrays(u, y, dt)


def test_the_unstable_pole_is_named_and_the_model_judged_ahead():
    model = NarxModel.from_terms({"y(k-1)": 1.1, "u(k-1)": 1.0}, sample_time=0.1, output_units=("m",))
    found = validate(model, looped())
    assert found.status is ValidationStatus.UNSTABLE and not found.status.ok
    assert "closed loop" in str(found) and "z = 1.1, +0.953 1/s" in str(found)
    assert found.unstable.pole == pytest.approx(1.1) and found.unstable.rate == pytest.approx(np.log(1.1) / 0.1)
    # ln 1.1 = 0.0953, so that it grows by e in ten steps; the noise of ten steps adds up to this
    assert found.unstable.steps == 10
    expected = 0.02 * np.sqrt(sum(1.1 ** (2 * j) for j in range(10)))
    assert found.unstable.ahead.rms[0] == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("terms", [{"y(k-1)": 1.0 + 2e-14}, {"y(k-1)": 2.0, "y(k-2)": -1.0 - 2e-15}])
def test_a_pole_at_one_but_for_rounding_is_not_unstable(terms):
    model = NarxModel.from_terms({**terms, "u(k-1)": 1.0}, sample_time=0.1)
    assert validate(model, looped()).unstable is None


def test_a_pole_within_its_uncertainty_of_the_circle_is_not_called_unstable():
    record = looped(300)
    cov = np.diag([0.1**2, 1e-6])
    model = NarxModel.from_terms({"y(k-1)": 1.1, "u(k-1)": 1.0}, sample_time=0.1, theta_cov=cov)
    assert validate(model, record).unstable is None


@pytest.mark.parametrize("term", ["y(k-1)^2", "u(k-1)^2", "y(k-1)^3"])
def test_a_negligible_nonlinear_term_changes_nothing(term):
    """Whether its free run diverges, is held by the loop's input, or turns around at another equilibrium."""
    for size in (-1e-6, -1e-3, 1e-6):
        model = NarxModel.from_terms({"y(k-1)": 1.1, "u(k-1)": 1.0, term: size}, sample_time=0.1)
        for seed in range(3):
            found = validate(model, looped(600, seed=seed))
            assert found.unstable is not None and abs(found.unstable.pole) == pytest.approx(1.1, abs=0.002)
            assert found.unstable.steps in (10, 11) and not any("lacks" in note for note in found.notes)


def test_a_model_with_a_limit_cycle_is_not_called_unstable():
    """y(k) = 1.2 y(k-1) - 0.2 y(k-1)^3 rests at +-1, not at 0, the mean of recordings that go to and fro."""
    model = NarxModel.from_terms({"y(k-1)": 1.2, "y(k-1)^3": -0.2, "u(k-1)": 1.0}, sample_time=0.1)
    for seed in range(10):
        rng = np.random.default_rng([seed, 3])
        u, y = 0.3 * rng.normal(size=1500), np.zeros(1500)
        for k in range(1, 1500):
            y[k] = 1.2 * y[k - 1] - 0.2 * y[k - 1] ** 3 + u[k - 1]
        record = Recording.from_arrays(u, y + 0.01 * rng.normal(size=1500), 0.1)
        assert abs(poles_at(model, [record])[0]) > 1.0 and validate(model, record).unstable is None


def test_poles_of_a_nonlinear_model_are_those_at_the_mean():
    # slope of 0.5 y + 0.3 y^2 u at y = 1, u = 2: 0.5 + 0.6 * 2 = 1.7, and -0.2 at lag 2
    model = NarxModel.from_terms({"y(k-1)": 0.5, "y(k-1)^2u(k-1)": 0.3, "y(k-2)": -0.2}, sample_time=1.0)
    record = Recording.from_arrays([1.0, 3.0] * 10, [0.5, 1.5] * 10, 1.0)
    np.testing.assert_allclose(poles_at(model, [record]), np.roots([1, -1.7, 0.2]), rtol=1e-7)


def test_poles_of_two_coupled_outputs():
    equations = {"y1": {"y1(k-1)": 0.5, "y2(k-2)": 0.4}, "y2": {"y1(k-1)": 0.3, "u(k-1)": 1.0}}
    model = NarxModel.from_terms(equations, sample_time=1.0)
    rng = np.random.default_rng(1)
    record = Recording.from_arrays(rng.normal(size=20), rng.normal(size=(2, 20)), 1.0)
    # z^3 - 0.5 z^2 - 0.12 = 0, the rest at the origin
    expected = np.sort(np.abs(np.roots([1, -0.5, 0, -0.12])))[::-1]
    np.testing.assert_allclose(np.abs(poles_at(model, [record]))[:3], expected, rtol=1e-6)


def test_a_stable_plant_in_open_loop_is_done():
    """Of 20 fits with one pole and one zero more than the plant has, all are done."""
    for seed in range(20):
        rng = np.random.default_rng([seed, 5])
        u = rng.normal(size=600) if seed % 2 else np.repeat(rng.uniform(-1, 1, 60), 10)
        y = lfilter([0, 0.1], [1, -0.9], u)
        y = y + 0.1 * y.std() * rng.normal(size=600)
        assert OutputError().fit(Recording.from_arrays(u, y, 0.1)).status_ is FitStatus.DONE


def held_loop(seed, n=600, pole=1.1, process=0.02, reading=0.0):
    """x(k) = pole x(k-1) + u(k-1) + process noise, read with noise, under u = r - (pole - 0.6) y."""
    rng = np.random.default_rng([seed, 17])
    wanted, x, y, u = 0.3 * rng.normal(size=n), np.zeros(n), np.zeros(n), np.zeros(n)
    e, v = process * rng.normal(size=n), reading * rng.normal(size=n)
    for k in range(1, n):
        x[k] = pole * x[k - 1] + u[k - 1] + e[k]
        y[k] = x[k] + v[k]
        u[k] = wanted[k] - (pole - 0.6) * y[k]
    return Recording.from_arrays(5.0 + u, 300.0 + y / 7.0, 0.1)


@pytest.mark.parametrize(
    ("process", "reading", "pole"), [(0.02, 0.0, 1.1), (0.0, 0.1, 1.1), (0.05, 0.1, 1.1), (0.02, 0.05, 1.02)]
)
def test_the_interval_holds_the_pole_in_a_loop(process, reading, pole):
    """Of 60 recordings of each kind, at least 54 of the 95 % intervals hold the pole (binomial chance of fewer: 3 %)."""
    hits = 0
    for seed in range(60):
        low, high = recorded_pole([held_loop(seed, pole=pole, process=process, reading=reading)]).interval
        hits += low <= pole <= high
    assert hits >= 54


def test_least_squares_of_the_plain_model_is_biased_where_the_long_one_is_not():
    """Readings of 20 % noise: least squares of y on y(k-1), u(k-1) is off by ten intervals."""
    record = held_loop(1, n=3000, process=0.0, reading=0.1)
    y, u = record.outputs[0] - record.outputs[0].mean(), record.inputs[0] - record.inputs[0].mean()
    plain = np.linalg.lstsq(np.stack([y[:-1], u[:-1]], axis=1), y[1:])[0][0]
    found = recorded_pole([record])
    assert abs(plain - 1.1) > 10 * 1.96 * found.deviation
    assert found.interval[0] <= 1.1 <= found.interval[1]


def test_a_growing_oscillation_of_two_coupled_outputs():
    """Eigenvalues 1.02 exp(+-0.4i) of two states, both read, under a stabilising state feedback; 20 of 20 hold."""
    turn = 1.02 * np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    for seed in range(20):
        rng = np.random.default_rng([seed, 3])
        y, u = np.zeros((2, 500)), np.zeros((2, 500))
        for k in range(1, 500):
            y[:, k] = turn @ y[:, k - 1] + u[:, k - 1] + 0.05 * rng.normal(size=2)
            u[:, k] = -0.4 * y[:, k] + 0.2 * rng.normal(size=2)
        found = recorded_pole([Recording.from_arrays(u, y, 1.0)])
        assert abs(abs(found.pole) - 1.02) < 3.5 * found.deviation < 0.03
        assert abs(np.angle(found.pole)) == pytest.approx(0.4, abs=0.05)


def test_recordings_without_noise_constant_inputs_and_too_few_samples():
    exact = recorded_pole([held_loop(0, process=0.0)])
    assert abs(exact.pole) == pytest.approx(1.1, rel=1e-9) and exact.deviation < 1e-6
    record = held_loop(0)
    both = Recording.from_arrays(np.stack([record.inputs[0], np.full(600, 2.0)]), record.outputs, 0.1)
    assert recorded_pole([both]).pole == pytest.approx(recorded_pole([record]).pole)
    twice = Recording.from_arrays(np.stack([record.inputs[0], 2.0 * record.inputs[0]]), record.outputs, 0.1)
    assert abs(recorded_pole([twice]).pole) == pytest.approx(1.1, abs=0.02)
    assert recorded_pole([record.section(0, 8)]) is None


def test_validation_names_both_poles_and_says_which_to_trust():
    record = held_loop(3, n=1500, process=0.0, reading=0.1)
    biased = NarxModel.from_terms({"y(k-1)": 1.05, "u(k-1)": 0.1, "1": -15.5}, sample_time=0.1)
    found = validate(biased, record)
    low, high = found.unstable.interval
    assert low <= 1.1 <= high < 1.2 and abs(found.unstable.recorded_pole) == pytest.approx((low + high) / 2)
    assert "linear model (ARX) of high order" in str(found) and "trust this pole" in str(found)


def test_a_stable_model_of_an_unstable_plant_is_told():
    stable = NarxModel.from_terms({"y(k-1)": 0.6, "1": 120.0}, sample_time=0.1)
    (note,) = (one for one in validate(stable, held_loop(4)).notes if "unstable pole" in one)
    assert "which this model lacks" in note and "closed loop" in note


def test_no_stable_plant_is_called_unstable():
    """None of 40 recordings of stable plants, a tenth of them integrators, in open loop, some without noise."""
    model = NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=0.1)
    for seed in range(40):
        rng = np.random.default_rng([seed, 23])
        u = np.repeat(rng.uniform(-1, 1, 80), 10) if seed % 2 else rng.normal(size=800)
        pole = 1.0 if seed % 10 == 0 else rng.uniform(0.5, 0.999)
        y = lfilter([0.0, 0.1], [1.0, -pole], u)
        y = y + (0.0 if seed % 4 == 3 else 0.05) * y.std() * rng.normal(size=800)
        records = [Recording.from_arrays(u, y, 0.1)]
        assert stable_model_of_unstable(model, records, recorded_once(model, records)) == ""


def held_back(seed, n=420):
    """A motor with an encoder, driven on and off up to a wanted place; read off a clock that jitters by a fifth."""
    rng = np.random.default_rng([seed, 29])
    times = 0.02 * (np.arange(n) + 0.2 * rng.uniform(-1, 1, n))
    fine = np.arange(0.0, 0.02 * n, 1e-3)
    place, speed, track, commands, target = 0.0, 0.0, [], [], rng.uniform(500, 2000)
    for now in fine:
        command = 70.0 if now > 3.0 and place < 0.8 * target else 0.0
        speed += 1e-3 * (20.0 * command - speed) / 0.05
        place += 1e-3 * speed
        track.append(place)
        commands.append(command)
    level = np.interp(times, fine, np.round(track))
    return times, np.interp(times, fine, commands), level


@pytest.mark.parametrize("step", [0.02, 0.018, 0.025])
def test_a_resampled_integrator_that_stands_still_is_not_called_unstable(step):
    """None of 20: its readings are interpolated, so look ahead, and a long model of them grows where nothing moves."""
    model = NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=step)
    for seed in range(20):
        times, commands, level = held_back(seed)
        even = np.arange(0.0, times[-1], step)
        held = commands[np.clip(np.searchsorted(times, even, side="right") - 1, 0, None)]
        record = Recording.from_arrays(held, np.interp(even, times, level), step)
        assert stable_model_of_unstable(model, [record], recorded_once(model, [record])) == ""


def test_a_pole_that_grows_too_fast_for_any_loop_is_none():
    assert recorded_pole([held_loop(0, pole=1.8)]) is not None
    assert recorded_pole([held_loop(0, pole=3.0)]) is None


def test_a_mode_that_grows_while_the_input_stands_still_has_to_show():
    """The same growth of 1.1 a sample: with a loop that acts each sample it is the plant's, else y had left its span."""
    record = held_loop(0)
    assert abs(recorded_pole([record]).pole) == pytest.approx(1.1, abs=0.02)
    still = np.concatenate([record.inputs, np.full((1, 300), record.inputs[0, -1])], axis=1)
    rng = np.random.default_rng(4)
    outputs = np.concatenate([record.outputs, rng.choice(record.outputs[0], (1, 300))], axis=1)
    found = recorded_pole([Recording.from_arrays(still, outputs, 0.1)])
    assert found is None or found.interval[0] < 1.0

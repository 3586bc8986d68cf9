"""Models of unstable plants: the pole, and how far ahead they are judged."""

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.narx import NarxModel, ValidationStatus, validate
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.linear import OutputError
from deatwin.ident.narx.unstable import poles_at
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

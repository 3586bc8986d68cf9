"""Kernels of models with several inputs, against closed forms and against tones in simulation."""

from dataclasses import replace

import numpy as np
import pytest
from slopes import differences

from deatwin.ident.frequency import gfrf, nofrf, nofrf_exact, output_orders, output_spectrum, remove_dc
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError, Recording

A, B, C, D, E, F = 0.5, 0.8, -0.3, 0.2, 0.1, 0.15
TERMS = {"y(k-1)": A, "u1(k-1)": B, "u2(k-2)": C, "u1(k-1)u2(k-1)": D, "y(k-1)u2(k-1)": E, "u2(k-1)^2": F}
MODEL = NarxModel.from_terms(TERMS, sample_time=1.0, theta_cov=1e-4 * np.eye(len(TERMS)))
W = np.random.default_rng(0).uniform(-3.0, 3.0, (20, 2))


def z(omega: np.ndarray, lag: int = 1) -> np.ndarray:
    return np.exp(-1j * omega * lag)


def first(row: int, omega: np.ndarray) -> np.ndarray:
    return (B * z(omega) if row == 0 else C * z(omega, 2)) / (1 - A * z(omega))


def cross(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """H_2 of u1 at the first frequencies and u2 at the second: what both tones make together, by 2!."""
    both = D * z(one + two) + E * first(0, one) * z(one) * z(two)
    return both / 2 / (1 - A * z(one + two))


def second_input(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """H_2 of u2 at both frequencies."""
    mixed = first(1, one) * z(one) * z(two) + first(1, two) * z(two) * z(one)
    return (F * z(one + two) + E * mixed / 2) / (1 - A * z(one + two))


def test_kernels_of_second_order_are_the_closed_forms() -> None:
    one, two = W.T
    np.testing.assert_allclose(gfrf(MODEL, 2, W, inputs=["u1", "u2"]).values, cross(one, two), rtol=1e-12)
    np.testing.assert_allclose(gfrf(MODEL, 2, W[:, ::-1], inputs=["u2", "u1"]).values, cross(one, two), rtol=1e-12)
    np.testing.assert_allclose(gfrf(MODEL, 2, W, inputs=["u2", "u2"]).values, second_input(one, two), rtol=1e-12)
    assert not gfrf(MODEL, 2, W, inputs=["u1", "u1"]).values.any()


def test_derivatives_and_values_at_other_parameters() -> None:
    def values(theta: np.ndarray) -> np.ndarray:
        return gfrf(replace(MODEL, theta=theta), 2, W, inputs=["u1", "u2"]).values

    found = gfrf(MODEL, 2, W, inputs=["u1", "u2"])
    np.testing.assert_allclose(found.gradient, differences(values, MODEL.theta, 1e-6), atol=1e-7)
    assert found.evaluate is not None
    other = MODEL.theta + 1e-5 * np.eye(MODEL.theta.size)[0]
    np.testing.assert_allclose(found.evaluate(other[None]).values[0], values(other), rtol=1e-10)
    assert found.band().high.shape == (20,) and found.label == r"$H_2^{\mathrm{u1,u2}}$"


def steady(model: NarxModel, period: np.ndarray) -> np.ndarray:
    """Spectrum of the output's last period after a hundred that forget the start."""
    inputs = np.tile(period, 100)
    drive = Recording.from_arrays(inputs, np.zeros(inputs.shape[1]), 1.0)
    n = period.shape[1]
    return np.fft.rfft(model.simulate(drive).outputs[0, -n:]) / n


@pytest.mark.filterwarnings("ignore::deatwin.ident.frequency.NofrfWarning")
def test_orders_of_the_output_add_up_to_the_simulation() -> None:
    rng = np.random.default_rng(1)
    period, model = rng.normal(size=(2, 32)) * 0.3, NarxModel.from_terms({**TERMS, "y(k-1)^2": 0.05}, sample_time=1.0)
    np.testing.assert_allclose(output_spectrum(model, period, 30).values, steady(model, period), atol=1e-12)
    orders = output_orders(model, period, 2)
    parts = sum(
        np.fft.rfft(np.prod([period[row] ** power for row, power in enumerate(powers.values())], axis=0))
        / 32
        * spread(nofrf_exact(model, period, powers), 17)
        for powers in ({"u1": 2, "u2": 0}, {"u1": 1, "u2": 1}, {"u1": 0, "u2": 2})
    )
    np.testing.assert_allclose(parts, orders[1].values, atol=1e-13)


def spread(found: object, n_lines: int) -> np.ndarray:
    values = np.zeros(n_lines, dtype=complex)
    values[np.rint(found.omega * 32 / 2 / np.pi).astype(int)] = found.values
    return values


@pytest.mark.filterwarnings("ignore::deatwin.ident.frequency.NofrfWarning")
def test_the_cross_nofrf_of_two_tones_is_twice_the_cross_kernel() -> None:
    n, (one, two) = 64, (5, 11)
    k = np.arange(n)
    period = np.array([0.7 * np.cos(2 * np.pi * one * k / n), 0.4 * np.cos(2 * np.pi * two * k / n + 1.0)])
    found = nofrf_exact(MODEL, period, {"u1": 1, "u2": 1})
    lines = np.rint(found.omega * n / 2 / np.pi).astype(int).tolist()
    assert lines == [two - one, one + two]
    w = 2 * np.pi / n * np.array([[-one, two], [one, two]])
    np.testing.assert_allclose(found.values, 2 * gfrf(MODEL, 2, w, inputs=["u1", "u2"]).values, rtol=1e-10)
    assert found.label == r"$G_2^{\mathrm{u1,u2}}$"


def test_inputs_are_named_as_in_the_model() -> None:
    named = NarxModel.from_terms(
        {"y(k-1)": 0.5, "volts(k-1)": 1.0, "heat(k-1)volts(k-1)": 0.1},
        sample_time=1.0,
        input_names=("volts", "heat"),
        input_units=("V", "K"),
        output_units=("m",),
    )
    found = gfrf(named, 2, W, inputs=["volts", "heat"])
    assert found.unit == "m/(V K)" and found.inputs == ("volts", "heat")
    with pytest.raises(ModelError, match=r"no input 'volt'; did you mean \"volts\"\?"):
        gfrf(named, 1, [0.1], inputs=["volt"])
    for wrong in (["volts"], "volts", 2):
        with pytest.raises(ModelError, match="needs the names of 2 input"):
            gfrf(named, 2, W, inputs=wrong)
    with pytest.raises(ModelError, match="for several take nofrf_exact"):
        nofrf(named, np.ones((2, 8)), 1)
    with pytest.raises(ModelError, match="give the power of each by its name"):
        nofrf_exact(named, np.ones((2, 8)), 2)
    with pytest.raises(ModelError, match=r"of shape \(2, n_samples\)"):
        output_spectrum(named, np.ones(8), 2)


def test_about_an_operating_point() -> None:
    # About u2 = 1, y = 0 with u1 = u2's effect: the product D u1 u2 adds D u1 to the linear part.
    moved = remove_dc(MODEL, [0.0, 1.0])
    about = gfrf(MODEL, 1, W[:, 0], inputs=["u1"], operating_input=[0.0, 1.0])
    expected = (B + D) * z(W[:, 0]) / (1 - (A + E) * z(W[:, 0]))
    np.testing.assert_allclose(about.values, expected, rtol=1e-12)
    np.testing.assert_allclose(gfrf(moved, 1, W[:, 0], inputs=["u1"]).values, expected, rtol=1e-12)


def tones(amplitude: float) -> np.ndarray:
    """A period whose tones' sums of up to two do not meet."""
    k = np.arange(64)
    waves = [np.cos(2 * np.pi * 5 * k / 64), np.cos(2 * np.pi * 11 * k / 64 + 1.0)]
    return amplitude * np.array(waves)


def test_the_powers_of_each_input_have_the_kernels_that_the_terms_say() -> None:
    # Without feedback the model has two orders.
    model = NarxModel.from_terms({t: value for t, value in TERMS.items() if "y" not in t}, sample_time=1.0)
    closed = (({"u1": 1}, B, 1), ({"u2": 1}, C, 2), ({"u1": 1, "u2": 1}, D, 1), ({"u2": 2}, F, 1), ({"u1": 2}, 0.0, 1))
    for powers, weight, lag in closed:
        found = nofrf_exact(model, tones(0.7), powers)
        assert found.omega.size > 0
        np.testing.assert_allclose(found.values, weight * z(found.omega, lag), atol=1e-11)

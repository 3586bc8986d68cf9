"""Frequency responses against closed forms and differences, on grids and points; those of any model are in tests/property."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from slopes import differences

from deatwin.ident.frequency import frequency_grid, gfrf, output_spectrum
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

NONLINEAR = {"1": 0.1, "y(k-1)": 0.5, "y(k-2)^2": -0.2, "y(k-1)u(k-1)": 0.15, "u(k-1)": 0.4, "u(k-2)^3": 0.1}
SAMPLE_TIME = 0.02
OMEGA = 2 * np.pi * np.geomspace(0.1, 25.0, 40)


def nonlinear(theta=None, cov=None, operating=None):
    values = NONLINEAR.values() if theta is None else theta
    return NarxModel.from_terms(
        dict(zip(NONLINEAR, values, strict=True)),
        sample_time=SAMPLE_TIME,
        theta_cov=cov,
        operating=operating,
        input_units=("V",),
        output_units=("m",),
    )


def mean_over_permutations(response, omega):
    orders = list(permutations(range(omega.shape[1])))
    return sum(response(omega[:, list(order)]) for order in orders) / len(orders)


def random_omega(order, count=25):
    omega = np.random.default_rng(order).uniform(-np.pi, np.pi, (count, order)) / SAMPLE_TIME
    omega[0] = 0.0  # a constant is a tone too
    omega[1] = omega[1, 0]
    return omega


def test_the_bilinear_system_at_every_order():
    """y = a y + b u + e y u: H_n is the mean over permutations of a chain, b z_1/(1 - a z_1) times e z/(1 - a z) at each
    partial sum."""
    model = NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)": 0.4, "y(k-1)u(k-1)": 0.15}, sample_time=SAMPLE_TIME)

    def chain(omega):
        z = np.exp(-1j * SAMPLE_TIME * np.cumsum(omega, axis=1))
        return np.prod(z / (1 - 0.6 * z), axis=1) * 0.4 * 0.15 ** (omega.shape[1] - 1)

    for order in range(1, 8):
        omega = random_omega(order, 3)
        np.testing.assert_allclose(gfrf(model, order, omega).values, mean_over_permutations(chain, omega), rtol=1e-11)


LAGGED = {
    "y(k-1)": 0.5,
    "y(k-3)": -0.2,
    "u(k)": 0.1,
    "u(k-2)": 0.4,
    "y(k-1)y(k-3)": 0.3,
    "y(k-2)u(k)": -0.15,
    "u(k)u(k-3)": 0.2,
    "y(k-1)y(k-2)y(k-4)": 0.07,
    "y(k-1)y(k-2)u(k-1)": -0.05,
    "y(k-3)u(k-1)u(k-2)": 0.25,
    "u(k)u(k-1)u(k-4)": -0.1,
    "y(k-1)y(k-2)u(k)u(k-3)": 0.35,
    "y(k-2)^2y(k-3)^2": -0.4,
}


@pytest.mark.parametrize("order", [1, 2, 3])
def test_gradients_against_differences(order):
    """The equilibrium moves with the parameters: some derivatives come through it alone."""
    omega = random_omega(order, 6)
    response = gfrf(nonlinear(), order, omega, operating_input=0.7)
    theta = np.array(list(NONLINEAR.values()))
    slopes = differences(lambda t: gfrf(nonlinear(t), order, omega, operating_input=0.7).values, theta, 1e-5)
    sizes = np.abs(response.gradient).max(axis=0)
    assert np.all(sizes > 0)
    np.testing.assert_allclose(response.gradient / sizes, slopes / sizes, rtol=1e-6, atol=1e-7)


def test_a_parameter_of_zero_has_a_derivative():
    """A term that does not act yet: y^2 at the equilibrium 0 changes nothing of order 1, and H_2 at once."""
    model = NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)": 0.4, "y(k-1)^2": 0.0}, sample_time=SAMPLE_TIME)
    omega = random_omega(2, 6)
    response = gfrf(model, 2, omega)
    np.testing.assert_array_equal(response.values, 0.0)
    unit = replace(model, theta=np.array([0.6, 0.4, 1.0]))  # H_2 is linear in it
    np.testing.assert_allclose(response.gradient[:, 2], gfrf(unit, 2, omega).values, rtol=1e-12)
    np.testing.assert_array_equal(gfrf(model, 1, OMEGA).gradient[:, 2], 0.0)


@pytest.mark.parametrize("lengths", [(7, 5, 3), (41, 23, 30), (1, 6, 4), (6, 1, 4), (6, 4, 1), (1, 1, 1), (3, 1, 1)])
def test_a_grid_gives_what_its_points_give(lengths):
    """Points in disorder are no grid; on a grid, also of several blocks, pairs of tones are computed once."""
    rng = np.random.default_rng(3)
    omega = frequency_grid(*(rng.uniform(-100, 100, n) for n in lengths))
    model = NarxModel.from_terms(LAGGED, sample_time=SAMPLE_TIME)
    order = rng.permutation(len(omega))
    np.testing.assert_allclose(gfrf(model, 3, omega).values[order], gfrf(model, 3, omega[order]).values, rtol=1e-12)
    some = order[:50]  # the gradient of few points of the largest grid
    grid = gfrf(model, 3, omega if len(omega) < 1000 else omega[: 4 * 23 * 30])
    some = some[some < len(grid.omega)]
    np.testing.assert_allclose(grid.gradient[some], gfrf(model, 3, omega[some]).gradient, rtol=1e-11, atol=1e-13)


def test_what_is_all_but_a_grid_is_none():
    """A diagonal, frequencies that come again, a grid with one point moved, and one without its last point."""
    axis = np.linspace(-100.0, 100.0, 5)
    moved = frequency_grid(axis, axis).copy()
    moved[7, 0] += 1.0
    again = frequency_grid([1.0, 1.0, 2.0], [3.0, 3.0])
    model = NarxModel.from_terms(LAGGED, sample_time=SAMPLE_TIME)
    for omega in (np.stack([axis, axis], axis=1), again, moved, frequency_grid(axis, axis)[:-1], moved[:, ::-1]):
        points = [gfrf(model, 2, point).values[0] for point in omega]
        np.testing.assert_allclose(gfrf(model, 2, omega).values, points, rtol=1e-12)


def test_models_of_inputs_alone_and_of_outputs_alone():
    volterra = NarxModel.from_terms({"u(k)": 1.0, "u(k)u(k-2)": 0.5, "u(k-1)^3": 2.0}, sample_time=SAMPLE_TIME)
    omega = random_omega(2)
    z = np.exp(-1j * SAMPLE_TIME * omega)
    np.testing.assert_allclose(gfrf(volterra, 2, omega).values, 0.25 * (z[:, 0] ** 2 + z[:, 1] ** 2), rtol=1e-12)
    omega = random_omega(3)
    cube = 2.0 * np.exp(-1j * SAMPLE_TIME * omega.sum(axis=1))
    np.testing.assert_allclose(gfrf(volterra, 3, omega).values, cube, rtol=1e-12)
    np.testing.assert_array_equal(gfrf(volterra, 4, random_omega(4)).values, 0.0)
    unforced = NarxModel.from_terms({"y(k-1)": 0.5, "y(k-1)^2": 0.1}, sample_time=SAMPLE_TIME)
    response = gfrf(unforced, 2, random_omega(2))
    assert not response.values.any() and not response.gradient.any()


def test_frequency_grid_runs_fastest_along_the_last():
    grid = frequency_grid([1.0, 2.0], [3.0, 4.0, 5.0])
    np.testing.assert_array_equal(grid, [[1, 3], [1, 4], [1, 5], [2, 3], [2, 4], [2, 5]])
    for axes in ((), (1.0,), ([1.0, 2.0], "abc")):
        with pytest.raises(ModelError, match="grid"):
            frequency_grid(*axes)


@pytest.mark.parametrize(
    ("order", "omega", "said"),
    [
        *((order, OMEGA, "must be an integer from 1 to 8") for order in (0, -1, 9, 2.5, 1.0, True, "2", None)),
        (1, np.nan, "nan rad/s; frequencies go up to half the sampling rate"),
        (1, 1000.0, "1000 rad/s; frequencies go up to half the sampling rate"),
        (1, [1.0, np.inf], "half the sampling rate"),
        (1, np.array([1.0 + 2.0j]), "omega must be real numbers; got complex numbers"),
        (1, "fast", "omega must be real numbers; got text"),
        (1, [None], "omega must be real numbers"),
        (1, [[1.0], [1.0, 2.0]], "rows differ in length"),
        (1, [], "omega is empty"),
        (2, np.empty((0, 2)), "omega is empty"),
        (1, [[1.0, 2.0]], r"order 1 needs \(n,\)"),
        (2, OMEGA, r"order 2 needs \(n, 2\)"),
        (3, np.ones((4, 2)), r"order 3 needs \(n, 3\)"),
    ],
)
def test_orders_and_frequencies_that_are_none_are_said(order, omega, said):
    with pytest.raises(ModelError, match=said):
        gfrf(nonlinear(), order, omega)


def test_models_and_operating_points_that_do_not_suit_are_said():
    with pytest.raises(ModelError, match="2 inputs: name that of each frequency"):
        gfrf(NarxModel.from_terms({"u1(k)": 1.0, "u2(k)": 1.0}, sample_time=1.0), 1, 0.1)
    outputs = NarxModel.from_terms({"y1": {"u(k-1)": 1.0}, "y2": {"u(k-1)": 1.0}}, sample_time=1.0)
    with pytest.raises(ModelError, match="one output; this one has 2"):
        gfrf(outputs, 1, 0.1)
    noisy = NarxModel.from_terms({"u(k-1)": 1.0, "e(k-1)": 0.5}, sample_time=1.0)
    with pytest.raises(ModelError, match="without noise terms; give its `deterministic` part"):
        gfrf(noisy, 1, 0.1)
    np.testing.assert_allclose(gfrf(noisy.deterministic, 1, 0.1).gain, 1.0, rtol=1e-14)
    for operating_input in ("high", 1j, [1.0, 2.0], np.nan):
        with pytest.raises(ModelError, match="operating_input"):
            gfrf(nonlinear(), 1, 0.1, operating_input=operating_input)


def test_a_pole_at_the_frequency_is_said():
    """y(k) = -y(k-2) + u(k-1) has poles at a quarter of the sampling rate, of either sign."""
    model = NarxModel.from_terms({"y(k-2)": -1.0, "u(k-1)": 1.0, "u(k-1)^2": 1.0}, sample_time=0.5)
    quarter = np.pi / 2 / 0.5
    assert not gfrf(model, 1, 0.9 * quarter).status.ok
    np.testing.assert_allclose(gfrf(model, 1, 0.5 * quarter).gain, 1 / abs(1 - 1j), rtol=1e-12)
    for order, omega in ((1, quarter), (1, [0.1, -quarter]), (2, [[0.25 * quarter, 0.75 * quarter]])):
        with pytest.raises(ModelError, match=r"pole on the unit circle, at 0\.25 times the sampling rate"):
            gfrf(model, order, omega)
    assert np.isfinite(output_spectrum(model, np.ones(6), 1).values).all()  # its lines are sixths
    with pytest.raises(ModelError, match=r"at 0\.25 times the sampling rate"):
        output_spectrum(model, np.ones(8), 1)


TERMS = {"y(k-1)": 0.5, "y(k-2)": 0.1, "u(k-1)": 0.4, "y(k-1)^2": 0.2, "y(k-1)y(k-2)u(k)": -0.1, "u(k)^2u(k-1)": 0.3}
MODEL = NarxModel.from_terms(TERMS, sample_time=1.0)
ANGLES = np.random.default_rng(0).uniform(-3, 3, (5, 3))


def test_the_same_signal_written_twice_counts_twice():
    """y and y1 are the one output of the model."""
    twice = NarxModel.from_terms({"y(k-1)": 0.3, "y1(k-1)": 0.4, "u(k-1)": 1.0, "y(k-1)^2": 0.1}, sample_time=1.0)
    once = NarxModel.from_terms({"y(k-1)": 0.7, "u(k-1)": 1.0, "y(k-1)^2": 0.1}, sample_time=1.0)
    for order, omega in ((1, ANGLES[:, 0]), (2, ANGLES[:, :2])):
        np.testing.assert_allclose(gfrf(twice, order, omega).values, gfrf(once, order, omega).values, rtol=1e-12)


def test_memory_is_bounded_by_blocks():
    """Beyond what goes in and comes out, 96^3 points take no more than a block may hold (128 MB)."""
    import tracemalloc

    axis = np.linspace(-3, 3, 96)  # all at once they would take 290 MB
    omega = frequency_grid(axis, axis, axis)
    gfrf(MODEL, 3, omega[:10])
    tracemalloc.start()
    response = gfrf(MODEL, 3, omega)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    copies = 2 * omega.nbytes + response.values.nbytes  # frequencies in rad/s and in rad/sample
    assert peak < copies + 128e6

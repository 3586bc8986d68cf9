"""The equations of the parts, on what `gfrf` and `output_orders` do not reach."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.hierarchy import solve_parts
from deatwin.ident.frequency.parts import Orders
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

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
    """Beyond what goes in and comes out, 64^3 points take no more than a block may hold (128 MB)."""
    import tracemalloc

    axis = np.linspace(-3, 3, 64)
    omega = frequency_grid(axis, axis, axis)
    gfrf(MODEL, 3, omega[:10])
    tracemalloc.start()
    response = gfrf(MODEL, 3, omega)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    copies = 2 * omega.nbytes + response.values.nbytes  # frequencies in rad/s and in rad/sample
    assert peak < copies + 128e6


def test_a_line_that_meets_a_pole_has_no_steady_state():
    model = NarxModel.from_terms({"y(k-2)": -1.0, "u(k-1)": 1.0}, sample_time=1.0)
    solve_parts(model.terms, model.theta, Orders(np.ones(6), 1), by_theta=False)  # its lines are sixths
    with pytest.raises(ModelError, match=r"at 0\.25 times the sampling rate"):
        solve_parts(model.terms, model.theta, Orders(np.ones(8), 1), by_theta=False)
    many = np.stack([model.theta, 0.5 * model.theta], axis=1)
    with pytest.raises(ModelError, match="pole"):
        solve_parts(model.terms, many, Orders(np.ones(8), 1), by_theta=False)
    tamed = replace(model, theta=0.5 * model.theta)
    assert np.isfinite(solve_parts(tamed.terms, tamed.theta, Orders(np.ones(8), 1), by_theta=False)[1].value).all()

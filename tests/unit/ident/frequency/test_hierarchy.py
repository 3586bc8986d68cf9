"""The equations of the parts, on what `gfrf` and `output_orders` do not reach."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.hierarchy import products_of, solve_parts
from deatwin.ident.frequency.parts import Orders, Tones
from deatwin.ident.narx import NarxModel, Term
from deatwin.plant.errors import ModelError

TERMS = {"y(k-1)": 0.5, "y(k-2)": 0.1, "u(k-1)": 0.4, "y(k-1)^2": 0.2, "y(k-1)y(k-2)u(k)": -0.1, "u(k)^2u(k-1)": 0.3}
MODEL = NarxModel.from_terms(TERMS, sample_time=1.0)
ANGLES = np.random.default_rng(0).uniform(-3, 3, (5, 3))
PARTS = {"sets": (lambda: Tones(ANGLES), 7), "orders": (lambda: Orders(np.random.default_rng(1).normal(size=12), 3), 3)}


@pytest.mark.parametrize("kind", PARTS)
def test_many_models_at_once_are_each_of_them(kind):
    make, last = PARTS[kind]
    thetas = MODEL.theta[:, None] * np.random.default_rng(2).uniform(0.8, 1.2, (len(TERMS), 4))
    together = solve_parts(MODEL.terms, thetas, make(), by_theta=True)[last]
    for i in range(4):
        alone = solve_parts(MODEL.terms, thetas[:, i], make(), by_theta=True)[last]
        np.testing.assert_allclose(together.value[i], alone.value, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(together.slope[:, i], alone.slope, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("kind", PARTS)
def test_slopes_of_every_part_against_differences(kind):
    make, _ = PARTS[kind]
    found = solve_parts(MODEL.terms, MODEL.theta, make(), by_theta=True)
    for m, step in enumerate(1e-5 * np.eye(len(TERMS))):
        sides = [solve_parts(MODEL.terms, MODEL.theta + s * step, make(), by_theta=False) for s in (1, -1)]
        for part, jet in found.items():
            difference = (sides[0][part].value - sides[1][part].value) / 2e-5
            np.testing.assert_allclose(jet.slope[m], difference, rtol=1e-6, atol=1e-8)


def test_parts_that_are_zero_are_missing():
    square = NarxModel.from_terms({"y(k-1)": 0.5, "u(k)^2": 1.0}, sample_time=1.0)
    assert set(solve_parts(square.terms, square.theta, Tones(ANGLES), by_theta=True)) == {0b011, 0b101, 0b110}
    assert set(solve_parts(square.terms, square.theta, Orders(np.ones(4), 5), by_theta=False)) == {2}


def test_splits_of_a_set_are_all():
    tones = Tones(np.zeros((1, 4)))
    pairs = list(tones.splits(0b1101))
    assert len(set(pairs)) == 2**3 - 2 and all(a | b == 0b1101 and a & b == 0 for a, b in pairs)


def test_the_same_signal_written_twice_counts_twice():
    """y and y1 are the one output of the model."""
    twice = NarxModel.from_terms({"y(k-1)": 0.3, "y1(k-1)": 0.4, "u(k-1)": 1.0, "y(k-1)^2": 0.1}, sample_time=1.0)
    once = NarxModel.from_terms({"y(k-1)": 0.7, "u(k-1)": 1.0, "y(k-1)^2": 0.1}, sample_time=1.0)
    for order, omega in ((1, ANGLES[:, 0]), (2, ANGLES[:, :2])):
        np.testing.assert_allclose(gfrf(twice, order, omega).values, gfrf(once, order, omega).values, rtol=1e-12)


def test_products_that_are_kept_are_the_terms_and_what_they_are_made_of():
    """y(k-2)y(k-1)u(k) is made of y(k-2)y(k-1) and u(k), the former of its factors; y(k-2)u(k) of those that exist."""
    terms = [Term.parse(text) for text in ("y(k-1)y(k-2)u(k)", "y(k-2)u(k)", "u(k)")]
    assert products_of(terms) == 6


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

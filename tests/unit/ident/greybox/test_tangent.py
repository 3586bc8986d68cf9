"""What parameters take up of readings, beside least squares of another routine."""

import numpy as np
import pytest

from deatwin.ident.greybox.tangent import bounded_fit, least_within, linearised_rms, taken_off, tangent_basis


def test_a_linear_fit_ends_where_its_linearisation_says():
    rng = np.random.default_rng(0)
    jacobian, readings = rng.normal(size=(50, 3)), rng.normal(size=50)
    expected = np.sqrt(np.linalg.lstsq(jacobian, readings)[1][0] / 50)
    for scales in ([1.0, 1.0, 1.0], [1e-12, 1.0, 1e9]):
        assert linearised_rms(readings, jacobian * scales) == pytest.approx(expected, rel=1e-12)
    # A parameter that does nothing takes up nothing.
    assert linearised_rms(readings, np.zeros((50, 2))) == pytest.approx(np.sqrt(np.mean(readings**2)), rel=1e-12)


def test_what_is_taken_off_is_what_least_squares_leave():
    rng = np.random.default_rng(1)
    jacobian, signal = rng.normal(size=(40, 4)) * [1e-9, 1.0, 1e6, 0.0], rng.normal(size=40)
    basis = tangent_basis(jacobian)
    assert basis.shape == (40, 3)  # the fourth parameter does nothing
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-14)
    columns = jacobian[:, :3] / [1e-9, 1.0, 1e6]
    left = signal - columns @ np.linalg.lstsq(columns, signal)[0]
    np.testing.assert_allclose(taken_off(signal, basis), left, atol=1e-13)


def test_a_fit_that_may_go_anywhere_costs_nothing_and_one_that_may_not_what_is_missing():
    rng = np.random.default_rng(3)
    jacobian, residuals = rng.standard_normal((60, 4)) * [1.0, 1e6, 0.0, 1e-9], rng.standard_normal(60)
    anywhere = np.full(4, np.inf)
    cost, held = bounded_fit(residuals, jacobian, -anywhere, anywhere)
    assert cost == pytest.approx(0.0, abs=1e-12) and not held.any()
    best = np.linalg.lstsq(jacobian[:, [0, 1, 3]] / [1.0, 1e6, 1e-9], residuals, rcond=None)[0] / [1.0, 1e6, 1e-9]
    for k, step in zip((0, 1, 3), best, strict=True):  # each may move the other way only: it stays
        lower, upper = -anywhere, anywhere.copy()
        (lower if step < 0.0 else upper)[k] = 0.0
        cost, held = bounded_fit(residuals, jacobian, lower, upper)
        without = linearised_rms(residuals, np.delete(jacobian, k, axis=1))
        assert cost == pytest.approx(without**2 - linearised_rms(residuals, jacobian) ** 2, rel=1e-9)
        assert list(np.flatnonzero(held)) == [k]
        assert least_within(residuals, jacobian, lower, upper) == pytest.approx(without**2, rel=1e-9)


def test_what_one_parameter_may_not_do_another_one_does_not_do_for_it_beyond_its_own_bound():
    """Of two that do nearly the same the first would go out alone; with the second free to leave nothing were lost."""
    one, other, rest = np.linalg.qr(np.random.default_rng(4).standard_normal((80, 3)))[0].T
    jacobian = np.column_stack([one, 0.95 * one + np.sqrt(1.0 - 0.95**2) * other])
    residuals = 3.0 * one + rest
    cost, held = bounded_fit(residuals, jacobian, np.full(2, -np.inf), np.zeros(2))
    assert held.all()
    assert cost == pytest.approx(9.0 / 80)

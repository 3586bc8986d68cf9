"""What parameters take up of readings, beside least squares of another routine."""

import numpy as np
import pytest

from deatwin.ident.greybox.tangent import linearised_rms, linearised_step, taken_off, tangent_basis


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


def test_the_step_leaves_what_the_linear_model_does_and_moves_nothing_idle():
    rng = np.random.default_rng(3)
    jacobian, residuals = rng.standard_normal((60, 4)) * [1.0, 1e6, 0.0, 1e-9], rng.standard_normal(60)
    step = linearised_step(residuals, jacobian)
    assert step[2] == 0.0
    left = np.sqrt(np.mean((residuals - jacobian @ step) ** 2))
    assert left == pytest.approx(linearised_rms(residuals, jacobian), rel=1e-12)

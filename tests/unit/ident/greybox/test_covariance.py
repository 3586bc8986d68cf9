"""Covariance of least squares against draws."""

import numpy as np
import pytest

from deatwin.ident.greybox.covariance import with_errors


def test_errors_along_columns_carry_over_to_the_estimates_as_drawn() -> None:
    rng = np.random.default_rng(0)
    jacobian, columns, noise, draws = rng.standard_normal((60, 3)), 0.3 * rng.standard_normal((60, 4)), 0.5, 40_000
    jacobian[:, 2] *= 1e-9  # a parameter in a small unit
    errors = columns @ rng.standard_normal((4, draws)) + noise * rng.standard_normal((60, draws))
    drawn = np.cov(np.linalg.lstsq(jacobian, errors, rcond=None)[0])
    white = noise**2 * np.linalg.inv(jacobian.T @ jacobian)
    found = with_errors(white, jacobian, columns)
    size = np.sqrt(np.outer(np.diag(drawn), np.diag(drawn)))
    # A covariance of so many draws scatters by 1 %.
    assert (found / size) == pytest.approx(drawn / size, abs=0.04)
    assert with_errors(white, jacobian, np.zeros((60, 0))) == pytest.approx(white)

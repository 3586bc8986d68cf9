"""The scatter of fitted parameters by the jackknife: against refits, sample variances and repeated experiments."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import Fixed
from deatwin.ident.narx.robust import Cosines, pseudovalues, robust
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

TERMS = ["1", "y(k-1)", "u(k-1)", "u(k-1)^2"]


def recorded(seed: int, n: int = 640, colour: float = 0.8) -> Recording:
    """y = 0.5 y(-1) + u(-1) + 0.2 u(-1)^2, read with an error that an AR(1) filter has coloured."""
    rng = np.random.default_rng(seed)
    u, shocks = rng.standard_normal(n), 0.5 * rng.standard_normal(n)
    x, error = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        x[k] = 0.5 * x[k - 1] + u[k - 1] + 0.2 * u[k - 1] ** 2
        error[k] = colour * error[k - 1] + shocks[k]
    return Recording.from_arrays(u, x + error, 1.0)


def regressors(record: Recording) -> tuple[np.ndarray, np.ndarray]:
    u, y = record.inputs[0], record.outputs[0]
    return np.stack([np.ones(u.size - 1), y[:-1], u[:-1], u[:-1] ** 2], axis=1), y[1:]


def test_a_block_moves_the_parameters_as_a_fit_without_it() -> None:
    record = recorded(1)
    model = Fixed(terms=TERMS).fit(record).model_
    values = pseudovalues(model, record, n_blocks=16)
    rows, target = regressors(record)
    edges = np.linspace(0, len(target), 17).round().astype(int)
    for block in (0, 7, 15):
        kept = np.r_[0 : edges[block], edges[block + 1] : len(target)]
        without = np.linalg.lstsq(rows[kept], target[kept], rcond=None)[0]
        # identical up to the rounding of two solutions of well-conditioned equations
        np.testing.assert_allclose(values[block], 15 * (model.theta - without), rtol=1e-9, atol=1e-12)


def test_with_instruments_too() -> None:
    record, other = recorded(2), recorded(2, colour=0.0)
    z, (rows, target) = regressors(other)[0], regressors(record)
    plain = Fixed(terms=TERMS).fit(record).model_
    model = replace(plain, theta=np.linalg.solve(z.T @ rows, z.T @ target))
    values = pseudovalues(model, record, n_blocks=16, instruments=other)
    edges = np.linspace(0, len(target), 17).round().astype(int)
    kept = np.r_[0 : edges[3], edges[4] : len(target)]
    without = np.linalg.solve(z[kept].T @ rows[kept], z[kept].T @ target[kept])
    np.testing.assert_allclose(values[3], 15 * (model.theta - without), rtol=1e-9, atol=1e-12)


def test_all_cosines_together_are_the_sample_covariance() -> None:
    series = np.random.default_rng(3).standard_normal((40, 3)) @ np.array([[1, 0.5, 0], [0, 1, 2], [0, 0, 1]])
    cosines = Cosines.of(series)
    assert cosines.dof == 39
    # Parseval: an orthonormal transform keeps the sum of squares about the mean
    np.testing.assert_allclose(cosines.scale, np.cov(series.T) / 40, rtol=1e-12)
    direction = np.array([[1.0, -2.0, 0.3]])
    np.testing.assert_allclose(cosines.projected(direction).scale, Cosines.of(series @ direction.T).scale, rtol=1e-12)


def test_a_drift_is_told_from_scatter_and_followed() -> None:
    n = 64
    times = (np.arange(n) + 0.5) / n
    ramp = 3.0 * np.cos(np.pi * times)
    noise = np.random.default_rng(4).standard_normal(n)
    cosines = Cosines.of((ramp + noise)[:, None], 4)
    alone = Cosines.of(noise[:, None], 4)
    # the ramp is the first cosine and leaves the others alone
    np.testing.assert_allclose(cosines.scale, alone.scale, rtol=1e-12)
    np.testing.assert_allclose(cosines.drift(times)[:, 0] - alone.drift(times)[:, 0], ramp, atol=1e-12)
    # least squares on a constant and four cosines: the same variance of the fitted curve
    design = np.column_stack([np.ones(n), *(np.cos(j * np.pi * times) for j in range(1, 5))])
    spread = np.einsum("ti,ij,tj->t", design, np.linalg.inv(design.T @ design), design)
    residual = noise - design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    expected = spread * (residual @ residual) / (n - 5)
    np.testing.assert_allclose(cosines.drift_scales(times)[:, 0, 0], expected, rtol=1e-10)


def test_it_holds_over_repeated_experiments_where_that_of_least_squares_does_not() -> None:
    """Variances of 150 repeats: chi-squared of 149 degrees scatter by 12 %, so 35 % is three deviations."""
    fits = [(Fixed(terms=TERMS).fit(record).model_, record) for record in (recorded(100 + k) for k in range(150))]
    seen = np.var([model.theta for model, _ in fits], axis=0, ddof=1)
    plain = np.mean([np.diag(model.theta_cov) for model, _ in fits], axis=0)
    jackknife = np.mean([np.diag(robust(model, record).theta_cov) * 61 / 63 for model, record in fits], axis=0)
    np.testing.assert_allclose(jackknife, seen, rtol=0.35)
    assert not np.allclose(plain, seen, rtol=0.35)  # the coloured error moves constant and feedback more


def test_the_law_is_that_of_so_many_blocks() -> None:
    record = recorded(5)
    model = Fixed(terms=TERMS).fit(record).model_
    with_law = robust(model, record, n_blocks=32)
    assert with_law.theta_dof == 31
    np.testing.assert_array_equal(with_law.theta, model.theta)
    scale = Cosines.of(pseudovalues(model, record, n_blocks=32)).scale
    np.testing.assert_allclose(with_law.theta_cov, scale * 31 / 29, rtol=1e-12)  # variance of a t law


def test_what_cannot_be_known_is_said() -> None:
    record = recorded(6, n=100)
    model = Fixed(terms=TERMS).fit(record).model_
    with pytest.raises(ModelError, match="too few for 64 blocks"):
        pseudovalues(model, record)
    for wrong in (-1, 1, 16.0, "a"):
        with pytest.raises(ModelError, match="integer of at least 2"):
            robust(model, record, n_blocks=wrong)
    with pytest.raises(ModelError, match="instruments 49"):
        pseudovalues(model, record, n_blocks=16, instruments=recorded(6, n=50))
    with pytest.raises(ModelError, match="at least 13"):
        Cosines.of(np.zeros((10, 1)), 4)
    u = np.zeros(100)
    u[50] = 1.0
    once = Recording.from_arrays(u, np.random.default_rng(0).standard_normal(100), 1.0)
    with pytest.raises(ModelError, match="without samples 50 to 58"):
        pseudovalues(Fixed(terms=["y(k-1)", "u(k-1)"]).fit(once).model_, once, n_blocks=12)

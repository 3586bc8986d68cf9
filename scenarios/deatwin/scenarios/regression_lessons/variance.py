"""Bias and variance: the expected error on new data in closed form, and by repeating the experiment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from deatwin.ident.narx import LeastSquares, Ridge
from deatwin.plant.arrays import Array

Fitter = Callable[[Array], Array]

N, NOISE, DRAWS = 30, 0.5, 400
DEGREES = np.arange(13)
RIDGE_DEGREE, PENALTIES = 12, np.geomspace(1e-4, 10.0, 21)
POINTS = np.linspace(-1.0, 1.0, N)


def curve(points: Array) -> Array:
    """The true curve, which is not a polynomial."""
    return np.asarray(np.sin(np.pi * points) + 0.5 * np.cos(2 * points))


def powers(points: Array, degree: int) -> Array:
    """Legendre polynomials up to a degree as regressors, (degree + 1, n). Shapes: `points` (n,)."""
    return np.asarray(np.polynomial.legendre.legvander(points, degree).T, dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Decomposition:
    """Errors of an estimator by its complexity."""

    complexity: Array  # shape (n,): Degree or penalty
    freedom: Array
    bias: Array  # shape (n,): Mean squared bias and mean variance of the fitted values, in closed form
    variance: Array
    noise: float  # Variance of new readings
    test: Array
    test_error: Array
    training: Array  # shape (n,): Mean squared error on the readings that were fitted, over the same experiments
    covariance: Array
    covariance_error: Array

    @property
    def expected(self) -> Array:
        """Closed form of the error on new readings, shape (n,)."""
        return self.bias + self.variance + self.noise

    @property
    def worst(self) -> float:
        """Largest departure of the repeated experiments from it, in their standard errors."""
        return float(np.abs((self.test - self.expected) / self.test_error).max())

    @property
    def worst_freedom(self) -> float:
        """Largest departure of the covariances from the trace, in their standard errors."""
        return float(np.abs((self.covariance - self.freedom) / self.covariance_error).max())


def by_degree(rng: np.random.Generator) -> Decomposition:
    """Least squares with polynomials of growing degree."""

    def fitter(degree: float) -> Fitter:
        rows = powers(POINTS, int(degree))
        return lambda target: np.asarray(LeastSquares()(rows, target).theta @ rows)

    hats = []
    for degree in DEGREES:
        basis, _ = np.linalg.qr(powers(POINTS, int(degree)).T)
        hats.append(basis @ basis.T)
    return _decomposition(rng, DEGREES.astype(float), hats, fitter)


def by_penalty(rng: np.random.Generator) -> Decomposition:
    """Ridge regression of one degree with a growing penalty."""
    rows = powers(POINTS, RIDGE_DEGREE)

    def fitter(penalty: float) -> Fitter:
        return lambda target: Ridge(float(penalty))(rows, target).theta @ rows

    centred = rows[1:] - rows[1:].mean(axis=1, keepdims=True)
    z = centred / np.sqrt(np.mean(centred**2, axis=1, keepdims=True))
    hats = [
        np.full((N, N), 1 / N) + z.T @ np.linalg.solve(z @ z.T / N + penalty * np.eye(len(z)), z) / N
        for penalty in PENALTIES
    ]
    return _decomposition(rng, PENALTIES, hats, fitter)


def _decomposition(
    rng: np.random.Generator, complexity: Array, hats: list[Array], fitter: Callable[[float], Fitter]
) -> Decomposition:
    truth = curve(POINTS)
    noises, new = NOISE * rng.standard_normal((2, DRAWS, N))
    test, training, along = (np.empty((complexity.size, DRAWS)) for _ in range(3))
    for i, value in enumerate(complexity):
        fit = fitter(float(value))
        for j in range(DRAWS):
            fitted = fit(truth + noises[j])
            test[i, j] = np.mean((truth + new[j] - fitted) ** 2)
            training[i, j] = np.mean((truth + noises[j] - fitted) ** 2)
            along[i, j] = fitted @ noises[j] / NOISE**2
    return Decomposition(
        complexity=complexity,
        freedom=np.array([np.trace(hat) for hat in hats]),
        bias=np.array([np.mean((hat @ truth - truth) ** 2) for hat in hats]),
        variance=np.array([NOISE**2 * np.sum(hat**2) / N for hat in hats]),
        noise=NOISE**2,
        test=test.mean(axis=1),
        test_error=test.std(axis=1) / np.sqrt(DRAWS),
        training=training.mean(axis=1),
        covariance=along.mean(axis=1),
        covariance_error=along.std(axis=1) / np.sqrt(DRAWS),
    )

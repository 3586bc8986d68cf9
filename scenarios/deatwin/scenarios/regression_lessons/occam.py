"""Occam's razor: the evidence of polynomials of each degree for data of a cubic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Bayesian
from deatwin.ident.narx.bayes import Priors
from deatwin.plant.arrays import Array
from deatwin.scenarios.regression_lessons.variance import powers

N, NOISE, PRECISION = 40, 0.2, 0.04
"""Samples, standard deviation of the noise, prior precision of each parameter over the noise's."""
DRAWS, JUDGED = 400, 100  # Experiments, and those in which noise and size of the parameters are estimated too
TRUTH = np.array([0.3, -0.8, 0.5, 0.7])  # Legendre coefficients of the cubic
TRUE_DEGREE, DEGREES = 3, np.arange(11)
POINTS, BETWEEN = np.linspace(-1.0, 1.0, N), np.linspace(-0.99, 0.99, 200)


@dataclass(frozen=True, kw_only=True, eq=False)
class Occam:
    """Results by degree, over repeated experiments."""

    degrees: NDArray[np.int64]  # shape (n,): Of the polynomials
    training: Array
    test: Array
    monotone: bool  # True if the training error fell with each degree in each experiment
    evidence: Array  # shape (n,): Mean log evidence with known noise, and its standard error, nats
    evidence_error: Array
    expected: Array  # shape (n,): Closed form of that mean
    best_fit: Array
    occam_factor: Array
    peaks: NDArray[np.int64]
    largest_fit: NDArray[np.int64]  # shape (n_experiments,): Degree of the least training error
    agreement: float


def occam(rng: np.random.Generator) -> Occam:
    """Repeat the experiment and judge all degrees."""
    truth = TRUTH @ powers(POINTS, TRUE_DEGREE)
    readings = truth + NOISE * rng.standard_normal((DRAWS, N))
    designs = [powers(POINTS, int(degree)) for degree in DEGREES]
    laws = [NOISE**2 * (np.eye(N) + rows.T @ rows / PRECISION) for rows in designs]
    known = np.array([[_log_density(law, y) for y in readings] for law in laws])
    training, test = (np.empty((DEGREES.size, DRAWS)) for _ in range(2))
    for i, rows in enumerate(designs):
        theta = np.linalg.lstsq(rows.T, readings.T, rcond=None)[0]
        training[i] = np.mean((readings.T - rows.T @ theta) ** 2, axis=0)
        apart = powers(BETWEEN, int(DEGREES[i])).T @ theta - (TRUTH @ powers(BETWEEN, TRUE_DEGREE))[:, None]
        test[i] = np.mean(apart**2, axis=0) + NOISE**2
    fit = -N / 2 * np.log(2 * np.pi * NOISE**2) - N * training.mean(axis=1) / (2 * NOISE**2)
    unknown = np.array([[Bayesian()(rows, y).log_evidence for y in readings[:JUDGED]] for rows in designs])
    return Occam(
        degrees=DEGREES,
        training=training.mean(axis=1),
        test=test.mean(axis=1),
        monotone=bool(np.all(np.diff(training, axis=0) < 0)),
        evidence=known.mean(axis=1),
        evidence_error=known.std(axis=1) / np.sqrt(DRAWS),
        expected=np.array([_expected(law, truth) for law in laws]),
        best_fit=fit,
        occam_factor=fit - known.mean(axis=1),
        peaks=DEGREES[np.argmax(unknown, axis=0)],
        largest_fit=DEGREES[np.argmin(training, axis=0)],
        agreement=_agreement(designs, readings[0]),
    )


def _log_density(law: Array, y: Array) -> float:
    """ln N(y; 0, law)."""
    return float(-0.5 * (np.linalg.slogdet(2 * np.pi * law)[1] + y @ np.linalg.solve(law, y)))


def _expected(law: Array, truth: Array) -> float:
    """Mean of ln N(y; 0, law) for y ~ N(truth, NOISE^2)."""
    return _log_density(law, truth) - 0.5 * NOISE**2 * float(np.trace(np.linalg.inv(law)))


def _agreement(designs: list[Array], y: Array) -> float:
    """The evidence of the normal-gamma law is a multivariate t density of the readings."""
    from scipy.stats import multivariate_t

    priors, differences = Priors(a0=2.0, b0=0.1), []
    for rows in designs:
        ours = Bayesian(precision=1.0, priors=priors)(rows, y).log_evidence
        # The estimator divides each regressor by the power of two nearest to its root mean square.
        scaled = rows / np.exp2(np.round(np.log2(np.sqrt(np.mean(rows**2, axis=1)))))[:, None]
        shape = priors.b0 / priors.a0 * (np.eye(N) + scaled.T @ scaled)
        theirs = multivariate_t(loc=np.zeros(N), shape=shape, df=2 * priors.a0).logpdf(y)
        differences.append(abs(ours - float(theirs)))
    return max(differences)

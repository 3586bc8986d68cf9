"""Minimise the prediction errors by Gauss-Newton steps in a trust region."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.converged import converged
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials, is_stable
from deatwin.ident.narx.linear.prediction import PredictionErrors, prediction_errors
from deatwin.ident.narx.linear.start import Record

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Minimum:
    """Result of a search."""

    theta: Array  # shape (n_theta,): Parameters
    theta_cov: Array
    noise_variance: float  # sigma^2: sum of squares divided by the number of errors minus unknowns
    complete: bool  # False after an interrupt
    converged: bool = True  # True if the gradient is small


class PredictionErrorLoss:
    """Prediction errors as a function of theta and initial states; infinite if C or an F is unstable."""

    def __init__(self, orders: Orders, records: Sequence[Record]) -> None:
        self.orders = orders
        self.records = records
        self.n_start = sum(orders.nf)
        self.n_errors = sum(output.size - orders.first - orders.nd for _, output in records)
        self.best: tuple[float, Array] = np.inf, np.empty(0)
        self._last: tuple[Array, list[PredictionErrors]] = np.empty(0), []

    @property
    def n_unknowns(self) -> int:
        """Number of parameters plus initial states."""
        return self.orders.n_theta + len(self.records) * self.n_start

    def _each(self, unknowns: Array) -> list[PredictionErrors]:
        """Return errors and gradients of each record, cached for the last point."""
        if not np.array_equal(self._last[0], unknowns):
            theta, starts = np.split(unknowns, [self.orders.n_theta])
            p = self.orders.split(theta)
            each = zip(self.records, starts.reshape(len(self.records), self.n_start), strict=True)
            self._last = unknowns.copy(), [prediction_errors(self.orders, p, *r, start) for r, start in each]
        return self._last[1]

    def errors(self, unknowns: Array) -> Array:
        """Return all errors, (n_errors,), and keep the unknowns (n_unknowns,) if they are the best so far."""
        p = self.orders.split(unknowns[: self.orders.n_theta])
        if not all(is_stable(polynomial) for polynomial in (p.c, *p.f)):
            return np.full(self.n_errors, np.inf)
        errors = np.concatenate([one.errors for one in self._each(unknowns)])
        loss = float(errors @ errors)
        if loss < self.best[0]:
            self.best = loss, unknowns.copy()
        return errors

    def gradient(self, unknowns: Array) -> Array:
        """Return the derivative of the errors, shape (n_errors, n_unknowns). Shapes: `unknowns` (n_unknowns,)."""
        from scipy.linalg import block_diag

        each = self._each(unknowns)
        theta = np.concatenate([one.theta_gradient for one in each], axis=1)
        return np.asarray(np.concatenate([theta, block_diag(*(one.start_gradient for one in each))]).T)

    def started(self, polynomials: Polynomials) -> Array:
        """Return the unknowns for given polynomials, with the best initial states for them."""
        zero = np.zeros(self.n_start)
        starts = []
        for record in self.records:
            one = prediction_errors(self.orders, polynomials, *record, zero)
            starts.append(-np.linalg.lstsq(one.start_gradient.T, one.errors, rcond=None)[0])
        return np.concatenate([self.orders.join(polynomials), *starts])


def minimise(loss: PredictionErrorLoss, start: Polynomials) -> Minimum:
    """Search from one start."""
    from scipy.optimize import least_squares

    unknowns, complete = loss.started(start), True
    loss.best = float(np.sum(loss.errors(unknowns) ** 2)), unknowns
    try:
        least_squares(
            loss.errors, unknowns, loss.gradient, x_scale="jac", ftol=1e-12, xtol=1e-10, gtol=1e-12, max_nfev=200
        )
    except KeyboardInterrupt:
        complete = False
    square, unknowns = loss.best
    variance = square / (loss.n_errors - loss.n_unknowns)
    slopes, errors = loss.gradient(unknowns), loss.errors(unknowns)
    root = _inverse_root(slopes)
    n = loss.orders.n_theta
    size = float(np.sqrt(sum(output @ output for _, output in loss.records)))
    ended = converged(slopes, errors, errors.size, size)
    return Minimum(unknowns[:n], variance * (root @ root.T)[:n, :n], variance, complete, ended)


def _inverse_root(gradient: Array) -> Array:
    """Return W with W W' = (J'J)^-1; directions that the data do not determine get a very large variance."""
    norms = np.linalg.norm(gradient, axis=0)
    norms[norms == 0.0] = 1.0
    _, singular, right = np.linalg.svd(np.linalg.qr(gradient / norms, mode="r"))
    smallest = np.finfo(float).eps * gradient.shape[1] * max(float(singular[0]), np.finfo(float).tiny)
    return np.asarray(right.T / np.maximum(singular, smallest) / norms[:, None], dtype=np.float64)

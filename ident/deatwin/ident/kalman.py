"""One Kalman filter and fixed-interval smoother, with the likelihood and its gradient.

The model is x(k+1) = F_k x(k) + c_k + w(k), y_i(k) = h_ik' x(k) + v_i(k), white normal w ~ (0, Q_k), v_i ~ (0, R_i).
Numbers are taken in one at a time (Potter's update [1]_). Covariances are carried as roots, P = S S', also by the
recursion of Rauch, Tung and Striebel: nothing is subtracted, so a start may be as wide, or as exactly known, as one
likes. An extended filter linearises as it goes, by `update_root` and `advance_root`, and `kalman_filter` repeats it for
the smoother as the filter of the linear model with c_k = f(x) - F_k x.

.. [1] Bierman, "Factorization Methods for Discrete Sequential Estimation", Academic Press 1977, ch. V.
.. [2] de Jong, J. Am. Stat. Assoc. 84 (1989) 1085-1088.
.. [3] Koopman, Shephard, Biometrika 79 (1992) 823-826, doi:10.1093/biomet/79.4.823.
.. [4] Rauch, Tung, Striebel, AIAA J. 3 (1965) 1445-1450, doi:10.2514/3.3166; in roots: Park, Kailath, IEEE Trans.
   Autom. Control 41 (1996) 727-732.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import log, pi

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.kalman_loops import backward, forward, smooth
from deatwin.ident.state_space import StateSpace
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError


@dataclass(frozen=True, kw_only=True, eq=False)
class Filtered:
    """State estimates of the filter after each sample."""

    model: StateSpace
    states: Array  # shape (n, n_states): Mean given the measurements up to and including each sample
    roots: Array  # shape (n, n_states, n_states): Roots S of the covariance S S'
    innovations: Array
    """Measurement minus its prediction from all earlier ones (at the same sample, from outputs of lower number), shape
    (n_outputs, n); NaN where the measurement is missing."""
    innovation_variances: Array  # shape (n_outputs, n), all positive
    gains: Array  # shape (n_outputs, n, n_states): Change of the state per unit of each innovation

    @cached_property
    def n_measured(self) -> int:
        """Number of measurements, without the missing ones."""
        return int(np.isfinite(self.innovations).sum())

    @cached_property
    def log_likelihood(self) -> float:
        """Exact log likelihood of the measurements under the model, including the start."""
        variance, square = self.innovation_variances, self.innovations**2
        terms = np.where(np.isnan(square), 0.0, np.log(2 * pi * variance) + square / variance)
        return -0.5 * float(terms.sum())

    @property
    def variance_factor(self) -> float:
        """Common factor on all covariances (R, Q and that of the start) that maximises the likelihood."""
        return float(np.nansum(self.innovations**2 / self.innovation_variances)) / self.n_measured

    @property
    def scaled_log_likelihood(self) -> float:
        """Log likelihood after all covariances are multiplied by `variance_factor`."""
        logs = np.where(np.isnan(self.innovations), 0.0, np.log(self.innovation_variances))
        return -0.5 * (float(logs.sum()) + self.n_measured * (log(2 * pi * self.variance_factor) + 1.0))

    @property
    def covariances(self) -> Array:
        """Covariance of the state after each sample, shape (n, n_states, n_states)."""
        return np.asarray(self.roots @ self.roots.swapaxes(1, 2))

    @property
    def std(self) -> Array:
        """Standard deviations of the state after each sample, shape (n, n_states)."""
        return np.asarray(np.sqrt(np.einsum("kij,kij->ki", self.roots, self.roots)), dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothed:
    """State estimates from all measurements."""

    states: Array  # shape (n, n_states): Means
    covariances: Array  # shape (n, n_states, n_states)
    gains: Array  # shape (n - 1, n_states, n_states): Change of a smoothed state per change of the next one
    log_likelihood: float  # Log likelihood from the filter

    @property
    def std(self) -> Array:
        """Standard deviations, shape (n, n_states)."""
        variances = np.einsum("kii->ki", self.covariances)  # differences, so rounding may turn a zero negative
        return np.asarray(np.sqrt(np.maximum(variances, 0.0)), dtype=np.float64)


def kalman_filter(model: StateSpace, outputs: ArrayLike) -> Filtered:
    """Filter one record. Shapes: `outputs` (n_outputs, n) or (n,), NaN where a measurement is missing."""
    p, n, _ = model.rows.shape
    measured = np.atleast_2d(np.asarray(outputs, dtype=np.float64))
    if measured.shape != (p, n):
        raise ModelError(f"the outputs have the shape {measured.shape}; the model's rows need {(p, n)}")
    states, roots, innovations, variances, gains = forward(model, np.ascontiguousarray(measured))
    return Filtered(
        model=model, states=states, roots=roots, innovations=innovations, innovation_variances=variances, gains=gains
    )


def adjoint(filtered: Filtered) -> tuple[Array, Array]:
    """Run the filter's adjoint backward [2]_, [3]_; returns gradients of the log likelihood by a shift of the state
    before each sample (n, n_states), and minus the second derivatives (n, n_states, n_states)."""
    _require_no_fading(filtered.model)
    return backward(filtered.model, filtered.innovations, filtered.innovation_variances, filtered.gains)


def kalman_smoother(filtered: Filtered) -> Smoothed:
    """Return mean and covariance of each state, given the whole record [4]_."""
    _require_no_fading(filtered.model)
    states, covariances, gains = smooth(filtered.model, filtered.states, filtered.roots)
    return Smoothed(states=states, covariances=covariances, gains=gains, log_likelihood=filtered.log_likelihood)


def _require_no_fading(model: StateSpace) -> None:
    if model.fading != 1.0:
        raise ModelError("a fading filter has no likelihood and no smoother; take fading = 1")

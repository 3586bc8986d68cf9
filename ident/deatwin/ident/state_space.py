"""The state-space model that a Kalman filter runs over a record."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

_NOT_NEGATIVE = 1e-10  # eigenvalues of a correlation matrix below minus this are not rounding errors


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    """A linear state-space model over one record; each matrix is constant or given per sample."""

    rows: Array  # h_ik, output unit by unit of the state, shape (n_outputs, n, n_states) or (n, n_states)
    noise_variance: Array  # R_i of the noise, uncorrelated between outputs, shape (n_outputs,) or ()
    start: Array  # shape (n_states,): Mean of the state at the first sample, before its measurement
    start_cov: Array  # shape (n_states, n_states): Covariance of that state; zero where it is known exactly
    transition: Array | None = None  # F_k from sample k to k + 1, shape ([n - 1,] n_states, n_states); identity if None
    added: Array | None = None  # shape (n - 1, n_states): c_k, effect of known inputs on the state after sample k
    process_cov: Array | None = None  # Q_k of the noise added after sample k, shape as `transition`; zero if None
    intervals: Array | None = None  # shape (n - 1,): Factors on Q_k, for a random walk over a gap; 1 if None
    fading: float = 1.0
    """Forgetting factor in (0, 1] by which the covariance is divided in each step (recursive least squares with
    forgetting). Below 1 the likelihood and the smoother have no meaning."""

    def __post_init__(self) -> None:
        rows = np.asarray(self.rows, dtype=np.float64)
        rows = rows[None] if rows.ndim == 2 else rows
        if rows.ndim != 3 or 0 in rows.shape:
            raise ModelError(f"rows have the shape {rows.shape}; it must be (n_outputs, n, n_states)")
        p, n, m = rows.shape
        object.__setattr__(self, "rows", frozen(rows))
        shapes: dict[str, tuple[tuple[int, ...], ...]] = {
            "noise_variance": ((p,), (1,)),
            "start": ((m,),),
            "start_cov": ((m, m),),
            "transition": ((m, m), (n - 1, m, m)),
            "process_cov": ((m, m), (n - 1, m, m)),
            "intervals": ((n - 1,),),
            "added": ((n - 1, m),),
        }
        for name, allowed in shapes.items():
            given = getattr(self, name)
            if given is None:
                continue
            values = np.atleast_1d(np.asarray(given, dtype=np.float64))
            if values.shape not in allowed:
                wanted = " or ".join(map(str, allowed))
                raise ModelError(f"{name} has the shape {values.shape}; {p} rows of shape ({n}, {m}) need {wanted}")
            object.__setattr__(self, name, frozen(values))
        if self.noise_variance.shape != (p,):
            object.__setattr__(self, "noise_variance", frozen(np.full(p, self.noise_variance[0])))
        if not (np.all(self.noise_variance >= 0) and 0 < self.fading <= 1):
            raise ModelError(
                f"noise_variance = {self.noise_variance} must not be negative, "
                f"fading = {self.fading} must lie above 0 and not above 1"
            )

    @cached_property
    def process_root(self) -> Array | None:
        """Transposed roots G' with G G' = Q, shape (r, n_states) or (n - 1, r, n_states); None for no noise."""
        if self.process_cov is None or not self.process_cov.any():
            return None
        across = covariance_root(self.process_cov).swapaxes(-1, -2)
        return frozen(across[across.any(axis=1)] if across.ndim == 2 else across)


def covariance_root(covariance: Array) -> Array:
    """Return G with G G' = covariance. Shapes: `covariance` (n, n); returns (n, n)."""
    scale = np.sqrt(np.abs(np.einsum("...ii->...i", covariance)))
    divisor = np.where(scale > 0, scale, 1.0)
    correlation = covariance / (divisor[..., :, None] * divisor[..., None, :])
    values, axes = np.linalg.eigh(correlation)
    even = np.allclose(correlation, correlation.swapaxes(-1, -2), rtol=0, atol=1e-8)
    if not (even and np.all(np.isfinite(values)) and np.all(values > -_NOT_NEGATIVE * values.shape[-1])):
        raise ModelError("a covariance must be finite, symmetric and positive semidefinite")
    return np.asarray(divisor[..., :, None] * axes * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def frozen(values: Array) -> Array:
    array = np.ascontiguousarray(values, dtype=np.float64).view()
    array.setflags(write=False)
    return array

"""Feed a reference forward through the inverse of the actuator's linear dynamics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.control.arguments import instance, number, taking
from deatwin.control.controllers.inverse import InverseController
from deatwin.control.controllers.law import Law
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.plant.arrays import Array, Complex

_LAGS = (0.1, 0.4, 1.6)
"""Time constants of the filter, in periods of the upper end of the band, so that the filter follows creep within the
band."""
_LOWEST = 0.01  # Lower end of the band, as a share of its upper end
_POINTS = 80
_RIDGE = 1e-3  # Penalty relative to each column's size, which keeps the filter's coefficients from cancelling


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseFilter:
    """Stable filter F(z) with F(1) = 1 that approximates G(1)/G(z), the inverse dynamics of a model G, on a band.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        State matrix; its eigenvalues lie inside the unit circle.
    b, c : ndarray, shape (n,)
        Input and output vectors, dimensionless.
    d : float
        Direct term, dimensionless.
    band_Hz : float
        Upper end of the band, Hz.
    error : float
        Largest |F G/G(1) - 1| on the band. This is the largest relative error of the output for a sinusoidal
        reference in the band, if only feedforward acts.
    """

    a: Array
    b: Array
    c: Array
    d: float
    band_Hz: float
    error: float

    def response(self, omega: Array, sample_time: float) -> Complex:
        """Return the filter's frequency response at `omega` (n,) in rad/s; `sample_time` in s."""
        z = np.exp(1j * np.asarray(omega) * sample_time)
        states = np.linalg.solve(z[:, None, None] * np.eye(self.c.size) - self.a, self.b[None, :, None])
        return np.asarray(states[:, :, 0] @ self.c + self.d, dtype=np.complex128)

    def before(self, law: Law) -> Law:
        """Return `law` with the filtered reference added to its command; the filter's states come after the law's."""
        n, m = law.c.size, self.c.size
        b = np.vstack([law.b, np.stack([self.b, np.zeros(m)], axis=1)])
        a = np.block([[law.a, np.zeros((n, m))], [np.zeros((m, n)), self.a]])
        return Law(a=a, b=b, c=np.concatenate([law.c, self.c]), d=law.d + np.array([self.d, 0.0]))


@taking(linear=linear_model, band_Hz=number)
def inverse_filter(linear: LinearModel, band_Hz: float) -> InverseFilter:
    """Fit a causal filter to the inverse of a model's dynamics on a band.

    The output of the filter is a weighted sum of the present reference, the previous reference, and the reference
    filtered by each of three first-order lags. The weights minimise the sum of ``|F G/G(1) - 1|^2`` over frequencies
    from 1 % to 100 % of `band_Hz`. F is the response of the filter, G that of the model, and G(1) the static gain of
    the model. The filter is stable even if the model has zeros outside the unit circle.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`).
    band_Hz : float
        Upper end of the frequency band of the references, Hz; below half the sampling rate.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If `band_Hz` does not lie between 0 and half the sampling rate.
    """
    h = linear.require().sample_time
    highest = 0.5 / h
    if not 0.0 < band_Hz < highest:
        raise ControlError(f"a band up to {band_Hz:g} Hz: it must end above 0 and below {highest:g} Hz")
    omega = 2 * np.pi * np.geomspace(_LOWEST, 1.0, _POINTS) * band_Hz
    later = np.exp(-1j * omega * h)
    poles = np.exp(-h * band_Hz / np.array(_LAGS))
    columns = np.stack([later - 1.0, *((1.0 - p) / (1.0 - p * later) - 1.0 for p in poles)], axis=1)
    relative = (linear.response(omega) / linear.static_gain)[:, None]
    weights = _ridge(columns * relative, 1.0 - relative[:, 0])
    error = float(np.abs((1.0 + columns @ weights) * relative[:, 0] - 1.0).max())
    before, *lags = weights
    # States: the previous reference, and the lags x(k+1) = p x(k) + (1 - p) r(k), of which x(k+1) is the output.
    return InverseFilter(
        a=np.diag([0.0, *poles]),
        b=np.array([1.0, *(1.0 - poles)]),
        c=np.array([before, *(w * p for w, p in zip(lags, poles, strict=True))]),
        d=float(1.0 - weights.sum() + sum(w * (1.0 - p) for w, p in zip(lags, poles, strict=True))),
        band_Hz=band_Hz,
        error=error,
    )


@taking(controller=instance(InverseController), filter=instance(InverseFilter))
def with_dynamics(controller: InverseController, filter: InverseFilter) -> InverseController:
    """Return an inverse controller whose feedforward of the reference passes through a filter.

    Parameters
    ----------
    controller : InverseController
        Controller whose feedforward is the unfiltered reference, as from `with_inverse`.
    filter : InverseFilter
        Inverse filter of the model on which the controller was designed.

    Returns
    -------
    InverseController
        Controller with the same feedback loop as `controller`, and therefore with the same margins.
    """
    inner = controller.feedback
    law = filter.before(inner.law.feedforward(-1.0))
    windup = np.concatenate([inner.windup, np.zeros(filter.c.size)])
    return replace(controller, name=f"{controller.name} with dynamics", feedback=replace(inner, law=law, windup=windup))


def _ridge(matrix: Complex, target: Complex) -> Array:
    """Solve complex equations for real unknowns by least squares with a small ridge penalty."""
    rows = np.vstack([matrix.real, matrix.imag])
    sizes = np.diag(_RIDGE * np.linalg.norm(rows, axis=0))
    wanted = np.concatenate([target.real, target.imag, np.zeros(rows.shape[1])])
    return np.asarray(np.linalg.lstsq(np.vstack([rows, sizes]), wanted, rcond=None)[0])

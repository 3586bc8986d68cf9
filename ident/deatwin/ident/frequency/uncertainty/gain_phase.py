"""Gain and phase of an uncertain complex number: the law of propagation, how far it holds, and regions.

The number is normal in the plane, or bivariate Student-t. Sources: Ridler, Salter, Metrologia 39 (2002) 295-302,
doi:10.1088/0026-1394/39/3/6; Hall, Metrologia 41 (2004) 173-177, doi:10.1088/0026-1394/41/3/010.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability
from deatwin.ident.narx.posterior import quantile
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Frozen

_DEGENERATE = 1e-13  # share of the larger variance below which an ellipse is a line, up to rounding
_NOTHING = 1e-24  # share of the largest variance over frequency below which the response is zero, up to rounding
_BESIDE = 1e-6  # share of a value beyond which its distance from a line is no rounding, which is the root of the first


@dataclass(frozen=True, kw_only=True, eq=False)
class Ellipses(Frozen):
    """Principal axes of covariances; axes that consist only of rounding errors are set to 0."""

    variances: Array
    axes: Array  # shape (n, 2, 2): Principal axes, in columns

    @classmethod
    def of(cls, covariance: Array) -> Ellipses:
        """Return the ellipses of covariances. Shapes: `covariance` (n, 2, 2)."""
        variances, axes = np.linalg.eigh(covariance)
        least = np.maximum(_DEGENERATE * variances[:, -1:], _NOTHING * np.max(variances, initial=0.0))
        return cls(variances=np.where(variances > least, variances, 0.0), axes=axes)

    @property
    def rank(self) -> NDArray[np.int64]:
        """Number of axes that are not 0, shape (n,)."""
        return np.asarray(np.sum(self.variances > 0, axis=-1), dtype=np.int64)

    @property
    def roots(self) -> Array:
        """Return matrices R with R R' equal to the covariances, shape (n, 2, 2)."""
        return np.asarray(self.axes * np.sqrt(self.variances)[:, None, :])

    def squared_distance(self, away: Complex) -> Array:
        """Return squared Mahalanobis distances (..., n); deviations along an axis of length 0 are ignored."""
        weights = np.divide(1.0, self.variances, out=np.zeros_like(self.variances), where=self.variances > 0)
        along = (away.real * self.axes[:, 0, i] + away.imag * self.axes[:, 1, i] for i in (0, 1))
        return sum((weights[:, i] * part**2 for i, part in enumerate(along)), start=np.zeros(away.shape))

    def beside_zero(self, values: Complex) -> NDArray[np.bool_]:
        """Return whether 0 lies beside the line on which ellipses of length 0 across it lie. Shapes: `values` (n,)."""
        across = values.real * self.axes[:, 0, 0] + values.imag * self.axes[:, 1, 0]
        return np.asarray((self.rank == 1) & (np.abs(across) > _BESIDE * np.abs(values)), dtype=np.bool_)


@dataclass(frozen=True, kw_only=True, eq=False)
class Polar(Frozen):
    """Gain and phase with variances by linear propagation."""

    covariance: Array  # shape (n, 2, 2): Of gain, in the values' unit, and phase, rad; infinite where the gain is 0
    gain_bend: Array
    phase_bend: Array
    relative_deviation: Array  # shape (n,): Standard deviation along the ellipse's longer axis, divided by the gain

    @property
    def gain_index(self) -> Array:
        """Nonlinearity of the gain, shape (n,): the larger of its curvature and its relative deviation."""
        return np.maximum(self.gain_bend, self.relative_deviation)

    @property
    def phase_index(self) -> Array:
        """Nonlinearity of the phase, shape (n,): the larger of its curvature and the relative deviation."""
        return np.maximum(self.phase_bend, self.relative_deviation)


def polar(values: Complex, covariance: Array) -> Polar:
    """Propagate the covariance (n, 2, 2) of real and imaginary part to gain and phase; `values` (n,)."""
    # With r along the value and t across it, gain = g + r + t²/(2g) and phase = t/g - rt/g² to second order.
    gain = np.abs(values)
    direction = np.divide(values, gain, out=np.ones_like(values), where=gain > 0)
    turn = np.stack([direction.real, direction.imag, -direction.imag, direction.real], axis=-1).reshape(-1, 2, 2)
    ellipses = Ellipses.of(covariance)
    roots = turn @ ellipses.roots
    along = roots @ roots.swapaxes(1, 2)
    radial, across, both = along[:, 0, 0], along[:, 1, 1], along[:, 0, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.stack([np.ones_like(gain), 1.0 / gain], axis=-1)
        gain_bend = np.sqrt(3.0) * across / (2.0 * gain * np.sqrt(radial))
        phase_bend = np.sqrt(radial * across + 2.0 * both**2) / (gain * np.sqrt(across))
        turned = along * scale[:, :, None] * scale[:, None, :]
        relative = np.sqrt(ellipses.variances.max(axis=-1)) / gain
    # If the response does not vary across the value, gain and phase are linear, whatever the gain.
    return Polar(
        covariance=turned,
        gain_bend=np.where(across > 0, gain_bend, 0.0),
        phase_bend=np.where(across > 0, phase_bend, 0.0),
        relative_deviation=np.where(ellipses.rank > 0, relative, 0.0),
    )


def interval_radius(level: float, dof: float) -> float:
    """Return the half width of the central interval of a real normal or Student-t number, in standard deviations."""
    shrink = 1.0 if math.isinf(dof) else math.sqrt((dof - 2) / dof)
    return quantile(probability(level), dof) * shrink


def region_radius(level: float, dof: float, rank: NDArray[np.int64]) -> Array:
    """Mahalanobis radius of the region of a probability, (n,). Shapes: `rank` (n,)."""
    # In two dimensions the squared radius is -2 ln(1 - level) for a normal law, and (dof - 2)((1 - level)^(-2/dof) - 1)
    # for Student's t; with rank 1 the region is a segment.
    line, outside = interval_radius(level, dof), math.log1p(-level)
    squared = -2.0 * outside if math.isinf(dof) else (dof - 2.0) * math.expm1(-2.0 / dof * outside)
    return np.where(rank == 1, line, math.sqrt(squared))

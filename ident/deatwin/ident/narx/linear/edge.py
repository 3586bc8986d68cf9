"""Signs that a plant outside of the unit circle, or a loop, was fitted by a model that must be stable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.linear.polynomials import Orders
from deatwin.ident.narx.linear.start import Record
from deatwin.ident.narx.long_arx import answer_chance, enough_lags

__all__ = ["judged"]

Array = NDArray[np.float64]

_LAGS = 30
"""Lags of the inputs whose own past is taken out before the output's is asked."""
_LOOP = 1e-3
"""Chance of suspecting a loop where there is none: one test for each fit and input."""
_DETERMINED = 0.1
"""Two standard deviations of a pole's magnitude above which the data do not determine it: with one coefficient too
many a pole and a zero cancel anywhere in the unit disc, which says nothing of its edge."""


def judged(orders: Orders, theta: Array, theta_cov: Array, records: Sequence[Record]) -> FitStatus:
    """Return what a completed fit of F says: done, at the edge of stability, or of data from a loop.

    Parameters
    ----------
    orders : Orders
        Which coefficients are free.
    theta, theta_cov : ndarray, shapes (n_theta,) and (n_theta, n_theta)
        Parameters and their covariance.
    records : sequence of (ndarray, ndarray)
        Inputs, (n_inputs, n), and output, (n,).
    """
    longest = max(output.size for _, output in records)
    if _largest_pole(orders, theta, theta_cov) > 1.0 - 1.0 / longest:  # does not decay within the recording
        return FitStatus.EDGE_OF_STABILITY
    n_inputs = len(orders.nb)
    lags = enough_lags(records, n_inputs, _LAGS)
    if orders.nd + orders.nc == 0 and lags and min(answer_chance(records, i, lags) for i in range(n_inputs)) < _LOOP:
        return FitStatus.LOOP_SUSPECTED
    return FitStatus.DONE


def _largest_pole(orders: Orders, theta: Array, theta_cov: Array) -> float:
    """The largest magnitude that a root of an F has, or has within two standard deviations."""
    ends = np.cumsum(orders.sizes)
    largest, m = 0.0, len(orders.nb)
    for i, nf in enumerate(orders.nf):
        part = slice(ends[m + i], ends[m + i + 1])
        f = np.r_[1.0, theta[part]]
        slope = np.polyder(f)
        for root in np.roots(f):
            size, steep = abs(root), np.polyval(slope, root)
            largest = max(largest, size)
            if size == 0.0 or steep == 0.0:
                continue
            moved = (np.conj(root) / size * -(root ** np.arange(nf - 1, -1, -1)) / steep).real
            width = 2.0 * float(np.sqrt(max(moved @ theta_cov[part, part] @ moved, 0.0)))
            if width < _DETERMINED:
                largest = max(largest, size + width)
    return float(largest)

"""Detect models forced to be stable that were fitted to an unstable plant or to a closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.linear.polynomials import Orders
from deatwin.ident.narx.linear.search import Minimum, PredictionErrorLoss, minimise
from deatwin.ident.narx.linear.start import Record, starting_points
from deatwin.ident.narx.long_arx import answer_chance, enough_lags

Array = NDArray[np.float64]

_LAGS = 30  # Lags of the inputs that explain an input before past outputs are tested
_LOOP = 1e-3  # Probability of suspecting a loop where there is none, for each fit and input
_DETERMINED = 0.1  # Two standard deviations of a pole's magnitude above which the data do not determine the pole


def judged(orders: Orders, found: Minimum, records: Sequence[Record]) -> FitStatus:
    """Return whether a fit of F is done, at the edge of stability, or of data from a closed loop. A pole at the edge
    may be superfluous and cancel a zero, so it counts only if the model without both is worse by Schwarz's
    criterion."""
    longest = max(output.size for _, output in records)
    limit = 1.0 - 1.0 / longest  # a pole beyond it does not decay within the recording
    smaller, less = orders, found
    while (which := _at_edge(smaller, less, limit)) is not None:
        fewer = _without_a_pole(smaller, which)
        if fewer is None:
            return FitStatus.EDGE_OF_STABILITY
        reduced, n_errors = _fitted(fewer, records)
        unknowns = 2 + len(records)  # a coefficient of B and of F, and a state at each start
        gain = n_errors * np.log(reduced.noise_variance / less.noise_variance)
        if gain > unknowns * np.log(n_errors):
            return FitStatus.EDGE_OF_STABILITY
        smaller, less = fewer, reduced
    n_inputs = len(orders.nb)
    lags = enough_lags(records, n_inputs, _LAGS)
    if orders.nd + orders.nc == 0 and lags and min(answer_chance(records, i, lags) for i in range(n_inputs)) < _LOOP:
        return FitStatus.LOOP_SUSPECTED
    return FitStatus.DONE


def _without_a_pole(orders: Orders, which: int) -> Orders | None:
    """Return orders with one pole and one zero less for an input; None if it has no zero to spare."""
    if orders.nb[which] < 2:
        return None
    nb, nf = list(orders.nb), list(orders.nf)
    nb[which], nf[which] = nb[which] - 1, nf[which] - 1
    return replace(orders, nb=tuple(nb), nf=tuple(nf))


def _fitted(orders: Orders, records: Sequence[Record]) -> tuple[Minimum, float]:
    """Return the best fit, and its equivalent number of independent errors: n divided by the sum of their correlations,
    so that a slow pole that merely follows slow noise does not count."""
    loss = PredictionErrorLoss(orders, records)
    found = [minimise(loss, start) for start in starting_points(orders, records)]
    best = min(found, key=lambda one: one.noise_variance)
    errors = loss.errors(loss.started(orders.split(best.theta)))
    n = errors.size
    width = int(np.sqrt(n))
    products = np.array([errors[lag:] @ errors[: n - lag] for lag in range(width)])
    correlations = products[1:] / max(float(products[0]), np.finfo(float).tiny)
    inflation = 1.0 + 2.0 * float((1.0 - np.arange(1, width) / width) @ correlations)
    return best, n / max(inflation, 1.0)


def _at_edge(orders: Orders, found: Minimum, limit: float) -> int | None:
    """Return the input whose F has a root within two deviations of the edge of stability; else None."""
    ends = np.cumsum(orders.sizes)
    m = len(orders.nb)
    for i, nf in enumerate(orders.nf):
        part = slice(ends[m + i], ends[m + i + 1])
        f = np.r_[1.0, found.theta[part]]
        slope = np.polyder(f)
        for root in np.roots(f):
            size, steep = abs(root), np.polyval(slope, root)
            width = 0.0
            if size > 0.0 and steep != 0.0:
                moved = (np.conj(root) / size * -(root ** np.arange(nf - 1, -1, -1)) / steep).real
                width = 2.0 * float(np.sqrt(max(moved @ found.theta_cov[part, part] @ moved, 0.0)))
            if size > limit or (width < _DETERMINED and size + width > limit):
                return i
    return None

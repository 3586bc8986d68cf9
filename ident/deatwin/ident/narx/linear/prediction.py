"""Prediction errors of a linear model and their exact gradient, by filtering.

With n = A y - sum_i w_i - offset and w_i = (B_i/F_i) u_i, e = (D/C) n (Ljung, System Identification, 2nd ed., 1999,
section 10.3). What inputs did before the record acts on w_i as a pulse train of nf_i samples at its start. Of the
noise, e is taken as zero before the first error, and D acts on measured n only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.linear.polynomials import Orders, Polynomials

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Prediction errors of one record and their gradients."""

    errors: Array  # shape (n,): One-step prediction errors from sample ``first + nd`` of the record on
    theta_gradient: Array  # shape (n_theta, n): Derivative of the errors with respect to the parameters
    start_gradient: Array  # shape (sum of nf, n): Derivative of the errors with respect to the state at the start


def prediction_errors(
    orders: Orders, polynomials: Polynomials, inputs: Array, output: Array, start: Array
) -> PredictionErrors:
    """Prediction errors of a record and their gradient. Shapes: `inputs` (n_inputs, n); `output` (n,)."""
    p, nd = polynomials, orders.nd

    def whitened(rows: Array) -> Array:
        n = rows.shape[-1]
        moved = (p.d[k] * rows[..., nd - k : n - k] for k in range(nd + 1))
        return recursed(p.c, np.asarray(sum(moved)))

    past = lagged(output, range(orders.na + 1), orders.first)
    noise = p.a @ past - p.offset
    taps, pulses = [], []
    by_f: list[Array] = []
    for i, (u, f, pulse) in enumerate(zip(inputs, p.f, np.split(start, np.cumsum(orders.nf)[:-1]), strict=True)):
        delay, nb, nf = orders.nk[i], orders.nb[i], orders.nf[i]
        rows = lagged(u, range(delay, delay + nb), orders.first)
        drive = p.b[i][delay:] @ rows
        drive[:nf] += pulse
        w = recursed(f, drive)
        noise -= w
        taps.append(-whitened(recursed(f, rows)))
        by_f.append(whitened(recursed(f, _delayed(w, range(1, nf + 1)))))
        pulses.append(-whitened(recursed(f, np.eye(nf, drive.size))))
    errors = whitened(noise)
    parts = [
        whitened(past[1:]),
        *taps,
        *by_f,
        -recursed(p.c, _delayed(errors, range(1, orders.nc + 1))),
        recursed(p.c, np.array([noise[nd - k : noise.size - k] for k in range(1, nd + 1)]).reshape(nd, errors.size)),
        *([-whitened(np.ones((1, noise.size)))] if orders.offset else []),
    ]
    return PredictionErrors(errors, np.concatenate(parts), np.concatenate(pulses))


def lagged(signal: Array, lags: Sequence[int], first: int) -> Array:
    """Return a signal (n,) at several lags from a sample on, (n_lags, n - first)."""
    n = signal.size
    return np.array([signal[first - lag : n - lag] for lag in lags]).reshape(len(lags), n - first)


def recursed(denominator: Array, rows: Array) -> Array:
    """Filter rows (..., n) by 1/denominator from rest. Shapes: `denominator` (order + 1,)."""
    from scipy.signal import lfilter

    if denominator.size == 1 or rows.size == 0:
        return rows
    return np.asarray(lfilter([1.0], denominator, rows, axis=-1), dtype=np.float64)


def _delayed(signal: Array, lags: Sequence[int]) -> Array:
    """Return a signal at several lags, zero before its start, shape (n_lags, n)."""
    rows = np.zeros((len(lags), signal.size))
    for row, lag in zip(rows, lags, strict=True):
        row[lag:] = signal[: signal.size - lag]
    return rows

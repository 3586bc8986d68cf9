"""Prediction and free run of a linear model, from an estimated initial state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.horizon import require_steps
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials, is_stable
from deatwin.ident.narx.linear.prediction import lagged, prediction_errors, recursed
from deatwin.ident.narx.response import DIVERGED
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]


def some_steps(
    orders: Orders, polynomials: Polynomials, inputs: Array, output: Array, warmup: int, steps: int
) -> tuple[Array, int, int | None]:
    """Predict from the past up to some steps before, with zero for later e (Ljung, System Identification, 1999, section
    3.2).

    Shapes: `inputs` (n_inputs, n); `output` (n,); returns (n,), measured values first; first predicted sample;
    divergence.
    """
    from scipy.signal import lfilter

    if not all(is_stable(p) for p in (polynomials.c, *polynomials.f)):
        raise ModelError("a root of C or F lies on or outside of the unit circle: the predictor is unstable")
    found = prediction_errors(orders, polynomials, inputs, output, np.zeros(sum(orders.nf)))
    early = found.start_gradient[:, :warmup].T
    start = -np.linalg.lstsq(early, found.errors[:warmup], rcond=None)[0]
    first = output.size - found.errors.size + warmup
    require_steps(steps, first, output.size)
    errors = (found.errors + start @ found.start_gradient)[warmup:]
    pulse = np.r_[1.0, np.zeros(steps - 1)]
    response = lfilter(polynomials.c, np.convolve(polynomials.a, polynomials.d), pulse)
    first += steps - 1
    outputs = output.copy()
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable A many steps ahead overflows; detected below
        outputs[first:] -= np.convolve(errors, response, mode="valid")
    bad = ~(np.abs(outputs) < measured_limit(output))
    if not bad.any():
        return outputs, first, None
    outputs[bad] = output[np.flatnonzero(bad) - steps]
    return outputs, first, int(np.argmax(bad))


def free_run(
    polynomials: Polynomials, input_lag: int, inputs: Array, output: Array, warmup: int, limit: float
) -> tuple[Array, int, int | None]:
    """Simulate the deterministic part from a state fitted to the first `warmup` outputs after `input_lag`."""
    p = polynomials
    n = output.size - input_lag
    drive = np.full(n, p.offset)
    free = [recursed(p.a, np.eye(p.a.size - 1, n))]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable run overflows; detected below
        for u, b, f in zip(inputs, p.b, p.f, strict=True):
            drive += recursed(f, b @ lagged(u, range(b.size), input_lag))
            free.append(recursed(np.convolve(p.a, f), np.eye(f.size - 1, n)))
        run = recursed(p.a, drive)
        states = np.concatenate(free)
        start = np.linalg.lstsq(states[:, :warmup].T, (output[input_lag:] - run)[:warmup], rcond=None)[0]
        run = run + start @ states
    first = input_lag + warmup
    outputs = output.copy()
    outputs[first:] = run[warmup:]
    bad = ~(np.abs(outputs) < limit)
    if not bad.any():
        return outputs, first, None
    failed = int(np.argmax(bad))
    outputs[failed:] = outputs[failed - 1]
    return outputs, first, failed


def measured_limit(output: Array) -> float:
    """Return the magnitude beyond which an output has diverged, in its unit. Shapes: `output` (n,)."""
    return DIVERGED * max(float(np.abs(output).max()), np.finfo(float).tiny)

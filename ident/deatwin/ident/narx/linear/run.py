"""Prediction and free run of a linear model, each with the state that a record starts with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.horizon import require_steps
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials, is_stable
from deatwin.ident.narx.linear.prediction import lagged, prediction_errors, recursed
from deatwin.ident.narx.response import DIVERGED
from deatwin.plant.errors import ModelError

__all__ = ["free_run", "some_steps"]

Array = NDArray[np.float64]


def some_steps(
    orders: Orders, polynomials: Polynomials, inputs: Array, output: Array, warmup: int, steps: int
) -> tuple[Array, int, int | None]:
    """Predict each sample from the past that was measured until some steps before it.

    The output is what past and inputs give plus C/(A D) e; the errors e of the last ``steps`` samples are unknown and
    have the mean zero (Ljung, System Identification, 2nd ed., 1999, section 3.2).

    Parameters
    ----------
    orders : Orders
        Of the polynomials.
    polynomials : Polynomials
        C and F stable.
    inputs : ndarray, shape (n_inputs, n)
        Inputs.
    output : ndarray, shape (n,)
        Output.
    warmup : int
        Number of errors that set the state of the F.
    steps : int
        Number of samples ahead, at least 1.

    Returns
    -------
    outputs : ndarray, shape (n,)
        Predictions, after measured samples.
    first : int
        The first predicted sample.
    failed : int or None
        The first sample of which the prediction diverged; such ones hold the last measured output before the steps.

    Raises
    ------
    ModelError
        If C or an F is unstable, or the output is too short for the steps.
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
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable A many steps ahead; found below
        outputs[first:] -= np.convolve(errors, response, mode="valid")
    bad = ~(np.abs(outputs) < _limit(output))
    if not bad.any():
        return outputs, first, None
    outputs[bad] = output[np.flatnonzero(bad) - steps]
    return outputs, first, int(np.argmax(bad))


def free_run(
    polynomials: Polynomials, input_lag: int, inputs: Array, output: Array, warmup: int
) -> tuple[Array, int, int | None]:
    """Run the deterministic part free.

    Parameters
    ----------
    polynomials : Polynomials
        Of the model.
    input_lag : int
        Largest lag of an input, the sample at which the run starts.
    inputs : ndarray, shape (n_inputs, n)
        Inputs.
    output : ndarray, shape (n,)
        Output, of which ``warmup`` samples are used.
    warmup : int
        Number of samples that set the state, at least the number of poles.

    Returns
    -------
    outputs : ndarray, shape (n,)
        The run, after measured samples; from a divergence on the last value is held.
    first : int
        The first computed sample.
    failed : int or None
        Sample of a divergence.
    """
    p = polynomials
    n = output.size - input_lag
    drive = np.full(n, p.offset)
    free = [recursed(p.a, np.eye(p.a.size - 1, n))]
    with np.errstate(over="ignore", invalid="ignore"):  # an unstable run is found below
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
    bad = ~(np.abs(outputs) < _limit(output))
    if not bad.any():
        return outputs, first, None
    failed = int(np.argmax(bad))
    outputs[failed:] = outputs[failed - 1]
    return outputs, first, failed


def _limit(output: Array) -> float:
    """Return the magnitude beyond which an output has diverged."""
    return DIVERGED * max(float(np.abs(output).max()), np.finfo(float).tiny)

"""Predict several steps ahead: a short free run from each measured sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.free_run import innovations
from deatwin.ident.narx.terms import TermTable, Variable
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]
Booleans = NDArray[np.bool_]

_BLOCK = 4096  # runs simulated at once, whose regressors stay in the processor's cache


def require_steps(steps: int, first: int, n_samples: int) -> None:
    """Raise ModelError unless a recording has room for a prediction `steps` samples ahead from sample `first` on."""
    if whole_number(steps, "steps") > n_samples - first:
        raise ModelError(f"steps = {steps}; the recording of {n_samples} samples allows at most {n_samples - first}")


def steps_ahead(
    table: TermTable,
    theta: Array,
    inputs: Array,
    outputs: Array,
    steps: int,
    limit: float,
    equations: Sequence[int] | None = None,
) -> tuple[Array, Booleans]:
    """Predict each sample from outputs up to ``steps`` samples before it and all inputs; noise after those outputs is
    zero.

    Shapes: `theta` (n_terms,); `inputs` (n_inputs, n); `outputs` (n_outputs, n); returns predictions (n_outputs, m) of
    the m = n - max_lag - steps + 1 last samples, and divergence flags (m,).
    """
    belongs = np.array([0] * len(table.terms) if equations is None else equations)
    weights = np.where(belongs == np.arange(len(outputs))[:, None], theta, 0.0)
    signals = {"u": inputs, "y": outputs}
    if table.channels("e"):
        signals["e"] = innovations(table, theta, inputs, outputs, equations)
    n = outputs.shape[1] - table.max_lag - steps + 1
    found, failed = np.empty((len(outputs), n)), np.zeros(n, dtype=np.bool_)
    for start in range(0, n, _BLOCK):
        part = slice(start, min(start + _BLOCK, n))
        found[:, part], failed[part] = _runs(table, weights, signals, steps, limit, part)
    return found, failed


def _runs(
    table: TermTable, weights: Array, signals: dict[str, Array], steps: int, limit: float, part: slice
) -> tuple[Array, Booleans]:
    """Simulate the runs whose first computed samples are ``max_lag`` + those of ``part``; return their last outputs."""
    first, last = table.max_lag + part.start, table.max_lag + part.stop
    state = signals["y"][:, max(first - 1, 0) : max(last - 1, 0)] if first else np.zeros((len(weights), last))
    lost = np.zeros(last - first, dtype=np.bool_)
    past: list[Array] = []
    for step in range(steps):

        def lagged(v: Variable, lag: int, step: int = step, past: list[Array] = past) -> Array:
            if v.kind == "u" or lag > step:
                return signals[v.kind][v.index, first + step - lag : last + step - lag]
            return past[-lag][v.index] if v.kind == "y" else np.zeros(last - first)

        with np.errstate(over="ignore", invalid="ignore"):  # detected in the next line
            values = weights @ table.over(table.of_signals(lagged), last - first)
        lost |= ~np.all(np.abs(values) < limit, axis=0)
        state = np.where(lost, state, values)
        past = [*past, state][-max(table.max_lag, 1) :]
    return state, lost

"""Find the steady state of a model under a periodic input by simulating until it repeats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.free_run import free_run
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.response import divergence_limit

Array = NDArray[np.float64]

_RUN = 4096  # least samples of one run: a call costs as much as hundreds of samples
_PATIENCE = 1_000_000  # most samples of a simulation, or 100 periods if these are longer
_SMALL = 1e-11  # relative change of the output below which a change that no longer decreases is rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyState:
    """The last period of a simulation from rest."""

    values: Array  # shape (n_samples,): Output over one period, in its unit
    settled: bool  # True if the output repeats from period to period, up to rounding
    diverged: bool  # True if the output left all bounds; the values are then its last ones


def steady_state(model: NarxModel, excitation: Array) -> SteadyState:
    """Simulate a model from rest under a period, (n_samples,) or (n_inputs, n_samples), until the output repeats."""
    lag, n = model.table.max_lag, excitation.shape[-1]
    periods = -(-_RUN // n)
    inputs = np.atleast_2d(excitation)[:, np.arange(-lag, periods * n) % n]
    outputs = np.zeros((1, lag + periods * n))
    limit = divergence_limit(model.operating, outputs)
    last, fell = np.zeros(n), np.inf
    for _ in range(max(_PATIENCE // (periods * n), 100 // periods) + 1):
        run, failed = free_run(model.table, model.theta, inputs, outputs, limit)
        values = run[0, -n:]
        if failed is not None:
            return SteadyState(values=values, settled=False, diverged=True)
        before = run[0, -2 * n : -n] if periods > 1 else last
        change, size = float(np.abs(values - before).max()), float(np.abs(values).max())
        if change == 0.0 or fell <= change <= _SMALL * size:
            return SteadyState(values=values, settled=True, diverged=False)
        last, fell = values, change
        outputs = np.zeros_like(outputs)
        outputs[0, :lag] = run[0, run.shape[1] - lag :]
    return SteadyState(values=last, settled=False, diverged=False)

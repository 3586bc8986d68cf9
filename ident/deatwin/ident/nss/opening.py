"""Find the initial state of a run that makes its first readings most likely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.ident.nss.march import System
from deatwin.plant.arrays import Array

_STEPS = 50  # Most Gauss-Newton steps; few samples need few
_WIDTH = 3.0  # Prior deviation of a first state: its rms value is about one in training, and a record may begin outside
_EXACT = 1e-6  # Noise, in scaled outputs, below which readings are exact, so that rounding competes with no prior


@dataclass(frozen=True, kw_only=True, eq=False)
class Opening:
    """Initial state with its covariance for known weights, and its derivative by these."""

    state: Array  # shape (n_states,)
    covariance: Array  # shape (n_states, n_states)
    by_theta: Array  # shape (n_states, n_theta)

    @classmethod
    def known(cls, state: Array, n_theta: int) -> Opening:
        """Return a state that is exact."""
        return cls(state=state, covariance=np.zeros((state.size, state.size)), by_theta=np.zeros((state.size, n_theta)))


def opened(system: System, inputs: Array, outputs: Array, noise: Array) -> Opening:
    """Fit the first state. Shapes: `inputs` (n_inputs, n); `outputs` (n_outputs, n); `noise` (n_outputs,) deviations."""
    n, sigma = system.basis.states, np.maximum(noise, _EXACT)
    state = np.zeros(n)

    def errors(at: Array) -> Array:
        found, _, reached = system.run(inputs, at)
        if reached < inputs.shape[1] or not np.all(np.isfinite(found)):
            return np.full(outputs.size + n, np.inf)
        return np.concatenate([((outputs.T - found) / sigma).ravel(), -at / _WIDTH])

    def slopes(at: Array) -> Array:
        gradient = system.sensitivities(inputs, at)[1]
        return np.asarray((gradient / sigma[:, None]).reshape(outputs.size, -1))

    left, count = errors(state), system.theta.size
    for _ in range(_STEPS):
        if not np.all(np.isfinite(left)):
            break
        rows = np.concatenate([slopes(state)[:, count:], np.eye(n) / _WIDTH])
        step = np.linalg.lstsq(rows, left, rcond=None)[0]
        for _ in range(30):
            ahead = errors(state + step)
            if ahead @ ahead < left @ left:
                break
            step = step / 2.0
        else:
            break
        fall = left @ left - ahead @ ahead
        state, left = state + step, ahead
        if fall <= 1e-12 * (left @ left):
            break
    if not np.all(np.isfinite(left)):
        return Opening.known(state, count)
    found = slopes(state)
    information = found[:, count:].T @ found[:, count:] + np.eye(n) / _WIDTH**2
    inverse = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return Opening(state=state, covariance=inverse, by_theta=-inverse @ found[:, count:].T @ found[:, :count])

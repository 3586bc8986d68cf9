"""A march through many samples, piece by piece; a sample that is not solved in one step is taken in shorter ones."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from deatwin.plant.integrator.march import March
from deatwin.plant.sample import SHORTER_STEPS, solved

CHUNK = 200
"""Samples in one call of compiled code."""


def repeated(step: ca.Function, name: str, n_states: int) -> ca.Function:
    """A step repeated over a piece, as `marched` takes it."""
    states = list(range(n_states))
    return step.mapaccum(name, CHUNK, states, states)


def marched(
    march: March, n_states: int, inputs: np.ndarray, start: float, sample_time: float
) -> Iterator[list[np.ndarray]]:
    """Results of a march, for some samples at a time; ends early where one is not solved. Shapes: `inputs` (n_u, n)."""
    u, t, h = march.arguments[-5:-2]
    begin, n = 0, inputs.shape[1]
    while begin < n:
        count = min(CHUNK, n - begin)
        # The last piece is filled up with its last sample.
        u[:count], u[count:] = inputs[:, begin : begin + count].T, inputs[:, begin + count - 1]
        h[:], t[:, 0] = sample_time, start + sample_time * np.arange(begin, begin + CHUNK)
        results = march.advance()
        good = solved(results[-1], results[n_states], count)
        if good:
            yield _kept(march, results, n_states, 0, good)
        begin += good
        if good < count:
            u[:], time = inputs[:, begin], start + sample_time * begin
            for shorter in SHORTER_STEPS:
                h[:], t[:, 0] = sample_time / shorter, time + sample_time / shorter * np.arange(CHUNK)
                results = march.advance()
                if solved(results[-1], results[n_states], shorter) == shorter:
                    yield _kept(march, results, n_states, shorter - 1, shorter)
                    break
            else:
                return
            begin += 1


def _kept(march: March, results: list[np.ndarray], n_states: int, first: int, last: int) -> list[np.ndarray]:
    """Results of some samples, without the error; the states after the last of them are the march's next."""
    for argument, result in zip(march.arguments[:n_states], results[:n_states], strict=True):
        width = argument.shape[0]
        argument[:] = result[(last - 1) * width : last * width]
    widths = [result.shape[0] // CHUNK for result in results[:-1]]
    return [r[first * k : last * k].copy() for r, k in zip(results[:-1], widths, strict=True)]

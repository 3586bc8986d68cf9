"""A march through many samples, in arrays that CasADi reads and writes in place; a hard sample is taken in shorter
steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.integrator.newton import SETTLED
from deatwin.plant.sample import SHORTER_STEPS, solved

CHUNK = 200  # Number of samples in one call of compiled code


class March:
    """Arguments and results of a function as arrays, because converting each call takes longer than a step."""

    def __init__(self, function: ca.Function) -> None:
        self._arguments = [_array(function.size_in(i)) for i in range(function.n_in())]
        self._results = [_array(function.size_out(i)) for i in range(function.n_out())]
        # The buffer owns the memory that the call uses, so it must live as long.
        buffer: Any
        buffer, self._call = function.buffer()
        self._buffer = buffer
        for number, array in enumerate(self._arguments):
            if array.size:
                buffer.set_arg(number, memoryview(array))  # type: ignore[arg-type]
        for number, array in enumerate(self._results):
            if array.size:
                buffer.set_res(number, memoryview(array))  # type: ignore[arg-type]

    @property
    def arguments(self) -> list[np.ndarray]:
        """Arguments to fill, each matrix transposed: shape (columns, rows)."""
        return self._arguments

    def advance(self) -> list[np.ndarray]:
        """Call the function."""
        self._call()
        return self._results


def _array(size: tuple[int, int]) -> np.ndarray:
    return np.zeros((size[1], size[0]))


def repeated(step: ca.Function, name: str, n_states: int) -> ca.Function:
    """Repeat a step over a piece of a record, for `marched`."""
    states = list(range(n_states))
    return _until_lost(step).mapaccum(name, CHUNK, states, states)


def _until_lost(step: ca.Function) -> ca.Function:
    """Return a step that is skipped after an unsolved one, whose states are NaN."""
    arguments = step.mx_in()
    after, *others, error = step.call(arguments)
    found = [after + ca.if_else(error <= SETTLED, 0.0, np.nan), *others, error]
    tried = ca.Function(f"{step.name()}_tried", arguments, found)
    lost = [ca.MX(ca.DM.nan(step.size_out(i))) for i in range(step.n_out())]
    given_up = ca.Function(f"{step.name()}_given_up", arguments, lost)
    either = ca.Function.if_else(f"{step.name()}_either", tried, given_up)
    return ca.Function(
        f"{step.name()}_until_lost", arguments, either.call([ca.sum1(arguments[0]) <= np.inf, *arguments])
    )


def marched(
    march: March, n_states: int, inputs: np.ndarray, start: float, sample_time: float
) -> Iterator[list[np.ndarray]]:
    """Yield the results of some samples at a time; end at an unsolved sample. Shapes: `inputs` (n_u, n)."""
    u, t, h = march.arguments[-5:-2]
    begin, n = 0, inputs.shape[1]
    while begin < n:
        count = min(CHUNK, n - begin)
        # The last piece is padded with its last sample.
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
    """Return the results of some samples, without the error; their last states are the start of the next."""
    for argument, result in zip(march.arguments[:n_states], results[:n_states], strict=True):
        width = argument.shape[0]
        argument[:] = result[(last - 1) * width : last * width]
    widths = [result.shape[0] // CHUNK for result in results[:-1]]
    return [r[first * k : last * k].copy() for r, k in zip(results[:-1], widths, strict=True)]

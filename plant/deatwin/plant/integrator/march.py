"""A function of one sample repeated over many, with its numbers in arrays that CasADi reads and writes in place."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


class March:
    """Arguments and results of a function as arrays; each call works on what they hold."""

    def __init__(self, function: ca.Function) -> None:
        self._arguments = [_array(function.size_in(i)) for i in range(function.n_in())]
        self._results = [_array(function.size_out(i)) for i in range(function.n_out())]
        # The buffer owns the memory that the call works with: it must live as long.
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
        """Arguments to fill: each matrix transposed, so of shape (columns, rows)."""
        return self._arguments

    def advance(self) -> list[np.ndarray]:
        """Call the function."""
        self._call()
        return self._results


def _array(size: tuple[int, int]) -> np.ndarray:
    return np.zeros((size[1], size[0]))

"""Long records, thinned to what a picture can show."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def envelope(timepts: Array, values: Array, columns: int = 500) -> tuple[Array, Array]:
    """The samples that a picture of so many columns can show: lowest and highest of each column. Shapes: `timepts,
    values` (n,).
    """
    n = values.size
    if n <= 2 * columns:
        return timepts, values
    size = -(-n // columns)
    padded = np.concatenate([values, np.full(-n % size, values[-1])]).reshape(-1, size)
    first = size * np.arange(padded.shape[0])
    kept = np.unique(np.minimum(np.concatenate([first + padded.argmin(axis=1), first + padded.argmax(axis=1)]), n - 1))
    return timepts[kept], values[kept]

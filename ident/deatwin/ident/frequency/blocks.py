"""Split frequencies into blocks, to limit memory. On a grid, each combination of tones is computed only once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.parts import Tones

Array = NDArray[np.float64]


def blocks_of(
    angles: Array, size: int, rows: Sequence[int] = ()
) -> tuple[tuple[int, ...], Iterator[tuple[tuple[slice, ...], Tones]]]:
    """Cut frequencies into blocks. Shapes: `angles` (n, order); `rows` (order,) of the inputs."""
    axes = _axes(angles)
    if axes is None:
        lines = ((part,) for part in _cut(len(angles), size))
        return (len(angles),), ((block, Tones(angles[block], rows)) for block in lines)
    shape = tuple(axis.size for axis in axes)
    lengths = list(shape)
    while prod(lengths) > size:  # halving the longest side keeps blocks nearly cubic, with small faces
        longest = int(np.argmax(lengths))
        lengths[longest] = -(-lengths[longest] // 2)
    boxes = product(*(_cut(n, length) for n, length in zip(shape, lengths, strict=True)))
    return shape, (
        (box, Tones.on_grid([axis[cut] for axis, cut in zip(axes, box, strict=True)], rows)) for box in boxes
    )


def _cut(count: int, length: int) -> list[slice]:
    return [slice(first, first + length) for first in range(0, count, length)]


def _axes(angles: Array) -> list[Array] | None:
    """Return the frequencies of each tone if the points are all their combinations, the last one varying fastest."""
    lengths, stride = [], len(angles)
    for column in angles.T:
        changed = column != column[0]
        step = int(np.argmax(changed)) if changed.any() else stride
        if step > stride or stride % step:
            return None
        lengths.append(stride // step)
        stride = step
    if stride != 1:
        return None
    axes = []
    grid = angles.reshape(*lengths, angles.shape[1])
    for tone in range(angles.shape[1]):
        along = np.moveaxis(grid[..., tone], tone, -1)
        axes.append(along[(0,) * (len(lengths) - 1)])
        if np.any(along != axes[-1]):
            return None
    return axes

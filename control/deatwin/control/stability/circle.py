"""Find crossings of the real axis and the unit circle and the points nearest to -1, on a grid and then refined.

With L = N/D, A = D + N and B = D - N: Re(A B*) = |D|² - |N|² is zero where |L| is one, Im(A B*) = 2 Im(N D*) where L is
real, |1 + L|² = |A|²/|D|² and |1 + L|²/|1 - L|² = |A|²/|B|². These polynomials are smooth however sharp the resonances
are, but the grid may miss crossings between two sharp resonances that lie closer together than a few of its points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.control.stability.polynomials import jet
from deatwin.plant.arrays import Array

Index = NDArray[np.intp]
Cells = tuple[Index, Index]
Measure = Callable[[Array, Array, Array], tuple[Array, Array, Array]]

_LOWEST = 1e-6  # Least distance of a crossing from 0 and from half the sampling rate, rad per sample
_PER_DECADE = 16  # Number of points per decade in the logarithmic part of the grid, which serves slow loops
_PER_DEGREE = 32  # Number of points per coefficient of the polynomials in the linear part of the grid
_BLOCK = 1 << 16  # Number of values in a block of loops, which then stays in the processor's cache
_MOST = 1 << 17  # Largest number of loops that are searched at once
_STEPS = 80  # Largest number of steps of a refinement; bisection alone needs 60
_ROUNDING = 4 * np.finfo(float).eps
_FLAT = 1e-15  # Relative decrease of a minimum below which no further step is taken
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, kw_only=True, eq=False)
class Places:
    """Points on the unit circle, each with the number of its loop."""

    loops: Index  # shape (n_places,): Number of the loop
    angle: Array  # shape (n_places,): Angle, rad per sample, between 0 and pi

    def __add__(self, other: Places) -> Places:
        return Places(loops=np.concatenate([self.loops, other.loops]), angle=np.concatenate([self.angle, other.angle]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearest:
    """Smallest distance of each loop from -1, and where it occurs."""

    distance: Array  # shape (n,): Distance, dimensionless
    angle: Array  # shape (n,): Angle at which it occurs, rad per sample


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """Crossings and nearest points, from which margins are computed."""

    gain: Places  # Frequencies with |L| = 1
    real: Places  # Frequencies with Im L = 0, without z = 1 and z = -1
    modulus: Nearest  # |1 + L|
    disk: Nearest  # |1 + L|/|1 - L|


def search(top: Array, bottom: Array) -> Search:
    """Search the upper half of the unit circle. Shapes: `top, bottom` (n, m)."""
    parts = [_search(top[i : i + _MOST], bottom[i : i + _MOST]) for i in range(0, max(len(top), 1), _MOST)]
    starts = range(0, max(len(top), 1), _MOST)

    def places(name: str) -> Places:
        found = [(getattr(part, name), start) for part, start in zip(parts, starts, strict=True)]
        return Places(
            loops=np.concatenate([p.loops + start for p, start in found]),
            angle=np.concatenate([p.angle for p, _ in found]),
        )

    def nearest(name: str) -> Nearest:
        found = [getattr(part, name) for part in parts]
        return Nearest(
            distance=np.concatenate([f.distance for f in found]), angle=np.concatenate([f.angle for f in found])
        )

    return Search(gain=places("gain"), real=places("real"), modulus=nearest("modulus"), disk=nearest("disk"))


def _search(top: Array, bottom: Array) -> Search:
    grid = _grid(top.shape[1])
    cells = _scan(grid, bottom + top, bottom - top)
    above, below = np.ascontiguousarray(top.T), np.ascontiguousarray(bottom.T)
    plus, minus, ones = below + above, below - above, np.ones((1, len(top)))
    deep = _descend(plus, ones, _at(grid, cells["deep"]), _width(grid, cells["deep"]))[0]

    def nearest(name: str, under: Array) -> Nearest:
        """Return the refined minima of the grid, and of |A|, because a sharp minimum may lie between grid points."""
        starts = _at(grid, cells[name]) + deep
        width = np.concatenate([_width(grid, cells[name]), _width(grid, cells["deep"])])
        found, squares = _descend(plus, under, starts, width)
        order = np.lexsort((squares, found.loops))
        loops, first = np.unique(found.loops[order], return_index=True)
        distance, angle = np.full(len(top), np.inf), np.zeros(len(top))
        distance[loops] = np.sqrt(squares[order][first])
        angle[loops] = found.angle[order][first]
        return Nearest(distance=distance, angle=angle)

    def crossings(name: str, measure: Measure) -> Places:
        return _crossings(above, below, grid, cells[name], cells[f"{name} dips"], measure)

    return Search(
        gain=crossings("gain", _level),
        real=crossings("real", _height),
        modulus=nearest("modulus", below),
        disk=nearest("disk", minus),
    )


def _grid(size: int) -> Array:
    decades = np.log10(np.pi / _LOWEST)
    slow = np.geomspace(_LOWEST, np.pi, int(_PER_DECADE * decades))[:-1]
    even = np.linspace(0.0, np.pi, _PER_DEGREE * max(size, 4) + 1)[:-1]
    return np.concatenate([np.union1d(slow, even), [np.pi - _LOWEST, np.pi]])


def _scan(grid: Array, plus: Array, minus: Array) -> dict[str, Cells]:
    """Return the cells of the grid that contain a solution, as the loop and the grid point at or before it."""
    lags = np.arange(plus.shape[1])
    cosines, sines = np.cos(np.outer(lags, grid)), np.sin(np.outer(lags, grid))
    sines[:, -1] = 0.0
    found: dict[str, list[Cells]] = {}
    rows = max(1, _BLOCK // grid.size)
    for start in range(0, len(plus), rows):
        part = slice(start, start + rows)
        a, a_j, b, b_j = plus[part] @ cosines, plus[part] @ sines, minus[part] @ cosines, minus[part] @ sines
        level, height = a * b + a_j * b_j, a * b_j - a_j * b
        a2, b2 = a * a + a_j * a_j, b * b + b_j * b_j
        d2 = 0.25 * (a2 + b2) + 0.5 * level
        with np.errstate(over="ignore"):
            from_one, from_disk = a2 / np.maximum(d2, _TINY), a2 / np.maximum(b2, _TINY)
        cells = {
            "gain": _changes(level),
            "gain dips": _dips(level),
            "real": _changes(height[:, 1:-1], 1),
            "real dips": _dips(height),
            "modulus": _valleys(from_one),
            "disk": _valleys(from_disk),
            "deep": _inner_valleys(a2),
        }
        for name, (loops, points) in cells.items():
            found.setdefault(name, []).append((loops + start, points))
    return {name: _joined(pieces) for name, pieces in found.items()}


def _joined(pieces: list[Cells]) -> Cells:
    return np.concatenate([p[0] for p in pieces]), np.concatenate([p[1] for p in pieces])


def _changes(values: Array, first: int = 0) -> Cells:
    positive = values > 0.0
    loops, points = np.nonzero(positive[:, 1:] != positive[:, :-1])
    return loops, points + first


def _valleys(values: Array) -> Cells:
    """Return the local minima, including the ends."""
    falls = np.ones((len(values), values.shape[1] + 1), dtype=np.bool_)
    np.less(values[:, 1:], values[:, :-1], out=falls[:, 1:-1])
    falls[:, -1] = False
    loops, points = np.nonzero(falls[:, :-1] & ~falls[:, 1:])
    return loops, points


def _inner_valleys(values: Array) -> Cells:
    loops, points = _valleys(values)
    inner = (points > 0) & (points < values.shape[1] - 1)
    return loops[inner], points[inner]


def _dips(values: Array) -> Cells:
    """Return cells in which a polynomial has an extremum and may cross zero twice without a change of sign."""
    loops, points = _inner_valleys(np.abs(values))
    before, at, after = (values[loops, points + shift] for shift in (-1, 0, 1))
    same = (before * at > 0.0) & (after * at > 0.0)
    return loops[same], points[same]


def _at(grid: Array, cells: Cells) -> Places:
    return Places(loops=cells[0], angle=grid[cells[1]])


def _width(grid: Array, cells: Cells) -> Array:
    """Return the largest distance of a refined point from its grid point, rad per sample."""
    gaps = np.diff(grid)
    return np.maximum(gaps[np.maximum(cells[1] - 1, 0)], gaps[np.minimum(cells[1], gaps.size - 1)])


def _level(above: Array, below: Array, angle: Array) -> tuple[Array, Array, Array]:
    """Return |N|² - |D|² with its first two derivatives."""
    values = []
    for columns in (above, below):
        f, df, ddf = jet(columns, angle, 2)
        values.append((abs(f) ** 2, 2 * (f.conj() * df).real, 2 * (abs(df) ** 2 + (f.conj() * ddf).real)))
    (n, dn, ddn), (d, dd, ddd) = values
    return n - d, dn - dd, ddn - ddd


def _height(above: Array, below: Array, angle: Array) -> tuple[Array, Array, Array]:
    """Return Im(N D*) with its first two derivatives."""
    (n, dn, ddn), (d, dd, ddd) = jet(above, angle, 2), jet(below, angle, 2)
    first = dn * d.conj() + n * dd.conj()
    second = ddn * d.conj() + 2 * dn * dd.conj() + n * ddd.conj()
    return (n * d.conj()).imag, first.imag, second.imag


def _crossings(above: Array, below: Array, grid: Array, cells: Cells, dips: Cells, measure: Measure) -> Places:
    def slope(top: Array, bottom: Array, angle: Array) -> tuple[Array, Array, Array]:
        _, first, second = measure(top, bottom, angle)
        return first, second, second

    start, end = grid[dips[1] - 1], grid[dips[1] + 1]
    turn, kept = _roots(above[:, dips[0]], below[:, dips[0]], start, end, slope)
    loops = np.concatenate([cells[0], dips[0][kept], dips[0][kept]])
    low = np.concatenate([grid[cells[1]], start[kept], turn])
    high = np.concatenate([grid[cells[1] + 1], turn, end[kept]])
    angle, kept = _roots(above[:, loops], below[:, loops], low, high, measure)
    # A crossing within rounding of a grid point may not change the sign when it is evaluated again: it is that point.
    at_end = np.setdiff1d(np.arange(cells[0].size), kept)
    ends = [np.abs(measure(above[:, loops[at_end]], below[:, loops[at_end]], c[at_end])[0]) for c in (low, high)]
    ending = np.where(ends[0] < ends[1], low[at_end], high[at_end])
    return Places(loops=np.concatenate([loops[kept], loops[at_end]]), angle=np.concatenate([angle, ending]))


def _roots(top: Array, bottom: Array, low: Array, high: Array, measure: Measure) -> tuple[Array, Index]:
    """Find roots by Newton's method, or bisection outside the bracket; return which brackets contain a root."""
    positive = measure(top, bottom, low)[0] > 0.0
    kept = np.flatnonzero(positive != (measure(top, bottom, high)[0] > 0.0))
    low, high, positive, top, bottom = low[kept], high[kept], positive[kept], top[:, kept], bottom[:, kept]
    angle, left = 0.5 * (low + high), np.arange(kept.size)
    for _ in range(_STEPS):
        if not left.size:
            break
        here = angle[left]
        value, slope, _ = measure(top, bottom, here)
        same = (value > 0.0) == positive[left]
        low[left], high[left] = np.where(same, here, low[left]), np.where(same, high[left], here)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = here - value / slope
        middle = 0.5 * (low[left] + high[left])
        angle[left] = np.where((step >= low[left]) & (step <= high[left]), step, middle)
        unsettled = np.abs(angle[left] - here) > _ROUNDING * here
        left, top, bottom = left[unsettled], top[:, unsettled], bottom[:, unsettled]
    return angle, kept


def _descend(over: Array, under: Array, starts: Places, width: Array) -> tuple[Places, Array]:
    """Find local minima of |over/under|² by Newton's method, with shorter steps if the value does not decrease."""
    top, bottom = over[:, starts.loops], under[:, starts.loops]
    angle, left = starts.angle.copy(), np.arange(starts.loops.size)
    value, slope, bend = _square(top, bottom, angle)
    step = _newton_step(slope, bend, width)
    for _ in range(_STEPS):
        unsettled = np.abs(bend) * step**2 > _FLAT * value[left]
        left, top, bottom = left[unsettled], top[:, unsettled], bottom[:, unsettled]
        step, bend = step[unsettled], bend[unsettled]
        if not left.size:
            break
        there = np.pi - np.abs(np.pi - np.abs(angle[left] + step))  # the circle is symmetric
        found, slope, fresh = _square(top, bottom, there)
        lower = found < value[left]
        angle[left] = np.where(lower, there, angle[left])
        value[left] = np.where(lower, found, value[left])
        bend = np.where(lower, fresh, bend)
        step = np.where(lower, _newton_step(slope, fresh, width[left]), 0.25 * step)
    return Places(loops=starts.loops, angle=angle), value


def _newton_step(slope: Array, bend: Array, width: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        step = np.where(bend > 0.0, -slope / bend, -np.sign(slope) * width)
    return np.clip(step, -width, width)


def _square(top: Array, bottom: Array, angle: Array) -> tuple[Array, Array, Array]:
    """Return |top/bottom|² with two derivatives; infinite with zero slope where the denominator is zero."""
    (a, da, dda), (b, db, ddb) = jet(top, angle, 2), jet(bottom, angle, 2)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        w = a / b
        dw = (da - w * db) / b
        ddw = (dda - 2 * dw * db - w * ddb) / b
        value, slope = abs(w) ** 2, 2 * (w.conj() * dw).real
        bend = 2 * (abs(dw) ** 2 + (w.conj() * ddw).real)
    sound = np.isfinite(value) & np.isfinite(slope) & np.isfinite(bend)
    return np.where(sound, value, np.inf), np.where(sound, slope, 0.0), np.where(sound, bend, 0.0)

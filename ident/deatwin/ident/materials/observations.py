"""All samples of a set of tests as one vector, and the stresses that a material predicts for it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from deatwin.ident.materials.energies import EnergyStart
from deatwin.ident.materials.flow import STRETCHES, branch_stress, dynamic_shares
from deatwin.ident.materials.tests import MaterialTest
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.laws.energies import first_invariant

PER_DECADE = 12  # Relaxation times per decade of the table; a spline between them is exact to 1e-5
BEYOND = 3.0  # Multiple of the tests' longest time up to which a relaxation time may lie: slower branches are springs
SEGMENT, MOST = 12, 2000  # Least samples kept of each straight piece of a path, and most samples kept of all pieces
KEPT = 200  # Samples kept of a test with few pieces: more would mostly repeat each other
STRAIGHT = 0.01  # Share of a path's range by which a piece may deviate from a straight line and still count as straight
PULL = 1e-4  # Relative change of the stretch, to either side, whose difference gives the modulus at a stretch
CURVED, RATES = 0.1, 2.0
"""CURVED: deviation of a path from a pull at an even rate, as a share of its range. RATES: ratio of the rates of two
pulls. From either on, tests can separate relaxation from elasticity; at a single rate, both bend the curve."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Block(Frozen):
    """The samples of one test."""

    test: MaterialTest
    measured: Array  # (n,): stresses or moduli, Pa
    stretches: Array  # (2, m): stretches of each sample, or of the two pulls of a dma test
    times: Array | None  # (n,), s

    def elastic(self, start: EnergyStart, coordinates: Array) -> tuple[Array, Array]:
        """Return stresses of the equilibrium network and their derivatives. Shapes: returns (n,), (n, k)."""
        stress, slopes = start.stress(self.stretches, coordinates)
        if not self.test.is_dma:
            return stress, slopes
        share = np.repeat([1.0 / self._moduli, 0.0], self.measured.size // 2)
        pulled = 2.0 * PULL * float(np.asarray(self.test.stretch))
        return share * (stress[1] - stress[0]) / pulled, share[:, None] * (slopes[1] - slopes[0]) / pulled

    def branches(self, relaxation: Array) -> Array:
        """Return stresses of branches with a modulus of 1. Shapes: (m,) in s; returns (n, m)."""
        if self.test.is_dma:
            shares = dynamic_shares(np.asarray(self.test.frequencies), relaxation)
            return 3.0 / float(np.asarray(self.test.stretch)) ** 2 / self._moduli * np.vstack(shares)
        if self.times is None:
            return np.zeros((self.measured.size, relaxation.size))
        return branch_stress(self.times, self.stretches, relaxation)

    @property
    def _moduli(self) -> float:
        """Return the tensile modulus for each measured modulus; the film is incompressible."""
        return 3.0 if self.test.shear else 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """The blocks of all tests, with the table of their branches."""

    blocks: tuple[Block, ...]
    relaxation: tuple[float, float] | None  # Shortest and longest relaxation time, s; None if no test shows one

    @classmethod
    def of(cls, tests: Sequence[MaterialTest]) -> Observations:
        """Collect all tests."""
        clocks = [clock for test in tests if (clock := test.clock) is not None and shows_memory(tests)]
        span = (min(c[0] for c in clocks), max(c[1] for c in clocks) * BEYOND) if clocks else None
        return cls(blocks=tuple(map(_block, tests)), relaxation=span)

    @cached_property
    def measured(self) -> Array:
        """All samples, Pa, shape (n,)."""
        return np.concatenate([block.measured for block in self.blocks])

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Sample ranges of the blocks."""
        ends = np.cumsum([0, *(block.measured.size for block in self.blocks)])
        return tuple(slice(int(a), int(b)) for a, b in itertools.pairwise(ends))

    @cached_property
    def specimens(self) -> tuple[NDArray[np.intp], ...]:
        """Sample ranges of the specimens."""
        names = np.concatenate([np.full(b.measured.size, b.test.specimen, dtype=object) for b in self.blocks])
        return tuple(np.flatnonzero(names == name) for name in dict.fromkeys(names))

    @cached_property
    def groups(self) -> tuple[NDArray[np.intp], ...]:
        """Sample ranges with one noise level each: stresses, and moduli."""
        dynamic = np.concatenate([np.full(b.measured.size, b.test.is_dma) for b in self.blocks])
        return tuple(found for kind in (False, True) if (found := np.flatnonzero(dynamic == kind)).size)

    @cached_property
    def largest(self) -> float:
        """Largest first invariant in the tests."""
        return float(max(np.max(first_invariant(*block.stretches)) for block in self.blocks))

    @cached_property
    def grid(self) -> Array:
        """Relaxation times of the table, s, shape (g,)."""
        if self.relaxation is None:
            return np.empty(0)
        low, high = np.log10(self.relaxation)
        return np.logspace(low, high, 2 + int(PER_DECADE * (high - low)))

    @cached_property
    def table(self) -> Array:
        """Stresses of each branch of the table, shape (n, g)."""
        return np.vstack([block.branches(self.grid) for block in self.blocks])

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(np.log(self.grid), self.table, axis=1)

    def elastic(self, start: EnergyStart, coordinates: Array) -> tuple[Array, Array]:
        """Return stresses of the equilibrium network and their derivatives. Shapes: returns (n,), (n, k)."""
        parts = [block.elastic(start, coordinates) for block in self.blocks]
        return np.concatenate([part[0] for part in parts]), np.vstack([part[1] for part in parts])

    def branches(self, log_times: Array) -> tuple[Array, Array]:
        """Return stresses of branches with a modulus of 1, and their derivatives. Shapes: (m,); returns (n, m) each."""
        if not log_times.size:
            empty = np.zeros((self.measured.size, 0))
            return empty, empty
        return self._spline(log_times), self._spline(log_times, 1)


def shows_memory(tests: Sequence[MaterialTest]) -> bool:
    """Return whether the tests contain more than pulls at one constant rate."""
    rates = []
    for test in tests:
        if test.is_dma:
            return True
        if test.times is None:
            continue
        times, stretch = np.asarray(test.times), np.asarray(test.stretch)
        even = 1.0 + (stretch[-1] - 1.0) * times / times[-1]
        if np.max(np.abs(stretch - even)) > CURVED * max(float(np.ptp(stretch)), float(np.max(np.abs(stretch - 1.0)))):
            return True
        rates.append(abs(stretch[-1] - 1.0) / times[-1])
    return bool(rates) and max(rates) > RATES * min(rates)


def _block(test: MaterialTest) -> Block:
    if test.is_dma:
        stretch = float(np.asarray(test.stretch)) * np.array([1.0 - PULL, 1.0 + PULL])
        measured = np.concatenate([np.asarray(test.storage), np.asarray(test.loss)])
        return Block(test=test, measured=measured, stretches=np.vstack([stretch, stretch**-0.5]), times=None)
    stretch = np.asarray(test.stretch)
    times = None if test.times is None else np.asarray(test.times)
    kept = samples_kept(np.arange(stretch.size, dtype=float) if times is None else times, stretch)
    along = stretch[kept]
    return Block(
        test=test,
        measured=np.asarray(test.stress)[kept],
        stretches=np.vstack([along, STRETCHES[test.deformation](along)]),
        times=None if times is None else times[kept],
    )


def samples_kept(times: Array, stretch: Array) -> NDArray[np.intp]:
    """Return samples that describe a path (n,): corners, and samples at even and at growing distances."""
    if times.size <= KEPT:
        return np.arange(times.size)
    corners = _corners(times, stretch)
    count = max(KEPT // (corners.size - 1), SEGMENT)
    if count * (corners.size - 1) > MOST:
        return np.unique(np.linspace(0, times.size - 1, MOST).astype(int))
    found = [corners]
    for first, last in itertools.pairwise(corners):
        found.append(np.linspace(first, last, count // 2).astype(int))
        found.append((first + np.geomspace(1, max(last - first, 1), count // 2)).astype(int))
    return np.unique(np.concatenate(found))


def _corners(times: Array, stretch: Array) -> NDArray[np.intp]:
    """Return the ends of the straight pieces of a path (Douglas and Peucker)."""
    limit = STRAIGHT * max(float(np.ptp(stretch)), 1e-12)
    found, open_pieces = {0, times.size - 1}, [(0, times.size - 1)]
    while open_pieces and len(found) < MOST:
        first, last = open_pieces.pop()
        if last - first < 2:
            continue
        inside = slice(first + 1, last)
        share = (times[inside] - times[first]) / (times[last] - times[first])
        apart = np.abs(stretch[inside] - stretch[first] - share * (stretch[last] - stretch[first]))
        if apart.max() > limit:
            middle = first + 1 + int(np.argmax(apart))
            found.add(middle)
            open_pieces += [(first, middle), (middle, last)]
    return np.array(sorted(found))

"""Fit an energy with Maxwell branches by least squares, and find the numbers of branches that are worth trying."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import least_squares, nnls

from deatwin.ident.materials.energies import EnergyStart
from deatwin.ident.materials.noise import ROUNDING, Whitener
from deatwin.ident.materials.observations import PER_DECADE, Observations
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.laws.energies import neo_hookean
from deatwin.plant.parameters import Parameter
from deatwin.plant.prefixes import with_unit

LEAST, MOST = 1.0, 1e9  # Range of a branch's shear modulus, Pa, as in rig files
COARSE = PER_DECADE // 3  # Step through the table for a first fit: tests distinguish three relaxation times per decade
CLOSE, LONGEST = 1e-7, 100  # Change of the loss at which a fit ends, relative to it, and most evaluations of a fit
BRANCHES = 8  # Most branches: more than published spectra of elastomers have within the time range of one machine


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A parameter with its 95 % interval, SI."""

    name: str
    value: float
    low: float
    high: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.name}: {with_unit(self.value, self.unit)}, from {with_unit(self.low, self.unit)} to "
            f"{with_unit(self.high, self.unit)}"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit(Frozen):
    """The best fit of one energy with a given number of branches."""

    start: EnergyStart
    coordinates: Array  # Parameters of the energy, then logarithms of the branches' moduli, Pa, and of their times, s
    modelled: Array  # (n,): modelled stress or modulus, Pa
    slopes: Array  # (n, k): its derivatives by the coordinates
    prior: Array  # (k,): prior precision of each coordinate
    loss: float  # Sum of squares of the whitened residuals and of the prior's residuals

    @property
    def n_branches(self) -> int:
        """Number of branches."""
        return (self.coordinates.size - len(self.start.parameters)) // 2

    @property
    def elastic(self) -> Array:
        """Coordinates of the energy's parameters."""
        return self.coordinates[: len(self.start.parameters)]

    @property
    def branches(self) -> Array:
        """Moduli in Pa and times in s, shape (2, m), shortest time first."""
        found = np.exp(self.coordinates[len(self.start.parameters) :]).reshape(2, -1)
        return found[:, np.argsort(found[1])]

    def criterion(self, count: float) -> float:
        """Schwarz' criterion: minus twice the log evidence, for errors with one unknown common size."""
        return count * np.log(max(self.loss, ROUNDING * count)) + self.coordinates.size * np.log(count)


def fit(data: Observations, start: EnergyStart, elastic: Array, branches: Array, white: Whitener) -> Fit:
    """Fit from values of the energy's coordinates and of branches. Shapes: (k,), (2, m) in Pa and s."""
    count, number = len(start.parameters), branches.shape[1]
    times = data.relaxation or (1.0, 1.0)
    expected, deviations = _prior(start, number, times)

    @lru_cache(maxsize=1)  # the solver asks for the slopes right after the stress
    def at(key: bytes) -> tuple[Array, Array]:
        x = np.frombuffer(key)
        stress, slopes = data.elastic(start, x[:count])
        parts, moved = data.branches(x[count + number :])
        moduli = np.exp(x[count : count + number])
        return stress + parts @ moduli, np.hstack([slopes, parts * moduli, moved * moduli])

    def model(x: Array) -> tuple[Array, Array]:
        return at(x.tobytes())

    low, high = (
        np.concatenate([ends, np.full(number, np.log(modulus)), np.full(number, np.log(time))])
        for ends, modulus, time in zip(start.bounds, (LEAST, MOST), times, strict=True)
    )
    inside = np.minimum(1e-6 * (high - low), 1e-6)  # a start on a bound would never leave it
    x = np.clip(np.concatenate([elastic, np.log(branches).ravel()]), low + inside, high - inside)
    wanted = white(data.measured)
    found = least_squares(
        lambda x: np.concatenate([white(model(x)[0]) - wanted, (x - expected) / deviations]),
        x,
        jac=lambda x: np.vstack([white(model(x)[1]), np.diag(1.0 / deviations)]),
        bounds=(low, high),
        x_scale="jac",
        ftol=CLOSE,
        max_nfev=LONGEST,
    )
    modelled, slopes = model(found.x)
    prior = deviations**-2.0
    return Fit(
        start=start, coordinates=found.x, modelled=modelled, slopes=slopes, prior=prior, loss=2.0 * float(found.cost)
    )


def _prior(start: EnergyStart, number: int, times: tuple[float, float]) -> tuple[Array, Array]:
    """Return expected coordinates and their deviations: weak, for directions that the tests do not determine."""
    expected, deviations = start.prior
    low, high = np.log(times)
    return (
        np.concatenate([expected, np.full(number, np.log(start.stiffest)), np.full(number, (low + high) / 2)]),
        np.concatenate([deviations, np.full(number, np.log(10.0)), np.full(number, max(high - low, 1.0))]),
    )


def neo_hookean_modulus(data: Observations, white: Whitener) -> float:
    """Return the shear modulus, Pa, from which all energies start: least squares with branches of the coarse table."""
    unit = Parameter(name="mu", value=1.0, unit="Pa", lower=0.0, upper=2.0)
    stress, _ = data.elastic(EnergyStart(energy=neo_hookean, parameters=(unit,)), np.ones(1))
    columns = np.column_stack([stress, data.table[:, ::COARSE]]) if data.grid.size else stress[:, None]
    moduli, _ = nnls(white(columns), white(data.measured))
    return float(moduli[0]) or 0.01 * float(np.sum(moduli)) or 1.0


def richest(data: Observations, start: EnergyStart, white: Whitener) -> Fit:
    """Fit an energy with as many branches as the tests can distinguish in the coarse table of relaxation times."""
    elastic, branches = start.start, np.empty((2, 0))
    if not data.grid.size:
        return fit(data, start, elastic, branches, white)
    parts, times = data.table[:, ::COARSE], data.grid[::COARSE]
    for _ in range(2):  # energy and branches in turn: quick, and good enough to start the joint fit
        stress, _ = data.elastic(start, elastic)
        moduli, _ = nnls(white(parts), white(data.measured - stress))
        branches = _merged_neighbours(moduli, times)
        elastic = fit(data, start, elastic, branches, white).elastic
    while branches.shape[1] > BRANCHES:
        branches = _merged(branches)
    return fit(data, start, elastic, branches, white)


def fewer_and_fewer(data: Observations, rich: Fit, white: Whitener) -> Iterator[Fit]:
    """Yield fits with one branch less each time: the two most similar branches are merged."""
    yield rich
    found = rich
    while found.n_branches:
        less = _merged(found.branches) if found.n_branches > 1 else np.empty((2, 0))
        found = fit(data, rich.start, found.elastic, less, white)
        yield found


def _merged_neighbours(moduli: Array, times: Array) -> Array:
    """Merge neighbouring branches of the table. Shapes: (m,) both; returns (2, k)."""
    used = np.flatnonzero(moduli > 1e-6 * max(float(moduli.max(initial=0.0)), LEAST))
    if not used.size:
        return np.empty((2, 0))
    runs = np.split(used, np.flatnonzero(np.diff(used) > 1) + 1)
    return np.array([_one(np.vstack([moduli[run], times[run]])) for run in runs]).T


def _merged(branches: Array) -> Array:
    """Merge those two branches whose merger changes the fit least. Shapes: (2, m); returns (2, m - 1)."""
    moduli, apart = branches[0], np.diff(np.log(branches[1]))
    loss = apart**2 * moduli[1:] * moduli[:-1] / (moduli[1:] + moduli[:-1])
    k = int(np.argmin(loss))
    return np.column_stack([branches[:, :k], _one(branches[:, k : k + 2]), branches[:, k + 2 :]])


def _one(branches: Array) -> Array:
    """Merge branches into one with the sum of their moduli and the logarithmic mean of their times."""
    moduli, times = branches
    return np.array([moduli.sum(), np.exp(np.sum(moduli * np.log(times)) / moduli.sum())])

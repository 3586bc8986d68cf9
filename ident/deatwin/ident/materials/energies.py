"""Strain energies that may explain tests, with starting values and ranges for a fit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from deatwin.ident.materials.flow import STRETCHES, elastic_stress
from deatwin.plant.arrays import Array
from deatwin.plant.laws.energies import arruda_boyce, first_invariant, gent, mooney_rivlin, neo_hookean, ogden, yeoh
from deatwin.plant.parameters import Parameter, Scale

FURTHEST = 1e3  # Largest factor between a modulus and the neo-Hookean one, either way, that a test can show
STIFFEST_LIMIT = 1e4  # Stretch limit from which on a film is neo-Hookean to 1e-3 below a stretch of 3


@dataclass(frozen=True, kw_only=True)
class EnergyStart:
    """An energy with starting values of its parameters."""

    energy: Callable[..., Any]
    parameters: tuple[Parameter, ...]
    called: str = ""  # Name in a rig file; by default that of the law

    def __post_init__(self) -> None:
        if not self.called:
            object.__setattr__(self, "called", self.energy.__name__)

    @property
    def stiffest(self) -> float:
        """Largest modulus among the starting values, Pa; 1 if there is none."""
        return max((abs(p.value) for p in self.parameters if p.unit == "Pa"), default=1.0)

    @property
    def prior(self) -> Array:
        """Expected coordinates and their deviations, (2, k): a weak prior for what the tests leave open."""
        deviations = {Scale.LOGARITHMIC: np.log(10.0), Scale.LINEAR: 10.0 * self.stiffest}
        modulus = [deviations.get(p.scale, np.inf) if p.unit == "Pa" else np.inf for p in self.parameters]
        return np.vstack([self.start, modulus])

    def values(self, coordinates: Array) -> Array:
        """Return parameter values from coordinates. Shapes: (k,) both."""
        pairs = zip(self.parameters, coordinates, strict=True)
        return np.array([p.scale.to_value(float(c)) for p, c in pairs])

    @property
    def start(self) -> Array:
        """Coordinates of the start, shape (k,)."""
        return np.array([p.scale.to_coordinate(p.value) for p in self.parameters])

    @property
    def bounds(self) -> Array:
        """Return the ends of the coordinates' ranges, shape (2, k)."""
        ends = [[p.scale.to_coordinate(p.lower), p.scale.to_coordinate(p.upper)] for p in self.parameters]
        return np.sort(np.array(ends), axis=1).T

    def stress(self, stretches: Array, coordinates: Array) -> tuple[Array, Array]:
        """Elastic stress, Pa, and its derivatives by the coordinates. Shapes: (2, n), (k,); returns (n,), (n, k)."""
        values = self.values(coordinates)
        stress, slopes = elastic_stress(self.energy, stretches, values)
        return stress, slopes * [p.scale.slope(v) for p, v in zip(self.parameters, values, strict=True)]


def known_energies(modulus: float, largest: float) -> Iterator[EnergyStart]:
    """Return all energies of `deatwin.plant.laws` with starts, from a modulus, Pa, and the largest invariant."""

    def stiff(name: str, value: float) -> Parameter:
        low, high = modulus / FURTHEST, modulus * FURTHEST
        return Parameter(name=name, value=value, unit="Pa", lower=low, upper=high, scale=Scale.LOGARITHMIC)

    def free(name: str, value: float = 0.0, sign: int = 0) -> Parameter:
        low, high = (0.0 if sign > 0 else -modulus * FURTHEST), (0.0 if sign < 0 else modulus * FURTHEST)
        return Parameter(name=name, value=value, unit="Pa", lower=low, upper=high)

    def power(name: str, value: float) -> Parameter:
        # Below 0.5 the term can hardly be distinguished from a logarithm; above 20 it acts only in the last per cent of
        # a test.
        low, high = (0.5, 20.0) if value > 0 else (-20.0, -0.5)
        return Parameter(name=name, value=value, unit="1", lower=low, upper=high)

    def limit(name: str, value: float, least: float) -> Parameter:
        high = max(STIFFEST_LIMIT, 10 * least)
        return Parameter(name=name, value=value, unit="1", lower=least, upper=high, scale=Scale.RECIPROCAL)

    reach, chain = max(largest - 3.0, 1e-3), np.sqrt(largest / 3.0)
    yield EnergyStart(energy=neo_hookean, parameters=(stiff("shear_modulus", modulus),))
    yield EnergyStart(energy=mooney_rivlin, parameters=(stiff("C1", 0.4 * modulus), free("C2", 0.1 * modulus)))
    yield EnergyStart(energy=yeoh, parameters=(stiff("C1", 0.5 * modulus), free("C2"), free("C3")))
    for powers in ((2.0,), (2.0, -2.0), (1.3, 5.0), (1.3, 5.0, -2.0)):
        share = 2.0 * modulus / len(powers)
        terms = [
            (stiff(f"mu{k}", share / a) if a > 0 else free(f"mu{k}", share / a, sign=-1), power(f"alpha{k}", a))
            for k, a in enumerate(powers, start=1)
        ]
        yield EnergyStart(energy=ogden, parameters=tuple(p for term in terms for p in term))
    # Limits begin one per cent above the largest value in the tests, where the stress is a hundred times that without a
    # limit.
    yield EnergyStart(
        energy=gent,
        parameters=(stiff("shear_modulus", modulus), limit("stretch_limit", max(4 * reach, 10.0), 1.01 * reach)),
    )
    yield EnergyStart(
        energy=arruda_boyce,
        parameters=(stiff("shear_modulus", modulus), limit("locking_stretch", max(2.0 * chain, 3.0), 1.01 * chain)),
    )


def equibiaxial_of(largest: float) -> float:
    """Return the equibiaxial stretch, as of a film in a ring, at which the first invariant has a given value."""
    if largest <= 3.0 + 1e-9:
        return 1.0
    return float(brentq(lambda s: float(first_invariant(s, s)) - largest, 1.0, np.sqrt(largest)))


def is_stable(start: EnergyStart, coordinates: Array, largest: float) -> bool:
    """Return whether stress rises with stretch in all deformations, up to the largest first invariant of the tests."""
    for name, across in STRETCHES.items():
        top = equibiaxial_of(largest) if name == "equibiaxial" else np.sqrt(max(largest - 2.0, 1.0))
        along = np.linspace(1.0, max(top, 1.01), 60)
        stress, _ = start.stress(np.vstack([along, across(along)]), coordinates)
        if not np.all(np.diff(stress) > 0.0):
            return False
    return True

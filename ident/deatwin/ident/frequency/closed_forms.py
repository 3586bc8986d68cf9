"""Benchmark systems whose frequency responses of all orders can be written down.

With E = e^(-j(w_1 + ... + w_n)) and A(w) = 1 - a_1 e^(-jw) - a_2 e^(-2jw) at the sum of the frequencies, a power of the
input has H_n = c E/A; a power of the output averages H_n of lower orders over all ways to share the frequencies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import numpy as np

from deatwin.ident.frequency.gfrf import frequency_grid, gfrf
from deatwin.ident.narx import NarxModel
from deatwin.plant.arrays import Array, Complex

Response = Callable[[Array], Complex]
SAMPLE_TIME = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedForm:
    """A system whose frequency responses have closed forms."""

    name: str
    shown: str  # Its equation in readable form
    equation: Mapping[str, float]  # Parameter of each term
    responses: Mapping[int, Response]
    highest: int | None  # Highest order of its output; None if there is none

    @cached_property
    def model(self) -> NarxModel:
        """The system, at a sample time of 1 s."""
        return NarxModel.from_terms(self.equation, sample_time=SAMPLE_TIME)

    def errors(self) -> dict[int, float]:
        """Return the largest error of computed responses on grids, relative to the largest gain."""
        errors = {}
        for order, response in self.responses.items():
            axis = np.linspace(-3.0, 3.1, 401 if order == 1 else 11 if order < 4 else 7)
            grid = frequency_grid(*[axis] * order)
            values = gfrf(self.model, order, grid[:, 0] if order == 1 else grid).values
            expected = response(grid)
            errors[order] = float(np.abs(values - expected).max() / (np.abs(expected).max() or 1.0))
        return errors


def _turn(angles: Array, lag: int = 1) -> Complex:
    """Return E (see the module) to the power of a lag."""
    return np.asarray(np.exp(-1j * lag * angles.sum(axis=1)))


def _mean(values: Callable[[Array], Complex], angles: Array) -> Complex:
    """Average over all permutations of the frequencies."""
    every = [values(angles[:, list(order)]) for order in permutations(range(angles.shape[1]))]
    return np.asarray(np.mean(every, axis=0))


def _zero(angles: Array) -> Complex:
    return np.zeros(len(angles), dtype=np.complex128)


def _linear(angles: Array) -> Complex:
    return (_turn(angles) + 0.81 * _turn(angles, 2)) / (1 + 1.7 * _turn(angles) + 0.8 * _turn(angles, 2))


def _hammerstein(angles: Array) -> Complex:
    return 0.4 * _turn(angles) / (1 - 0.8 * _turn(angles))


def _quadratic_1(w: Array) -> Complex:
    return 0.4 * _turn(w) / (1 - 0.6 * _turn(w))


def _quadratic_2(w: Array) -> Complex:
    return 0.1 * _turn(w) / (1 - 0.6 * _turn(w)) * _quadratic_1(w[:, :1]) * _quadratic_1(w[:, 1:])


def _quadratic_3(w: Array) -> Complex:
    pairs = _mean(lambda v: 2 * _quadratic_1(v[:, :1]) * _quadratic_2(v[:, 1:]), w)
    return 0.1 * _turn(w) / (1 - 0.6 * _turn(w)) * pairs


def _quadratic_4(w: Array) -> Complex:
    def pairs(v: Array) -> Complex:
        uneven = 2 * _quadratic_1(v[:, :1]) * _quadratic_3(v[:, 1:])
        return uneven + _quadratic_2(v[:, :2]) * _quadratic_2(v[:, 2:])

    return 0.1 * _turn(w) / (1 - 0.6 * _turn(w)) * _mean(pairs, w)


def _spring(w: Array) -> Complex:
    return 1 - 1.5 * _turn(w) + 0.8 * _turn(w, 2)


def _duffing_1(w: Array) -> Complex:
    return 0.3 * _turn(w) / _spring(w)


def _duffing_3(w: Array) -> Complex:
    product = np.prod([_duffing_1(w[:, i : i + 1]) for i in range(3)], axis=0)
    return np.asarray(-0.02 * _turn(w) / _spring(w) * product)


LINEAR = ClosedForm(
    name="S1",
    shown="y = −1.7 y₁ − 0.8 y₂ + u₁ + 0.81 u₂",
    equation={"y(k-1)": -1.7, "y(k-2)": -0.8, "u(k-1)": 1.0, "u(k-2)": 0.81},
    responses={1: _linear, 2: _zero, 3: _zero},
    highest=1,
)
HAMMERSTEIN = ClosedForm(
    name="S2",
    shown="y = 0.8 y₁ + 0.4 (u₁ + u₁² + u₁³)",
    equation={"y(k-1)": 0.8, "u(k-1)": 0.4, "u(k-1)^2": 0.4, "u(k-1)^3": 0.4},
    responses={1: _hammerstein, 2: _hammerstein, 3: _hammerstein, 4: _zero},
    highest=3,
)
QUADRATIC = ClosedForm(
    name="quadratic",
    shown="y = 0.6 y₁ + 0.4 u₁ + 0.1 y₁²",
    equation={"y(k-1)": 0.6, "u(k-1)": 0.4, "y(k-1)^2": 0.1},
    responses={1: _quadratic_1, 2: _quadratic_2, 3: _quadratic_3, 4: _quadratic_4},
    highest=None,
)
DUFFING = ClosedForm(
    name="Duffing",
    shown="y = 1.5 y₁ − 0.8 y₂ + 0.3 u₁ − 0.02 y₁³",
    equation={"y(k-1)": 1.5, "y(k-2)": -0.8, "u(k-1)": 0.3, "y(k-1)^3": -0.02},
    responses={1: _duffing_1, 2: _zero, 3: _duffing_3, 4: _zero},
    highest=None,
)
SYSTEMS = (LINEAR, HAMMERSTEIN, QUADRATIC, DUFFING)
"""A linear system, one of finite order, and two of infinite order: one overdamped and one resonant."""

"""Regressors of a nonlinear state space: products of powers and functions of states, inputs and directions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from deatwin.ident.narx.shapes import SOURCES, Shape
from deatwin.plant.arrays import Array, Integers
from deatwin.plant.errors import ModelError

_HIGHEST = 1023  # Largest power; beyond it, powers of 2 overflow
_POWER = re.compile(r"([xus])(\d*)(?:\^(\d+))?")
_FUNCTION = re.compile(r"(\w+)\(([xus]\d*)((?:,[^(),]+)*)\)")


@dataclass(frozen=True)
class Factor:
    """A power or a function of one variable."""

    variable: int  # Index among states, inputs and directions, in this order
    power: int = 1
    shape: Shape | None = None

    def value(self, z: Array) -> Array:
        """Return the values of the factor for given values of its variable."""
        return z**self.power if self.shape is None else self.shape.value(z)

    def slope(self, z: Array) -> Array:
        """Return the derivative."""
        return self.power * z ** (self.power - 1) if self.shape is None else self.shape.slope(z)


Term = tuple[Factor, ...]


@dataclass(frozen=True)
class Basis:
    """All regressors: 1, the states, the inputs, then terms. A direction may use earlier ones only."""

    states: int
    inputs: int
    directions: int
    written: tuple[str, ...]  # The terms as text

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of states, inputs and directions."""
        inputs = ["u"] if self.inputs == 1 else numbered("u", self.inputs)
        return (*numbered("x", self.states), *inputs, *numbered("s", self.directions))

    @property
    def linear(self) -> int:
        """Number of regressors before the terms: 1, the states and the inputs."""
        return 1 + self.states + self.inputs

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """Factors of each regressor."""
        first = [(), *((Factor(i),) for i in range(self.states + self.inputs))]
        return (*first, *(self._parsed(text) for text in self.written))

    @property
    def size(self) -> int:
        """Number of regressors."""
        return self.linear + len(self.written)

    @property
    def labels(self) -> tuple[str, ...]:
        """Text of all regressors."""
        return ("1", *self.names[: self.states + self.inputs], *self.written)

    @cached_property
    def levels(self) -> Integers:
        """Number of the last direction in each regressor, from 1, or 0 if there is none; shape (n_regressors,)."""
        before = self.linear - 2
        found = [max([0, *(factor.variable - before for factor in term)]) for term in self.terms]
        return np.array(found, dtype=np.int64)

    def _parsed(self, text: str) -> Term:
        if not isinstance(text, str):
            raise ModelError(f"the term {text!r} must be text, such as x1^2 or |x2|")
        factors = []
        for word in text.split():
            word = re.sub(r"^\|(.*)\|$", r"abs(\1)", word)
            if found := _POWER.fullmatch(word):
                power = float(found[3] or 1)
                if not 1 <= power <= _HIGHEST:
                    raise ModelError(f"the power in {text!r} must be at least 1 and at most {_HIGHEST}")
                factors.append(Factor(self._place(found[1] + found[2], text), int(power)))
            elif found := _FUNCTION.fullmatch(word):
                numbers = [_number(part, text) for part in found[3].split(",")[1:]]
                factors.append(Factor(self._place(found[2], text), 1, Shape.of(found[1], numbers, 0)))
            else:
                raise ModelError(f"the term {text!r}: {word!r} is neither a power as x1^2 nor a function as sat(u,0.5)")
        if not factors:
            raise ModelError("a term needs a power or a function; the constant is always there")
        return tuple(factors)

    def _place(self, name: str, text: str) -> int:
        if name not in self.names:
            raise ModelError(f"the term {text!r} holds {name!r}; there are {', '.join(self.names)}")
        return self.names.index(name)

    def values(self, z: Array, directions: Array) -> Array:
        """Regressors (n_regressors, n), completing `directions` (n_directions, n_regressors); `z` (n_variables, n)."""
        rows = np.ones((self.size, z.shape[1]))
        for level in range(self.directions + 1):
            if level:
                known = self.levels < level
                z[self.linear - 2 + level] = directions[level - 1, known] @ rows[known]
            for j in np.flatnonzero(self.levels == level):
                for factor in self.terms[j]:
                    rows[j] *= factor.value(z[factor.variable])
        return rows

    def slopes(self, z: Array) -> Array:
        """Return their derivatives. Shapes: `z` (n_variables, n); returns (n, n_regressors, n_variables)."""
        found = np.zeros((z.shape[1], self.size, z.shape[0]))
        for j, term in enumerate(self.terms):
            for i, factor in enumerate(term):
                part = factor.slope(z[factor.variable])
                for other in term[:i] + term[i + 1 :]:
                    part = part * other.value(z[other.variable])
                found[:, j, factor.variable] += part
        return found

    @cached_property
    def tables(self) -> tuple[Integers, Integers, Array, Integers] | None:
        """Kernel tables: first factors; variable, power and function; numbers; levels. None for users' functions."""
        factors = [factor for term in self.terms for factor in term]
        if any(factor.shape is not None and factor.shape.name not in SOURCES for factor in factors):
            return None
        kinds = [-1 if factor.shape is None else SOURCES.index(factor.shape.name) for factor in factors]
        whole = [[factor.variable, factor.power, kind] for factor, kind in zip(factors, kinds, strict=True)]
        numbers = [(*(() if factor.shape is None else factor.shape.parameters), 0.0, 0.0)[:2] for factor in factors]
        starts = np.cumsum([0, *map(len, self.terms)]).astype(np.int64)
        return starts, np.array(whole, dtype=np.int64), np.array(numbers, dtype=np.float64), self.levels


def numbered(letter: str, count: int) -> list[str]:
    """Return names such as x1, x2."""
    return [f"{letter}{i}" for i in range(1, count + 1)]


def monomials(names: Sequence[str], degrees: Iterable[int]) -> tuple[str, ...]:
    """Return all monomials of some degrees, at least 2, as text."""
    found = []
    for degree in sorted(set(degrees)):
        for chosen in combinations_with_replacement(names, degree):
            powers = {name: chosen.count(name) for name in dict.fromkeys(chosen)}
            found.append(" ".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items()))
    return tuple(found)


def _number(text: str, term: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"the term {term!r}: {text!r} is not a number") from None

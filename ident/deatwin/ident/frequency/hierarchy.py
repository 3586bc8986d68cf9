"""The equations that a polynomial model makes for the parts of its output, each linear in its own part.

A Volterra system answers w = sum of parts with v = sum of parts: one for each order, or each combination of tones. A
product of lagged signals splits a part in all ways that the parts allow. The equation of a part, (1 - sum_l a_l q^-l)
v[s] = sum_m theta_m product_m[s], therefore holds only smaller parts on its right. On sets of frequencies, this is the
recursion of Peyton Jones and Billings (Int. J. Control 50 (1989) 1925-1940, doi:10.1080/00207178908953472).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import factorial, prod
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.terms import Term, Variable
from deatwin.plant.errors import ModelError

Array = NDArray[Any]
Feedback = Sequence[tuple[int, Array]]


class Jet(NamedTuple):
    """Values, and their derivatives by each parameter."""

    value: Array  # shape (..., n): Real or complex
    slope: Array | None


class Parts(Protocol):
    """A way to split input and output into parts, with the action of a linear filter on each part."""

    @property
    def order(self) -> Sequence[int]:
        """Return the parts, each after those that may compose it."""

    def splits(self, part: int) -> Iterable[tuple[int, int]]:
        """Return all ways to compose a part of two others."""

    def input(self, part: int, lag: int, row: int) -> Array | None:
        """Return the part of a delayed input, given its row. Shapes: returns (..., n)."""

    def delayed(self, values: Array, part: int, lag: int) -> Array:
        """Delay a part of an output. Shapes: `values` (..., n)."""

    def filtered(self, values: Array, part: int, feedback: Feedback) -> Array:
        """Solve (1 - sum_l a_l q^-l) v = values. Shapes: `values` (..., n); `feedback` (..., 1)."""


def solve_parts(terms: Sequence[Term], theta: Array, parts: Parts, *, by_theta: bool) -> dict[int, Jet]:
    """Compute the parts of a model's output. Shapes: `theta` (n_terms,)."""
    return _Solver(terms=terms, theta=np.asarray(theta)[..., None], parts=parts, by_theta=by_theta).solve()


@dataclass
class _Solver:
    terms: Sequence[Term]
    theta: Array
    parts: Parts
    by_theta: bool
    outputs: dict[int, Jet] = field(default_factory=dict)

    def solve(self) -> dict[int, Jet]:
        chains, _ = _chains(self.terms)
        linear = {m: chain.last.lag for m, chain in enumerate(chains) if chain.is_output}
        feedback = [(lag, self.theta[m]) for m, lag in linear.items()]
        others = {m: chain for m, chain in enumerate(chains) if m not in linear}
        for part in self.parts.order:
            found = {m: self.product(chain, part) for m, chain in others.items()}
            products = {m: jet for m, jet in found.items() if jet is not None}
            if products:
                value = self.parts.filtered(sum(self.theta[m] * p.value for m, p in products.items()), part, feedback)
                slope = self.slope(value, part, products, linear) if self.by_theta else None
                self.outputs[part] = Jet(value, None if slope is None else self.parts.filtered(slope, part, feedback))
        return self.outputs

    def slope(self, value: Array, part: int, products: Mapping[int, Jet], linear: Mapping[int, int]) -> Array:
        """Return the derivative of the equation by each parameter."""
        slope = np.zeros((len(self.terms), *value.shape), dtype=value.dtype)
        for m, lag in linear.items():
            slope[m] = self.parts.delayed(value, part, lag)
        for m, product in products.items():
            slope[m] += product.value
            if product.slope is not None:
                slope += self.theta[m] * product.slope
        return slope

    def product(self, chain: _Chain, part: int) -> Jet | None:
        """Return a part of a product of lagged signals."""
        if part not in chain.known:
            if chain.split is None:
                chain.known[part] = self.factor(chain.last, part)
            else:
                chain.known[part] = self.longer(*chain.split, part)
        return chain.known[part]

    def longer(self, earlier: _Chain, last: _Chain, part: int) -> Jet | None:
        """Return a part of a product, summed over all ways to split it between the last factor and the others."""
        total: Jet | None = None
        for first, second in self.parts.splits(part):
            a = self.product(earlier, first)
            b = self.product(last, second) if a is not None else None
            if a is not None and b is not None:
                total = _sum(total, _product(a, b))
        return total

    def factor(self, variable: Variable, part: int) -> Jet | None:
        if variable.kind == "u":
            driven = self.parts.input(part, variable.lag, variable.index)
            return None if driven is None else Jet(driven, None)
        jet = self.outputs.get(part)
        if jet is None:
            return None
        slope = None if jet.slope is None else self.parts.delayed(jet.slope, part, variable.lag)
        return Jet(self.parts.delayed(jet.value, part, variable.lag), slope)


def products_of(terms: Iterable[Term]) -> int:
    """Return how many products of factors are kept for each part: the products of the terms, and their sub-products."""
    return len(_chains(terms)[1])


@dataclass(eq=False)
class _Chain:
    """A product of lagged signals: its last factor, the product of the others, and the parts computed so far."""

    last: Variable
    split: tuple[_Chain, _Chain] | None
    known: dict[int, Jet | None] = field(default_factory=dict)

    @property
    def is_output(self) -> bool:
        return self.split is None and self.last.kind == "y"


def _chains(terms: Iterable[Term]) -> tuple[list[_Chain], dict[tuple[Variable, ...], _Chain]]:
    """Return the products of the terms, and all their sub-products, each once, by their factors."""
    made: dict[tuple[Variable, ...], _Chain] = {}

    def chain(factors: tuple[Variable, ...]) -> _Chain:
        if factors not in made:
            split = (chain(factors[:-1]), chain(factors[-1:])) if len(factors) > 1 else None
            made[factors] = _Chain(factors[-1], split)
        return made[factors]

    return [chain(_arranged(term)) for term in terms], made


def _arranged(term: Term) -> tuple[Variable, ...]:
    """Sort factors as the recursion needs them: outputs from last to first, then inputs from first to last."""
    outputs = [v for v in term.expanded if v.kind == "y"]
    return (*reversed(outputs), *(v for v in term.expanded if v.kind == "u"))


def _sum(a: Jet | None, b: Jet) -> Jet:
    if a is None:
        return b
    if a.slope is None or b.slope is None:
        return Jet(a.value + b.value, b.slope if a.slope is None else a.slope)
    return Jet(a.value + b.value, a.slope + b.slope)


def _product(a: Jet, b: Jet) -> Jet:
    slopes = [other.value * jet.slope for jet, other in ((a, b), (b, a)) if jet.slope is not None]
    return Jet(a.value * b.value, sum(slopes[1:], slopes[0]) if slopes else None)


_ROUNDING = 64 * np.finfo(float).eps  # relative size of what rounding leaves of a sum that is zero


class Tones:
    """Parts that are sets of tones, each a bit of the part's number. Shapes: `angles`, one for each tone; `rows` (order,)."""

    # The input is a sum of tones e^(jw_i k); the part of all n tones in the output is n! times the symmetric H_n.

    def __init__(self, angles: Sequence[Array], rows: Sequence[int] = ()) -> None:
        self.count = len(angles)
        self._rows = tuple(rows) or (0,) * self.count
        self.whole = (1 << self.count) - 1
        self._single = [np.exp(-1j * angle) for angle in angles]
        self._powers: dict[tuple[int, int], Array] = {}

    @property
    def repeats(self) -> int:
        """Number of times that H_n occurs in the component of all tones."""
        return factorial(self.count)

    @cached_property
    def order(self) -> Sequence[int]:
        """All sets, small ones first."""
        return sorted(range(1, self.whole + 1), key=lambda part: part.bit_count())

    def splits(self, part: int) -> Iterable[tuple[int, int]]:
        """Return all ways to split a set in two; either part may come first."""
        last = (part - 1) & part
        while last:
            yield part ^ last, last
            last = (last - 1) & part

    def input(self, part: int, lag: int, row: int) -> Array | None:
        """Return a delayed tone; zero for a set of several tones, which the input does not contain."""
        alone = part.bit_count() == 1 and self._rows[part.bit_length() - 1] == row
        return self._shift(part, lag) if alone else None

    def delayed(self, values: Array, part: int, lag: int) -> Array:
        """Multiply a part (..., n) by the phase factor of a delay at the sum of its tones' frequencies."""
        return values * self._shift(part, lag)

    def filtered(self, values: Array, part: int, feedback: Feedback) -> Array:
        """Divide by 1 - sum_l a_l e^(-jwl) at the sum of the set's frequencies. Shapes: `values` (..., n)."""
        return values / _denominator(feedback, self._shift(part, 1), lambda lag: self._shift(part, lag))

    def _shift(self, part: int, lag: int) -> Array:
        """Return e^(-jwl) at the sum of a set's frequencies, as a product over its tones."""
        if (part, lag) not in self._powers:
            if lag == 0:
                shift = np.ones_like(self._single[0])
            elif lag == 1:
                first = part & -part
                shift = self._single[first.bit_length() - 1]
                shift = shift if part == first else shift * self._shift(part ^ first, 1)
            else:
                shift = self._shift(part, lag // 2) * self._shift(part, lag - lag // 2)
            self._powers[part, lag] = shift
        return self._powers[part, lag]


class Orders:
    """Parts of a periodic output by order, that is, by the power of the input's size. Shapes: `excitation` (..., n)."""

    def __init__(self, excitation: Array, highest: int) -> None:
        self.excitation = np.atleast_2d(excitation)
        self.n_samples = self.excitation.shape[1]
        self.order: Sequence[int] = range(1, highest + 1)
        self._turn = np.exp(-2j * np.pi * np.arange(self.n_samples // 2 + 1) / self.n_samples)

    def splits(self, part: int) -> Iterable[tuple[int, int]]:
        """Return all pairs of orders that add up to an order."""
        return ((part - last, last) for last in range(1, part))

    def input(self, part: int, lag: int, row: int) -> Array | None:
        """Return the delayed input, which belongs to order one only."""
        return np.roll(self.excitation[row], lag) if part == 1 else None

    def delayed(self, values: Array, part: int, lag: int) -> Array:
        """Delay a part within the period. Shapes: `values` (..., n)."""
        return np.roll(values, lag, axis=-1)

    def filtered(self, values: Array, part: int, feedback: Feedback) -> Array:
        """Filter a part in the frequency domain, which is exact in the steady state. Shapes: `values` (..., n)."""
        denominator = _denominator(feedback, self._turn, lambda lag: self._turn**lag)
        return np.fft.irfft(np.fft.rfft(values) / denominator, self.n_samples)


class CrossOrders(Orders):
    """Parts of the output with given powers of each input. Shapes: `excitation` (n_inputs, n); `powers` (n_inputs,)."""

    # A part's number has one digit per input, its power. The base is so large that adding two parts never carries.

    def __init__(self, excitation: Array, powers: Sequence[int]) -> None:
        super().__init__(excitation, 1)
        self._base = 1 + max(powers)
        self._powers = {self._number(each): each for each in itertools.product(*(range(power + 1) for power in powers))}
        del self._powers[0]
        self.order = sorted(self._powers, key=lambda part: sum(self._powers[part]))
        self.whole = self._number(powers)

    def _number(self, powers: Sequence[int]) -> int:
        return sum(power * self._base**row for row, power in enumerate(powers))

    def splits(self, part: int) -> Iterable[tuple[int, int]]:
        """Return all ways to divide the powers of a part between two parts; either may come first."""
        for each in itertools.product(*(range(power + 1) for power in self._powers[part])):
            first = self._number(each)
            if first not in (0, part):
                yield first, part - first

    def input(self, part: int, lag: int, row: int) -> Array | None:
        """Return the delayed input of a row as the part with its first power."""
        return np.roll(self.excitation[row], lag) if part == self._base**row else None


def _denominator(feedback: Feedback, turn: Array, shift: Callable[[int], Array]) -> Array:
    """Return 1 - sum_l a_l e^(-jwl), which must not be zero; ``turn`` is e^(-jw) and ``shift(l)`` is e^(-jwl)."""
    denominator, size = np.ones_like(turn), np.ones(1)
    for lag, a in feedback:
        denominator = denominator - a * shift(lag)
        size = size + np.abs(a)
    poles = np.abs(denominator) <= _ROUNDING * size
    if poles.any():
        where = np.broadcast_to(turn, denominator.shape)[poles][0]
        raise ModelError(
            f"the linear part has a pole on the unit circle, at {abs(np.angle(where)) / (2 * np.pi):.6g} times the "
            "sampling rate: no response is finite where frequencies add to that; leave them out"
        )
    return denominator


def blocks_of(
    angles: Array, size: int, rows: Sequence[int] = ()
) -> tuple[tuple[int, ...], Iterator[tuple[tuple[slice, ...], Tones]]]:
    """Cut frequencies into blocks. Shapes: `angles` (n, order); `rows` (order,) of the inputs."""
    axes = _axes(angles)
    if axes is None:
        lines = ((part,) for part in _cut(len(angles), size))
        return (len(angles),), ((block, Tones(list(angles[block].T), rows)) for block in lines)
    shape = tuple(axis.size for axis in axes)
    lengths = list(shape)
    while prod(lengths) > size:  # halving the longest side keeps blocks nearly cubic, with small faces
        longest = int(np.argmax(lengths))
        lengths[longest] = -(-lengths[longest] // 2)
    boxes = itertools.product(*(_cut(n, length) for n, length in zip(shape, lengths, strict=True)))
    return shape, ((box, Tones(_sparse(axes, box), rows)) for box in boxes)


def _sparse(axes: Sequence[Array], box: Sequence[slice]) -> Sequence[Array]:
    """Return the frequencies of each tone in a box of a grid, along an axis of its own."""
    return np.meshgrid(*[axis[cut] for axis, cut in zip(axes, box, strict=True)], indexing="ij", sparse=True)


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

"""The equations that a polynomial model makes for the parts of its output, each linear in its own part.

A Volterra system answers w = sum of parts with v = sum of parts: one for each order, or each combination of tones. A
product of lagged signals splits a part in all ways that the parts allow. The equation of a part, (1 - sum_l a_l q^-l)
v[s] = sum_m theta_m product_m[s], therefore holds only smaller parts on its right. On sets of frequencies, this is the
recursion of Peyton Jones and Billings (Int. J. Control 50 (1989) 1925-1940, doi:10.1080/00207178908953472).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.terms import Term, Variable

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

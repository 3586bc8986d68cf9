"""Correction of a frozen response for parameters that change with time, to first order in their rate.

A part of the output is Y(t) e^(jwt), with an amplitude that changes (Zadeh, Proc. IRE 38 (1950) 291-299), so a delay is
q^-l Y(t) e^(jwt) = (Y(t) - l dY/dt) e^(jw(t - l)) to first order, with the rates for parameters that stand still. The
response of a linear system with A = 1 - sum_l a_l e^(-jwl) then differs by -(dH/dt) sum_l l a_l e^(-jwl) / A, its rate
times the group delay of 1/A. The equilibrium lags in the same way, and each delayed factor of a product sees its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency.dc import deviations
from deatwin.ident.frequency.hierarchy import Feedback, Jet, Parts, solve_parts
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Term, without
from deatwin.plant.arrays import Complex

Array = NDArray[Any]
Models = Sequence[NarxModel | None]  # Models of successive times; None where there is none

Reading = Callable[[Mapping[int, Jet]], Array | None]
"""Function that takes the result from the parts, shape (n_times, n); None if it is zero."""

_BLOCK = 65536  # values in a block of times, to limit memory


class MovingParts:
    """Parts whose amplitudes change along their first axis, which is time. Shapes: `rates` (n_times, n)."""

    def __init__(self, parts: Parts, rates: Mapping[int, Array]) -> None:
        self.parts, self.rates = parts, rates
        self.order, self.splits, self.input = parts.order, parts.splits, parts.input

    def delayed(self, values: Array, part: int, lag: int) -> Array:
        """Delay a part, taking its earlier amplitude into account. Shapes: `values` (n_times, n)."""
        return self.parts.delayed(values - lag * self.rates[part], part, lag)

    def filtered(self, values: Array, part: int, feedback: Feedback) -> Array:
        """Solve (1 - sum_l a_l q^-l) v = values with that delay. Shapes: `values` (n_times, n)."""
        memory = sum(lag * a * self.parts.delayed(self.rates[part], part, lag) for lag, a in feedback)
        return self.parts.filtered(values - memory, part, feedback)


def correction(
    models: Models, before: Models, after: Models, span: Array, parts: Parts, read: Reading, size: int
) -> Complex:
    """Return the first-order correction of a response for parameters that change with time, (n_times, n): the rates are
    those between the models ``before`` and ``after`` each time, ``span`` (n_times,) samples apart."""
    added = np.full((span.size, size), np.nan, dtype=np.complex128)
    step = max(_BLOCK // (3 * size), 1)
    for first in range(0, span.size, step):
        some = slice(first, first + step)
        block = _added(models[some], before[some], after[some], span[some], parts, read)
        if block is not None:
            added[some] = block
    return added


def _added(models: Models, before: Models, after: Models, span: Array, parts: Parts, read: Reading) -> Array | None:
    found = [None if model is None else deviations(model) for model in (*models, *before, *after)]
    known = [about for about in found if about is not None]
    if not known:
        return None
    terms, blank = known[0].model.terms, np.full(known[0].model.theta.size, np.nan)
    theta = np.stack([blank if about is None else about.model.theta for about in found], axis=-1)
    points = [
        (np.nan, np.nan) if about is None else (about.point.output, float(about.point.operating_input[0]))
        for about in found
    ]
    n = len(models)

    def rate(values: Array) -> Array:
        """Return difference quotients of values (3 n, m), in the order of ``found``."""
        return np.asarray((values[2 * n :] - values[n : 2 * n]) / span[:, None])

    with np.errstate(invalid="ignore", divide="ignore"):  # missing times are NaN, and so is the rate of a single time
        rates = {part: rate(jet.value) for part, jet in solve_parts(terms, theta, parts, by_theta=False).items()}
        here = theta[:, :n]
        moved = _moved(terms, here, *rate(np.array(points)).T)
        still = read(solve_parts(terms, here, parts, by_theta=False))
        true = read(solve_parts(terms, moved, MovingParts(parts, rates), by_theta=False))
    return 0.0 * here[:1].T if true is None or still is None else true - still


def _moved(terms: Sequence[Term], theta: Array, output_rate: Array, input_rate: Array) -> Array:
    """Expand about the levels that the delayed factors had while the equilibrium moved, shape (n_terms, n_times)."""
    place = {term: m for m, term in enumerate(terms)}
    linear = {term.factors[0][0]: theta[m] for term, m in place.items() if term.degree == 1}
    rates: dict[str, Array] = {"y": output_rate, "u": input_rate}
    drive = sum(variable.lag * a * rates[variable.kind] for variable, a in linear.items())
    behind = drive / (1.0 - sum(a for variable, a in linear.items() if variable.kind == "y"))
    moved = theta.copy()
    for m, term in enumerate(terms):
        for variable, power in term.factors:
            rest = without(term, variable)
            if rest in place:
                lag = variable.lag * rates[variable.kind] + (behind if variable.kind == "y" else 0.0)
                moved[place[rest]] -= power * theta[m] * lag
    return moved

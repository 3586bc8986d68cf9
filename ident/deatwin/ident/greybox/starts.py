"""Fits from several starts: what one descent says is a minimum need not be the least.

Where small errors of a parameter grow along a record, as in a pendulum that turns over, the error over the whole record
has many minima, and that over its opening has few. So each start first follows openings that grow by doubling, and
only then the whole.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from deatwin.ident.greybox.minimum import Minimum, minimise
from deatwin.ident.greybox.status import FitStatus

if TYPE_CHECKING:
    from deatwin.ident.greybox.problem import Problem


STARTS = 8
"""Most starts: where only one in three leads to the least minimum, all but one search in 25 find it."""
_AGREE = 0.01
"""Relative difference of two errors, rms, that is none: far above what a settled fit leaves, 5e-5."""
EXACT = 1e-6
"""Share of the readings' own spread below which an error is rounding and integration."""
_FIRST, _SMALLEST = 1 / 32, 4
"""The first opening's share of the record, and its least samples for each parameter."""
_ROUGH = 10
"""Evaluations on an opening, whose minimum is only a start for the next."""
_REACH = (0.5, 0.25, 0.125)
"""How far from the given values the starts lie, in turn: shares of a parameter's range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """The best of several fits."""

    best: Minimum  # With the simulations of all
    tried: int  # Number of fits
    agreed: int  # How many of them ended with the same error as the best


def least(
    problem: Problem, noise: float, starts: int, evaluations: int, tolerance: float, hopeless: float
) -> Search | None:
    """Fit from the given values, then through growing openings from there and from other points, as far as needed."""
    options = {"evaluations": evaluations, "tolerance": tolerance, "hopeless": hopeless}
    first = minimise(problem, **options)  # type: ignore[arg-type]
    if first is None or not problem.smooth().any() or first.status is FitStatus.GIVEN_UP:
        return None if first is None else Search(best=first, tried=1, agreed=1)
    found, spent = [first], first.evaluations
    spread = float(np.std(np.concatenate([part.measured for part in problem.parts])))
    # Of n samples of white noise the rms has a relative deviation of 1/sqrt(2 n).
    enough = noise * (1.0 + 3.0 / np.sqrt(2.0 * first.residuals.size))
    for start in _starts(problem, starts - 1) if _rms(first) > enough else ():
        one, cost = _through_openings(start, options)
        spent += cost
        if one is not None:
            found.append(one)
        if len(found) > 2 and _agreeing(found, spread) > 1:
            break
    best = replace(min(found, key=_rms), evaluations=spent)
    return Search(best=best, tried=len(found), agreed=_agreeing(found, spread))


def _rms(found: Minimum) -> float:
    return float(np.sqrt(np.mean(found.residuals**2)))


def _agreeing(found: list[Minimum], spread: float) -> int:
    errors = np.array([_rms(one) for one in found])
    return int(np.sum(errors <= max((1.0 + _AGREE) * float(errors.min()), EXACT * spread)))


def _starts(problem: Problem, count: int) -> Iterator[Problem]:
    """The problem from its own start, and from points of low discrepancy about it."""
    from scipy.stats import qmc

    centre, (lower, upper), smooth = problem.start(), problem.bounds(), problem.smooth()
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    points = qmc.Halton(d=centre.size, scramble=False).random(max(count, 1))[1:]  # the first is a corner of all ranges
    if count > 0:
        yield problem
    for k, point in enumerate(points):
        moved = centre + (2.0 * point - 1.0) * _REACH[k % len(_REACH)] * width * smooth
        values = problem.values(np.clip(moved, lower, upper))
        yield replace(problem, plant=problem.plant.with_values(values))


def _through_openings(problem: Problem, options: dict[str, float]) -> tuple[Minimum | None, int]:
    """A fit of openings of the record, each twice as long as the one before and begun where that ended."""
    needed = _SMALLEST * len(problem.names)
    share, spent, rough = _FIRST, 0.0, {**options, "evaluations": min(_ROUGH, options["evaluations"])}
    while share < 1.0:
        parts = tuple(part.opening(max(int(share * part.size), needed)) for part in problem.parts)
        found = minimise(replace(problem, parts=parts), **rough)  # type: ignore[arg-type]
        if found is None:
            return None, int(np.ceil(spent)) + 1
        spent += share * found.evaluations
        problem = replace(problem, plant=problem.plant.with_values(problem.values(found.coordinates)))
        share *= 2.0
    whole = minimise(problem, **options)  # type: ignore[arg-type]
    return whole, int(np.ceil(spent)) + (1 if whole is None else whole.evaluations)

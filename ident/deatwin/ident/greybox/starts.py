"""Fits from several starts, because one descent may end in a minimum that is not the least.

If small errors grow along a record, its opening has fewer minima: each start first fits openings that double in length.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.covariance import covariance, white_variances
from deatwin.ident.greybox.minimum import MOST, Interrupted, Minimum, minimise
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.status import FitStatus
from deatwin.plant.calibrated import TWO_SIDED_95

STARTS = 8  # Most starting points: if only one in three leads to the lowest minimum, 24 of 25 searches find it
_LIMIT = TWO_SIDED_95**2
"""95 % quantile of the chi-squared law with one degree of freedom. Two squared errors that differ by less, in variances
of a sample, could both belong to the true parameters."""
EXACT = 1e-6  # Share of the readings' standard deviation below which an error is rounding and integration
_FIRST, _SMALLEST = 1 / 32, 4  # Share of the record in the first opening, and least samples for each parameter
_ROUGH = 10  # Evaluations of the fit to an opening, whose minimum only serves as a start for the next one
_REACH = (0.5, 0.25, 0.125)  # Distances of successive starts from the given values, as shares of a parameter's range


@dataclass(frozen=True, kw_only=True, eq=False)
class Search:
    """The best of several fits from different starting points."""

    best: Minimum  # Its number of evaluations includes those of all starts
    tried: int  # Number of starting points
    agreed: int  # Number of starts that ended with the error of the best
    equals: tuple[np.ndarray, ...] = ()


def least(problem: Problem, starts: int, **options: Any) -> Search | None:
    """Fit from the given values, then as far as needed through openings and from others; `options` of `minimise`."""
    problem.watch.begin("fit from the given values")
    first = minimise(problem, **options)
    if first is None or not problem.smooth().any() or first.status is FitStatus.GIVEN_UP:
        return None if first is None else Search(best=first, tried=1, agreed=1)
    # Both fits from the given values count as one start: their agreement says nothing about other minima.
    best, agreed, found, spent, limit = first, [first], [first], first.evaluations, np.inf
    spread = float(np.std(np.concatenate([part.measured for part in problem.parts])))
    for number, start in enumerate(_starts(problem, starts) if starts > 1 else ()):
        problem.watch.begin(f"fit from start {number + 1} of at most {starts}")
        try:
            one, cost = _through_openings(start, options)
        except KeyboardInterrupt:
            raise Interrupted(replace(best, evaluations=spent, status=FitStatus.INTERRUPTED)) from None
        spent += cost
        if one is not None:
            found = [min(first, one, key=_rms)] if start is problem else [*found, one]
        best = min(found, key=_rms)
        limit = _same(best, spread)
        agreed = [one for one in found if _rms(one) <= limit]
        if len(agreed) > 1:
            break
    return Search(
        best=replace(best, evaluations=spent), tried=len(found), agreed=len(agreed), equals=_equals(best, agreed, limit)
    )


def with_better(search: Search, found: Minimum | None, spent: int) -> Search:
    """Continue a search from its end, and return the better of both results."""
    spent += search.best.evaluations + (0 if found is None else found.evaluations)
    if found is None or _rms(found) >= _rms(search.best):
        return replace(search, best=replace(search.best, evaluations=spent))
    same = _rms(search.best) <= _same(found, 0.0)
    return replace(
        search,
        best=replace(found, evaluations=spent),
        agreed=search.agreed if same else 1,
        equals=search.equals if same else (),
    )


def _rms(found: Minimum) -> float:
    return float(np.sqrt(np.mean(found.residuals**2)))


def largest_alike(residuals: np.ndarray, jacobian: np.ndarray) -> float:
    """Return the largest rms error that does not differ from a fit's; `residuals` (m,), `jacobian` (m, n)."""
    # Residuals that are correlated in time count as fewer samples; the ratio of the variances shows how many.
    white, robust = white_variances(residuals, jacobian), np.diag(covariance(residuals, jacobian))
    ratios = np.divide(robust, white, out=np.ones_like(white), where=white > 0.0)
    fewer = float(np.max(ratios, initial=1.0))  # as many if no parameter shows it
    return float(np.sqrt((1.0 + _LIMIT * fewer / residuals.size) * np.mean(residuals**2)))


def _same(best: Minimum, spread: float) -> float:
    """Return the largest error that equals the best fit's, up to rounding."""
    return max(largest_alike(best.residuals, best.jacobian), EXACT * spread)


def _equals(best: Minimum, agreed: list[Minimum], limit: float) -> tuple[np.ndarray, ...]:
    """Return fits with the best one's error at parameters where its linear model predicts another error."""
    apart: list[Minimum] = [best]
    for one in agreed:
        if all(_far(one.coordinates - other.coordinates, other, limit) for other in apart):
            apart.append(one)
    return tuple(one.coordinates for one in apart[1:])


def _far(step: np.ndarray, found: Minimum, limit: float) -> bool:
    return float(np.hypot(_rms(found), np.sqrt(np.mean((found.jacobian @ step) ** 2)))) > limit


def _starts(problem: Problem, count: int) -> Iterator[Problem]:
    """Return the problem at its own start, and at points of a low-discrepancy sequence about it."""
    from scipy.stats import qmc

    centre, (lower, upper), smooth = problem.start(), problem.bounds(), problem.smooth()
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    points = qmc.Halton(d=centre.size, scramble=False).random(count)[1:]  # the first point is a corner of all ranges
    yield problem
    for k, point in enumerate(points):
        moved = centre + (2.0 * point - 1.0) * _REACH[k % len(_REACH)] * width * smooth
        values = problem.values(np.clip(moved, lower, upper))
        yield replace(problem, plant=problem.plant.with_values(values))


def _through_openings(problem: Problem, options: Mapping[str, Any]) -> tuple[Minimum | None, int]:
    """Fit openings of the record, each twice as long as the one before and started from its result."""
    needed = _SMALLEST * len(problem.names)
    share, spent = _FIRST, 0.0
    rough = {
        **options,
        "evaluations": min(_ROUGH, options["evaluations"]),
        "tolerance": max(MOST, options["tolerance"] or MOST),
    }
    while share < 1.0:
        parts = tuple(part.opening(max(int(share * part.size), needed)) for part in problem.parts)
        found = minimise(replace(problem, parts=parts), **rough)
        if found is None:
            return None, int(np.ceil(spent)) + 1
        spent += share * found.evaluations
        problem = replace(problem, plant=problem.plant.with_values(problem.values(found.coordinates)))
        share *= 2.0
    whole = minimise(problem, **options)
    return whole, int(np.ceil(spent)) + (1 if whole is None else whole.evaluations)

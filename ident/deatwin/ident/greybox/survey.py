"""How far a parameter may go where the linear model of a fit does not hold.

The worst known parameter is held at twice its interval while the others are fitted: if the error rises as predicted,
all intervals are confirmed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaincinv

from deatwin.ident.greybox.covariance import covariance, white_variances
from deatwin.ident.greybox.minimum import Minimum, minimise
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.status import FitStatus

_TWICE = 2.0  # Distance of the first point to be examined, in half widths of the interval
_LEAST = 0.5
"""Share of the predicted rise below which the interval is too short. At twice the interval the prediction is four times
that at its end; if only half of it occurs, the error at the end may be as low as half of the limit."""
_SLACK = 1.25
"""Multiple of the predicted distance that other parameters may move: an interval that is off by a quarter is not
wrong."""
_CLEARLY = 0.1  # Squared standard errors by which another minimum is lower, and not the same one, better located
_GROWTH = 1.6  # Ratio of the distances of successive points
_BEYOND = 4.0
"""Multiple of the limit at which the way outwards ends: minima behind so high an error are for the starts to find."""
_EVALUATIONS, _WITHIN = 8, 1e-2
"""_EVALUATIONS: most simulations of a fit with one parameter held. _WITHIN: accuracy of its squared error, in variances
of a sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Survey:
    """Ranges of the parameters within which the error is below its limit, found along the worst known parameter."""

    lower: np.ndarray  # shape (n,): Smallest coordinates
    upper: np.ndarray  # shape (n,): Largest coordinates
    better: np.ndarray | None  # shape (n,): Coordinates of a clearly smaller error, if one was seen


def held(
    problem: Problem, centre: np.ndarray, spread: np.ndarray, k: int, at: float, *, evaluations: int, tolerance: float
) -> Minimum | None:
    """Fit all parameters but one, which is fixed, from the values that the covariance (n, n) predicts; `centre` (n,)."""
    # If parameters have the same effect, moving one alone would leave the valley of good fits, and perhaps the range in
    # which the plant can be simulated.
    along = np.nan_to_num(spread[:, k] / spread[k, k], posinf=0.0, neginf=0.0)
    moved = centre + problem.smooth() * along * (at - centre[k])
    moved[k] = at
    plant = problem.plant.with_values(problem.values(moved))
    others = tuple(name for j, name in enumerate(problem.names) if j != k)
    if others:
        found = minimise(replace(problem, plant=plant, names=others), evaluations=evaluations, tolerance=tolerance)
        return None if found is None else replace(found, coordinates=np.insert(found.coordinates, k, at))
    if (seen := problem.evaluate(moved)) is None:
        return None
    return Minimum(coordinates=moved, residuals=seen[0], jacobian=seen[1], status=FitStatus.SETTLED, evaluations=1)


def survey(problem: Problem, best: Minimum, known: np.ndarray, deviations: float) -> tuple[Survey | None, int]:
    """Find how far the worst known parameter may go, and count runs; None if the linear intervals are confirmed."""
    spread, white = covariance(best.residuals, best.jacobian), white_variances(best.residuals, best.jacobian)
    (lower, upper), own = problem.bounds(), np.sqrt(np.diag(spread))
    ranges = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    k = int(np.argmax(np.where(known, own / ranges, -1.0)))
    if not known[k] or not own[k] > 0.0:
        return None, 0
    square, samples = float(best.residuals @ best.residuals), best.residuals.size
    unit = square / samples * float(own[k] ** 2 / white[k])  # rise of the squared residual at one standard error
    seen, spent = [(0.0, best.coordinates)], 0

    def rise(at: float) -> float:
        nonlocal spent
        found = held(problem, best.coordinates, spread, k, at, evaluations=_EVALUATIONS, tolerance=_WITHIN / samples)
        spent += 1 if found is None else found.evaluations
        if found is None:
            return np.inf
        seen.append(((float(found.residuals @ found.residuals) - square) / unit, found.coordinates))
        return seen[-1][0]

    centre, half = float(best.coordinates[k]), deviations * float(own[k])
    ways = [_outwards(centre, -half, float(lower[k])), _outwards(centre, half, float(upper[k]))]
    looks = [(way, at, rise(at)) for way in ways if (at := next(way, None)) is not None]
    risen = all(found >= _LEAST * ((at - centre) / own[k]) ** 2 for _, at, found in looks)
    near = all((np.abs(x - best.coordinates) <= _SLACK * _TWICE * deviations * own).all() for _, x in seen)
    if risen and near:
        return None, spent
    # Where the error is not a parabola, the limit for all parameters at once applies.
    limit = 2.0 * float(gammaincinv(0.5 * own.size, 0.95))
    for way, _, found in looks:
        while found < _BEYOND * limit and (at := next(way, None)) is not None:
            found = rise(at)
    least, where = min(seen, key=lambda one: one[0])
    better = where if least < -_CLEARLY else None
    inside = [x for found, x in seen if found - least <= limit]
    first, last = min(x[k] for x in inside), max(x[k] for x in inside)
    # The limit is crossed somewhere before the next point outwards, so that point is included.
    next_ones = [max((x for _, x in seen if x[k] < first), key=lambda x: x[k], default=where)]
    next_ones += [min((x for _, x in seen if x[k] > last), key=lambda x: x[k], default=where)]
    points = np.array(inside + next_ones)
    return Survey(lower=points.min(axis=0), upper=points.max(axis=0), better=better), spent


def _outwards(centre: float, half: float, end: float) -> Iterator[float]:
    """Return points from twice the interval outwards; the last is the end of the range."""
    away = _TWICE * half
    while abs(away) < abs(end - centre):
        yield centre + away
        away *= _GROWTH
    if abs(end - centre) > abs(half) and np.isfinite(end):
        yield end

"""Minimise nonlinear least squares over simulations, some of which may fail."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.status import FitStatus
from deatwin.ident.greybox.tangent import least_within, linearised_rms

EVALUATIONS = 30
NEAR, MOST = 0.01, 1e-4
"""NEAR: squared distance from its minimum, in squared standard errors, at which a fit has settled; a tenth of a
standard error spoils no interval, because the mean square error grows by only 1 %. MOST: largest relative change of the
squared residual that counts as settled, for records of few samples."""
LOOKS = 2
"""Points, each better than all before, whose linear models must predict too high a minimum before a fit is given up.
One does not suffice: far from the minimum its prediction may be wrong, and a rejected trial point may be farther away
still."""
CLOSE = 1.25
"""Largest ratio of the squared residual to the one that its linear model predicts at which a minimum is foreseen. A
smaller difference between two rough fits decides nothing."""
MARGIN, SAME = 1e-9, 1e-6
"""Distance by which a start on a bound is moved inside, and that of two points that count as one, as shares of the range
or, if that is less than 1, in coordinates: those of most parameters are logarithms."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """Minimum of a sum of squares."""

    coordinates: np.ndarray  # shape (n,): Fitted parameters, each in its `Scale`
    residuals: np.ndarray  # shape (m,): Residuals at the minimum, SI
    jacobian: np.ndarray  # shape (m, n): Derivative of the readings at the minimum, SI
    status: FitStatus  # Settled, stopped before the minimum, or given up
    evaluations: int  # Number of simulations


class Interrupted(KeyboardInterrupt):
    """Raised by an interrupt during a fit that already has a result to keep."""

    def __init__(self, best: Minimum) -> None:
        super().__init__()
        self.best = best


def minimise(
    problem: Problem,
    *,
    evaluations: int = EVALUATIONS,
    tolerance: float | None = None,
    hopeless: float = np.inf,
    foreseen: float = 0.0,
) -> Minimum | None:
    """Minimise the squared residuals of a problem, as `descend` does, which says more of the result."""
    # Only smooth coordinates move: when an event passes a sample, its derivative no longer predicts the readings, and
    # the trust region would shrink to nothing.
    cost = _Memory(problem, hopeless, foreseen)
    start, (lower, upper) = cost.part(problem.start()), (cost.part(ends) for ends in problem.bounds())
    first = cost(start)
    if first is None:
        return None
    if not start.size:
        return cost.minimum(start, first, FitStatus.SETTLED)
    margin = MARGIN * np.maximum(1.0, np.abs(upper - lower))
    ftol = settled_at(tolerance, first[0].size)
    try:
        with np.errstate(over="ignore"):  # SciPy divides by tiny singular values where a parameter has no influence
            solution = least_squares(
                cost.residuals,
                np.clip(start, lower + margin, upper - margin),
                jac=cost.jacobian,
                bounds=(lower, upper),
                x_scale="jac",
                method="trf",
                ftol=ftol,
                xtol=min(1e-6, 1e-3 * np.sqrt(ftol)),  # because the error rises with the square of the step
                gtol=1e-12,
                max_nfev=evaluations,
            )
    except _NowhereToGo:
        return None
    except _Ended as end:
        return cost.minimum(end.x, end.found, end.status)
    except KeyboardInterrupt:
        raise Interrupted(cost.minimum(*(cost.lowest or (start, first)), FitStatus.INTERRUPTED)) from None
    found = cost(solution.x)
    ended = FitStatus.SETTLED if solution.status > 0 else FitStatus.STOPPED
    return None if found is None else cost.minimum(solution.x, found, ended)


def settled_at(tolerance: float | None, samples: int) -> float:
    """Return the relative change of the squared residual at which a fit has settled: as requested, or from `NEAR`."""
    # At a distance of d standard errors, the squared residual exceeds its minimum by d**2 variances of one sample.
    return min(NEAR / samples, MOST) if tolerance is None else tolerance


class _NowhereToGo(Exception):
    """Raised if the starting point cannot be simulated."""


class _Ended(Exception):
    """Raised, with the best point, when further simulations are not worth their time."""

    def __init__(self, x: np.ndarray, found: tuple[np.ndarray, np.ndarray], status: FitStatus) -> None:
        super().__init__()
        self.x, self.found, self.status = x, found, status


class _Memory:
    """Residuals and Jacobian of the last simulation and of the best one, which the solver may request again."""

    def __init__(self, problem: Problem, hopeless: float, foreseen: float) -> None:
        self.problem, self.hopeless, self.foreseen = problem, hopeless, foreseen
        self._smooth, self._start = problem.smooth(), problem.start()
        self._lower, self._upper = map(self.part, problem.bounds())
        self._same = SAME * np.maximum(1.0, np.abs(self._upper - self._lower))
        self._predicted = np.inf
        self.evaluations = 0
        self._looks: list[np.ndarray] = []
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray] | None] | None = None
        self.lowest: tuple[np.ndarray, tuple[np.ndarray, np.ndarray]] | None = None
        self._before: np.ndarray | None = None

    def part(self, coordinates: np.ndarray) -> np.ndarray:
        return coordinates[self._smooth]

    def whole(self, x: np.ndarray) -> np.ndarray:
        coordinates = self._start.copy()
        coordinates[self._smooth] = x
        return coordinates

    def minimum(self, x: np.ndarray, found: tuple[np.ndarray, np.ndarray], status: FitStatus) -> Minimum:
        return Minimum(
            coordinates=self.whole(x),
            residuals=found[0],
            jacobian=found[1],
            status=status,
            evaluations=self.evaluations,
        )

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        for known in filter(None, (self._last, self.lowest)):
            if np.array_equal(known[0], x):
                return known[1]
        self.evaluations += 1
        found = self.problem.evaluate(self.whole(x))
        self._last = x.copy(), found
        if found is not None:
            self._before = found[0]
            if self.lowest is None or found[0] @ found[0] < self.lowest[1][0] @ self.lowest[1][0]:
                self.lowest = x.copy(), found
                self._look(x, *found)
        return found

    def _look(self, x: np.ndarray, residuals: np.ndarray, jacobian: np.ndarray) -> None:
        """End the fit if the first points show that its minimum is too high, or if two of them agree on it."""
        if not (np.isfinite(self.hopeless) or self.foreseen):
            return
        # A start on a bound is moved inside by a tiny margin, which does not make it another point.
        if any(np.all(np.abs(x - seen) <= self._same) for seen in self._looks):
            return
        self._looks.append(x.copy())
        before, self._predicted = self._predicted, linearised_rms(residuals, jacobian[:, self._smooth])
        if self._predicted <= self.hopeless:
            self.hopeless = np.inf  # the fit remains worth its simulations
        elif len(self._looks) == LOOKS:
            raise _Ended(x.copy(), (residuals, jacobian), FitStatus.GIVEN_UP)
        agree = abs(self._predicted - before) < self.foreseen * self._predicted
        if agree and self._is_near(x, residuals, jacobian[:, self._smooth]):
            raise _Ended(x.copy(), (residuals, jacobian), FitStatus.STOPPED)

    def _is_near(self, x: np.ndarray, residuals: np.ndarray, slopes: np.ndarray) -> bool:
        """Return whether the linear model's minimum is near, and is hardly higher within the bounds."""
        least = self._predicted**2
        if np.mean(residuals**2) > CLOSE * least:
            return False
        within = least_within(residuals, slopes, self._lower - x, self._upper - x)
        return within < (1.0 + 2.0 * self.foreseen) * least

    def residuals(self, x: np.ndarray) -> np.ndarray:
        found = self(x)
        if found is not None:
            return found[0]
        # The plant fails at this trial point, as by pull-in: residuals so large make the solver take a shorter step.
        if self._before is None:
            raise RuntimeError("a fit was asked for residuals before a point that can be simulated")
        return 1e3 * (np.abs(self._before) + 1e-3)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        found = self(x)
        if found is None:
            raise _NowhereToGo  # only the start, moved inside its bounds, fails here; residuals exclude others
        return -found[1][:, self._smooth]

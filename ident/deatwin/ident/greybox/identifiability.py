"""Profile likelihood: how well recordings determine a calibrated parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import ClassVar

import numpy as np
from scipy.special import gammaincinv

from deatwin.ident.greybox.covariance import white_variances
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.minimum import EVALUATIONS
from deatwin.ident.greybox.parts import Part, Records, free_run_residuals, parts_of
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.survey import held
from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import DataError, ModelError, nearest
from deatwin.plant.parameters import Parameter
from deatwin.plant.words import spaced

LEVEL = 0.95
LIMIT = 2 * float(gammaincinv(0.5, LEVEL))  # Quantile at this level of the chi-squared law with one degree of freedom
CLOSE = 0.02  # Tolerance of the deviance at an end of the interval, relative to the limit
MOST_POINTS = 6  # Most refits on each side
SAME = 0.1
"""Share of the rms residual by which residuals of the same data differ at most, however many stages a step has; those
of other readings differ by more than the residual itself."""
ROUNDING = 1e-6  # The same as a share of the largest reading, for data that are fitted almost exactly


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile(Described):
    """Likelihood profile of one parameter: at each of its values, all other parameters are refitted.

    Parameters
    ----------
    parameter : Parameter
        Parameter with its calibrated value.
    values : ndarray, shape (n,)
        Values of the parameter, in increasing order, SI.
    deviances : ndarray, shape (n,)
        Twice the decrease of the log-likelihood from its maximum, at each value. The deviance is scaled so that its
        curvature matches the covariance of the calibration.
    low, high : float
        Ends of the 95 % interval, SI. Where the deviance stays below the 95 % limit, the interval ends at the physical
        range or at the last value at which the plant could be fitted.
    bounded : tuple of bool
        Two values: whether the recordings bound the parameter from below, and whether they bound it from above.
    """

    parameter: Parameter
    values: Array = field(
        metadata=coordinate("value", name="value", unit=attrgetter("parameter.unit"), about="value that was tried")
    )
    deviances: Array = field(metadata=variable("value", name="deviance", about="twice the loss of log likelihood"))
    low: float = field(metadata=variable(unit=attrgetter("parameter.unit"), about="lower end of the 95 % interval"))
    high: float = field(metadata=variable(unit=attrgetter("parameter.unit"), about="upper end of the 95 % interval"))
    bounded: tuple[bool, bool]

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "calibrated": variable(
            of=attrgetter("parameter.value"), unit=attrgetter("parameter.unit"), about="calibrated value"
        ),
        "parameter": attribute(of=attrgetter("parameter.name")),
        "bounded_below": attribute(of=lambda found: found.bounded[0]),
        "bounded_above": attribute(of=lambda found: found.bounded[1]),
        "level": attribute(of=lambda _: LEVEL),
        "limit": attribute(of=lambda _: LIMIT),
    }

    @property
    def identifiable(self) -> bool:
        """True if the recordings bound the parameter from both sides."""
        return all(self.bounded)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the deviance over the parameter, with the limit of the interval, on `ax` or new axes."""
        ax = axes_or_new(ax)
        # The signed root of the deviance is nearly straight between the values that were tried.
        root = np.sign(self.values - self.parameter.value) * np.sqrt(self.deviances)
        fine = np.linspace(self.values[0], self.values[-1], 200)
        ax.plot(fine, np.interp(fine, self.values, root) ** 2, color="C0")
        ax.plot(self.values, self.deviances, "o", color="C0", markersize=4)
        ax.axhline(LIMIT, color="0.4", linestyle="--", linewidth=0.8, label="95 %")
        ax.axvspan(self.low, self.high, color="C0", alpha=0.15, linewidth=0)
        ax.set_xlabel(f"{spaced(self.parameter.name)} ({self.parameter.unit})")
        ax.set_ylabel("deviance")
        ax.legend()
        return ax


@taking(calibration=instance(Calibration), name=instance(str))
def profile(calibration: Calibration, records: Records, name: str) -> Profile:
    """Compute the likelihood profile of a parameter, and from it a 95 % interval.

    The residuals of a plant are correlated in time, so the likelihood for white noise would give too narrow an
    interval. The deviance is therefore scaled: its curvature matches the calibration's covariance, which accounts for
    the correlation.

    Parameters
    ----------
    calibration : Calibration
        Calibration whose fit settled.
    records : Part, Experiment or Recording, or a sequence of such
        Data to which the plant was calibrated.
    name : str
        Name of a fitted parameter.

    Raises
    ------
    ModelError
        If the parameter was not fitted.
    DataError
        If the data are not those of the calibration.

    References
    ----------
    Raue et al., Bioinformatics 25 (2009) 1923-1929, doi:10.1093/bioinformatics/btp358; Chandler & Bate, Biometrika 94
    (2007) 167-183 (scaled likelihood).
    """
    if name not in calibration.names:
        raise ModelError(f"{name!r} was not fitted{nearest(name, calibration.names)}")
    parts = parts_of(records, calibration.plant.rig)
    if not _were_fitted(parts, calibration):
        raise DataError("these are not the data that were calibrated: give calibrate and profile the same recordings")
    sides = [_side(calibration, parts, name, sign) for sign in (-1, 1)]
    parameter = calibration.plant.parameters[name]
    points = {parameter.value: 0.0, **sides[0].tried, **sides[1].tried}
    values = np.array(sorted(points))
    ends = sorted(sides, key=lambda side: side.end)
    return Profile(
        parameter=parameter,
        values=values,
        deviances=np.array([points[v] for v in values]),
        low=ends[0].end,
        high=ends[1].end,
        bounded=(ends[0].bounded, ends[1].bounded),
    )


def _were_fitted(parts: Sequence[Part], calibration: Calibration) -> bool:
    """Return whether parts have, but for rounding, the residuals of a calibration."""
    residuals, largest = free_run_residuals(calibration.plant, parts), max(np.abs(p.measured).max() for p in parts)
    if residuals is None or residuals.shape != calibration.residuals.shape:
        return False
    difference = np.sqrt(np.mean((residuals - calibration.residuals) ** 2))
    return bool(difference <= SAME * calibration.rms + ROUNDING * largest)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    end: float
    bounded: bool
    tried: dict[float, float]


def _side(calibration: Calibration, parts: Sequence[Part], name: str, sign: int) -> _Side:
    """Find the value at which the deviance reaches its limit, by steps that are exact for a parabola."""
    parameter, scale = calibration.plant.parameters[name], calibration.plant.parameters[name].scale
    deviation, white = _deviations(calibration, name)
    centre = scale.to_coordinate(parameter.value)
    first, last = parameter.ends
    furthest = (last - centre) if sign > 0 else (centre - first)
    step, inner, outer = min(np.sqrt(LIMIT) * deviation, furthest), 0.0, np.inf
    within, beyond, tried = parameter.value, None, {}
    for _ in range(MOST_POINTS if furthest > 0 else 0):
        value = min(max(scale.to_value(centre + sign * step), parameter.lower), parameter.upper)
        deviance = _deviance(calibration, parts, name, value) * (white / deviation) ** 2
        if np.isfinite(deviance):
            tried[value] = deviance
        if abs(deviance / LIMIT - 1) < CLOSE:
            return _Side(end=value, bounded=True, tried=tried)
        if deviance < LIMIT:
            inner, within = step, value
        else:
            outer, beyond = step, value if np.isfinite(deviance) else beyond
        if inner == furthest:
            break
        step = min(_next_step(step, deviance, inner, outer), furthest)
    return _Side(end=within if beyond is None else beyond, bounded=beyond is not None, tried=tried)


def _next_step(step: float, deviance: float, inner: float, outer: float) -> float:
    """Return the next step: where the parabola through the last point reaches the limit, or between enclosing points."""
    guess = step * np.sqrt(LIMIT / max(deviance, 1e-2 * LIMIT))
    if inner < guess < outer:
        return float(guess)
    return (inner + (outer if np.isfinite(outer) else 2 * guess)) / 2


def _deviations(calibration: Calibration, name: str) -> tuple[float, float]:
    """Return standard deviations of a coordinate from the calibration's covariance, and for white residuals."""
    k = calibration.names.index(name)
    white = white_variances(calibration.residuals, calibration.jacobian)[k]
    return float(np.sqrt(calibration.covariance[k, k])), float(np.sqrt(white))


def _variance(calibration: Calibration) -> float:
    residuals = calibration.residuals
    return float(residuals @ residuals) / max(residuals.size - len(calibration.names), 1)


def _deviance(best: Calibration, parts: Sequence[Part], name: str, value: float) -> float:
    """Return twice the loss of log likelihood with one parameter fixed; infinite if no fit succeeds."""
    problem, k = Problem(plant=best.plant, parts=tuple(parts), names=best.names), best.names.index(name)
    at = best.plant.parameters[name].scale.to_coordinate(value)
    refit = held(problem, problem.start(), best.covariance, k, at, evaluations=EVALUATIONS, tolerance=1e-6)
    if refit is None:
        return float(np.inf)
    left = float(refit.residuals @ refit.residuals)
    return max(left - float(best.residuals @ best.residuals), 0.0) / _variance(best)

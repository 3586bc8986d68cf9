"""Other fits that explain the recordings as well, so that the intervals must allow for them.

Of two lags in series the readings determine both time constants, but not which belongs to which lag. And where friction
reverses, the residual is rough in the parameters, so a fit may end in one of many minima along a direction that the
readings hardly determine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.starts import largest_alike
from deatwin.ident.mismatch.likelihood.beforehand import departure
from deatwin.ident.mismatch.refit.search import EVALUATIONS
from deatwin.ident.mismatch.thresholds import ACCURACY
from deatwin.plant.effects.base import Place
from deatwin.plant.model import Plant

_IN_SERIES = (Place.DRIVE, Place.SENSOR)
"""Places at which the whole signal passes a lag."""


def with_nominal_start(fit: Calibration, nominal: Plant, parts: Sequence[Part], error: float) -> Calibration:
    """Fit again from the rig's nominal values, and return the better fit.

    If the rms residuals differ by less than the plant's `error`, rms, SI, both may be right. Then the readings do not
    determine the direction from one to the other, but the nominal values do: the fit from these is returned, with the
    variance of the nominal values in that direction.
    """
    stated = {p.name: p.value for p in nominal.parameters.values() if p.name in fit.names and not p.guessed}
    if not stated or not fit.status.ok:
        return fit
    other = descend(fit.plant.with_values(stated), parts, evaluations=EVALUATIONS, tolerance=ACCURACY)
    if not other.status.ok or not (_outside(other, fit) or _outside(fit, other)):
        return fit
    best, worse = sorted((fit, other), key=lambda one: one.rms)
    if worse.rms > np.hypot(largest_alike(best.residuals, best.jacobian), error):
        return best
    values, known = other.plant.parameters, fit.plant.parameters
    apart = [
        known[n].scale.to_coordinate(known[n].value) - values[n].scale.to_coordinate(values[n].value) for n in fit.names
    ]
    away = np.hypot.reduce(
        [departure(known[n], nominal.parameters[n]) - departure(values[n], nominal.parameters[n]) for n in stated]
    )
    # Beyond the other fit nothing is known of the residual.
    direction = np.array(apart) / max(float(away), 1.0)
    return replace(other, covariance=other.covariance + np.outer(direction, direction))


def _outside(other: Calibration, fit: Calibration) -> list[str]:
    """Return the parameters whose values in another fit lie outside their intervals."""
    ends = {name: fit.interval(name) for name in fit.names}
    return [name for name, (low, high) in ends.items() if not low <= other.plant.parameters[name].value <= high]


def with_exchanged_lags(fit: Calibration, parts: Sequence[Part]) -> Calibration:
    """Widen the intervals of a fit if exchanging the time constants of two lags fits as well; `equals` has that fit."""
    limit = largest_alike(fit.residuals, fit.jacobian)
    for lag, own in _pairs(fit):
        (first, second), parameters = fit.interval(lag), fit.plant.parameters
        values = {lag: parameters[own].value, own: parameters[lag].value}
        inside = all(parameters[name].lower <= value <= parameters[name].upper for name, value in values.items())
        if not inside or first <= values[lag] <= second:  # the interval contains both values already
            continue
        other = descend(fit.plant.with_values(values), parts, hopeless=limit)
        if other.status.ok and other.rms <= limit:
            ends = [sorted((*fit.interval(name), *other.interval(name))) for name in fit.names]
            equal = tuple(other.plant.parameters[name].value for name in fit.names)
            reach = tuple((each[0], each[-1]) for each in ends)
            fit = replace(fit, reach=reach, equals=(*fit.equals, equal))
    return fit


def exchanged_lags(fit: Calibration) -> Iterator[str]:
    """Say which lags fit the recordings equally well with their time constants exchanged."""
    for lag, own in _pairs(fit):
        unlike = fit.plant.parameters[lag].value, fit.plant.parameters[own].value
        for equal in fit.equals:
            other = tuple(equal[fit.names.index(name)] for name in (lag, own))
            if (unlike[0] - unlike[1]) * (other[0] - other[1]) < 0.0:
                yield (
                    f"two time constants can be exchanged: {lag} = {other[0]:.4g} s with {own} = {other[1]:.4g} s fits the "
                    f"recordings as well as {unlike[0]:.4g} s with {unlike[1]:.4g} s"
                )


def _pairs(fit: Calibration) -> Iterator[tuple[str, str]]:
    """Yield the time constant of each lag among the effects, with each other time constant of the plant."""
    plant = fit.plant
    lags = [f"{e.name}.{e.strength}" for e in plant.effects if e.place in _IN_SERIES]
    times = [n for n in fit.names if plant.parameters[n].unit == "s" and n not in plant.event_times]
    times = [n for n in times if n not in fit.undetermined]
    for number, name in enumerate(times):
        yield from (
            (name, other) if name in lags else (other, name) for other in times[:number] if {name, other} & {*lags}
        )

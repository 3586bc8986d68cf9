"""Lags in series: the readings determine both time constants, but not which belongs to which lag."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from deatwin.ident.greybox.fit import Calibration, descend
from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.starts import largest_alike
from deatwin.plant.effects.base import Place

_IN_SERIES = (Place.DRIVE, Place.SENSOR)
"""Places at which the whole signal passes a lag."""


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

"""Margins of a controller on linear models that have matrices, because polynomials lose many slow modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from deatwin.control.controllers.law import READING, Law
from deatwin.control.linear.family import LinearFamily
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.realisation import Realisation
from deatwin.control.stability.margins import Margins, margins
from deatwin.control.stability.polynomials import in_series
from deatwin.plant.arrays import Array, Complex

Loop = Callable[[Array], Complex]

_LOWEST = 1e-6  # Least distance of a crossing from 0 and from half the sampling rate, rad per sample, as in `margins`
_POINTS = 400  # Number of points in each part of the grid: logarithmic, 60 per decade, and linear, in steps of 0.45°
_NEAR = np.concatenate([-np.geomspace(30.0, 0.03, 40), [0.0], np.geomspace(0.03, 30.0, 40)])
"""Distances of grid points from a pole, in its widths. A resonance turns by half a circle within some of these."""
_DIVIDED, _ROUNDS = 16, 12  # Number of parts of a bracket, and number of divisions: 16^12 is 2^48
_INTEGRATES = 1e-9
"""Distance from 1 within which a controller's pole counts as an integrator; no other pole has a time constant of 10^9
samples."""
_ALGEBRAIC = 64 * np.finfo(float).eps  # Size of 1 + D D_k up to which it is rounding, and the loop has no solution


def loop_margins(linear: LinearModel, law: Law) -> Margins:
    """Compute the margins of a linear model under a control law."""
    if linear.realisation is not None:
        return _margins(linear.realisation, law, linear.sample_time)
    top, bottom = law.feedback
    return margins([in_series(linear.numerator, top)], [in_series(linear.denominator, bottom)], linear.sample_time)


def family_margins(family: LinearFamily, point: int, law: Law) -> Margins:
    """Compute the margins of all samples of a family at one operating point."""
    top, bottom = law.feedback
    if not family.realisations:
        return margins(
            in_series(family.numerators[point], top), in_series(family.denominators[point], bottom), family.sample_time
        )
    found = [
        margins([0.0], [1.0], family.sample_time) if one is None else _margins(one, law, family.sample_time)
        for one in family.realisations[point]
    ]
    return Margins(**{f.name: np.concatenate([getattr(m, f.name) for m in found]) for f in fields(Margins)})


def _margins(plant: Realisation, law: Law, sample_time: float) -> Margins:
    closed = _closed(plant, law)
    feedback = Realisation(a=law.a, b=-law.b[:, READING:], c=law.c, d=-law.d[READING:])

    def loop(angle: Array) -> Complex:
        delay = np.exp(-1j * angle)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(plant.response(delay) * feedback.response(delay))

    stable = closed is not None and bool((np.abs(np.linalg.eigvals(closed)) < 1.0).all())
    if closed is None or not stable:
        return _unstable(loop, plant, law, sample_time)
    angle = _grid(np.concatenate([plant.modes, feedback.modes, np.linalg.eigvals(closed)]))
    value = loop(angle)
    real = _crossings(lambda a: loop(a).imag, angle, value.imag)
    at_ends = _ends(loop, feedback)
    at_real = np.concatenate([loop(real), at_ends])
    size = np.abs(at_real[at_real.real < 0.0])
    gains = _gain_crossings(loop, angle, value)
    turned = np.angle(-loop(gains))
    disk = _least(lambda a: np.abs(1 + loop(a)) / np.maximum(np.abs(1 - loop(a)), np.finfo(float).tiny), angle)
    modulus = min(_least(lambda a: np.abs(1 + loop(a)), angle), float(np.abs(1 + at_ends).min(initial=np.inf)))
    return _one(
        gain=np.maximum(size, 1 / size).min(initial=np.inf),
        phase_deg=np.degrees(np.abs(turned)).min(initial=np.inf),
        delay=(np.mod(turned, 2 * np.pi) / gains * sample_time).min(initial=np.inf),
        crossover=gains.max(initial=0.0) / sample_time,
        disk=2 * disk,
        modulus=modulus,
    )


def _unstable(loop: Loop, plant: Realisation, law: Law, sample_time: float) -> Margins:
    """Return margins of zero, with the crossover of the unstable loop."""
    angle = _grid(np.concatenate([plant.modes, np.linalg.eigvals(law.a)]))
    crossover = _gain_crossings(loop, angle, loop(angle)).max(initial=0.0) / sample_time
    found = _one(gain=0.0, phase_deg=0.0, delay=0.0, crossover=crossover, disk=0.0, modulus=0.0)
    return Margins(**{**vars(found), "stable": np.zeros(1, dtype=np.bool_)})


def _one(**values: float) -> Margins:
    return Margins(**{name: np.array([float(v)]) for name, v in values.items()}, stable=np.ones(1, dtype=np.bool_))


def _closed(plant: Realisation, law: Law) -> Array | None:
    """Return the closed loop's matrix; None for an algebraic loop of gain -1, which has no solution."""
    a, b, c, d = plant.joined()
    back, through = -law.b[:, READING], -float(law.d[READING])
    around = 1.0 + d * through
    if abs(around) <= _ALGEBRAIC:
        return None
    # y = (C x + D C_k x_k)/(1 + D D_k) and u = C_k x_k - D_k y.
    reading = np.concatenate([c, d * law.c]) / around
    command = np.concatenate([np.zeros(b.size), law.c]) - through * reading
    n = b.size
    whole = np.zeros((n + law.c.size, n + law.c.size))
    whole[:n, :n], whole[n:, n:] = a, law.a
    whole[:n] += np.outer(b, command)
    whole[n:] -= np.outer(back, reading)
    return whole


def _grid(poles: Complex) -> Array:
    """Return angles from far below all time constants to half the sampling rate, dense near the poles."""
    grid = [np.geomspace(_LOWEST, np.pi - _LOWEST, _POINTS), np.linspace(0.0, np.pi, _POINTS + 1)[1:-1]]
    found = np.unique(np.concatenate([*grid, near(poles)]))
    return found[(found >= _LOWEST) & (found <= np.pi - _LOWEST)]


def near(poles: Complex) -> Array:
    """Return angles close to each pole of the upper half plane; some may lie beyond 0 or pi."""
    shown = poles[(poles.imag > 0.0) & (np.abs(poles) > 0.0)]
    width = np.maximum(np.abs(np.log(np.abs(shown))), np.finfo(float).eps)
    return np.asarray((np.angle(shown)[:, None] + width[:, None] * _NEAR).ravel())


def _ends(loop: Loop, feedback: Realisation) -> Complex:
    """Return the loop at 0 Hz and at half the sampling rate, where it is real unless the controller has a pole."""
    away = [np.abs(feedback.modes - end).min(initial=np.inf) > _INTEGRATES for end in (1.0, -1.0)]
    return loop(np.array([0.0, np.pi])[away])


def _gain_crossings(loop: Loop, angle: Array, value: Complex) -> Array:
    return _crossings(lambda a: np.abs(loop(a)) - 1.0, angle, np.abs(value) - 1.0)


def _crossings(function: Callable[[Array], Array], angle: Array, value: Array) -> Array:
    """Return the angles at which a function changes sign."""
    at = np.flatnonzero(np.sign(value[:-1]) * np.sign(value[1:]) < 0.0)
    low, high, sign = angle[at], angle[at + 1], np.sign(value[at])
    shares = np.linspace(0.0, 1.0, _DIVIDED + 1)
    for _ in range(_ROUNDS if at.size else 0):
        parts = low[:, None] + (high - low)[:, None] * shares
        inner = function(parts[:, 1:-1].ravel()).reshape(at.size, -1)
        changed = np.hstack([np.sign(inner) != sign[:, None], np.ones((at.size, 1), dtype=np.bool_)])
        first = np.argmax(changed, axis=1)
        rows = np.arange(at.size)
        low, high = parts[rows, first], parts[rows, first + 1]
    return np.concatenate([0.5 * (low + high), angle[value == 0.0]])


def _least(function: Callable[[Array], Array], angle: Array) -> float:
    """Return the smallest value of a function, after refining each minimum of the grid."""
    value = function(angle)
    least = float(value.min())
    padded = np.concatenate([[np.inf], value, [np.inf]])
    # A minimum far above the smallest one on the grid cannot fall below it between two points.
    at = np.flatnonzero((value <= padded[:-2]) & (value <= padded[2:]) & (value < 2.0 * least))
    low, high = angle[np.maximum(at - 1, 0)], angle[np.minimum(at + 1, angle.size - 1)]
    shares = np.linspace(0.0, 1.0, _DIVIDED + 1)
    for _ in range(_ROUNDS // 2):
        parts = low[:, None] + (high - low)[:, None] * shares
        inner = function(parts.ravel()).reshape(parts.shape)
        best = np.argmin(inner, axis=1)
        rows = np.arange(at.size)
        low, high = parts[rows, np.maximum(best - 1, 0)], parts[rows, np.minimum(best + 1, _DIVIDED)]
        least = min(least, float(inner.min()))
    return least

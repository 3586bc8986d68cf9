r"""Evidence with the scales unknown: :math:`\int p(y|\kappa, \sigma)\,p(\kappa)\,p(\sigma)`.

The whitening depends on ρ = κ/σ only; at each ρ the integral over the noise is exact and costs hardly anything. For one
reading the integral over log ρ is a sum over two dozen values, placed where the integrand is large. For several, whose
columns share their coordinates, Laplace's rule integrates over all log ρ and log σ about the joint maximum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from deatwin.ident.mismatch.likelihood.laplace import LOG_2PI, Weighed
from deatwin.ident.mismatch.likelihood.model import Prior, Reading
from deatwin.ident.mismatch.likelihood.whitening import grams
from deatwin.ident.mismatch.thresholds import ACCURACY
from deatwin.plant.errors import DataError

NODES = 8
"""Number of ratios that are evaluated at a time: over the prior, about the best of these, and across the peak."""
FAR = 4.0
"""Half width of the range of ratios that is tried first, in standard deviations of the prior."""
SHIFTS = 8
"""Largest number of times that the range is extended, by its half width, because the best ratio is at its end; also the
largest number of times that ratios are added about the peak."""
NEGLIGIBLE = 30.0
"""Nats below the peak from which on the integrand, e^-30 of the peak, is negligible."""
FEWEST = 4
"""Smallest number of ratios at a peak: a cubic needs four."""
TWICE = 0.02
"""Smallest distance between two ratios, in widths of the peak; a spline through nearer ones would follow rounding
errors."""
ACROSS, FINE = 8.0, 41
"""Half width of the range over which a scale is summed, in standard deviations of the peak, and number of its values.
At steps of less than half a deviation the error of the trapezoidal rule is below double precision."""
STEP, ROUNDS, ENOUGH = 0.01, 40, 1e-4
"""Step of a logarithm for derivatives (e^0.01), largest number of Newton steps, and gain in nats below which they end:
no decision depends on it, and smaller gains are lost in the error of the derivatives."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Result of a fit: log evidence, most probable scales, and coordinates (m,), (m, m) at these."""

    log: float
    kappas: tuple[float, ...]
    sigmas: tuple[float, ...]
    mean: np.ndarray
    cov: np.ndarray


def evidence(readings: Sequence[Reading], prior: Prior) -> Evidence:
    """Compute the evidence of a fit whose coordinates all readings share."""
    if {reading.columns.shape[1] for reading in readings} != {prior.fitted.size}:
        raise DataError("every reading needs a column for each coordinate of the prior")
    return _of_one(readings[0], prior) if len(readings) == 1 else _of_several(readings, prior)


def weighed(reading: Reading, prior: Prior, log_ratios: np.ndarray) -> list[Weighed]:
    """Evaluate a reading at several ratios of error to noise."""
    rows, size = reading.rows, 1 + reading.columns.shape[1]
    seen = np.flatnonzero(rows.any(axis=1))  # the columns of another reading's own error are 0 here
    known, logs = grams(reading.process, np.exp(log_ratios), (reading.times, reading.records), rows[seen])
    found = np.zeros((log_ratios.size, size, size))
    found[:, seen[:, None], seen] = known
    pairs = zip(found, logs, strict=True)
    return [Weighed(products=p, logs=float(log), count=reading.times.size, prior=prior) for p, log in pairs]


class _Curve:
    """Logarithm of the integrand over log ρ, at increasing values of it, with the most probable log σ at each."""

    def __init__(self, reading: Reading, prior: Prior) -> None:
        self._reading, self._prior = reading, prior
        self._known: dict[float, tuple[float, float, Weighed]] = {}

    def extend(self, log_ratios: np.ndarray) -> None:
        for at, fit in zip(log_ratios, weighed(self._reading, self._prior, log_ratios), strict=True):
            self._known[float(at)] = (*_over_noise(fit, self._reading, float(at)), fit)

    @property
    def at(self) -> np.ndarray:
        return np.array(sorted(self._known))

    @property
    def values(self) -> np.ndarray:
        return np.array([self._known[at][0] for at in sorted(self._known)])

    def best(self) -> tuple[float, float, Weighed]:
        """Return log ρ, log σ and the fit at the maximum of the integrand."""
        at = max(self._known, key=lambda at: self._known[at][0])
        return at, *self._known[at][1:]


def _of_one(reading: Reading, prior: Prior) -> Evidence:
    curve, centre = _Curve(reading, prior), float(np.log(reading.kappa.median / reading.sigma.median))
    spread = float(np.hypot(reading.kappa.spread, reading.sigma.spread))
    if spread > 0.0:
        total = _integral(curve, centre, spread)
    else:
        curve.extend(np.array([centre]))
        total = float(curve.values[0])
    log_ratio, log_sigma, fit = curve.best()
    mean, cov = fit.coordinates(log_sigma)
    sigma = float(np.exp(log_sigma))
    return Evidence(log=total, kappas=(sigma * float(np.exp(log_ratio)),), sigmas=(sigma,), mean=mean, cov=cov)


def _integral(curve: _Curve, centre: float, spread: float) -> float:
    """Integrate over log ρ: over the prior, about the best value there, then across the peak; return the logarithm."""
    from scipy.interpolate import CubicSpline

    curve.extend(centre + FAR * spread * np.linspace(-1.0, 1.0, NODES))
    for _ in range(SHIFTS):
        at, best = curve.at, int(np.argmax(curve.values))
        if 0 < best < at.size - 1:
            break
        curve.extend(at[best] + FAR * spread * np.linspace(0.0, 1.0 if best else -1.0, NODES)[1:])
    best = int(np.clip(best, 1, at.size - 2))
    curve.extend(np.linspace(at[best - 1], at[best + 1], NODES + 2)[1:-1])
    at, values = curve.at, curve.values
    best = int(np.clip(np.argmax(values), 1, at.size - 2))
    slopes = np.diff(values[best - 1 : best + 2]) / np.diff(at[best - 1 : best + 2])
    # quadratic coefficient of the parabola through three values
    bend = (slopes[1] - slopes[0]) / (at[best + 1] - at[best - 1])
    slope = slopes[0] + bend * (at[best] - at[best - 1])
    width = np.sqrt(-0.5 / bend) if bend < 0.0 else spread
    peak = at[best] - (0.5 * slope / bend if bend < 0.0 else 0.0)
    curve.extend(peak + width * (np.arange(NODES) - (NODES - 1) / 2.0))
    for _ in range(SHIFTS):  # if the peak is no parabola, ratios are added about it
        at, values = curve.at, curve.values
        counts = (values > values.max() - NEGLIGIBLE) & (np.diff(at, prepend=-np.inf) > TWICE * width)
        if counts.sum() >= FEWEST:
            break
        best = int(np.clip(np.argmax(values), 1, at.size - 2))
        nearer = np.linspace(at[best - 1], at[best + 1], NODES + 2)
        width = nearer[1] - nearer[0]
        curve.extend(nearer[1:-1])
    else:
        return float(values.max() + np.log(width))  # such an uneven peak is only rounding
    fine = np.linspace(at[counts][0], at[counts][-1], 1 + 100 * NODES)
    return float(logsumexp(CubicSpline(at[counts], values[counts])(fine)) + np.log(fine[1] - fine[0]))


def _over_noise(fit: Weighed, reading: Reading, log_ratio: float) -> tuple[float, float]:
    """Integrate over log σ at one ρ, times the prior of κ; return the logarithm, and the most probable log σ."""

    def log_density(log_sigma: np.ndarray) -> np.ndarray:
        priors = reading.sigma.log_density(log_sigma) + reading.kappa.log_density(log_sigma + log_ratio)
        return fit.log_evidence(log_sigma) + priors

    # If σ or κ is known, σ is known, too, or follows from ρ.
    if reading.sigma.spread == 0.0 or reading.kappa.spread == 0.0:
        known = reading.sigma.median if reading.sigma.spread == 0.0 else reading.kappa.median / np.exp(log_ratio)
        log_sigma = float(np.log(known))
        return float(log_density(np.array([log_sigma]))[0]), log_sigma
    centre, seen = np.log(reading.sigma.median), 0.5 * np.log(fit.products[0, 0] / fit.count)
    far = ACROSS * reading.sigma.spread
    bounds = (min(centre - far, seen - far), max(centre + far, seen + far))
    best = float(minimize_scalar(lambda x: -log_density(np.array([x]))[0], bounds=bounds, method="bounded").x)
    slope = log_density(best + STEP * np.array([-1.0, 0.0, 1.0]))
    width = STEP / np.sqrt(max(-np.diff(slope, 2)[0], STEP**2))
    nodes = best + width * np.linspace(-ACROSS, ACROSS, FINE)
    return float(logsumexp(log_density(nodes)) + np.log(nodes[1] - nodes[0])), best


def _of_several(readings: Sequence[Reading], prior: Prior) -> Evidence:
    """Integrate over the unknown scales by Laplace's rule, starting at the best scales of each reading alone."""
    start = np.array([_near(reading, prior) for reading in readings])
    unknown = np.array([[r.kappa.spread > 0.0, r.sigma.spread > 0.0] for r in readings])
    joint = _Joint(readings, prior)

    def scales(moved: np.ndarray) -> np.ndarray:
        at = start.copy()
        at[unknown] = moved
        return at

    best, value, bends = _maximum(lambda moved: joint.log_density(scales(moved)), start[unknown])
    found = scales(best)
    mean, cov = joint.fit(found).coordinates(0.0)
    return Evidence(
        log=value + 0.5 * (best.size * LOG_2PI - float(np.log(bends).sum())),
        kappas=tuple(map(float, np.exp(found[:, 0]))),
        sigmas=tuple(map(float, np.exp(found[:, 1]))),
        mean=mean,
        cov=cov,
    )


def _near(reading: Reading, prior: Prior) -> tuple[float, float]:
    """Return log κ and log σ near the optimum of one reading alone: those at the best of the first ratios."""
    centre = float(np.log(reading.kappa.median / reading.sigma.median))
    spread = float(np.hypot(reading.kappa.spread, reading.sigma.spread))
    curve = _Curve(reading, prior)
    curve.extend(centre + FAR * spread * np.linspace(-1.0, 1.0, NODES) if spread > 0.0 else np.array([centre]))
    log_ratio, log_sigma, _ = curve.best()
    return log_ratio + log_sigma, log_sigma


class _Joint:
    """Joint log density of several readings, whose products are added."""

    def __init__(self, readings: Sequence[Reading], prior: Prior) -> None:
        self._readings, self._prior = readings, prior
        self._known: dict[tuple[int, float], Weighed] = {}

    def fit(self, scales: np.ndarray) -> Weighed:
        """Fit at log κ and log σ of each reading, (J, 2); the products already include the noise."""
        parts = [self._part(j, round(float(k - s), 9)) for j, (k, s) in enumerate(scales)]
        weights = np.exp(-2.0 * scales[:, 1])
        return Weighed(
            products=sum((w * part.products for w, part in zip(weights, parts, strict=True)), np.zeros(())),
            logs=sum(part.logs + 2.0 * part.count * s for part, s in zip(parts, scales[:, 1], strict=True)),
            count=sum(part.count for part in parts),
            prior=self._prior,
        )

    def log_density(self, scales: np.ndarray) -> float:
        """Return the log evidence at given scales plus their log priors."""
        priors = [
            (r.kappa.log_density(k) + r.sigma.log_density(s)) for r, (k, s) in zip(self._readings, scales, strict=True)
        ]
        return float(self.fit(scales).log_evidence(np.zeros(1))[0] + np.sum(priors))

    def _part(self, j: int, log_ratio: float) -> Weighed:
        # derivatives need the ratios beside this one as well, and all are whitened in one pass
        if (j, log_ratio) not in self._known:
            near = np.round(log_ratio + STEP * np.arange(-2, 3), 9)
            parts = weighed(self._readings[j], self._prior, near)
            self._known |= {(j, float(at)): part for at, part in zip(near, parts, strict=True)}
        return self._known[j, log_ratio]


def _maximum(of: Callable[[np.ndarray], float], start: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Maximise a function by Newton's method; return place, value and negative curvatures."""
    at, value = start, of(start)
    for _ in range(ROUNDS):
        slope, bend = _slopes(of, at, value)
        squares, axes = np.linalg.eigh(-bend)
        bends = np.maximum(np.abs(squares), ACCURACY * max(np.abs(squares).max(initial=0.0), 1.0))
        step = axes @ (axes.T @ slope / bends)
        if slope @ step <= 2.0 * ENOUGH:
            break
        step /= max(1.0, float(np.abs(step).max()))
        while (there := of(at + step)) < value:
            step /= 2.0
            if np.abs(step).max() < STEP**2:  # the derivatives are not accurate enough to show a gain
                return at, value, bends
        at, value = at + step, there
    return at, value, bends


def _slopes(of: Callable[[np.ndarray], float], at: np.ndarray, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivatives, by central differences."""
    units = STEP * np.eye(at.size)
    ups, downs = np.array([of(at + u) for u in units]), np.array([of(at - u) for u in units])
    bend = np.diag((ups - 2.0 * value + downs) / STEP**2)
    for i in range(at.size):
        for j in range(i):
            corners = [of(at + a * units[i] + b * units[j]) * a * b for a in (-1, 1) for b in (-1, 1)]
            bend[i, j] = bend[j, i] = sum(corners) / (4.0 * STEP**2)
    return (ups - downs) / (2.0 * STEP), bend

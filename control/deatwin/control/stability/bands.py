"""Margins and locus of a loop with the band that the model's covariance gives them, to first order.

A margin that another crossing may take over gets the lowest limit of all crossings.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import coefficients, number, taking
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.control.stability.circle import search
from deatwin.control.stability.loops import near
from deatwin.control.stability.margins import margins
from deatwin.control.stability.polynomials import in_series
from deatwin.ident.frequency.dc import Equilibrium
from deatwin.ident.frequency.response import FrequencyResponse, FrequencyStatus, Pointwise
from deatwin.ident.frequency.uncertainty.gain_phase import Ellipses, interval_radius
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import PART_COORDINATES, Described, Metadata, attribute, coordinate, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new

_LOWEST, _POINTS = 1e-4, 2000  # Lowest frequency of the locus, rad per sample, and number of frequencies
_TOUCHES = 1e-9  # Distance from -1 that counts as none; rounding of a crossing's angle leaves up to 1e-12
_ELLIPSES = 24  # Number of ellipses that are drawn; more would cover each other


@dataclass(frozen=True, kw_only=True)
class UncertainMargin:
    """A gain, phase, delay or disk margin with its uncertainty.

    Parameters
    ----------
    value : float
        Margin with the estimated coefficients: gain margin as a factor, phase margin in degrees, delay margin in s,
        disk margin dimensionless. Infinite if no change of this kind makes the loop unstable.
    deviation : float
        First-order standard deviation: for phase and delay, that of the margin; for gain and disk, that of the natural
        logarithm of the margin. 0 if the margin is infinite.
    low : float
        Lower confidence limit of the margin, to first order. At a level of 95 %, the margin exceeds this limit with a
        probability of 97.5 %. If the loop has several crossings, this is the smallest of their limits. The limit is
        never below the margin at the edge of stability, which is 1 for the gain margin and 0 for the others.
    """

    value: float = field(metadata=variable(about="margin of the model itself"))
    deviation: float = field(metadata=variable(about="standard deviation; of the logarithm for gain and disk"))
    low: float = field(metadata=variable(about="lower limit"))


_MARGINS = {"gain": "", "phase_deg": "deg", "delay": "s", "disk": ""}


@dataclass(frozen=True, kw_only=True, eq=False)
class MarginBand(Described):
    """Margins and Nyquist curve of a loop L with a confidence band, as `band_margins` returns them.

    Parameters
    ----------
    gain, phase_deg, delay, disk : UncertainMargin
        Gain margin (factor), phase margin (degrees), delay margin (s) and disk margin (dimensionless).
    modulus : float
        Least distance of L from -1 over frequency, with the estimated coefficients; dimensionless.
    modulus_low : float
        Least distance from -1 to the band of L; 0 if -1 lies inside the band. If this distance is positive, every loop
        in the band is stable, to first order.
    response : FrequencyResponse
        L over frequency, with the covariance of real and imaginary part; dimensionless.
    level : float
        Probability that the band contains L at all frequencies. It is also the two-sided level of the margins' limits.
    """

    gain: UncertainMargin
    phase_deg: UncertainMargin
    delay: UncertainMargin
    disk: UncertainMargin
    modulus: float = field(metadata=attribute())
    modulus_low: float = field(metadata=attribute())
    response: FrequencyResponse
    level: float = field(metadata=attribute())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "margin": coordinate("margin", of=lambda _: list(_MARGINS)),
        "unit": coordinate("margin", of=lambda _: list(_MARGINS.values())),
        "margins": table_along("margin", name="", of=lambda band: [getattr(band, name) for name in _MARGINS]),
        "loop": variable("omega", of=attrgetter("response.values"), about="open loop L"),
        "covariance": variable(
            "omega", "part", "other_part", of=attrgetter("response.covariance"), about="of the parts of L"
        ),
        "omega": coordinate("omega", of=attrgetter("response.omega"), unit="rad/s"),
        "frequency_Hz": coordinate("omega", of=lambda band: band.response.omega / (2 * np.pi), unit="Hz"),
        "radius": attribute(),
        **PART_COORDINATES,
    }

    @property
    def radius(self) -> float:
        """Mahalanobis radius of the ellipses that form the band of L (Scheffé).

        The square of the radius is the `level` quantile of the chi-square distribution, whose degrees of freedom are
        the rank of the covariance. The ellipsoid of this radius about the estimated coefficients contains the true
        coefficients with the probability `level`. The ellipse at each frequency is the projection of this ellipsoid, so
        the band contains the true L at all frequencies with at least that probability.
        """
        return _scheffe(self.response.theta_cov, self.level)

    def ellipse(self, n_points: int = 73) -> Complex:
        """Return the closed outline of the band's ellipse at each frequency, complex, shape (n, `n_points`)."""
        turn = np.linspace(0.0, 2 * np.pi, n_points)
        outline = self.radius * Ellipses.of(self.response.covariance).roots @ np.stack([np.cos(turn), np.sin(turn)])
        return np.asarray(self.response.values[:, None] + outline[:, 0] + 1j * outline[:, 1])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the Nyquist curve near -1 with the ellipses of the simultaneous band, on `ax` or new axes."""
        from matplotlib.collections import LineCollection

        axes = axes_or_new(ax)
        values = self.response.values
        near = np.flatnonzero(np.abs(values) < 2.5)
        axes.plot(values.real, values.imag, color="C0", label="loop of the model")
        if near.size:
            shown = near[evenly_along(values[near], _ELLIPSES)]
            outlines = self.ellipse()[shown]
            segments = list(np.stack([outlines.real, outlines.imag], axis=-1))
            name = f"{100 * self.level:g} % band, all frequencies at once"
            axes.add_collection(LineCollection(segments, colors="C0", linewidths=0.8, alpha=0.6, label=name))
        turn = np.linspace(0.0, 2 * np.pi, 181)
        if self.modulus_low > 0.0:
            circle = -1.0 + self.modulus_low * np.exp(1j * turn)
            axes.plot(circle.real, circle.imag, color="C3", linewidth=0.8, label="nearest the band comes to -1")
        axes.plot(-1.0, 0.0, "+", color="k", markersize=10, label="-1")
        axes.set_xlim(-2.0, 1.0)
        axes.set_ylim(-2.0, 1.0)
        axes.set_aspect("equal")
        axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.set_xlabel("real part of L")
        axes.set_ylabel("imaginary part of L")
        axes.legend(fontsize="small", loc="lower left")
        return axes


@dataclass(frozen=True, kw_only=True, eq=False)
class _Loop:
    """The loop at given angles: its value, slope by the angle, and gradient by the model's coefficients."""

    value: Complex
    slope: Complex
    gradient: Complex

    @property
    def log_slope(self) -> Complex:
        return self.slope / self.value

    @property
    def log_gradient(self) -> Complex:
        return self.gradient / self.value[:, None]


@taking(linear=linear_model, feedback_numerator=coefficients, feedback_denominator=coefficients, level=number)
def band_margins(
    linear: LinearModel, feedback_numerator: ArrayLike, feedback_denominator: ArrayLike, *, level: float = 0.95
) -> MarginBand:
    """Propagate the covariance of a linear model to the margins and the Nyquist curve of its loop with a controller.

    A change of the coefficients changes the loop L by dL at a fixed frequency; L' is the derivative of L with respect
    to frequency. A phase crossing shifts by dw = -Im(dL/L)/Im(L'/L), and ln|L| at the crossing changes by
    Re(dL/L + dw L'/L). A gain crossing shifts by dw = -Re(dL/L)/Re(L'/L), and the phase at the crossing changes by
    Im(dL/L + dw L'/L). The disk margin is
    the minimum of 2 |1 + L|/|1 - L| over frequency. Its change is that of this expression at the frequency of the
    minimum. Its lower limit is the lowest of the limits at all local minima.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`) and with its covariance.
    feedback_numerator, feedback_denominator : array_like, shapes (n,) and (m,)
        Coefficients of z^0, z^-1, ... of the controller (`Law.feedback`), input unit per output unit. They count as
        exact.
    level : float
        Confidence level of the band and (two-sided) of the limits of the margins, between 0 and 1.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If the loop with the estimated coefficients is unstable, if the coefficients are inaccurate
        (`LinearModel.detail`), or if the level does not lie between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise ControlError(f"the level is {level}: it must lie between 0 and 1")
    if linear.require().realisation is not None and linear.detail:
        raise ControlError(f"no band of the loop: {linear.detail}")
    top, bottom = np.atleast_1d(feedback_numerator, feedback_denominator)
    feedback = (np.asarray(top, np.float64), np.asarray(bottom, np.float64))
    top, bottom = in_series(linear.numerator, feedback[0]), in_series(linear.denominator, feedback[1])
    own = margins(top, bottom, linear.sample_time)
    if not own.stable[0]:
        raise ControlError("the loop of the model itself is unstable: it has no margins; choose a slower controller")
    size = max(top.size, bottom.size)
    top, bottom = (np.pad(c, (0, size - c.size)) for c in (top, bottom))
    found = search(top[None, :], bottom[None, :])
    at = partial(_loop, linear, feedback)
    # Between grid points -1 may be approached sharply, and a band as thin as a line contains it only where L is real.
    poles = np.concatenate([np.roots(c) for c in (bottom, top + bottom)])
    angle = np.concatenate([found.modulus.angle, found.real.angle, near(poles)])
    angle = np.union1d(np.geomspace(_LOWEST, np.pi, _POINTS), angle[(angle > _LOWEST) & (angle < np.pi)])
    response = _response(linear, feedback, angle)
    return MarginBand(
        gain=_gain(at, np.concatenate([[0.0], found.real.angle, [np.pi]]), linear.covariance, level),
        phase_deg=_phase(at, found.gain.angle, linear.covariance, level),
        delay=_delay(at, found.gain.angle, linear.covariance, level, linear.sample_time),
        disk=_disk(at, found.disk.angle, angle, linear.covariance, level),
        modulus=float(own.modulus[0]),
        modulus_low=float(_distance(response, _scheffe(linear.covariance, level)).min()),
        response=response,
        level=level,
    )


def _loop(linear: LinearModel, feedback: tuple[Array, Array], angle: Array) -> _Loop:
    shift = np.exp(-1j * angle)

    def value(coefficients: Array) -> tuple[Complex, Complex]:
        lags = np.arange(coefficients.size)
        powers = shift[:, None] ** lags
        return powers @ coefficients, -1j * (powers * lags) @ coefficients

    parts = [value(c) for c in (linear.numerator, feedback[0], linear.denominator, feedback[1])]
    (b, db), (n, dn), (a, da), (d, dd) = parts
    loop = b * n / (a * d)
    in_b = shift[:, None] ** np.arange(linear.numerator.size) * (n / (a * d))[:, None]
    in_a = -(shift[:, None] ** np.arange(1, linear.denominator.size)) * (loop / a)[:, None]
    slope = (db * n + b * dn) / (a * d) - loop * (da / a + dd / d)
    return _Loop(value=loop, slope=slope, gradient=np.concatenate([in_b, in_a], axis=1))


def _gradient(angle: Array, linear: LinearModel, feedback: tuple[Array, Array]) -> Complex:
    return _loop(linear, feedback, angle).gradient


def _response(linear: LinearModel, feedback: tuple[Array, Array], angle: Array) -> FrequencyResponse:
    output = np.nan if linear.operating_output is None else linear.operating_output
    point = Equilibrium(
        operating_input=np.array([linear.operating_input]),
        outputs=np.array([output]),
        stable=np.array([True]),
        chosen=0,
    )
    return FrequencyResponse(
        symbol="L",
        order=0,
        values=_loop(linear, feedback, angle).value,
        omega=angle / linear.sample_time,
        point=point,
        status=FrequencyStatus.OK,
        unit="",
        theta_cov=linear.covariance,
        differentiate=Pointwise(partial(_gradient, linear=linear, feedback=feedback), angle),
    )


def _deviations(gradient: Array, covariance: Array) -> Array:
    return np.sqrt(np.einsum("ni,ij,nj->n", gradient, covariance, gradient).clip(min=0.0))


def _least(values: Array, deviations: Array, lows: Array) -> UncertainMargin:
    if not values.size:
        return UncertainMargin(value=np.inf, deviation=0.0, low=np.inf)
    first = int(np.argmin(values))
    low = max(float(lows.min()), 0.0)
    return UncertainMargin(value=float(values[first]), deviation=float(deviations[first]), low=low)


def _lower(values: Array, deviations: Array, level: float) -> Array:
    return values - interval_radius(level, np.inf) * deviations


def _gain(at: partial[_Loop], angle: Array, covariance: Array, level: float) -> UncertainMargin:
    with np.errstate(divide="ignore", invalid="ignore"):
        loop = at(angle)
    kept = np.isfinite(loop.value) & (loop.value.real < 0.0) & (np.abs(loop.value) < 1e12)
    loop, angle = at(angle[kept]), angle[kept]
    moves = (angle > 0.0) & (angle < np.pi)  # at the ends the loop stays real
    shift = np.zeros((angle.size, covariance.shape[0]))
    shift[moves] = -loop.log_gradient.imag[moves] / loop.log_slope.imag[moves, None]
    gradient = loop.log_gradient.real + loop.log_slope.real[:, None] * shift
    deviations, size = _deviations(gradient, covariance), np.abs(loop.value)
    # |L| itself is nearly normal; its logarithm is not if the loop is small compared with its deviation.
    reach = interval_radius(level, np.inf) * deviations * np.where(size < 1.0, 1.0, -1.0)
    farther = size * np.maximum(1.0 + reach, np.finfo(float).tiny)
    lows = np.where(size < 1.0, 1.0 / np.maximum(farther, size), farther)
    found = _least(np.maximum(size, 1.0 / size), deviations, lows)
    return UncertainMargin(value=found.value, deviation=found.deviation, low=max(found.low, 1.0))


def _phase_gradient(loop: _Loop) -> tuple[Array, Array]:
    """Return gradients of the phase at gain crossings, rad, and of the crossings, rad per sample."""
    shift = -loop.log_gradient.real / loop.log_slope.real[:, None]
    return loop.log_gradient.imag + loop.log_slope.imag[:, None] * shift, shift


def _phase(at: partial[_Loop], angle: Array, covariance: Array, level: float) -> UncertainMargin:
    loop = at(angle)
    gradient = np.degrees(_phase_gradient(loop)[0])
    values, deviations = np.degrees(np.abs(np.angle(-loop.value))), _deviations(gradient, covariance)
    return _least(values, deviations, _lower(values, deviations, level))


def _delay(at: partial[_Loop], angle: Array, covariance: Array, level: float, h: float) -> UncertainMargin:
    loop = at(angle)
    turn, shift = _phase_gradient(loop)
    phase = np.mod(np.angle(-loop.value), 2 * np.pi)
    gradient = (turn - (phase / angle)[:, None] * shift) / angle[:, None] * h
    values, deviations = phase / angle * h, _deviations(gradient, covariance)
    return _least(values, deviations, _lower(values, deviations, level))


def _disk(at: partial[_Loop], nearest: Array, grid: Array, covariance: Array, level: float) -> UncertainMargin:
    value, deviation = _disk_at(at, grid, covariance)
    # Another approach to -1 on the grid, less close but less certain, may become the nearest.
    inner = 1 + np.flatnonzero((value[1:-1] < value[:-2]) & (value[1:-1] <= value[2:]))
    inner = inner[(grid[inner - 1] > nearest[0]) | (grid[inner + 1] < nearest[0])]
    own = _disk_at(at, nearest, covariance)
    value, deviation = (np.append(first, others[inner]) for first, others in zip(own, (value, deviation), strict=True))
    low = float(np.exp((value - interval_radius(level, np.inf) * deviation).min()))
    return UncertainMargin(value=float(np.exp(value[0])), deviation=float(deviation[0]), low=low)


def _disk_at(at: partial[_Loop], angle: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the logarithm of the symmetric distance from -1 at each angle, and its deviation, both (n,)."""
    # At an integrator's pole the loop is infinite, and the distance is 1 whatever the coefficients.
    with np.errstate(divide="ignore", invalid="ignore"):
        loop = at(angle)
        gradient = (2 * loop.gradient / ((1 + loop.value) * (1 - loop.value))[:, None]).real
        value = np.log(2 * np.abs((1 + loop.value) / (1 - loop.value)))
    sound = np.isfinite(value) & np.isfinite(gradient).all(axis=1)
    value, gradient = np.where(sound, value, np.log(2.0)), np.where(sound[:, None], gradient, 0.0)
    return value, _deviations(gradient, covariance)


def _scheffe(covariance: Array, level: float) -> float:
    from scipy.stats import chi2

    sizes = np.sqrt(np.diag(covariance).clip(min=0.0))
    units = np.where(sizes > 0.0, sizes, 1.0)
    rank = int(np.linalg.matrix_rank(covariance / np.outer(units, units), hermitian=True)) if sizes.any() else 0
    return float(np.sqrt(chi2.ppf(level, rank))) if rank else 0.0


def _distance(response: FrequencyResponse, radius: float) -> Array:
    """Return the distance of -1 from the ellipses; the nearest point on an axis of length s is at d s²/(s² + l)."""
    ellipses = Ellipses.of(response.covariance)
    away = 1.0 + response.values
    along = _along_axes(away, ellipses)
    squares = radius**2 * ellipses.variances
    low, high = np.zeros(away.size), np.sqrt(squares.max(axis=1)) * np.abs(away)
    for _ in range(100):  # bisection for the multiplier l at which the point lies on the ellipse
        middle = 0.5 * (low + high)
        with np.errstate(divide="ignore", invalid="ignore"):
            outside = np.nansum(squares * along**2 / (squares + middle[:, None]) ** 2, axis=1) > 1.0
        low, high = np.where(outside, middle, low), np.where(outside, high, middle)
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = np.where(squares > 0.0, high[:, None] / (squares + high[:, None]), 1.0)
        inside = np.all(squares > 0.0, axis=1) & (np.sum(along**2 / squares, axis=1) <= 1.0)
    distance = np.hypot(*(along * rest).T)
    return np.where(inside | (distance <= _TOUCHES), 0.0, distance)


def stable_probability(band: MarginBand) -> float:
    """Return the probability that a loop of the model is stable, to first order; 1 if -1 lies outside the band."""
    if band.modulus_low > 0.0:
        return 1.0
    from scipy.stats import norm

    # The most probable unstable loop passes through -1; beyond its distance, in deviations, lies the normal law's tail.
    ellipses = Ellipses.of(band.response.covariance)
    along = _along_axes(1.0 + band.response.values, ellipses)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.where(np.abs(along) <= _TOUCHES, 0.0, along**2 / ellipses.variances)
    return float(norm.cdf(np.sqrt(squares.sum(axis=1).min())))


def _along_axes(away: Complex, ellipses: Ellipses) -> Array:
    """Return the parts of distances along the axes of ellipses. Shapes: `away` (n,); returns (n, 2)."""
    return np.stack([away.real * ellipses.axes[:, 0, i] + away.imag * ellipses.axes[:, 1, i] for i in (0, 1)], axis=-1)


def evenly_along(values: Complex, count: int) -> NDArray[np.intp]:
    """Return positions of points at equal distances along a curve."""
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
    return np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], count)).clip(max=values.size - 1))

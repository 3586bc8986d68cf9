"""Design PI and PID controllers by loop shaping: the largest integral gain within bounds on robustness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deatwin.control.arguments import number, pair, taking
from deatwin.control.controllers.linear import LinearController
from deatwin.control.design.pid import Limits, PidGains, pid
from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, linear_model
from deatwin.plant.arrays import Array, Complex

Shape = Callable[[float, float], PidGains]  # Gains of a controller from its integral gain and its time constant

_POINTS = 1500  # Number of frequencies in each part of the grid, the logarithmic and the even one
_LOWEST = 1e-5  # Lowest frequency of the grid, rad per sample
_NEAR = np.sinh(np.linspace(-6.0, 6.0, 121)) / np.sinh(6.0)  # Relative frequencies about a pole, dense near it
_LONGEST = 1000.0  # Least upper end of the controller's time constants that are tried, in samples
_TIMES = 240  # Number of time constants that are tried, before the search is refined about the best
_FILTER = 10.0  # Ratio of the derivative time to its filter's time constant


@dataclass(frozen=True, kw_only=True)
class Robustness:
    """Bounds on robustness that a loop must keep."""

    max_sensitivity: float  # Largest |1/(1 + L)|, above 1
    phase_margin_deg: float  # Least phase margin, degrees

    def __post_init__(self) -> None:
        if not 1.0 < self.max_sensitivity < np.inf:
            raise ControlError(f"max_sensitivity is {self.max_sensitivity:g}: it must be above 1 (1.2 to 2 is usual)")
        if not 0.0 <= self.phase_margin_deg < 90.0:
            raise ControlError(
                f"phase_margin_deg is {self.phase_margin_deg:g}: it must be from 0 to below 90, which an integrator has"
            )

    def is_late(self, loops: Complex) -> NDArray[np.bool_]:
        """Return where the phase of loops is within the phase margin of -180°."""
        return np.asarray(np.abs(np.angle(-loops)) < np.radians(self.phase_margin_deg))

    def largest_gain(self, loops: Complex) -> Array:
        """Return the factors (n,) by which loops (n, n_frequencies) may be multiplied before they reach a bound."""
        # At each frequency a bound is reached at the lower root k of |1 + k L|² = 1/M², or at |k L| = 1 if the phase of
        # L is within the margin of -180°. Below the smallest of these k the locus never touches the circle about -1.
        real, square = loops.real, np.abs(loops) ** 2
        outside = 1.0 - 1.0 / self.max_sensitivity**2
        under = real**2 - square * outside
        reached = (under >= 0.0) & (real < 0.0)
        root = np.full(loops.shape, np.inf)
        root[reached] = outside / (-real[reached] + np.sqrt(under[reached]))
        late = self.is_late(loops)
        root[late] = np.minimum(root[late], 1.0 / np.sqrt(square[late]))
        return np.asarray(root.min(axis=1))


@taking(linear=linear_model, command_limits=pair, crossover_Hz=number, phase_margin_deg=number, max_sensitivity=number)
def loop_shaping(
    linear: LinearModel,
    *,
    command_limits: Limits,
    crossover_Hz: float | None = None,
    phase_margin_deg: float = 60.0,
    max_sensitivity: float = 1.4,
) -> LinearController:
    """Design a sampled PI controller with the largest integral gain that satisfies the bounds on the loop.

    The integral gain rejects slow disturbances. The bounds hold for the sampled loop L, and still hold if the loop gain
    is reduced. If a crossover is given, the loop gain is one at the crossover and below one at all higher frequencies.

    Parameters
    ----------
    linear : LinearModel
        Model of the actuator with the delay of the loop (`LinearModel.in_loop`).
    command_limits : (float, float)
        Least and largest command, in its unit.
    crossover_Hz : float, optional
        Frequency at which the loop gain is one, Hz; by default that of the controller with the largest integral gain.
        Choose the crossover well inside the band that the model's recording excited; the model is not reliable outside
        this band.
    phase_margin_deg : float
        Least phase margin, degrees.
    max_sensitivity : float
        Upper bound on the sensitivity |1/(1 + L)|.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model. Its closed-loop time is the inverse of the crossover in rad/s.

    Raises
    ------
    ModelError
        If the status of the model is not OK, for example because its operating point is unstable.
    ControlError
        If an argument is invalid, if the model responds to a command in the same sample, or if the bounds cannot be met
        at `crossover_Hz`. In the last case the message gives the largest crossover at which they can be met.

    References
    ----------
    Åström, Panagopoulos & Hägglund, Automatica 34 (1998) 585-601: the largest integral gain at a bounded sensitivity.
    """

    def gains(integral: float, time: float) -> PidGains:
        return PidGains(proportional=integral * time, integral=integral)

    bounds = Robustness(max_sensitivity=max_sensitivity, phase_margin_deg=phase_margin_deg)
    return _shaped(linear, gains, bounds, command_limits, crossover_Hz)


@taking(linear=linear_model, command_limits=pair, crossover_Hz=number, phase_margin_deg=number, max_sensitivity=number)
def loop_shaping_pid(
    linear: LinearModel,
    *,
    command_limits: Limits,
    crossover_Hz: float | None = None,
    phase_margin_deg: float = 60.0,
    max_sensitivity: float = 1.4,
) -> LinearController:
    """Design a sampled PID controller with the largest integral gain that satisfies the bounds on the loop.

    The method is that of `loop_shaping`. The derivative time is fixed at a quarter of the integral time, which gives
    the controller two equal real zeros.

    Parameters
    ----------
    linear, command_limits, crossover_Hz, phase_margin_deg, max_sensitivity
        See `loop_shaping`.

    Returns
    -------
    LinearController
        Controller with the sampling time of the model. Its closed-loop time is the inverse of the crossover in rad/s.

    Raises
    ------
    ModelError, ControlError
        As in `loop_shaping`.

    References
    ----------
    Panagopoulos, Åström & Hägglund, IEE Proc. Control Theory Appl. 149 (2002) 32-40 (constrained optimisation).
    """
    h = linear.sample_time

    def gains(integral: float, time: float) -> PidGains:
        if time == 0.0:
            return PidGains(proportional=0.0, integral=integral)
        derivative_time = 0.5 * time
        return PidGains(
            proportional=2.0 * time * integral,
            integral=integral,
            derivative=time**2 * integral,
            filter_time=max(derivative_time / _FILTER, h),
        )

    bounds = Robustness(max_sensitivity=max_sensitivity, phase_margin_deg=phase_margin_deg)
    return _shaped(linear, gains, bounds, command_limits, crossover_Hz)


def _shaped(
    linear: LinearModel, gains: Shape, bounds: Robustness, command_limits: Limits, crossover_Hz: float | None
) -> LinearController:
    loops = _Loops(linear.require_in_loop(), gains, bounds)
    if crossover_Hz is None:
        integral, time = loops.fastest()
        crossover = loops.crossover(integral, time)
    else:
        crossover = 2 * np.pi * crossover_Hz
        integral, time = loops.at(crossover)
    found = gains(float(np.copysign(integral, linear.static_gain)), time)
    return pid(linear, found, command_limits, 1.0 / crossover)


class _Loops:
    """Loops of a model with controllers of one shape, on a grid of frequencies."""

    def __init__(self, linear: LinearModel, gains: Shape, bounds: Robustness) -> None:
        self.linear, self.gains, self.bounds = linear, gains, bounds
        self.omega = _frequencies(linear)
        h = linear.sample_time
        lag = -h / np.log(np.abs(linear.poles).max(initial=0.5))
        # Includes 0, a controller without a proportional part.
        self.times = np.append(0.0, np.geomspace(0.1 * h, max(_LONGEST * h, 3.0 * lag), _TIMES))

    @cached_property
    def table(self) -> Complex:
        """All loops at all frequencies, shape (n_times, n_frequencies)."""
        return self.values(self.times, self.omega)

    def values(self, times: Array, omega: Array) -> Complex:
        """Return loops with an integral gain of one, shape (n_times, n_frequencies)."""
        h, sign = self.linear.sample_time, float(np.sign(self.linear.static_gain))
        delay, model = np.exp(-1j * omega * h), sign * self.linear.response(omega)
        rows = []
        for time in times:
            top, bottom = self.gains(1.0, float(time)).law(h).feedback
            rows.append(np.polyval(top[::-1], delay) / np.polyval(bottom[::-1], delay) * model)
        return np.array(rows)

    def fastest(self) -> tuple[float, float]:
        """Return the largest integral gain within the bounds, and the time constant that belongs to it."""
        times, omega, values = self.times, self.omega, self.table
        # Times are refined between the neighbours of the best, and frequencies near the crossovers of these.
        for width in (1e-2, 1e-3, 1e-4):
            largest = self.bounds.largest_gain(values)
            best = int(np.argmax(largest))
            low, high = max(best - 1, 0), min(best + 1, times.size - 1)
            alike = [k for k in range(low, high + 1) if largest[k] > 0.5 * largest[best]]
            crossed = [self.crossover(float(largest[k]), float(times[k])) for k in alike]
            near = np.linspace(min(crossed) * (1.0 - width), max(crossed) * (1.0 + width), 81)
            omega, times = np.union1d(omega, np.minimum(near, omega[-1])), np.linspace(times[low], times[high], 41)
            values = self.values(times, omega)
        largest = self.bounds.largest_gain(values)
        best = int(np.argmax(largest))
        return float(largest[best]), float(times[best])

    def crossover(self, integral: float, time: float) -> float:
        """Return the highest frequency at which the loop gain is one, rad/s."""
        level = np.log(integral * np.abs(self.values(np.array([time]), self.omega)[0]))
        last = np.flatnonzero(level >= 0.0)[-1]
        around = slice(last, last + 2)
        return float(np.exp(np.interp(0.0, -level[around], np.log(self.omega[around]))))

    def at(self, crossover: float) -> tuple[float, float]:
        """Return the largest integral gain within the bounds for a given crossover, and its time constant."""
        nyquist = np.pi / self.linear.sample_time
        if not 0.0 < crossover < nyquist:
            raise ControlError(
                f"a crossover of {crossover / (2 * np.pi):g} Hz: it must lie between 0 and half the sampling rate, "
                f"{nyquist / (2 * np.pi):g} Hz"
            )
        found = self._reached(crossover)
        if found is None:
            raise ControlError(self._why_not(crossover))
        return found

    def _reached(self, crossover: float) -> tuple[float, float] | None:
        loops = self.values(self.times, np.array([crossover]))[:, 0]
        needed = 1.0 / np.abs(loops)  # integral gains with which the loop gain is one at the crossover
        good = (needed <= self.bounds.largest_gain(self.table)) & ~self.bounds.is_late(loops)
        good &= ~self._crosses_above(needed, crossover)
        if not good.any():
            return None
        best = int(np.argmax(np.where(good, needed, 0.0)))
        return float(needed[best]), float(self.times[best])

    def _crosses_above(self, needed: Array, crossover: float) -> NDArray[np.bool_]:
        above = self.omega > crossover * (1.0 + 1e-9)
        return np.asarray((needed[:, None] * np.abs(self.table[:, above]) > 1.0).any(axis=1))

    def _why_not(self, crossover: float) -> str:
        """Explain what the loop reaches at this crossover, and up to which crossover the bounds can be kept."""
        phase = np.unwrap(np.angle(self.table), axis=1)[:, np.searchsorted(self.omega, crossover)]
        margin = 180.0 + float(np.degrees(phase).max())
        low, high = self.omega[0], crossover
        if self._reached(low) is None:
            up_to = "the bounds can be kept at no crossover"
        else:
            for _ in range(20):
                middle = float(np.sqrt(low * high))
                low, high = (middle, high) if self._reached(middle) is not None else (low, middle)
            up_to = f"the bounds can be kept up to a crossover of {low / (2 * np.pi):.3g} Hz"
        return (
            f"a crossover of {crossover / (2 * np.pi):g} Hz with a phase margin of at least "
            f"{self.bounds.phase_margin_deg:g}° and a peak of the sensitivity of at most "
            f"{self.bounds.max_sensitivity:g} cannot be reached: the phase margin there is at most {margin:.3g}°; "
            f"{up_to}"
        )


def _frequencies(linear: LinearModel) -> Array:
    """Return frequencies, rad/s, from far below all time constants to half the sampling rate, dense near the poles."""
    poles = linear.poles[np.abs(linear.poles) > 0.0]
    grid = [np.geomspace(_LOWEST, np.pi, _POINTS), np.linspace(0.0, np.pi, _POINTS + 1)[1:]]
    for pole in poles[poles.imag > 0.0]:
        angle, width = float(np.angle(pole)), 1.0 - abs(pole)
        near = angle + 30.0 * width * _NEAR
        grid.append(near[(near > 0.0) & (near < np.pi)])
    return np.unique(np.concatenate(grid)) / linear.sample_time

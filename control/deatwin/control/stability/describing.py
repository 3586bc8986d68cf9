"""Describing functions: the gain of a nonlinearity for a sine, at the sine's own frequency.

For an input A sin(wt), N(A, w) is the first harmonic of the output by A, a complex number whose phase is that of the
output ahead of the input.

References
----------
Gelb & Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design (1968), chapters 2 and 3 and
appendix B.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import finite, function, number, numbers, require_fields, taking, whole
from deatwin.control.errors import ControlError
from deatwin.control.stability.quantising import quantiser_gain

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_GAUSS = 64  # points of a smooth half period: the integrands are entire functions
_STIFF = 20.0  # amplitude by distance from which a memory that fades in less than an amplitude has a limit of its own
_PANELS = 16  # of a quarter of the period, before any is halved
_NODES = 10  # of a panel
_HALVINGS = 48  # of a panel with a jump inside
_ACCURACY = 1e-12  # of a panel, of the largest output


@dataclass(frozen=True, kw_only=True)
class DescribingFunction(ABC):
    """A nonlinearity whose response to a sine is known in closed form; all its parameters are positive."""

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            number(value, item.name)
            if not (np.isfinite(value) and value > 0.0) and not (value == 0.0 and item.metadata.get("zero")):
                name = type(self).__name__
                raise ControlError(f"{item.name} of the {name} is {value}: it must be positive and finite")

    def __call__(self, amplitude: ArrayLike, omega: ArrayLike = 1.0) -> Complex:
        """Return N(A, w). `omega` its angular frequency, rad/s."""
        numbers(amplitude, "amplitude")
        numbers(omega, "omega")
        try:
            size, rate = np.broadcast_arrays(np.asarray(amplitude, np.float64), np.asarray(omega, np.float64))
        except ValueError:
            shapes = f"{np.shape(amplitude)} and {np.shape(omega)}"
            raise ControlError(f"amplitude and omega must broadcast; got the shapes {shapes}") from None
        if not all(np.isfinite(each).all() and np.all(each > 0.0) for each in (size, rate)):
            raise ControlError("a describing function takes positive and finite amplitudes and frequencies")
        return np.asarray(self._of(size, rate), dtype=np.complex128)

    @abstractmethod
    def _of(self, amplitude: Array, omega: Array) -> Complex | Array:
        """N(A, w) of arrays of one shape."""


def _clipped_share(ratio: Array) -> Array:
    """Gain of a saturation for a sine, at ratio = limit by amplitude."""
    x = np.clip(ratio, -1.0, 1.0)
    return np.asarray(2.0 / np.pi * (np.arcsin(x) + x * np.sqrt(1.0 - x**2)))


@dataclass(frozen=True, kw_only=True)
class Saturation(DescribingFunction):
    """Saturation: proportional up to a limit, constant beyond.

    Parameters
    ----------
    limit : float
        Magnitude of the input at which the output saturates, in the input's unit.
    slope : float
        Slope up to the limit, output unit by input unit.
    """

    limit: float
    slope: float = 1.0

    def _of(self, amplitude: Array, omega: Array) -> Array:
        return self.slope * _clipped_share(self.limit / amplitude)


@dataclass(frozen=True, kw_only=True)
class DeadZone(DescribingFunction):
    """Dead zone: zero output up to a limit, beyond it proportional to the excess.

    Parameters
    ----------
    limit : float
        Half width of the zone, in the input's unit.
    slope : float
        Slope beyond the zone, output unit by input unit.
    """

    limit: float
    slope: float = 1.0

    def _of(self, amplitude: Array, omega: Array) -> Array:
        return self.slope * (1.0 - _clipped_share(self.limit / amplitude))


@dataclass(frozen=True, kw_only=True)
class Quantiser(DescribingFunction):
    """Rounding to the nearest multiple of a step, with zero among them (mid-tread).

    Parameters
    ----------
    step : float
        Step, in the unit of input and output.
    """

    step: float

    def _of(self, amplitude: Array, omega: Array) -> Array:
        with np.errstate(over="ignore"):
            return quantiser_gain(amplitude / self.step)


@dataclass(frozen=True, kw_only=True)
class Relay(DescribingFunction):
    """Relay: the output switches between two levels when the input leaves a band about zero.

    Parameters
    ----------
    level : float
        Magnitude of the output, in its unit.
    hysteresis : float
        Half width of the band, in the input's unit; 0 for an ideal relay. A smaller sine does not switch it.
    """

    level: float
    hysteresis: float = 0.0

    def __post_init__(self) -> None:
        require_fields(self, level=number, hysteresis=number)
        if not (self.level > 0.0 and self.hysteresis >= 0.0 and np.isfinite([self.level, self.hysteresis]).all()):
            raise ControlError("a relay needs a positive level and a hysteresis of 0 or more")

    def _of(self, amplitude: Array, omega: Array) -> Complex:
        ratio = self.hysteresis / amplitude
        turn = np.sqrt(np.maximum(1.0 - ratio**2, 0.0)) - 1j * ratio
        return np.asarray(np.where(ratio <= 1.0, 4.0 * self.level / (np.pi * amplitude) * turn, 0.0))


@dataclass(frozen=True, kw_only=True)
class Backlash(DescribingFunction):
    """Play: the output follows half the gap behind the input, and stays constant while the input crosses the gap.

    Parameters
    ----------
    gap : float
        Full width of the gap, in the unit of input and output; an input that swings less does not move the output.
    """

    gap: float

    def _of(self, amplitude: Array, omega: Array) -> Complex:
        x = self.gap / amplitude
        moved = 0.5 * (1.0 + _clipped_share(1.0 - x)) - 1j * x * (2.0 - x) / np.pi
        return np.asarray(np.where(x < 2.0, moved, 0.0))


@dataclass(frozen=True, kw_only=True)
class RateLimiter(DescribingFunction):
    """Rate limiter: the output follows the input at no more than a given rate (slew rate).

    Up to A w = rate the output follows the sine. Above that it leaves the sine on a straight line where the sine is too
    fast, and joins it again. From A w = rate sqrt(1 + pi²/4) on it never joins it, and is a triangle.

    Parameters
    ----------
    rate : float
        Largest rate in both directions, in the unit of input and output per second.
    """

    rate: float

    def _of(self, amplitude: Array, omega: Array) -> Complex:
        slope = np.minimum(self.rate / (amplitude * omega), 1.0)
        triangle = slope * np.hypot(1.0, 0.5 * np.pi) < 1.0
        lag = np.arccos(np.minimum(0.5 * np.pi * slope, 1.0))
        limited = 4.0 / np.pi * slope * np.exp(-1j * lag)
        partly = _partly_limited(np.where(triangle, 1.0, slope))
        return np.asarray(np.where(triangle, limited, partly))


def _partly_limited(slope: Array) -> Complex:
    """N of a unit sine that is cut by straight lines of a slope between 0.54 and 1."""
    leave = np.pi - np.arccos(slope)  # where the sine falls as fast as the line
    height = np.sin(leave)
    low, high = leave.copy(), leave + np.pi
    for _ in range(60):  # where the line meets the sine again: only there is it above
        middle = 0.5 * (low + high)
        # Near the start both are equal to third order: what counts is the difference without what they share.
        gap = height - slope * (middle - leave) - np.sin(middle)
        apart = (gap > 0.0) | (middle - leave < 2.0 * np.arccos(slope))
        low, high = np.where(apart, middle, low), np.where(apart, high, middle)
    join = 0.5 * (low + high)

    def line(t: Array) -> Complex:
        """Integral of (height - slope (t - leave)) exp(-jt)."""
        return np.asarray(np.exp(-1j * t) * (1j * (height - slope * (t - leave)) - slope))

    def sine(t: Array) -> Complex:
        """Integral of sin(t) exp(-jt)."""
        return np.asarray(-0.25 * np.exp(-2j * t) - 0.5j * t)

    whole = line(join) - line(leave) + sine(leave + np.pi) - sine(join)
    return np.asarray(2j / np.pi * whole)


@dataclass(frozen=True, kw_only=True)
class BoucWen(DescribingFunction):
    r"""Bouc-Wen hysteretic force with n = A = beta = 1 and gamma = 0: `deatwin.plant.Hysteresis` with a beta of 1.

    The memory follows :math:`x_h\,d\zeta = dx - |dx|\,\zeta` at any speed. On a rising sine it is
    :math:`1 - (1 + \zeta_m) e^{-(x + A)/x_h}` with the turning value :math:`\zeta_m = \tanh(A/x_h)`.

    Parameters
    ----------
    force : float
        Force F_h, N. N(A) describes the force that opposes the motion; its phase leads by up to a quarter turn.
    distance : float
        Characteristic distance x_h, m.
    """

    force: float
    distance: float

    def _of(self, amplitude: Array, omega: Array) -> Complex:
        nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
        # Of large sines all but the start of the rise is +1: half of the points lie there.
        size = amplitude[..., None] / self.distance
        edge = np.where(size > _STIFF, np.arccos(np.maximum(1.0 - 2.0 * _STIFF / size, -1.0)), 0.5 * np.pi)
        total = np.zeros(amplitude.shape, dtype=np.complex128)
        for low, high in ((np.zeros_like(edge), edge), (edge, np.full_like(edge, np.pi))):
            turn = low + 0.5 * (high - low) * (nodes + 1.0)  # from the lower turning point on
            memory = 1.0 - (1.0 + np.tanh(size)) * np.exp(-size * (1.0 - np.cos(turn)))
            total += np.sum(0.5 * (high - low) * weights * memory * np.exp(-1j * (turn - 0.5 * np.pi)), axis=-1)
        return np.asarray(2j / np.pi * self.force / amplitude * total)


@taking(map=function, amplitude=numbers)
def describing_function(map: Callable[[Array], Array], amplitude: ArrayLike) -> Complex:
    """Compute the describing function of a static map, by adaptive quadrature that locates kinks and jumps.

    Parameters
    ----------
    map : callable
        Function from an array of inputs to an array of as many outputs. For a table use
        ``lambda x: numpy.interp(x, inputs, outputs)``; for a map about an operating point, ``lambda x: f(x0 + x)``.
    amplitude : array_like
        Amplitude of the sine, positive, in the input's unit.

    Returns
    -------
    ndarray of complex, of the shape of the amplitude
        First harmonic of the output divided by the amplitude, output unit by input unit; mean and other harmonics are
        ignored.

    Raises
    ------
    ControlError
        If an amplitude is not positive, or the map does not return finite numbers of the shape of its input.
    """
    sizes = np.asarray(amplitude, dtype=np.float64)
    if not (np.all(sizes > 0.0) and np.isfinite(sizes).all()):
        raise ControlError("a describing function takes positive amplitudes")
    flat = sizes.reshape(-1)
    values = [_harmonic(map, size) / size for size in flat]
    return np.asarray(np.array(values, dtype=np.complex128).reshape(sizes.shape))


def _lobatto(count: int) -> tuple[Array, Array]:
    """Nodes and weights on [-1, 1] with both ends, so that a jump beside an end is not overlooked."""
    highest = np.polynomial.Legendre.basis(count - 1)
    nodes = np.concatenate([[-1.0], np.sort(highest.deriv().roots().real), [1.0]])
    return nodes, 2.0 / (count * (count - 1) * highest(nodes) ** 2)


def _harmonic(map: Callable[[Array], Array], size: float) -> float:
    """First harmonic of map(size sin t); of a static map it is real, and t from -pi/2 to pi/2 counts twice."""
    nodes, weights = _lobatto(_NODES)

    def integral(low: Array, high: Array) -> tuple[Array, Array]:
        t = low[:, None] + 0.5 * (high - low)[:, None] * (nodes + 1.0)
        sine = np.sin(t)
        values = np.asarray(map((size * sine).reshape(-1)), dtype=np.float64)
        if values.shape != (t.size,) or not np.isfinite(values).all():
            raise ControlError("the map must return one finite number for each of its inputs")
        values = values.reshape(t.shape)
        return 0.5 * (high - low) * ((values * sine) @ weights), np.abs(values).max(axis=1)

    # A jump just below the peak of the sine is passed for a short time only: panels shrink towards the peaks.
    even, fine = np.linspace(0.0, 0.5 * np.pi, _PANELS + 1), 0.5 * np.pi - np.geomspace(1e-9, 0.1, 36)
    quarter = np.union1d(even, fine)
    edges = np.union1d(-quarter, quarter)
    low, high = edges[:-1], edges[1:]
    whole, top = integral(low, high)
    total, largest = 0.0, float(top.max())
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = np.stack([low, middle], axis=1).reshape(-1), np.stack([middle, high], axis=1).reshape(-1)
        halves, top = integral(low, high)
        largest = max(largest, float(top.max()))
        pairs = halves.reshape(-1, 2)
        open_ = np.abs(pairs.sum(axis=1) - whole) > _ACCURACY * largest
        total += float(pairs[~open_].sum())
        keep = np.repeat(open_, 2)
        low, high, whole = low[keep], high[keep], halves[keep]
        if not low.size:
            break
    return 2.0 / np.pi * (total + float(whole.sum()))


@taking(run=function, amplitude=finite, omega=finite, samples=whole(8), periods=whole(1))
def describing_function_of_run(
    run: Callable[[Array, float], Array], amplitude: float, omega: float, *, samples: int = 4096, periods: int = 4
) -> complex:
    """Compute the describing function of a system with memory, by simulating it on a sine until it repeats.

    Parameters
    ----------
    run : callable
        Simulation: a function from sampled inputs, shape (n,), and their spacing in s to the outputs, shape (n,).
    amplitude : float
        Amplitude of the sine, positive, in the input's unit.
    omega : float
        Angular frequency, rad/s.
    samples : int
        Number of samples in a period. The error of the harmonic falls with their inverse at jumps, and with the square
        of their inverse at kinks.
    periods : int
        Number of periods to simulate; the last one is evaluated.

    Returns
    -------
    complex
        First harmonic of the output divided by the amplitude, output unit by input unit.

    Raises
    ------
    ControlError
        If amplitude or frequency are not positive, there are fewer than 8 samples or no period, or the outputs are not
        finite or of another shape.
    """
    if not (amplitude > 0.0 and omega > 0.0 and samples >= 8 and periods >= 1):
        raise ControlError("it takes a positive amplitude and frequency, 8 samples in a period and a period")
    phase = 2 * np.pi * np.arange(samples * periods + 1) / samples
    outputs = np.asarray(run(amplitude * np.sin(phase), 2 * np.pi / (omega * samples)), dtype=np.float64)
    if outputs.shape != phase.shape or not np.isfinite(outputs).all():
        raise ControlError("the run must return one finite output for each input")
    last = slice(samples * (periods - 1), samples * periods)
    return complex(2j / (samples * amplitude) * np.sum(outputs[last] * np.exp(-1j * phase[last])))

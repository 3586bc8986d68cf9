"""Limit cycles that describing functions predict for a sampled loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import coefficients, function, numbers, positive, taking
from deatwin.control.errors import ControlError
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new

Describing = Callable[[Array, Array], Complex]

_STEPS = 60
_SETTLED = 1e-10  # Change of log amplitude and log frequency below which Newton's method has converged
_DIFFERENCE = 1e-6  # Step of the logarithms for central differences, which are accurate to about 1e-10
_SAME = 1e-6  # Relative difference of amplitudes and frequencies below which two cycles are the same


@dataclass(frozen=True, kw_only=True)
class LimitCycle:
    """A predicted limit cycle of a loop.

    Parameters
    ----------
    amplitude : float
        Amplitude of the oscillation at the input of the nonlinearity, in the unit of this input.
    frequency_Hz : float
        Frequency, Hz.
    stable : bool
        True if the loop returns to the cycle after a small disturbance (Loeb's criterion). From an unstable limit cycle
        the oscillation decays or grows.
    """

    amplitude: float = field(metadata=variable(about="of the sine at the input of the nonlinearity"))
    frequency_Hz: float = field(metadata=variable(unit="Hz"))
    stable: bool = field(metadata=variable(about="whether the loop returns to it"))


@dataclass(frozen=True, kw_only=True, eq=False)
class LimitCycles(Described, Sequence[LimitCycle]):
    """Predicted limit cycles of a loop in order of increasing amplitude, with the curves that predict them.

    Parameters
    ----------
    cycles : tuple of LimitCycle
        Predicted limit cycles; empty if there are none.
    omega : ndarray, shape (n_omega,)
        Angular frequencies of the search, rad/s.
    loop : ndarray of complex, shape (n_omega,)
        Frequency response L of the linear part of the loop at `omega`, in the inverse unit of `describing`.
    amplitudes : ndarray, shape (n_amplitudes,)
        Amplitudes of the search, in the unit of the nonlinearity's input.
    describing : ndarray of complex, shape (n_amplitudes,)
        Describing function N of the nonlinearity at `amplitudes`, at the frequency of the first cycle. If there is no
        cycle, the frequency is the geometric mean of the search range.
    """

    cycles: tuple[LimitCycle, ...] = field(metadata=table_along("cycle", kind=LimitCycle))
    omega: Array = field(metadata=coordinate("omega", unit="rad/s"))
    loop: Complex = field(metadata=variable("omega", about="open loop L"))
    amplitudes: Array = field(metadata=coordinate("amplitude", name="amplitude"))
    describing: Complex = field(metadata=variable("amplitude", about="describing function N"))

    DERIVED: ClassVar[Mapping[str, Metadata]] = {"n_cycles": attribute(of=len)}

    @overload
    def __getitem__(self, index: int) -> LimitCycle: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[LimitCycle, ...]: ...
    def __getitem__(self, index: int | slice) -> LimitCycle | tuple[LimitCycle, ...]:
        return self.cycles[index]

    def __len__(self) -> int:
        return len(self.cycles)

    def __iter__(self) -> Iterator[LimitCycle]:
        return iter(self.cycles)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Plot the Nyquist curve of L and -1/N(A), which meet at the limit cycles, on `ax` or new axes."""
        axes = axes_or_new(ax)
        moves = self.describing != 0.0
        inverse = -1.0 / self.describing[moves]
        meets = np.array([self._loop_at(cycle) for cycle in self.cycles])
        axes.plot(self.loop.real, self.loop.imag, color="C0", label="loop L, upper half of the circle")
        if inverse.size:
            name = f"-1/N(A), A from {self.amplitudes[0]:.3g} to {self.amplitudes[-1]:.3g}"
            axes.plot(inverse.real, inverse.imag, color="C1", label=name)
        for cycle, at in zip(self.cycles, meets, strict=True):
            name = "stable" if cycle.stable else "unstable"
            axes.plot(
                at.real,
                at.imag,
                "o",
                color="C3",
                markerfacecolor="C3" if cycle.stable else "white",
                label=f"{name}, {cycle.frequency_Hz:.3g} Hz, amplitude {cycle.amplitude:.3g}",
            )
        axes.plot(-1.0, 0.0, "+", color="k", markersize=10, label="-1")
        # The locus of an integrator is unbounded; only the surroundings of -1 and of the cycles are shown.
        reach = 1.6 * max(1.0, float(np.abs(meets).max(initial=0.0)))
        axes.set_xlim(-1.2 * reach, 0.6 * reach)
        axes.set_ylim(-reach, 0.6 * reach)
        axes.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.axvline(0.0, color="0.8", linewidth=0.8, zorder=0)
        axes.set_xlabel("real part")
        axes.set_ylabel("imaginary part")
        axes.legend(fontsize="small")
        return axes

    def _loop_at(self, cycle: LimitCycle) -> complex:
        omega = 2 * np.pi * cycle.frequency_Hz
        real, imag = (np.interp(omega, self.omega, part) for part in (self.loop.real, self.loop.imag))
        return complex(real, imag)


@taking(
    loop_numerator=coefficients,
    loop_denominator=coefficients,
    sample_time=positive,
    describing_function=function,
    amplitudes=numbers,
    omegas=numbers,
)
def limit_cycles(
    loop_numerator: ArrayLike,
    loop_denominator: ArrayLike,
    sample_time: float,
    describing_function: Describing,
    amplitudes: ArrayLike,
    omegas: ArrayLike,
) -> LimitCycles:
    """Predict limit cycles by solving ``1 + N(A, w) L(e^{jwh}) = 0``, the loop under negative feedback.

    N(A, w) is the describing function of the nonlinearity at the amplitude A and the angular frequency w, L is the
    linear part of the loop, and h is the sampling time. Solutions are located on a grid of amplitudes and frequencies,
    and refined by Newton's method.

    Parameters
    ----------
    loop_numerator, loop_denominator : array_like, shapes (n_b,) and (n_a,)
        Coefficients of z^0, z^-1, ... of L, the linear part of the loop; see `margins`. The product N L is
        dimensionless.
    sample_time : float
        Sampling time h, s.
    describing_function : callable
        Function that returns N for two arguments, an array of amplitudes and an array of angular frequencies. The
        arrays broadcast against each other.
    amplitudes : array_like, shape (n_amplitudes,)
        Amplitudes of the search, increasing and positive, in the unit of the nonlinearity's input. Two cycles
        between the same grid points may be found as one.
    omegas : array_like, shape (n_omega,)
        Angular frequencies of the search, increasing and positive, up to half the sampling rate, rad/s.

    Returns
    -------
    LimitCycles
        Predicted cycles. The method neglects all harmonics but the first; the prediction is reliable only if the loop
        attenuates higher harmonics strongly.

    Raises
    ------
    ControlError
        If there are fewer than two amplitudes or frequencies, if they do not increase or lie outside their range, or if
        `describing_function` returns an array of another shape.

    References
    ----------
    Gelb & Vander Velde, Multiple-Input Describing Functions and Nonlinear System Design (1968), sections 3.1 (the
    condition) and 3.2 (stability after Loeb).
    """
    sizes, rates = _axis(amplitudes, "amplitudes", np.inf), _axis(omegas, "omegas", np.pi / sample_time)
    top, bottom = (np.atleast_1d(np.asarray(c, dtype=np.float64)) for c in (loop_numerator, loop_denominator))

    def loop(omega: Array) -> Complex:
        shift = np.exp(-1j * omega * sample_time)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.polyval(top[::-1], shift) / np.polyval(bottom[::-1], shift))

    def logarithm(log_size: Array, log_rate: Array) -> Complex:
        """Return ln(-N L), which is zero at a limit cycle."""
        omega = np.exp(log_rate)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(-_described(describing_function, np.exp(log_size), omega) * loop(omega)))

    starts = _cells(logarithm(np.log(sizes)[:, None], np.log(rates)[None, :]))
    found = _refined(logarithm, np.log(sizes), np.log(rates), starts)
    cycles = tuple(sorted(found, key=lambda cycle: (cycle.amplitude, cycle.frequency_Hz)))
    middle = 2 * np.pi * cycles[0].frequency_Hz if cycles else float(np.sqrt(rates[0] * rates[-1]))
    return LimitCycles(
        cycles=cycles,
        omega=rates,
        loop=loop(rates),
        amplitudes=sizes,
        describing=_described(describing_function, sizes, np.full(sizes.size, middle)),
    )


def _described(describing_function: Describing, sizes: Array, omega: Array) -> Complex:
    """Return N with the shape to which amplitudes and frequencies broadcast; ControlError if N does not fit it."""
    values, shape = describing_function(sizes, omega), np.broadcast_shapes(np.shape(sizes), np.shape(omega))
    try:
        return np.array(np.broadcast_to(np.asarray(values, dtype=np.complex128), shape))
    except (TypeError, ValueError) as error:
        raise ControlError(
            f"describing_function must return numbers of the shape to which its arguments broadcast, here {shape}; "
            f"it returned {np.shape(values)}"
        ) from error


def _axis(values: ArrayLike, name: str, limit: float) -> Array:
    axis = np.array(values, dtype=np.float64)
    sound = axis.ndim == 1 and axis.size >= 2 and np.all(np.diff(axis) > 0.0) and axis[0] > 0.0
    if not sound or not np.isfinite(axis).all() or axis[-1] > limit * (1 + 1e-12):
        raise ControlError(f"{name} must be two or more increasing positive numbers, of at most {limit:g}")
    return axis


def _cells(values: Complex) -> NDArray[np.intp]:
    """Return the lower corners of cells that may contain a zero, shape (n, 2)."""
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    gain, phase = corners.real, corners.imag
    gains = (np.nanmin(gain, axis=0) <= 0.0) & (np.nanmax(gain, axis=0) >= 0.0)
    # A jump of the phase from -pi to pi is no passage through zero.
    phases = (phase.min(axis=0) <= 0.0) & (phase.max(axis=0) >= 0.0) & (np.ptp(phase, axis=0) < np.pi)
    return np.argwhere(gains & phases)


def _refined(
    logarithm: Callable[[Array, Array], Complex], sizes: Array, rates: Array, cells: NDArray[np.intp]
) -> list[LimitCycle]:
    if not len(cells):
        return []
    at = np.stack([sizes[cells[:, 0]] + sizes[cells[:, 0] + 1], rates[cells[:, 1]] + rates[cells[:, 1] + 1]]) / 2
    # The zero of a cell may lie slightly outside of it, but not outside the given axes.
    gaps = [np.stack([np.diff(sizes)[cells[:, 0]], np.diff(rates)[cells[:, 1]]])]
    low, high = at - gaps[0], at + gaps[0]
    low = np.maximum(low, np.array([[sizes[0]], [rates[0]]]))
    high = np.minimum(high, np.array([[sizes[-1]], [rates[-1]]]))
    step = np.full(at.shape, np.inf)
    for _ in range(_STEPS):
        value, slopes, determinant = _tangent(logarithm, at, low, high)
        with np.errstate(all="ignore"):
            step = np.stack(
                [
                    -(value.real * slopes[1].imag - value.imag * slopes[1].real) / determinant,
                    -(slopes[0].real * value.imag - slopes[0].imag * value.real) / determinant,
                ]
            )
        step = np.where(np.isfinite(step), step, 0.5 * (low + high) - at)
        new = np.clip(at + step, low, high)
        step, at = new - at, new
        if np.all(np.abs(step) < _SETTLED):
            break
    value, _, determinant = _tangent(logarithm, at, low, high)
    cycles: list[LimitCycle] = []
    for (size, rate), rest, turning in zip(at.T, np.abs(value), determinant, strict=True):
        if not rest < 1e-7:
            continue
        cycle = LimitCycle(
            amplitude=float(np.exp(size)), frequency_Hz=float(np.exp(rate) / (2 * np.pi)), stable=bool(turning > 0.0)
        )
        if not any(_same(cycle, other) for other in cycles):
            cycles.append(cycle)
    return cycles


def _tangent(
    logarithm: Callable[[Array, Array], Complex], at: Array, low: Array, high: Array
) -> tuple[Complex, tuple[Complex, Complex], Array]:
    """Return value, slopes by both logarithms, and Loeb's determinant, which is positive at a stable cycle."""
    # A cycle is stable if dU/dA dV/dw - dU/dw dV/dA > 0 with X = U + jV = 1 + NL; ln(-NL) is -X to first order.
    slopes = []
    for row in (0, 1):
        ends = []
        for sign in (-1.0, 1.0):
            moved = at.copy()
            moved[row] = np.clip(moved[row] + sign * _DIFFERENCE, low[row], high[row])
            ends.append((moved[row], logarithm(moved[0], moved[1])))
        with np.errstate(all="ignore"):
            slopes.append((ends[1][1] - ends[0][1]) / (ends[1][0] - ends[0][0]))
    determinant = slopes[0].real * slopes[1].imag - slopes[1].real * slopes[0].imag
    return logarithm(at[0], at[1]), (slopes[0], slopes[1]), determinant


def _same(first: LimitCycle, second: LimitCycle) -> bool:
    return bool(
        np.isclose(first.amplitude, second.amplitude, rtol=_SAME, atol=0.0)
        and np.isclose(first.frequency_Hz, second.frequency_Hz, rtol=_SAME, atol=0.0)
    )

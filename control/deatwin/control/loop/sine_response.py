"""The response of the physics plant to sines of several sizes: a describing function that holds all its physics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.errors import ControlError
from deatwin.control.loop.closed_loop import approach
from deatwin.plant.model import Plant

if TYPE_CHECKING:
    from scipy.interpolate import RegularGridInterpolator

__all__ = ["SineResponse", "sine_response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_SETTLE, _MEASURE = 2, 3  # periods before and in which is measured
_FEWEST = 40  # samples before and in which is measured: a high frequency has several periods more, a mode rings on


@dataclass(frozen=True, kw_only=True, eq=False)
class SineResponse:
    """Fundamental of the reading over that of the command, ``G(A, w)``.

    Parameters
    ----------
    amplitudes : ndarray, shape (n,)
        Of the command, in its unit.
    omega : ndarray, shape (m,)
        rad/s.
    values : ndarray of complex, shape (n, m)
        Output unit by input unit, from a command to the reading before the next; NaN where the plant failed.
    """

    amplitudes: Array
    omega: Array
    values: Complex

    def __post_init__(self) -> None:
        for array in (self.amplitudes, self.omega, self.values):
            array.setflags(write=False)

    @cached_property
    def _logarithm(self) -> RegularGridInterpolator:
        from scipy.interpolate import RegularGridInterpolator

        phase = np.unwrap(np.unwrap(np.angle(self.values), axis=1), axis=0)
        # What does not move at all has no logarithm; the last digit of one may lie outside of the grid.
        table = np.log(np.maximum(np.abs(self.values), np.finfo(float).tiny)) + 1j * phase
        axes = np.log(self.amplitudes), np.log(self.omega)
        return RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)

    def __call__(self, amplitude: ArrayLike, omega: ArrayLike) -> Complex:
        """Between the points measured, linear in logarithms; outside, at the nearest end.

        Parameters
        ----------
        amplitude : array_like
            Of the command, in its unit.
        omega : array_like
            rad/s; broadcasts with the amplitudes.

        Returns
        -------
        ndarray of complex
            Output unit by input unit.
        """
        size = np.clip(amplitude, self.amplitudes[0], self.amplitudes[-1])
        rate = np.clip(omega, self.omega[0], self.omega[-1])
        points = np.stack(np.broadcast_arrays(np.log(size), np.log(rate)), axis=-1)
        return np.exp(np.asarray(self._logarithm(points), dtype=np.complex128))


def sine_response(
    plant: Plant, operating_input: float, amplitudes: ArrayLike, omega: ArrayLike
) -> SineResponse | None:
    """Measure the response to sines, from small to large, without noise.

    Parameters
    ----------
    plant : Plant
        With its effects.
    operating_input : float
        About which the sines move, in the input's unit.
    amplitudes : array_like, shape (n,)
        Increasing and positive, in the input's unit.
    omega : array_like, shape (m,)
        Increasing and positive, below half the sampling rate, rad/s.

    Returns
    -------
    SineResponse or None
        Of the amplitudes that the plant lived through; None where it did not live through two of them.

    Raises
    ------
    ControlError
        If amplitudes or frequencies are not as described.
    """
    sizes, rates = (np.array(v, dtype=np.float64) for v in (amplitudes, omega))
    h = plant.rig.sample_time
    for name, axis, limit in (("amplitudes", sizes, np.inf), ("omega", rates, np.pi / h)):
        if axis.ndim != 1 or axis.size < 2 or not (axis[0] > 0.0 and np.all(np.diff(axis) > 0.0) and axis[-1] < limit):
            raise ControlError(f"{name} must be two or more increasing positive numbers, below {limit:.4g}")
    values = np.array([_of_frequency(plant, operating_input, sizes, float(rate)) for rate in rates]).T
    lived = int(np.argmax([*~np.all(np.isfinite(values), axis=1), True]))
    if lived < 2:
        return None
    return SineResponse(amplitudes=sizes[:lived], omega=rates, values=values[:lived])


def _of_frequency(plant: Plant, operating_input: float, sizes: Array, omega: float) -> Complex:
    """One size after another, in one run; NaN from where the plant fails."""
    h = plant.rig.sample_time
    period = 2 * np.pi / (omega * h)
    first = max(int(np.ceil(_SETTLE * period)), _FEWEST)
    clock: Array = omega * h * np.arange(first + max(round(_MEASURE * period), _FEWEST), dtype=np.float64)
    before = approach(plant, operating_input, first)
    sines: Array = operating_input + sizes[:, None] * np.sin(clock)
    run = plant.simulator.run(
        np.concatenate([before.commands, sines.ravel()]), start=before.start, sample_time=h,
        rest_command=plant.rig.start.rest_command, values=plant.free_values,
    )  # fmt: skip
    found = np.full(sizes.size, np.nan + 0j)
    readings = run.outputs[before.commands.size : -1]  # each before the command of its row
    for number in range(readings.size // clock.size):
        of_size = readings[number * clock.size :][first : clock.size]
        found[number] = _fundamental(of_size, clock[first:]) / _fundamental(sines[number, first:], clock[first:])
    return found


def _fundamental(values: Array, clock: Array) -> complex:
    """Least squares, so that periods need not be whole numbers of samples; a mean and a drift are taken out."""
    basis = np.stack([np.sin(clock), np.cos(clock), np.ones_like(clock), np.linspace(-1.0, 1.0, clock.size)], axis=1)
    sine, cosine = np.linalg.lstsq(basis, values, rcond=None)[0][:2]
    return complex(sine, cosine)

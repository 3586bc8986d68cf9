"""The plant's response to sines of several amplitudes: a describing function measured on the complete plant model."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import finite, function, instance, numbers, require_fields, taking
from deatwin.control.errors import ControlError
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.loop.closed_loop import approach
from deatwin.control.progress import Progress, part
from deatwin.ident.arguments import keep_read_only
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Rebuilt
from deatwin.plant.integrator.march import March, marched, repeated
from deatwin.plant.model import Plant
from deatwin.plant.rest import rest_state

if TYPE_CHECKING:
    from scipy.interpolate import RegularGridInterpolator

_SETTLE, _MEASURE = 2, 3  # Number of periods before the measurement, and in it
_FEWEST = 40  # Least number of samples before the measurement, and in it
_DECAY = 1e-4
"""Share of its amplitude to which each mode of the linearised plant that oscillates decays before the measurement. A mode
that does not oscillate leaves a drift, which is fitted beside the sine."""
_LONGEST = 4_000  # Largest number of samples of waiting, because a mode may have hardly any damping
_PIECE = 20_000  # Number of samples held in memory at a time


@dataclass(frozen=True, kw_only=True, eq=False)
class SineResponse(Rebuilt):
    """Response ``G(A, w)`` to a sinusoidal command of the amplitude A and the angular frequency w.

    G is the complex amplitude of the reading's fundamental divided by that of the command.

    Parameters
    ----------
    amplitudes : ndarray, shape (n,)
        Amplitudes of the command, in its unit.
    omega : ndarray, shape (m,)
        Angular frequencies, rad/s.
    values : ndarray of complex, shape (n, m)
        Response G, output unit per input unit, of the rig's readings. A reading, even a mean over the hold, counts as
        taken at the end of the hold, just before the command takes its next value. NaN if the simulation failed.

    Raises
    ------
    ControlError
        If amplitudes or frequencies are not at least two increasing positive numbers, or the values do not have the
        shape (n, m).
    """

    amplitudes: Array
    omega: Array
    values: Complex

    def __post_init__(self) -> None:
        require_fields(self, amplitudes=_increasing, omega=_increasing, values=_complex)
        keep_read_only(self, "amplitudes", "omega")
        keep_read_only(self, "values", kind=np.complex128)
        shape = self.amplitudes.size, self.omega.size
        if self.values.shape != shape:
            raise ControlError(f"values of a response have the shape {self.values.shape}: it must be {shape}")

    @cached_property
    def _logarithm(self) -> RegularGridInterpolator:
        from scipy.interpolate import RegularGridInterpolator

        phase = np.unwrap(np.unwrap(np.angle(self.values), axis=1), axis=0)
        # A response of zero has no logarithm. Rounding may put a logarithm just outside the grid.
        table = np.log(np.maximum(np.abs(self.values), np.finfo(float).tiny)) + 1j * phase
        axes = np.log(self.amplitudes), np.log(self.omega)
        return RegularGridInterpolator(axes, table, bounds_error=False, fill_value=None)

    def __call__(self, amplitude: ArrayLike, omega: ArrayLike) -> Complex:
        """Interpolate G in the logarithms of A, w and G; outside the measured range, take the nearest A and w."""
        size = np.clip(amplitude, self.amplitudes[0], self.amplitudes[-1])
        rate = np.clip(omega, self.omega[0], self.omega[-1])
        points = np.stack(np.broadcast_arrays(np.log(size), np.log(rate)), axis=-1)
        return np.exp(np.asarray(self._logarithm(points), dtype=np.complex128))


def _increasing(value: Any, name: str, below: float = np.inf) -> None:
    """Raise an error unless values can be an axis of a response."""
    numbers(value, name)
    axis = np.asarray(value, dtype=np.float64)
    if axis.ndim != 1 or axis.size < 2 or not (axis[0] > 0.0 and np.all(np.diff(axis) > 0.0) and axis[-1] < below):
        limit = "and finite" if below == np.inf else f"below {below:.4g}"
        raise ControlError(f"{name} must be two or more increasing positive numbers, {limit}")


def _complex(value: Any, name: str) -> None:
    """Raise an error unless a value is an array of real or complex numbers."""
    try:
        kind = np.asarray(value).dtype.kind
    except ValueError:
        kind = "O"
    if kind not in "iufc":
        raise ControlError(f"{name} must be an array of complex numbers")


@taking(plant=instance(Plant), operating_input=finite, amplitudes=_increasing, omega=_increasing, progress=function)
def sine_response(
    plant: Plant, operating_input: float, amplitudes: ArrayLike, omega: ArrayLike, *, progress: Progress | None = None
) -> SineResponse | None:
    """Simulate the noise-free response of a plant to sinusoidal commands of several amplitudes and frequencies.

    Parameters
    ----------
    plant : Plant
        Plant, with its effects.
    operating_input : float
        Constant input about which the sines oscillate, in its unit.
    amplitudes : array_like, shape (n,)
        Amplitudes of the sines, increasing and positive, in the input's unit.
    omega : array_like, shape (m,)
        Angular frequencies, increasing and positive, below half the sampling rate, rad/s.
    progress : callable, optional
        Callback that receives the completed share, from 0 to 1.

    Returns
    -------
    SineResponse or None
        Response at all amplitudes below the first one at which the simulation fails; None if fewer than two remain.

    Raises
    ------
    ControlError
        If an argument has the wrong type or range, or if there are fewer than two amplitudes or frequencies.
    """
    sizes, rates = (np.array(v, dtype=np.float64) for v in (amplitudes, omega))
    h = plant.rig.sample_time
    _increasing(rates, "omega", below=np.pi / h)
    ringing = _ringing(plant, operating_input)
    sines = [_Sine.of(float(rate), h, ringing) for rate in rates]
    ends = np.cumsum([0, *(sine.count for sine in sines)]) / sum(sine.count for sine in sines)
    values = np.array(
        [
            _of_frequency(plant, operating_input, sizes, sine, part(progress, float(first), float(last)))
            for sine, (first, last) in zip(sines, pairwise(ends), strict=True)
        ]
    ).T
    lived = int(np.argmax([*~np.all(np.isfinite(values), axis=1), True]))
    if lived < 2:
        return None
    return SineResponse(amplitudes=sizes[:lived], omega=rates, values=values[:lived])


@dataclass(frozen=True, kw_only=True)
class _Sine:
    """A sine in samples."""

    angle: float  # Phase step per sample, rad
    first: int  # First sample after settling, from which it is measured
    count: int

    @classmethod
    def of(cls, omega: float, sample_time: float, ringing: int) -> Self:
        period = 2 * np.pi / (omega * sample_time)
        first = max(int(np.ceil(_SETTLE * period)), _FEWEST, ringing)
        return cls(angle=omega * sample_time, first=first, count=first + max(round(_MEASURE * period), _FEWEST))

    def basis(self, number: Array) -> Array:
        """Return sine, cosine, a mean and a drift over the measured samples, shape (n, 4)."""
        clock, last = self.angle * number, self.count - 1
        drift = (2.0 * number - self.first - last) / (last - self.first)
        return np.stack([np.sin(clock), np.cos(clock), np.ones_like(clock), drift], axis=1)


def _ringing(plant: Plant, operating_input: float) -> int:
    """Return the number of samples in which the modes that oscillate have decayed."""
    poles = linearise_plant(plant, operating_input).poles
    slowest = np.max(np.abs(poles[(poles.imag != 0.0) & (np.abs(poles) < 1.0)]), initial=0.0)
    return 0 if slowest == 0.0 else int(min(np.ceil(np.log(_DECAY) / np.log(slowest)), _LONGEST))


def _of_frequency(
    plant: Plant, operating_input: float, sizes: Array, sine: _Sine, progress: Progress | None
) -> Complex:
    """Measure one amplitude after another in one run; values are NaN from the one at which the plant fails."""
    found = np.full(sizes.size, np.nan + 0j)
    ends = np.linspace(0.0, 1.0, sizes.size + 2).tolist()
    before = approach(plant, operating_input, 1)
    run = LongRun(plant, before.start)
    run.readings(before.commands)
    for number in _pieces(sine.first - 1, part(progress, *ends[:2])):
        run.readings(np.full(number.size, operating_input))
    for row, (first, last) in enumerate(pairwise(ends[1:])):
        found[row] = _gain(run, operating_input, sizes[row], sine, part(progress, first, last))
    return found


def _gain(run: LongRun, centre: float, size: float, sine: _Sine, progress: Progress | None) -> complex:
    """Return the fundamental of the reading over that of the command; NaN if the plant fails."""
    # By least squares, because periods need not be whole numbers of samples; mean and drift are removed.
    level, triangle = run.reading, np.empty((0, 6))  # without the constant part, sums lose fewer digits
    for number in _pieces(sine.count, progress):
        commands = centre + size * np.sin(sine.angle * number)
        readings = run.readings(commands)
        if readings is None:
            return complex(np.nan)
        rows = np.column_stack([sine.basis(number), readings - level, commands - centre])[number >= sine.first]
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, rows]), mode="r"))
    reading, command = np.linalg.lstsq(triangle[:4, :4], triangle[:4, 4:], rcond=None)[0][:2].T
    return complex(*reading) / complex(*command)


def _pieces(count: int, progress: Progress | None) -> Iterator[Array]:
    """Yield consecutive blocks of sample numbers; report progress whenever the next block is requested."""
    for begin in range(0, count, _PIECE):
        end = min(begin + _PIECE, count)
        yield np.arange(begin, end, dtype=np.float64)
        if progress is not None:
            progress(end / count)


class LongRun:
    """A run of a plant from rest, computed like `Simulator.run` but without a record of the signals."""

    def __init__(self, plant: Plant, start: float) -> None:
        values, command = plant.free_values, plant.rig.start.rest_command
        self._equations = equations = plant.simulator.equations
        # Repeats the compiled sample of a stepper, so that nothing is compiled for long runs alone.
        self._sample = plant.simulator.sample(values, plant.rig.sample_time)
        self._march = March(repeated(self._sample.step, "long_run", 2))
        rest, held = rest_state(equations, command, values), equations.held_inputs(command)
        self._lives, self._time, self._past = rest.found, start, np.full(equations.history, command)
        x, z, d, *_, p, c = self._march.arguments
        x[:], z[:], d[:], p[:], c[:] = rest.x, rest.z, rest.d, values, equations.constants
        self._reading = float(equations.output(rest.x, rest.z, rest.d, held, start, values, equations.constants))

    @property
    def reading(self) -> float:
        """Return the reading before the next command, without noise, SI; after a failure, the last known reading."""
        return self._reading

    def readings(self, commands: Array) -> Array | None:
        """Continue the run; return the reading before each command. Shapes: `commands` (n,); returns (n,)."""
        after = self._ends(self._inputs(commands)) if self._lives else None
        if after is None:
            self._lives = False
            return None
        before = np.concatenate([[self._reading], after[:-1]])
        self._reading, self._time = float(after[-1]), self._time + self._sample.sample_time * commands.size
        return before

    def _inputs(self, commands: Array) -> Array:
        """Return the inputs of each sample, shape (n_u, n), including past commands from the previous piece."""
        known = np.concatenate([self._past, commands])
        number = np.arange(-self._past.size, commands.size, dtype=np.float64)
        times = self._time + self._sample.sample_time * number
        inputs = self._equations.inputs(known, 0.0, times)[:, self._past.size :]
        self._past = known[commands.size :]
        return inputs

    def _ends(self, inputs: Array) -> Array | None:
        """Return the readings at the end of each sample; None if one cannot be solved."""
        steps = self._sample.steps
        parts = np.repeat(inputs, steps, axis=1)
        pieces = marched(self._march, 2, parts, self._time, self._sample.sample_time / steps)
        found = np.concatenate([np.empty(0), *(levels[:, 0] for *_, levels, _ in pieces)])
        return found[steps - 1 :: steps] if found.size == parts.shape[1] else None

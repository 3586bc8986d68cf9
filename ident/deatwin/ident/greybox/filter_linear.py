"""A plant linearised along its own free run.

x_{k+1} = F_k x_k + B_k theta + G_k d_k and e_k = C_k x_k + D_k theta + L_k d_k + v_k, where x and
theta are deviations of state and parameters, d enters at an opening, and e is measured minus simulated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox.filter_openings import STATE, Opening, places
from deatwin.ident.greybox.filter_step import LinearStep, held_ghost, linear_step, start_ghost
from deatwin.ident.greybox.parts import Part
from deatwin.plant.arrays import Array
from deatwin.plant.effects.base import Place
from deatwin.plant.equations import Equations
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter
from deatwin.plant.rest import rest_state

ALIKE = 1 - 1e-9  # Cosine of the responses to two openings above which they count as one
SPREAD = 0.3
"""Standard deviation of a calibrated parameter from the truth, as a share of its value, if a missing effect has biased
the calibration."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear:
    """A plant, linearised along its free run through one part of the recordings."""

    plant: Plant  # Linearised plant
    state_names: tuple[str, ...]  # Names of the states x, in order
    openings: tuple[Opening, ...]
    timepts: Array  # shape (n,): Clock times of the ends of samples, beginning with the start procedure, s
    residual: Array  # shape (n,): Measured minus simulated at the end of each sample, SI; NaN where no reading counts
    transition: Array  # shape (n, n_x, n_x): F_k, derivative of the states at the end of a sample by those at its start
    by_parameter: Array
    rows: Array  # shape (n, n_x): C_k, derivative of the reading at the end of a sample by the states at its start
    rows_by_parameter: Array  # shape (n, n_p): D_k, derivative of that reading by the parameters
    start_by_parameter: Array  # shape (n_x, n_p): Derivative of the state of rest by the parameters
    entering: Array  # shape (n, n_x, n_openings): G_k, derivative of the states by an input in this sample only
    rows_entering: Array  # shape (n, n_openings): L_k, derivative of the reading by that input
    states: Mapping[str, Array]
    counts: Array  # shape (n,): Readings of which `residual` is the mean: 1 or 0, more where samples were joined
    interval: float  # Interval between samples, s

    @property
    def counted(self) -> NDArray[np.bool_]:
        """True if the reading at the end of each sample is used, shape (n,)."""
        return self.counts > 0

    @cached_property
    def prior(self) -> Array:
        """Variances of the constant parameters' coordinates, shape (n_p,)."""
        # The standard deviation is the width of the range for a parameter that may be zero, else a share of the value.
        free = [self.plant.parameters[name] for name in self.plant.parameters.free]
        return np.array([_spread(parameter) ** 2 for parameter in free])

    def joined(self, size: int) -> Linear:
        """Return a model in which several samples are joined into one, with a constant unknown input."""
        if size == 1:
            return self
        n_x, n_p = self.start_by_parameter.shape
        pad = -self.residual.size % size
        still = np.broadcast_to(np.eye(n_x), (pad, n_x, n_x))
        step = _blocks(np.concatenate([self.transition, still]), size)
        drive = _blocks(_padded(np.concatenate([self.by_parameter, self.entering], axis=2), pad), size)
        rows = _blocks(_padded(self.rows, pad), size)
        feed = _blocks(_padded(np.hstack([self.rows_by_parameter, self.rows_entering]), pad), size)
        counts = _blocks(_padded(self.counts, pad), size)
        errors = _blocks(_padded(np.nan_to_num(self.residual), pad), size)
        # Derivatives of the states within a block, and of the mean of its readings, by the values at its start.
        inside = np.zeros((len(step), n_x, n_x + drive.shape[3]))
        inside[:, :, :n_x] = np.eye(n_x)
        total = np.zeros((len(step), inside.shape[2]))
        for k in range(size):
            seen = np.einsum("bi,bij->bj", rows[:, k], inside)
            seen[:, n_x:] += feed[:, k]
            total += counts[:, k, None] * seen
            inside = step[:, k] @ inside
            inside[:, :, n_x:] += drive[:, k]
        number = counts.sum(axis=1)
        share = np.maximum(number, 1)
        total /= share[:, None]
        last = np.minimum(size * np.arange(1, len(step) + 1), self.residual.size) - 1
        middle = np.add.reduceat(np.ones(self.residual.size), size * np.arange(len(step)))
        return replace(
            self,
            timepts=self.timepts[last],
            residual=np.where(number > 0, (counts * errors).sum(axis=1) / share, np.nan),
            transition=inside[:, :, :n_x],
            by_parameter=inside[:, :, n_x : n_x + n_p],
            entering=inside[:, :, n_x + n_p :],
            rows=total[:, :n_x],
            rows_by_parameter=total[:, n_x : n_x + n_p],
            rows_entering=total[:, n_x + n_p :],
            counts=number,
            interval=size * self.interval,
            states={
                name: np.add.reduceat(values, size * np.arange(len(step))) / middle
                for name, values in self.states.items()
            },
        )

    def parameter_response(self) -> Array:
        """Derivative of the readings by parameters that differ from the beginning on, shape (n, n_p)."""
        answers, x = self.rows_by_parameter.copy(), self.start_by_parameter.copy()
        for k, (row, step) in enumerate(zip(self.rows, self.transition, strict=True)):
            answers[k] += row @ x
            x = step @ x + self.by_parameter[k]
        return answers

    def response(self, number: int, entering: Array) -> Array:
        """Return the response of the readings to an unknown input. Shapes: `entering` (n, m); returns (n, m)."""
        answers = self.rows_entering[:, number, None] * entering
        drive = self.entering[:, :, number, None] * entering[:, None]
        x = np.zeros(drive.shape[1:])
        for k, (row, step) in enumerate(zip(self.rows, self.transition, strict=True)):
            answers[k] += row @ x
            x = step @ x + drive[k]
        return answers


def _spread(parameter: Parameter) -> float:
    scale = parameter.scale
    if parameter.lower <= 0 <= parameter.upper:
        return parameter.upper - parameter.lower
    return abs(SPREAD * parameter.value / scale.slope(parameter.value))


def _padded(array: Array, count: int) -> Array:
    return np.concatenate([array, np.zeros((count, *array.shape[1:]))])


def _blocks(array: Array, size: int) -> Array:
    return array.reshape(len(array) // size, size, *array.shape[1:])


def with_equations(
    plant: Plant, parts: Sequence[Part], openings: Sequence[Opening] | None = None
) -> tuple[Linear, ...]:
    """Linearise a plant with known equations along its free run."""
    chosen = tuple(places(plant) if openings is None else openings)
    step = linear_step(plant, chosen)
    return tuple(_linearised(plant, part, chosen, step) for part in parts)


def _linearised(plant: Plant, part: Part, openings: tuple[Opening, ...], step: LinearStep) -> Linear:
    timeline, rig = plant.timeline(part.experiment), plant.rig
    at = part.counted(timeline)
    n = int(at.max()) + 1
    run = plant.simulator.run(**plant.given(timeline, n))
    if not run.status.ok:
        plant.simulate(part.experiment).require()  # raises an error with the reason
    equations = step.equations
    # Plants of one structure share the step but not its values; the unknown inputs are zero.
    values = np.concatenate([plant.free_values, np.zeros(len(equations.parameters.free) - plant.free_values.size)])
    rest = rest_state(equations, rig.start.rest_command, values)
    times = timeline.start + timeline.sample_time * np.arange(n)
    inputs = equations.inputs(timeline.commands[:n], rig.start.rest_command, times, timeline.channels)
    x, z, slopes, reading_slopes = step.along(rest, inputs, timeline.start, timeline.sample_time, values, plant.steps)

    residual = np.full(n, np.nan)
    later = at >= 0  # a reading of the state of rest itself belongs to no sample
    residual[at[later]] = part.measured[later] - run.outputs[at[later] + 1]
    columns = _Columns.of(plant, equations, openings)
    slope = np.array([p.scale.slope(p.value) for p in (plant.parameters[name] for name in plant.parameters.free)])
    by_parameter = slopes[:, :, columns.free] + slopes[:, :, columns.held] @ rest.d_p[:, columns.free]
    rows_by_parameter = reading_slopes[:, columns.free] + reading_slopes[:, columns.held] @ rest.d_p[:, columns.free]
    entering, rows_entering = columns.entering(slopes, reading_slopes)
    signals = dict(zip(plant.equations.signals, run.watched if run.watched is not None else (), strict=True))
    unknowns = dict(zip((*equations.states, *equations.coordinates), np.vstack([x.T, z.T]), strict=True))
    return Linear(
        plant=plant,
        state_names=plant.equations.states,
        openings=openings,
        timepts=timeline.start + timeline.sample_time * np.arange(1.0, n + 1),
        residual=residual,
        transition=slopes[:, :, columns.start],
        by_parameter=by_parameter * slope,
        rows=reading_slopes[:, columns.start],
        rows_by_parameter=rows_by_parameter * slope,
        start_by_parameter=rest.x_p[:, columns.free] * slope,
        entering=entering,
        rows_entering=rows_entering,
        states={**signals, **unknowns, rig.input_name: timeline.commands[:n], rig.output_name: run.outputs[1:]},
        counts=np.isfinite(residual).astype(float),
        interval=timeline.sample_time,
    )


def without_repeats(linears: Sequence[Linear]) -> tuple[Linear, ...]:
    """Remove places whose effect equals that of an earlier place, up to a factor."""
    entering = [np.concatenate([x.entering, x.rows_entering[:, None]], axis=1) for x in linears]
    sizes = np.max([np.abs(e).max(axis=(0, 2)) for e in entering], axis=0)
    columns = np.concatenate([(e / np.maximum(sizes, 1e-300)[:, None]).reshape(-1, e.shape[2]) for e in entering])
    lengths = np.linalg.norm(columns, axis=0)
    alike = np.abs(columns.T @ columns) / np.maximum(np.outer(lengths, lengths), 1e-300)
    kept = [k for k in range(lengths.size) if lengths[k] > 0 and not (alike[k, :k] > ALIKE).any()]
    return tuple(
        replace(
            linear,
            openings=tuple(linear.openings[k] for k in kept),
            entering=linear.entering[:, :, kept],
            rows_entering=linear.rows_entering[:, kept],
        )
        for linear in linears
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Columns:
    """Positions of the columns of the derivatives."""

    free: list[int]
    held: list[int]
    start: list[int]
    openings: list[int]

    @classmethod
    def of(cls, plant: Plant, equations: Equations, openings: Sequence[Opening]) -> _Columns:
        number = {name: k for k, name in enumerate(equations.parameters.free)}
        name_of = {Place.PARAMETER.value: lambda o: o.signal, STATE: lambda o: start_ghost(o.signal)}
        return cls(
            free=[number[name] for name in plant.parameters.free],
            held=[number[held_ghost(name)] for name in equations.held],
            start=[number[start_ghost(name)] for name in equations.states],
            openings=[number[name_of.get(o.place, lambda o: o.name)(o)] for o in openings],
        )

    def entering(self, slopes: Array, reading_slopes: Array) -> tuple[Array, Array]:
        return slopes[:, :, self.openings], reading_slopes[:, self.openings]


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Noise and model error that explain a residual without any unknown input."""

    noise: float  # Standard deviation of the sensor's white noise, SI
    model_error: float = 0.0  # Rms of the plant's own error in the reading, SI
    memory: float = 1.0  # Correlation time of the model error, s

    @classmethod
    def of(cls, linears: Sequence[Linear], noise: float | None = None) -> Floor:
        """Return noise and model error of a plant; the model error has the time scale of the motion."""
        rig = linears[0].plant.rig
        memory = float(np.median([_correlation_time(linear) for linear in linears]))
        return cls(noise=rig.noise if noise is None else noise, model_error=rig.model_error, memory=memory)


def _correlation_time(linear: Linear) -> float:
    """Return the correlation time of the states, weighted by their part of the reading, or of the reading, s."""
    still = np.zeros(linear.residual.size) if linear.state_names else linear.states[linear.plant.rig.output_name]
    motion = sum(
        (np.abs(linear.rows[:, k]).mean() * linear.states[name] for k, name in enumerate(linear.state_names)),
        start=still,
    )
    motion = motion - motion.mean()
    if not motion.any():
        return linear.interval
    spectrum = np.abs(np.fft.rfft(motion, 2 * motion.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: motion.size]
    return linear.interval * max(1, int(np.argmax(correlation < correlation[0] / np.e)))

"""A plant linearised along its own free run.

x_{k+1} = F_k x_k + B_k theta + G_k d_k and e_k = C_k x_k + D_k theta + L_k d_k + v_k, where x and
theta are deviations of state and parameters, d enters at an opening, and e is measured minus simulated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.greybox.filter_openings import STATE, Opening, opened_equations, places
from deatwin.ident.greybox.parts import Part
from deatwin.plant.arrays import Array
from deatwin.plant.effects.base import Place
from deatwin.plant.equations import Equations
from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.collocation import step_functions
from deatwin.plant.integrator.compiled import compile_functions
from deatwin.plant.integrator.march import March
from deatwin.plant.integrator.newton import SETTLED
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter
from deatwin.plant.rest import RestState, rest_state

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


CHUNK = 200
SHORTER_STEPS = (4, 16, 64)


def start_ghost(state: str) -> str:
    """Return the name of the auxiliary parameter for a state at the start of a step."""
    return f"start.{state}"


def held_ghost(name: str) -> str:
    """Return the name of the auxiliary parameter for a held quantity."""
    return f"held.{name}"


class _Key:
    """Cache key of the compiled step: plant and places, without values that a fit changes."""

    def __init__(self, plant: Plant, openings: tuple[Opening, ...]) -> None:
        self.plant, self.openings = plant, openings
        # Plants of the same structure have the same equations, and share a compiled step.
        self._key = (plant.equations, openings)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Key) and self._key == other._key


def linear_step(plant: Plant, openings: tuple[Opening, ...]) -> LinearStep:
    """Return the compiled step; plants of the same structure share it within this process."""
    return _step(_Key(plant, openings))


@lru_cache(maxsize=8)
def _step(key: _Key) -> LinearStep:
    return LinearStep(key.plant, key.openings)


class LinearStep:
    """One sample, with its derivatives by start, held quantities and parameters."""

    # Start and held quantities are auxiliary parameters (ghosts) that occur in no equation; derivatives carried into a
    # step are unit vectors for them, and zero for the parameters.
    def __init__(self, plant: Plant, openings: Sequence[Opening]) -> None:
        ghosts = [*map(start_ghost, plant.equations.states), *map(held_ghost, plant.equations.held)]
        self.equations = opened_equations(plant, openings, ghosts)
        step = step_functions(self.equations)
        march = step.sensitive.mapaccum("linear_march", CHUNK, [0, 1], [0, 1])
        self._march = compile_functions({"linear_march": march}, in_lanes=step.in_lanes)["linear_march"]

    def along(
        self, rest: RestState, inputs: Array, start: float, sample_time: float, values: Array, steps: int = 1
    ) -> tuple[Array, Array, Array, Array]:
        """Step through a record. Shapes: `inputs` (n_u, n); returns (n, n_x), (n, n_z), (n, n_x, n_p), (n, n_p)."""
        inputs, sample_time = np.repeat(inputs, steps, axis=1), sample_time / steps
        march = March(self._march)
        x, z, dx, dd, d, u, t, h, p, c = march.arguments
        x[:], z[:], d[:], p[:], c[:] = rest.x, rest.z, rest.d, values, self.equations.constants
        free, n_x, n_d = self.equations.parameters.free, rest.x.size, rest.d.size
        n_p, first = len(free), len(free) - n_x - n_d
        dx.reshape(CHUNK, n_p, n_x)[:, first : first + n_x] = np.eye(n_x)
        dd.reshape(CHUNK, n_p, n_d)[:, first + n_x :] = np.eye(n_d)
        found: list[list[Array]] = []
        shapes = _shapes(rest, n_p)
        begin, n = 0, inputs.shape[1]
        while begin < n:
            count = min(CHUNK, n - begin)
            u[:count], u[count:] = inputs[:, begin : begin + count].T, inputs[:, begin + count - 1]
            h[:], t[:, 0] = sample_time, start + sample_time * np.arange(begin, begin + CHUNK)
            results = _advanced(march, shapes)
            good = _solved(results, count)
            if not good:
                u[:], time = inputs[:, begin], start + sample_time * begin
                results, good = [r[None] for r in self._in_shorter(march, rest, n_p, time, sample_time)], 1
            found.append([r[:good] for r in results])
            x[:], z[:] = found[-1][0][-1], found[-1][1][-1]
            begin += good
        x_all, z_all, *slopes = (np.concatenate(r) for r in zip(*found, strict=True))
        by_state, by_reading = _over_samples(slopes[0].swapaxes(1, 2), slopes[2].swapaxes(1, 2), steps, first)
        return x_all[steps - 1 :: steps], z_all[steps - 1 :: steps], by_state, by_reading[:, 0]

    def _in_shorter(self, march: March, rest: RestState, n_p: int, time: float, sample_time: float) -> list[Array]:
        """Replace a sample that cannot be solved in one step by shorter steps, and chain their derivatives."""
        _, _, _, _, _, _, t, h, _, _ = march.arguments
        n_x = rest.x.size
        first = n_p - n_x - rest.d.size
        for number in SHORTER_STEPS:
            h[:], t[:, 0] = sample_time / number, time + sample_time / number * np.arange(CHUNK)
            results = _advanced(march, _shapes(rest, n_p))
            if _solved(results, number) < number:
                continue
            rows, reading_rows = (results[i][:number].swapaxes(1, 2) for i in (2, 4))
            by_state, by_reading = _over_samples(rows, reading_rows, number, first)
            last = [r[number - 1] for r in results]
            return [last[0], last[1], by_state[0].T, last[3], by_reading[0].T, last[5]]
        raise SimulationError("the equations of a sample could not be solved where the plant was to be linearised")


def _over_samples(by_state: Array, by_reading: Array, steps: int, first: int) -> tuple[Array, Array]:
    """Return derivatives by the starts of samples, (n, n_x, n_p) and (n, 1, n_p), from those by the starts of steps."""
    n_x = by_state.shape[1]
    rows = np.concatenate([by_state, by_reading], axis=1)
    rows = rows.reshape(-1, steps, *rows.shape[1:])
    ends = rows[:, 0]
    for k in range(1, steps):
        through, direct = rows[:, k, :, first : first + n_x], rows[:, k].copy()
        direct[..., first : first + n_x] = 0.0
        ends = direct + through @ ends[:, :n_x]
    return ends[:, :n_x], ends[:, n_x:]


def _shapes(rest: RestState, n_p: int) -> list[tuple[int, ...]]:
    """Return the transposed shape of each result for one sample."""
    n_x, n_z = rest.x.size, rest.z.size
    return [(n_x,), (n_z,), (n_p, n_x), (1,), (n_p, 1), (1,)]


def _advanced(march: March, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
    """Return the results of the next samples, stacked along the first axis."""
    return [r.reshape(CHUNK, *shape).copy() for r, shape in zip(march.advance(), shapes, strict=True)]


def _solved(results: list[Array], count: int) -> int:
    """Return the number of leading samples that were solved."""
    bad = ~((results[-1][:count, 0] <= SETTLED) & np.isfinite(results[3][:count, 0]))
    return int(np.argmax(bad)) if bad.any() else count

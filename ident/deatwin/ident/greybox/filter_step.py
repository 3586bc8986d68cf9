"""One implicit step of a plant with its derivatives by the states at its start, along a free run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from deatwin.ident.greybox.filter_openings import Opening, opened_equations
from deatwin.plant.arrays import Array
from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.collocation import step_functions
from deatwin.plant.integrator.compiled import compile_functions
from deatwin.plant.integrator.march import March
from deatwin.plant.integrator.newton import SETTLED
from deatwin.plant.model import Plant
from deatwin.plant.rest import RestState

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
        """Step through a record, each sample in some steps. Shapes: `inputs` (n_u, n); `values` (n_p,); returns, of the
        ends of samples, (n, n_x), (n, n_z), (n, n_x, n_p), (n, n_p)."""
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
    """Return derivatives by the states at the starts of samples, (n, n_x, n_p) and (n, 1, n_p), from those of steps by
    their own starts; the derivatives by the start begin at column `first`.
    """
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

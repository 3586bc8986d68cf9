"""Linearisation of one sample of a plant about rest, by the implicit function theorem on its step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.plant.branch import branch_step
from deatwin.plant.copies import Frozen
from deatwin.plant.equations import Equations
from deatwin.plant.errors import DataError
from deatwin.plant.integrator.collocation import radau
from deatwin.plant.integrator.parts import Step
from deatwin.plant.model import Plant
from deatwin.plant.rest import in_tension, rest_state
from deatwin.plant.rest_path import NoRestError, Point, followed, inputs_at, sample_functions, settled

RANK = 1e-12
"""Singular value of the equations of rest, relative to the largest, below which a combination of them determines
nothing: rounding leaves some 1e-15, and each equation has a scale of its own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SmallSignal(Frozen):
    """Deviations from rest by samples: x_{k+1} = A x_k + sum_l B_l u_{k-l}, y_k = C x_k + sum_l D_l u_{k-l}."""

    a: np.ndarray  # shape (n_x, n_x): Dynamics of the states, each in units of its typical size
    b: np.ndarray
    c: np.ndarray  # shape (n_x,): Reading by state, SI per typical size
    d: np.ndarray  # shape (1 + history,): Reading by command, SI per unit of the command
    reading: float  # Reading at rest, SI
    static_gain: float


def small_signals(
    plant: Plant, commands: Sequence[float] | np.ndarray, *, values: np.ndarray | None = None, time: float = 0.0
) -> tuple[SmallSignal | None, ...]:
    """Linearise a sample of a plant about rest at `commands` (n,); quantities held at the start stay held."""
    wanted = np.atleast_1d(np.asarray(commands, dtype=float))
    if not (wanted.ndim == 1 and np.isfinite(wanted).all() and np.isfinite(time)):
        raise DataError(f"commands = {commands} and time = {time} must be finite numbers")
    equations, start = plant.equations, plant.rig.start.rest_command
    known = plant.free_values if values is None else np.asarray(values, dtype=float)
    found: list[SmallSignal | None] = [None] * wanted.size
    try:
        first = rest_state(equations, start, known)
    except (RuntimeError, np.linalg.LinAlgError):
        return tuple(found)
    if not first.found:
        return tuple(found)
    step = branch_step(equations, first, start, known, np.inf)
    away = np.argsort(np.abs(wanted - start), kind="stable")
    for side in (away[wanted[away] >= start], away[wanted[away] < start]):
        at, here = start, np.concatenate([first.x, first.z])
        for place in side.tolist():
            try:
                here = followed(step, here, at, float(wanted[place]))
                at = float(wanted[place])
                point = settled(equations, here, first.d, at, known, time)
                if not in_tension(equations, *point, time):  # its equations do not hold; a rig may not watch it
                    break
                found[place] = _differentiated(plant, point, time)
            # CasADi and NumPy raise errors where Newton's method left the range of stretches: no slope is finite there.
            except (NoRestError, RuntimeError, np.linalg.LinAlgError):
                break
    return tuple(found)


def _differentiated(plant: Plant, point: Point, time: float) -> SmallSignal:
    """Return one sample from rest, with its derivatives by the states at its start and by the commands."""
    equations, sample_time, (here, held, inputs, values) = plant.equations, plant.rig.sample_time, point
    functions, n_x, width = sample_functions(equations), len(equations.states), sample_time / plant.steps
    parts = [part for k in range(plant.steps) for part in equations.steps(k * width, width)]
    step, *others = [_step_derivatives(equations, point, time, part) for part in parts]
    for later in others:
        step = np.hstack([later[:, :n_x] @ step[:n_x, :n_x], later[:, :n_x] @ step[:n_x, n_x:] + later[:, n_x:]])
    step[:, :n_x] = step[:, :n_x] @ equations.begun

    seen = inputs_at(equations, inputs, time - sample_time, time)
    reading = functions.output(here, held, seen, time, values, equations.constants)
    level, by_end, by_last = (np.asarray(v) for v in reading)
    through = (by_end * equations.scale @ step).ravel()
    if not (np.isfinite(step).all() and np.isfinite(through).all() and np.isfinite(level).all()):
        raise NoRestError
    return SmallSignal(
        a=step[:n_x, :n_x].copy(),
        b=step[:n_x, n_x:].copy(),
        c=through[:n_x].copy(),
        d=through[n_x:] + by_last.ravel()[: 1 + equations.history],
        reading=float(level.item()),
        static_gain=_static_gain(equations, point, time, sample_time),
    )


def _static_gain(equations: Equations, point: Point, time: float, sample_time: float) -> float:
    """Return the slope of the reading by a slow command."""
    # States that the equations of rest leave open, such as the memory of hysteresis, keep their time integral.
    (here, held, inputs, values), functions, count = point, sample_functions(equations), 1 + equations.history
    inputs = inputs_at(equations, inputs, time - sample_time, time)
    arguments = (here, held, inputs, time, values, equations.constants)
    by_unknowns, by_inputs = (np.asarray(v) for v in functions.resting(*arguments)[1:])
    scaled, pushed = by_unknowns * equations.scale, -by_inputs[:, :count].sum(axis=1)
    rows = np.abs(scaled).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    scaled, pushed = scaled / rows[:, None], pushed / rows
    left, sizes, _ = np.linalg.svd(scaled)
    silent = left[:, sizes <= RANK * sizes.max(initial=0.0)]
    mass = np.zeros(here.size)
    mass[: len(equations.states)] = np.asarray(equations.mass(values, equations.constants)).ravel()
    conserved = (silent / rows[:, None]).T * (mass * equations.scale)
    conserved = conserved / np.maximum(np.linalg.norm(conserved, axis=1, keepdims=True), np.finfo(float).tiny)
    moved, _, rank, _ = np.linalg.lstsq(
        np.vstack([scaled, conserved]), np.append(pushed, np.zeros(len(conserved))), rcond=RANK
    )
    drifts = np.abs(silent.T @ pushed).max(initial=0.0) > RANK * max(float(np.abs(pushed).max(initial=0.0)), 1.0)
    if drifts or rank < here.size:
        return float("nan")
    _, by_end, by_last = (np.asarray(v) for v in functions.output(*arguments))
    return float((by_end.ravel() * equations.scale) @ moved + by_last.ravel()[:count].sum())


def _step_derivatives(equations: Equations, point: Point, time: float, step: Step) -> np.ndarray:
    """Return derivatives of the scaled unknowns after a step, by the states at its start and by the commands."""
    here, held, inputs, values = point
    functions, constants, n_x = sample_functions(equations), equations.constants, len(equations.states)
    nodes, matrix = radau(equations.stages)
    inverse, n, count = np.linalg.inv(matrix), here.size, 1 + equations.history
    mass = np.zeros(n)
    mass[:n_x] = np.asarray(equations.mass(values, constants)).ravel()
    weight = np.where(np.arange(n) < n_x, step.width, 1.0)[:, None]
    used = nodes if equations.sample_start is not None else nodes[-1:]
    begun = [time - step.begin - node * step.width for node in used]
    known = [inputs_at(equations, inputs, begin, begin + step.middle) for begin in begun]
    slopes = [functions.dynamics(here, held, u, time, values, constants)[1:] for u in known]
    slopes *= equations.stages // len(slopes)

    system: np.ndarray = np.kron(inverse, np.diag(mass))
    for i, (by_unknowns, _) in enumerate(slopes):
        system[i * n : (i + 1) * n, i * n : (i + 1) * n] -= weight * np.asarray(by_unknowns)
    system = system * np.tile(equations.scale, equations.stages)  # columns: unknowns in units of their scale
    by_start = np.kron(inverse.sum(axis=1)[:, None], np.diag(mass * equations.scale)[:, :n_x])
    by_commands = np.vstack([weight * np.asarray(by_inputs)[:, :count] for _, by_inputs in slopes])
    rows = np.abs(system).max(axis=1, keepdims=True, initial=0.0)
    return np.linalg.solve(system / rows, np.hstack([by_start, by_commands]) / rows)[-n:]

"""States of rest followed from the start of an experiment to other commands, with held quantities kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from deatwin.plant.branch import FURTHEST, Step, branch_step
from deatwin.plant.equations import Equations
from deatwin.plant.integrator.stages import REVERSE
from deatwin.plant.model import Plant
from deatwin.plant.rest import rest_state, resting, scaled

HALVINGS = 14  # Largest number of halvings of the way from rest, with which pull-in is found to a part in 16000
UPDATES = 20
SETTLED = 1e-12  # Relative change of the unknowns that ends Newton's method, which is not differentiated


def rest_under(plant: Plant, command: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return the state in which a plant rests after it was brought to a constant command. Shapes: returns (n_x,)."""
    equations, start, values = plant.equations, plant.rig.start.rest_command, plant.free_values
    first = rest_state(equations, start, values)
    if not first.found:
        return None
    try:
        step = branch_step(equations, first, start, values, np.inf)
        here = followed(step, np.concatenate([first.x, first.z]), start, command)
        here = settled(equations, here, first.d, command, values, 0.0)[0]
    except (NoRestError, RuntimeError):
        return None
    n_x = len(equations.states)
    return here[:n_x], here[n_x:], first.d


def held_rest(
    equations: Equations, here: np.ndarray, held: np.ndarray, command: float, values: np.ndarray
) -> np.ndarray:
    """Move an equilibrium (n_x + n_z,) to where it lies with quantities `held` (n_d,) since the start."""
    if not held.size:
        return here
    try:
        return settled(equations, here, held, command, values, 0.0)[0]
    except (NoRestError, RuntimeError):
        return here


class NoRestError(Exception):
    """Raised if no state of rest can be reached."""


Point = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Unknowns (states and coordinates), held quantities, inputs, free parameters."""


def settled(
    equations: Equations, here: np.ndarray, held: np.ndarray, command: float, values: np.ndarray, time: float
) -> Point:
    """Let the state of rest adapt, step by step, to its clock time and to quantities held since the start."""
    n_x = len(equations.states)
    own = np.asarray(equations.hold(here[:n_x], here[n_x:], values, equations.constants)).ravel()
    done, step = 0.0, 1.0
    while done < 1.0:
        share = min(done + step, 1.0)
        inputs = inputs_at(equations, equations.held_inputs(command), share * time, share * time)
        point = (here, own + share * (held - own), inputs, values)
        there = _solved(equations, point, share * time)
        # New held quantities also rescale a charge, which is stored in kV, so that it may move further than the film.
        if there is not None and np.max(np.abs(there - here) / equations.scale, initial=0.0) < 4 * FURTHEST:
            here, done, step = there, share, 2 * step
        elif step > 1 / 2**HALVINGS:
            step /= 2
        else:
            raise NoRestError
    return here, held, inputs, values


def _solved(equations: Equations, point: Point, time: float) -> np.ndarray | None:
    """Find an equilibrium by Newton's method from the unknowns of a nearby one; None if it fails."""
    here, *known = point
    evaluate = sample_functions(equations).resting
    for _ in range(UPDATES):
        value, slope, _ = (np.asarray(v) for v in evaluate(here, *known[:2], time, known[2], equations.constants))
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        kept, step = resting(equations), np.zeros(here.size)
        matrix, rows = scaled(equations, slope, kept)
        step[kept] = np.linalg.lstsq(matrix, value.ravel()[kept] / rows, rcond=None)[0]
        here = here - equations.scale * step
        if np.max(np.abs(step), initial=0.0) < SETTLED:
            return here
    return None


def followed(step: Step, here: np.ndarray, start: float, command: float) -> np.ndarray:
    """Follow an equilibrium to another command; raise NoRestError if the branch ends first, in a fold or by snapping."""
    at, width = start, command - start
    while at != command:
        target = command if abs(command - at) <= abs(width) else at + width
        if (there := step(target, here)) is not None:
            at, here = target, there
        elif abs(width) > abs(command - start) / 2**HALVINGS:
            width /= 2
        else:
            raise NoRestError
    return here


def inputs_at(equations: Equations, inputs: np.ndarray, begin: float, middle: float) -> np.ndarray:
    """Return the inputs of a sample that begins at a time, s, and of a step in it with a given middle."""
    moved = equations.with_middle(inputs, middle)
    if equations.sample_start is not None:
        moved[equations.sample_start] = begin
    return moved


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleFunctions:
    """Functions of a sample: `dynamics` ``(w, d, u, t, p, c) -> ((f; g), by w, by u)``, `resting`, `output`."""

    dynamics: ca.Function
    resting: ca.Function
    output: ca.Function


@lru_cache(maxsize=64)
def sample_functions(equations: Equations) -> SampleFunctions:
    arguments, split = equations.symbols()
    w, _, u, *_ = arguments
    f, y = ca.cse(equations.dynamics(*split)), equations.output(*split)
    dynamics = resting = ca.Function("small_dynamics", arguments, _with_slopes(f, w, u))
    if equations.integrals or equations.shifts:
        ends = ca.SX(f)
        for row, width in zip(equations.begins_at_zero.tolist(), equations.integrals.values(), strict=True):
            ends[row] -= w[row] / width
        for name, source in equations.shifts.items():
            row, other = (equations.states.index(each) for each in (name, source))
            ends[row] += w[other] - w[row]
        resting = ca.Function("small_resting", arguments, _with_slopes(ends, w, u))
    return SampleFunctions(
        dynamics=dynamics, resting=resting, output=ca.Function("small_output", arguments, _with_slopes(y, w, u))
    )


def _with_slopes(value: ca.SX, w: ca.SX, u: ca.SX) -> list[ca.SX]:
    by_w, by_u = (ca.densify(ca.jacobian(value, symbol, REVERSE)) for symbol in (w, u))
    return list(ca.cse([ca.densify(value), by_w, by_u]))

"""One sample of a plant for small deviations from rest, as the matrices of a sampled linear system.

The step over a sample, :math:`(x, u) \\to (x^+, y)`, solves the collocation equations

.. math:: M\\sum_j (A^{-1})_{ij}(X_j - x) = h f(X_i, Z_i, u, t + c_i h), \\qquad 0 = g(X_i, Z_i, u, t + c_i h)

so that its exact derivatives follow from the implicit function theorem: one linear system, with a right side for each
state and each input.

References
----------
Hairer & Wanner, Solving Ordinary Differential Equations II (1996), section IV.5, doi:10.1007/978-3-642-05221-7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.errors import DataError
from deatwin.plant.integrator.collocation import STAGES, radau
from deatwin.plant.integrator.parts import Step
from deatwin.plant.integrator.stages import REVERSE
from deatwin.plant.rest import TENSION, rest_state, resting

if TYPE_CHECKING:
    from deatwin.plant.model import Plant


FURTHEST = 0.25
"""From one command to the next no unknown moves further, in units of its scale: a film that snaps does."""
HALVINGS = 14
"""How often the way from rest is halved before there counts as none: pull-in is then found to a part in 16000."""
UPDATES = 20
SETTLED = 1e-12
"""Change of the unknowns, against their scale, that ends Newton's method; nothing is differentiated through it."""
RANK = 1e-12
"""Singular value of the equations of rest, against the largest, below which a combination of them says nothing:
rounding leaves some 1e-15, and each equation has a scale of its own."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SmallSignal:
    r"""Deviations from rest, sample by sample.

    .. math:: x_{k+1} = A x_k + \sum_l B_l u_{k-l}, \qquad y_k = C x_k + \sum_l D_l u_{k-l}
    """

    a: np.ndarray  # shape (n_x, n_x): Of the states, each in units of its typical size
    b: np.ndarray
    c: np.ndarray  # shape (n_x,): SI by typical size
    d: np.ndarray  # shape (1 + history,): SI by unit of the command
    reading: float  # At rest, SI
    static_gain: float

    def __post_init__(self) -> None:
        for name in ("a", "b", "c", "d"):
            getattr(self, name).setflags(write=False)


def small_signals(
    plant: Plant, commands: Sequence[float] | np.ndarray, *, values: np.ndarray | None = None, time: float = 0.0
) -> tuple[SmallSignal | None, ...]:
    """Linearise one sample of a plant about its states of rest at constant commands. `plant` with its sample time;
    `commands` (n,); `values` (n_p,).
    """
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
    away = np.argsort(np.abs(wanted - start), kind="stable")
    for side in (away[wanted[away] >= start], away[wanted[away] < start]):
        at, here = start, np.concatenate([first.x, first.z])
        for place in side.tolist():
            try:
                here = _followed(equations, here, at, float(wanted[place]), known)
                at = float(wanted[place])
                point = _settled(equations, here, first.d, at, known, time)
                _require_tension(equations, point, time)
                found[place] = _differentiated(equations, point, time, plant.rig.sample_time)
            # CasADi's and numpy's: where Newton left the range of stretches there is no slope, or no finite one.
            except (_NoRest, RuntimeError, np.linalg.LinAlgError):
                break
    return tuple(found)


def rest_under(plant: Plant, command: float, *, time: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Find the state in which a plant rests once it was brought from its start to a constant command. Shapes: returns
    (n_x,).
    """
    equations, start, values = plant.equations, plant.rig.start.rest_command, plant.free_values
    first = rest_state(equations, start, values)
    if not first.found:
        return None
    try:
        here = _followed(equations, np.concatenate([first.x, first.z]), start, command, values)
        here = _settled(equations, here, first.d, command, values, time)[0]
    except (_NoRest, RuntimeError):
        return None
    n_x = len(equations.states)
    return here[:n_x], here[n_x:], first.d


def held_rest(
    equations: Equations, here: np.ndarray, held: np.ndarray, command: float, values: np.ndarray
) -> np.ndarray:
    """Move an equilibrium to where it is with what was held since the start, such as the zero of the sensor. Shapes:
    `here` (n_x + n_z,); `held` (n_d,); `values` (n_p,); returns (n_x + n_z,).
    """
    if not held.size:
        return here
    try:
        return _settled(equations, here, held, command, values, 0.0)[0]
    except (_NoRest, RuntimeError):
        return here


class _NoRest(Exception):
    """There is no state of rest in reach."""


Point = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Unknowns (states and coordinates), held quantities, inputs, free parameters."""


def _settled(
    equations: Equations, here: np.ndarray, held: np.ndarray, command: float, values: np.ndarray, time: float
) -> Point:
    """Let the rest settle with what is held since the start of the experiment, and at its clock time, step by step."""
    n_x = len(equations.states)
    own = np.asarray(equations.hold(here[:n_x], here[n_x:], values, equations.constants)).ravel()
    done, step = 0.0, 1.0
    while done < 1.0:
        share = min(done + step, 1.0)
        inputs = _inputs(equations, equations.held_inputs(command), share * time, share * time)
        point = (here, own + share * (held - own), inputs, values)
        there = _solved(equations, point, share * time)
        # What is held changes the meaning of a charge, which lies in kV: it may move further than the film.
        if there is not None and np.max(np.abs(there - here) / equations.scale, initial=0.0) < 4 * FURTHEST:
            here, done, step = there, share, 2 * step
        elif step > 1 / 2**HALVINGS:
            step /= 2
        else:
            raise _NoRest
    return here, held, inputs, values


def _solved(equations: Equations, point: Point, time: float) -> np.ndarray | None:
    """Unknowns at which nothing moves, by Newton's method from those of a point nearby; None where it fails."""
    here, *known = point
    evaluate = _functions(equations).dynamics
    for _ in range(UPDATES):
        value, slope, _ = (np.asarray(v) for v in evaluate(here, *known[:2], time, known[2], equations.constants))
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        kept, step = resting(equations), np.zeros(here.size)
        step[kept] = _scaled_solution(slope[np.ix_(kept, kept)], value.ravel()[kept], equations.scale[kept])
        here = here - equations.scale * step
        if np.max(np.abs(step), initial=0.0) < SETTLED:
            return here
    return None


def _require_tension(equations: Equations, point: Point, time: float) -> None:
    """A film without tension wrinkles: the equations do not hold. A rig that does not watch it has none to lose."""
    if TENSION in equations.signals:
        (here, held, inputs, values), n_x = point, len(equations.states)
        seen = equations.watched(here[:n_x], here[n_x:], held, inputs, time, values, equations.constants)
        if float(seen[equations.signals.index(TENSION)]) < 0.0:
            raise _NoRest


def _followed(equations: Equations, here: np.ndarray, start: float, command: float, values: np.ndarray) -> np.ndarray:
    """The equilibrium under another command, unless the branch ends before, in a fold or by snapping."""
    at, step, sign = start, command - start, _sign(equations, here, start, values)
    while at != command:
        target = command if abs(command - at) <= abs(step) else at + step
        tried = rest_state(equations, target, values, guess=here)
        there = np.concatenate([tried.x, tried.z])
        near = tried.found and np.max(np.abs(there - here) / equations.scale, initial=0.0) < FURTHEST
        if near and _sign(equations, there, target, values) == sign:
            at, here = target, there
        elif abs(step) > abs(command - start) / 2**HALVINGS:
            step /= 2
        else:
            raise _NoRest
    return here


def _sign(equations: Equations, here: np.ndarray, command: float, values: np.ndarray) -> float:
    """Of the determinant of the equations of rest: it changes in a fold."""
    inputs = equations.held_inputs(command)
    slope = np.asarray(_functions(equations).rest_slope(here, inputs, values, equations.constants))
    kept = resting(equations)
    return float(np.linalg.slogdet(slope[np.ix_(kept, kept)]).sign)


def _scaled_solution(slope: np.ndarray, value: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Least step, in units of the scale: what may stay anywhere, as a memory at rest, stays where it is."""
    scaled = slope * scale
    rows = np.abs(scaled).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(scaled / rows[:, None], value / rows, rcond=None)[0])


def _inputs(equations: Equations, inputs: np.ndarray, begin: float, middle: float) -> np.ndarray:
    """Inputs of a sample that begins at a time, s, and of a step in it with its middle at another."""
    moved = equations.with_middle(inputs, middle)
    if equations.sample_start is not None:
        moved[equations.sample_start] = begin
    return moved


def _differentiated(equations: Equations, point: Point, time: float, sample_time: float) -> SmallSignal:
    """The sample from rest, where all stages rest, and its derivatives by the states at its start and by commands."""
    here, held, inputs, values = point
    functions, n_x = _functions(equations), len(equations.states)
    step, *second = [_step_derivatives(equations, point, time, part) for part in equations.steps(0.0, sample_time)]
    for later in second:
        step = np.hstack([later[:, :n_x] @ step[:n_x, :n_x], later[:, :n_x] @ step[:n_x, n_x:] + later[:, n_x:]])

    seen = _inputs(equations, inputs, time - sample_time, time)
    reading = functions.output(here, held, seen, time, values, equations.constants)
    level, by_end, by_last = (np.asarray(v) for v in reading)
    through = (by_end * equations.scale @ step).ravel()
    if not (np.isfinite(step).all() and np.isfinite(through).all() and np.isfinite(level).all()):
        raise _NoRest
    return SmallSignal(
        a=step[:n_x, :n_x].copy(),
        b=step[:n_x, n_x:].copy(),
        c=through[:n_x].copy(),
        d=through[n_x:] + by_last.ravel()[: 1 + equations.history],
        reading=float(level.item()),
        static_gain=_static_gain(equations, point, time, sample_time),
    )


def _static_gain(equations: Equations, point: Point, time: float, sample_time: float) -> float:
    """Slope of the reading by the command, along the states of rest that a slow command goes through.

    Where a combination of the equations says nothing, as of the memory of hysteresis that follows the motion, its
    time integral is conserved, and says how that state moves.
    """
    (here, held, inputs, values), functions, count = point, _functions(equations), 1 + equations.history
    inputs = _inputs(equations, inputs, time - sample_time, time)
    arguments = (here, held, inputs, time, values, equations.constants)
    by_unknowns, by_inputs = (np.asarray(v) for v in functions.dynamics(*arguments)[1:])
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
    """Derivatives of the unknowns after a step, by the states at its start and by the commands, in units of the
    scale.
    """
    here, held, inputs, values = point
    functions, constants, n_x = _functions(equations), equations.constants, len(equations.states)
    nodes, matrix = radau(STAGES)
    inverse, n, count = np.linalg.inv(matrix), here.size, 1 + equations.history
    mass = np.zeros(n)
    mass[:n_x] = np.asarray(equations.mass(values, constants)).ravel()
    weight = np.where(np.arange(n) < n_x, step.width, 1.0)[:, None]
    used = nodes if equations.sample_start is not None else nodes[-1:]
    begun = [time - step.begin - node * step.width for node in used]
    known = [_inputs(equations, inputs, begin, begin + step.middle) for begin in begun]
    slopes = [functions.dynamics(here, held, u, time, values, constants)[1:] for u in known]
    slopes *= STAGES // len(slopes)

    system: np.ndarray = np.kron(inverse, np.diag(mass))
    for i, (by_unknowns, _) in enumerate(slopes):
        system[i * n : (i + 1) * n, i * n : (i + 1) * n] -= weight * np.asarray(by_unknowns)
    system = system * np.tile(equations.scale, STAGES)  # columns: unknowns in units of their scale
    by_start = np.kron(inverse.sum(axis=1)[:, None], np.diag(mass * equations.scale)[:, :n_x])
    by_commands = np.vstack([weight * np.asarray(by_inputs)[:, :count] for _, by_inputs in slopes])
    rows = np.abs(system).max(axis=1, keepdims=True, initial=0.0)
    return np.linalg.solve(system / rows, np.hstack([by_start, by_commands]) / rows)[-n:]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Functions:
    """Derivatives that one sample needs, evaluated by CasADi's virtual machine: nothing is compiled.

    `dynamics`: ``(w, d, u, t, p, c) -> ((f; g), by w, by u)``; `output` likewise of the reading; `rest_slope`:
    ``(w, u, p, c) ->`` derivative of the equations of rest.
    """

    dynamics: ca.Function
    output: ca.Function
    rest_slope: ca.Function


@lru_cache(maxsize=64)
def _functions(equations: Equations) -> _Functions:
    n_x = len(equations.states)
    w, d = ca.SX.sym("w", equations.scale.size), ca.SX.sym("d", len(equations.held))
    u, t = ca.SX.sym("u", equations.held_inputs(0.0).size), ca.SX.sym("t")
    p, c = ca.SX.sym("p", len(equations.parameters.free)), ca.SX.sym("c", equations.constants.size)
    arguments, split = [w, d, u, t, p, c], [w[:n_x, :], w[n_x:, :], d, u, t, p, c]
    f, y = ca.cse(equations.dynamics(*split)), equations.output(*split)
    rest = equations.rest(w[:n_x, :], w[n_x:, :], u, p, c)
    return _Functions(
        dynamics=ca.Function("small_dynamics", arguments, _with_slopes(f, w, u)),
        output=ca.Function("small_output", arguments, _with_slopes(y, w, u)),
        rest_slope=ca.Function("small_rest", [w, u, p, c], [ca.densify(ca.jacobian(rest, w))]),
    )


def _with_slopes(value: ca.SX, w: ca.SX, u: ca.SX) -> list[ca.SX]:
    by_w, by_u = (ca.densify(ca.jacobian(value, symbol, REVERSE)) for symbol in (w, u))
    return list(ca.cse([ca.densify(value), by_w, by_u]))

"""The state of rest of a plant, and how it moves with the parameters.

A *free integrator*, a state on which no equation of rest depends, keeps the rig's guess.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.safe_read import clipped

NO_REST = "no state of rest was found: the film is too soft for its load, or a parameter is far off"

UPDATES = 60
TENSION = "tension"  # Signal in which a rig watches the least tension of its film
CONTINUATION = 20
HALVINGS = 5  # Largest number of halvings of a continuation step without an equilibrium
REACH, GROWTH = 0.1, 1.3
"""Longest first step of Newton's method relative to the unknowns' scale, which keeps it inside the material's range of
stretches, and the factor by which this length grows."""
SETTLED = 1e-11
UNBALANCED = 1e-6
"""Largest residual of an equation of rest, relative to its change when an unknown moves by its scale. About `SETTLED`
remains at an equilibrium that was found; a whole load remains if there is none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RestState:
    """Equilibrium under a constant command."""

    found: bool  # True if an equilibrium was found
    x: np.ndarray  # States, SI
    z: np.ndarray  # Coordinates, SI
    d: np.ndarray  # Held quantities, SI
    x_p: np.ndarray  # shape (n_x, n_p): Derivatives of the states by the free parameters
    z_p: np.ndarray  # shape (n_z, n_p): Derivatives of the coordinates
    d_p: np.ndarray  # shape (n_d, n_p): Derivatives of the held quantities
    fault: str = ""  # Reason why no equilibrium was found, in one line; empty if one was


def rest_state(
    equations: Equations, command: float, values: np.ndarray, *, guess: np.ndarray | None = None
) -> RestState:
    """Find the state of rest by a damped Newton method. Shapes: `values` (n_p,); `guess` (n_x + n_z,)."""
    functions, kept = _functions(equations), resting(equations)
    constants, inputs = equations.constants, equations.held_inputs(command)
    w = np.asarray(equations.guess(values, constants)).ravel() if guess is None else guess
    fault, reach, last, closest = NO_REST, REACH, np.inf, np.full(kept.size, np.inf)
    for number in range(UPDATES):
        residual, jacobian = (np.asarray(v) for v in functions.residual(w, inputs, values, constants))
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            fault = fault if number else _undefined_at_guess(equations, residual.ravel(), jacobian, w, values)
            break
        matrix, rows = scaled(equations, jacobian, kept)
        step, left = np.zeros(w.size), residual.ravel()[kept] / rows
        closest = np.minimum(closest, np.abs(left))
        step[kept] = equations.scale[kept] * np.linalg.lstsq(matrix, left, rcond=None)[0]
        size = np.max(np.abs(step) / equations.scale, initial=0.0)
        # While the remaining way shrinks, it is straight, and longer steps may be taken to a distant unknown.
        reach, last = (GROWTH * reach if size < last else REACH), size
        w = w - step * (1.0 if size <= reach else reach / size)
        if size < SETTLED:
            fault = _unbalanced(equations, left, matrix, kept)
            break
    if fault == NO_REST and TENSION not in equations.signals:
        fault = _rootless(equations, closest, kept)
    n_x, found = len(equations.states), not fault
    # Without an equilibrium there is nothing to differentiate.
    w_p = _slope(equations, w, inputs, values) if found else np.zeros((w.size, values.size))
    d, d_w, d_p = (np.asarray(v) for v in functions.held(w, values, constants))
    return RestState(
        found=found, x=w[:n_x], z=w[n_x:], d=d.ravel(), x_p=w_p[:n_x], z_p=w_p[n_x:], d_p=d_w @ w_p + d_p, fault=fault
    )


def scaled(equations: Equations, jacobian: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobian with scaled unknowns and rows, and the rows' sizes, so that units do not affect its rank."""
    matrix = (jacobian * equations.scale)[np.ix_(kept, kept)]
    rows = np.abs(matrix).max(axis=1, initial=0.0)
    rows[rows == 0.0] = 1.0
    return matrix / rows[:, None], rows


def _slope(equations: Equations, w: np.ndarray, inputs: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the derivative of the state of rest by the parameters; a free integrator moves with its guess."""
    functions, kept = _functions(equations), resting(equations)
    jacobian, by_parameters = (np.asarray(v) for v in functions.slopes(w, inputs, values, equations.constants))
    w_p = np.asarray(functions.guess_slope(values, equations.constants))
    matrix, rows = scaled(equations, jacobian, kept)
    left = (by_parameters + jacobian @ w_p)[kept] / rows[:, None]
    w_p[kept] -= equations.scale[kept, None] * np.linalg.lstsq(matrix, left, rcond=None)[0]
    return w_p


def undefined_ahead(
    equations: Equations, rest: RestState, path: np.ndarray, inputs: np.ndarray, values: np.ndarray
) -> str:
    """Name the equation that becomes undefined just after a run, `path` (n_x + n_z, n); empty if there is none."""
    path = np.hstack([np.concatenate([rest.x, rest.z])[:, None], path])
    ahead = path[:, -1] - path[:, -2] if path.shape[1] > 1 else np.zeros(len(path))
    n_x = len(equations.states)
    masses = np.asarray(equations.mass(values, equations.constants)).ravel()
    if not np.isfinite(masses).all():
        which = f"the mass of state {equations.states[int(np.argmin(np.isfinite(masses)))]} has no finite value"
        return _blamed(which, equations, values) or which
    for samples in (0.0, 1.0, 2.0):  # the last state, and where it leads at the same or twice the speed
        w = path[:, -1] + samples * ahead
        residual, jacobian = (
            np.asarray(v) for v in _functions(equations).residual(w, inputs, values, equations.constants)
        )
        which, at = _undefined(equations, residual.ravel(), jacobian, w)
        reading = equations.output(w[:n_x], w[n_x:], rest.d, inputs, 0.0, values, equations.constants)
        if not which and not np.isfinite(float(reading)):
            which = "the reading has no finite value"
        if which:
            return _blamed(which, equations, values) or (
                f"{which}{f' near {at}' if at else ''}, as a quotient by zero, a logarithm or a root there: the equations must have a "
                "value wherever the plant may go"
            )
    return ""


def _blamed(which: str, equations: Equations, values: np.ndarray) -> str:
    """Name the parameter expression that makes an equation undefined; empty if it is not the parameters alone."""
    culprit = _undefined_by_parameters(equations, values)
    return culprit and f"{which}: {culprit}; give the parameter a range in which it has one"


def _undefined_at_guess(
    equations: Equations, residual: np.ndarray, jacobian: np.ndarray, w: np.ndarray, values: np.ndarray
) -> str:
    which, at = _undefined(equations, residual, jacobian, w)
    return _blamed(which, equations, values) or (
        f"no state of rest was found: {which} at the initial guess ({at}), "
        "as a quotient by zero, a logarithm or a root there: give another guess (build.guess), or check the parameters"
    )


def _undefined(equations: Equations, residual: np.ndarray, jacobian: np.ndarray, w: np.ndarray) -> tuple[str, str]:
    """Name the equation with an undefined value or slope, and its arguments; empty if all are defined."""
    at = ", ".join(f"{n} = {v:.4g}" for n, v in zip(equations.states + equations.coordinates, w, strict=True))
    missing, bent = ~np.isfinite(residual), ~np.isfinite(jacobian).all(axis=1)
    if not (missing.any() or bent.any()):
        return "", at
    what = "value" if missing.any() else "slope"
    row = int(np.argmax(missing if missing.any() else bent))
    return f"{equations.names_of_rest[row]} has no finite {what}", at


def _unbalanced(equations: Equations, left: np.ndarray, matrix: np.ndarray, kept: np.ndarray) -> str:
    """Name the states without an equilibrium if Newton's method stalls; empty if the equations hold."""
    if np.max(np.abs(left), initial=0.0) < UNBALANCED:
        return ""
    if kept[np.argmax(np.abs(left))] >= len(equations.states):
        return _rootless(equations, np.abs(left), kept)
    free = np.abs(np.linalg.svd(matrix)[2][-1])  # the direction without a restoring force
    unknowns = np.array(equations.states + equations.coordinates)[kept]
    names = unknowns[free > 1e-3 * free.max()]  # the others take part by rounding only
    one = next((name for name in names if name in equations.states), names[0])
    return (
        f"{'state' if len(names) == 1 else 'states'} {', '.join(names)} {'has' if len(names) == 1 else 'have'} no "
        f"equilibrium at the start: let {'it' if len(names) == 1 else 'one'} start from a parameter, as in "
        f'build.state("{one}", scale=..., start=build.parameter("{one}_at_start"))'
    )


def _rootless(equations: Equations, closest: np.ndarray, kept: np.ndarray) -> str:
    """Name the equation of rest that Newton's method left farthest from zero, with the smallest values reached."""
    row = int(kept[np.argmax(closest)])
    start = ", or let the state start from a parameter (build.state(..., start=...))"
    return (
        f"no state of rest was found: {equations.names_of_rest[row]} was zero nowhere it was tried, and may have no real "
        "root: check it and the parameters, or give another guess (build.guess)"
        f"{start if row < len(equations.states) else ''}"
    )


def has_equilibrium(
    equations: Equations, rest: RestState, rest_command: float, command: float, values: np.ndarray
) -> bool:
    """Return whether the plant, brought slowly from rest to a command, has an equilibrium with its film in tension."""
    here, share, step = np.concatenate([rest.x, rest.z]), 0.0, 1.0 / CONTINUATION
    while share < 1.0 - 1e-12:
        at = rest_command + min(share + step, 1.0) * (command - rest_command)
        state = rest_state(equations, at, values, guess=here)
        if state.found:
            here, share = np.concatenate([state.x, state.z]), share + step
            if not in_tension(equations, here, state.d, equations.held_inputs(at), values):
                return False
        elif step * CONTINUATION * 2**HALVINGS > 1.5:
            step /= 2
        else:
            return False
    return True


def in_tension(
    equations: Equations, here: np.ndarray, held: np.ndarray, inputs: np.ndarray, values: np.ndarray, time: float = 0.0
) -> bool:
    """Return whether the film is in tension; also true if the rig does not watch its tension."""
    if TENSION not in equations.signals:
        return True
    n_x = len(equations.states)
    seen = equations.watched(here[:n_x], here[n_x:], held, inputs, time, values, equations.constants)
    return float(seen[equations.signals.index(TENSION)]) >= 0.0


@lru_cache(maxsize=64)
def resting(equations: Equations) -> np.ndarray:
    """Return which unknowns have a definite state of rest, as a mask."""
    entries, n_x = _functions(equations).pattern, len(equations.states)
    kept = np.arange(equations.scale.size)
    while free := [k for k in kept if k < n_x and not entries[kept, k].any()]:
        kept = np.setdiff1d(kept, free)
    return kept


@dataclass(frozen=True, kw_only=True, eq=False)
class _Functions:
    """Equations of rest r(w, u, p, c) = 0 with their derivatives."""

    residual: ca.Function  # ``(w, u, p, c) -> (r, derivative by w)``
    slopes: ca.Function  # ``(w, u, p, c) ->`` derivatives of r by w and by p
    guess_slope: ca.Function  # ``(p, c) ->`` derivative of the guess by p
    held: ca.Function  # ``(w, p, c) -> (d, derivatives by w and by p)``
    pattern: np.ndarray  # shape (n, n): True where the derivative of r by w has entries


@lru_cache(maxsize=64)
def _functions(equations: Equations) -> _Functions:
    (w, _, u, _, p, c), (x, z, *_) = equations.symbols()
    r, guess = equations.rest(x, z, u, p, c), equations.guess(p, c)
    r_w, r_p = ca.jacobian(r, w), ca.densify(ca.jacobian(r, p))
    d = equations.hold(x, z, p, c)
    return _Functions(
        residual=ca.Function("rest_residual", [w, u, p, c], [ca.densify(r), ca.densify(r_w)]),
        slopes=ca.Function("rest_slopes", [w, u, p, c], [ca.densify(r_w), r_p]),
        guess_slope=ca.Function("guess_slope", [p, c], [ca.densify(ca.jacobian(guess, p))]),
        held=ca.Function("held", [w, p, c], [d, ca.densify(ca.jacobian(d, w)), ca.densify(ca.jacobian(d, p))]),
        pattern=np.asarray(ca.DM(r_w.sparsity(), 1).full()) != 0.0,
    )


def _undefined_by_parameters(equations: Equations, values: np.ndarray) -> str:
    """Name the innermost expression of parameters, shape (n_p,), without a finite value; empty if all are finite."""
    p = ca.vertcat(*map(ca.SX.sym, equations.parameters.free))
    x, z, d, u, t = (ca.SX.sym(name, equations.dynamics.size1_in(k)) for k, name in enumerate("xzdut"))
    c = ca.SX(equations.constants)
    roots = [equations.mass(p, c), *(f(x, z, d, u, t, p, c) for f in (equations.dynamics, equations.output))]
    inner = _of_parameters_alone(ca.vertcat(*map(ca.densify, roots)), p)
    if not inner:
        return ""
    found = np.asarray(ca.Function("inner", [p], [ca.vertcat(*inner)])(values)).ravel()
    if np.isfinite(found).all():
        return ""
    culprit = inner[int(np.argmin(np.isfinite(found)))]  # its operands come before it, and are finite
    numbers = dict(zip(equations.parameters.free, values, strict=True))
    at = ", ".join(f"{symbol} = {numbers[str(symbol)]:.4g}" for symbol in ca.symvar(culprit))
    return f"{clipped(str(culprit), 120)} has no finite value at {at}"


def _of_parameters_alone(roots: Any, p: Any) -> list[Any]:
    """Return the operations in an expression that depend on parameters only, operands first."""
    alone = {symbol.element_hash(): True for symbol in ca.vertsplit(p)}
    found, waiting = [], [roots[k] for k in range(roots.numel())]
    while waiting:
        node = waiting[-1]
        parts = [node.dep(k) for k in range(node.n_dep())]
        if missing := [part for part in parts if part.element_hash() not in alone]:
            if node.element_hash() not in alone:
                waiting += missing
                continue
        waiting.pop()
        if node.element_hash() not in alone:
            own = all(alone[part.element_hash()] for part in parts) if parts else node.is_constant()
            alone[node.element_hash()] = own
            if own and any(not part.is_constant() for part in parts):
                found.append(node)
    return found

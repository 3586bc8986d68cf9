"""The state of rest of a plant, and how it moves with the parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations

__all__ = ["TENSION", "RestState", "has_equilibrium", "rest_state"]

UPDATES = 60
TENSION = "tension"
"""Signal in which a rig watches the least tension of its film."""
CONTINUATION = 20
HALVINGS = 5
"""How often a step of the continuation is halved where no equilibrium is found."""
REACH, GROWTH = 0.1, 1.3
"""Longest first step of Newton's method against the unknowns' scale, which keeps it inside the material's range of
stretches, and how it grows."""
SETTLED = 1e-11


@dataclass(frozen=True, kw_only=True, eq=False)
class RestState:
    """Equilibrium under a constant command.

    Parameters
    ----------
    found : bool
        Whether an equilibrium was found.
    x, z, d : ndarray
        States, coordinates and held quantities, SI.
    x_p, z_p, d_p : ndarray, shape (n, n_p)
        Their derivatives by the free parameters.
    """

    found: bool
    x: np.ndarray
    z: np.ndarray
    d: np.ndarray
    x_p: np.ndarray
    z_p: np.ndarray
    d_p: np.ndarray


def rest_state(
    equations: Equations, command: float, values: np.ndarray, *, guess: np.ndarray | None = None
) -> RestState:
    """Find the state of rest by a damped Newton method.

    Parameters
    ----------
    equations : Equations
        The plant's DAE.
    command : float
        The command at rest, in its unit.
    values : ndarray, shape (n_p,)
        Free parameters, SI.
    guess : ndarray, shape (n_x + n_z,), optional
        Where to start; the rig's own guess by default.

    Returns
    -------
    RestState
        With `found` false, and the last iterate, where there is no equilibrium in reach.
    """
    functions = _functions(equations)
    constants, inputs = equations.constants, equations.held_inputs(command)
    w = np.asarray(equations.guess(values, constants)).ravel() if guess is None else guess
    found, reach, last = False, REACH, np.inf
    for _ in range(UPDATES):
        residual, jacobian = (np.asarray(v) for v in functions[0](w, inputs, values, constants))
        if not (np.isfinite(residual).all() and np.isfinite(jacobian).all()):
            break
        # In scaled unknowns and rows: equations of unlike units must not decide about the rank.
        scaled = jacobian * equations.scale
        rows = np.abs(scaled).max(axis=1, initial=0.0)
        rows[rows == 0.0] = 1.0
        step = equations.scale * np.linalg.lstsq(scaled / rows[:, None], residual.ravel() / rows, rcond=None)[0]
        size = np.max(np.abs(step) / equations.scale, initial=0.0)
        # While what is left to go shrinks, the way is straight, and a far unknown may be reached in longer steps.
        reach, last = (GROWTH * reach if size < last else REACH), size
        w = w - step * min(1.0, reach / size if size > 0 else 1.0)
        if size < SETTLED:
            found = True
            break
    n_x = len(equations.states)
    # Where no equilibrium was found the Jacobian may be singular, and there is nothing to differentiate.
    w_p = np.asarray(functions[1](w, inputs, values, constants)) if found else np.zeros((w.size, values.size))
    d, d_w, d_p = (np.asarray(v) for v in functions[2](w, values, constants))
    return RestState(
        found=found, x=w[:n_x], z=w[n_x:], d=d.ravel(), x_p=w_p[:n_x], z_p=w_p[n_x:], d_p=d_w @ w_p + d_p
    )


def has_equilibrium(
    equations: Equations, rest: RestState, rest_command: float, command: float, values: np.ndarray
) -> bool:
    """Whether the plant, brought slowly from rest to a command, has an equilibrium there, with its film in tension.

    Parameters
    ----------
    equations : Equations
        The plant's DAE.
    rest : RestState
        At the rest command.
    rest_command, command : float
        From and to, in the command's unit.
    values : ndarray, shape (n_p,)
        Free parameters, SI.

    Returns
    -------
    bool
    """
    state, share, step = rest, 0.0, 1.0 / CONTINUATION
    while share < 1.0 - 1e-12:
        at = rest_command + min(share + step, 1.0) * (command - rest_command)
        further = rest_state(equations, at, values, guess=np.concatenate([state.x, state.z]))
        if further.found:
            state, share = further, share + step
            if not _in_tension(equations, state, at, values):
                return False
        elif step * CONTINUATION * 2**HALVINGS > 1.5:
            step /= 2
        else:
            return False
    return True


def _in_tension(equations: Equations, state: RestState, command: float, values: np.ndarray) -> bool:
    """True also of a rig that does not watch the tension of its film."""
    if TENSION not in equations.signals:
        return True
    inputs = equations.held_inputs(command)
    seen = equations.watched(state.x, state.z, state.d, inputs, 0.0, values, equations.constants)
    return float(seen[equations.signals.index(TENSION)]) >= 0.0


@lru_cache(maxsize=64)
def _functions(equations: Equations) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Residual with its Jacobian, slope of the solution, and held quantities with their derivatives."""
    n_x = len(equations.states)
    w = ca.SX.sym("w", equations.scale.size)
    u = ca.SX.sym("u", equations.held_inputs(0.0).size)
    p = ca.SX.sym("p", len(equations.parameters.free))
    c = ca.SX.sym("c", equations.constants.size)
    r = equations.rest(w[:n_x, :], w[n_x:, :], u, p, c)
    r_w, r_p = ca.jacobian(r, w), ca.jacobian(r, p)
    d = equations.hold(w[:n_x, :], w[n_x:, :], p, c)
    slope_w, slope_p = ca.MX.sym("w", w.numel()), ca.MX.sym("p", p.numel())
    slope_u, slope_c = ca.MX.sym("u", u.numel()), ca.MX.sym("c", c.numel())
    arguments = [slope_w, slope_u, slope_p, slope_c]
    parts = ca.Function("parts", [w, u, p, c], [ca.densify(r_w), r_p])(*arguments)
    return (
        ca.Function("rest_residual", [w, u, p, c], [r, ca.densify(r_w)]),
        ca.Function("rest_slope", arguments, [-ca.solve(parts[0], parts[1], "qr")]),
        ca.Function("held", [w, p, c], [d, ca.densify(ca.jacobian(d, w)), ca.densify(ca.jacobian(d, p))]),
    )

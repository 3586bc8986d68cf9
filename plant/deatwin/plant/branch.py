"""Equilibria of a plant along the command, and the snaps of a simulation from one to another.

In a fold the film's stiffness is zero; a film that passes a fold snaps to another equilibrium, or pulls in.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.integrator.march import March
from deatwin.plant.rest import RestState, rest_state, resting

FURTHEST = 0.25
"""Largest move of an unknown between two points of a curve, in units of its scale; a film that snaps moves further."""
RUNAWAY = 20.0
"""Largest distance of an unknown from rest, in units of its scale. No film reaches it, but a material model without a
limit of stretch would be followed without end."""
HALVINGS = 12
"""Largest number of halvings of a stride in the command before the equilibrium counts as ended: a part in 4000 is
finer than any amplifier resolves."""
STRIDES = np.sqrt(np.linspace(0.0, 1.0, 9))[1:]
"""Fractions of the way to the furthest command at which the equilibrium is first sought, evenly spaced in their square
because the stress grows with the square of the voltage. A stride that is too long costs a failed search."""
BETWEEN = np.linspace(0.0, 1.0, 17)[1:-1]
"""Fractions of the way between two states at which an unstable tangent is sought: a snap passes an unstable
equilibrium, which lies well between the two stable ones."""
PIECE = 512  # Number of samples checked together; the check starts anew after each snap, which leads to another branch
ACTED_ON = "film_voltage"  # Signal of a rig with a film

Step = Callable[[float, np.ndarray], np.ndarray | None]


def branch_step(
    equations: Equations, rest: RestState, start: float, values: np.ndarray, farthest: float = RUNAWAY
) -> Step:
    """Find an equilibrium near another one, under a changed command. Shapes: `values` (n_p,)."""

    def distance(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.max(np.abs(one - other) / equations.scale, initial=0.0))

    def sign(command: float, unknowns: np.ndarray) -> float:
        return float(_signs(equations, unknowns[:, None], equations.held_inputs(command)[:, None], values)[0])

    first = np.concatenate([rest.x, rest.z])
    at_rest = sign(start, first)

    def step(command: float, here: np.ndarray) -> np.ndarray | None:
        tried = rest_state(equations, command, values, guess=here)
        there = np.concatenate([tried.x, tried.z])
        near = tried.found and distance(there, here) < FURTHEST and distance(there, first) < farthest
        return there if near and sign(command, there) == at_rest else None

    return step


def followed(step: Step, at: float, here: np.ndarray, target: float, halvings: int) -> tuple[float, np.ndarray, bool]:
    """Follow an equilibrium towards a command. Shapes: `here` (n_x + n_z,)."""
    there = step(target, here)
    if there is not None:
        return target, there, True
    if halvings == 0:
        return at, here, False
    middle = (at + target) / 2
    at, here, reached = followed(step, at, here, middle, halvings - 1)
    return followed(step, at, here, target, halvings - 1) if reached else (at, here, False)


def snap_throughs(
    equations: Equations, rest: RestState, unknowns: np.ndarray, inputs: np.ndarray, start: float, values: np.ndarray
) -> tuple[int, ...]:
    """Return samples at which a film begins to snap to another equilibrium or back; empty without a fold."""
    if ACTED_ON not in equations.signals or inputs.shape[1] == 0:
        return ()
    commands = inputs[0]
    limits = float(min(commands.min(), start)), float(max(commands.max(), start))
    ends = _ends_of_rest(equations, start, limits, values.tobytes())
    if ends == limits:
        return ()
    at_rest = np.concatenate([rest.x, rest.z])[:, None]
    stable = _signs(equations, at_rest, equations.held_inputs(start)[:, None], values)[0]
    way, found, here, count = np.hstack([at_rest, unknowns]), [], 0, PIECE
    arrived, direction = 0, np.zeros(len(way))
    while here < commands.size:
        piece = slice(here, here + count)
        stays, crosses = _stable(equations, way[:, here : here + count + 1], inputs[:, piece], ends, values, stable)
        if not stays.size:  # between two equilibria throughout: look further ahead
            here, count = (here, 2 * count) if here + count < commands.size else (commands.size, count)
            continue
        if not crosses.any():
            here, count = here + 1 + int(stays[-1]), PIECE
            continue
        first = int(np.argmax(crosses))
        left, entered = here + (1 + int(stays[first - 1]) if first else 0), here + int(stays[first])
        here, count, turn = entered + 1, PIECE, (way[:, entered + 1] - way[:, left]) / equations.scale
        inside = (commands >= ends[0]) & (commands <= ends[1])
        # A further move in the same direction, while the equilibrium still exists, is the end of the last snap.
        if turn @ direction <= 0 or not inside[arrived:here].all():
            held = np.flatnonzero(inside[: left + 1])
            found.append(min(int(held[-1]) + 1, left) if held.size else left)
        command, arrived, direction = float(commands[entered]), here, turn
        other = rest_state(equations, command, values, guess=unknowns[:, entered])
        ends = _ends(equations, other, command, limits, values) if other.found else limits
    return tuple(found)


def _stable(
    equations: Equations,
    way: np.ndarray,
    inputs: np.ndarray,
    ends: tuple[float, float],
    values: np.ndarray,
    stable: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return samples that end in a stable state, and whether unstable states lie between each and the one before."""
    told = inputs.copy()
    past = slice(0, 1 + equations.history)
    told[past] = np.clip(told[past], *ends)
    stays = np.flatnonzero(_signs(equations, way[:, 1:], told, values) == stable)
    if not stays.size:
        return stays, np.empty(0, dtype=bool)
    last = np.concatenate([[0], stays[:-1] + 1])
    before, moves = way[:, last], way[:, stays + 1] - way[:, last]
    moved = np.max(np.abs(moves) / equations.scale[:, None], axis=0) >= FURTHEST
    moved |= np.diff(stays, prepend=-1) > 1  # unstable samples lie between
    between = before[:, moved, None] + moves[:, moved, None] * BETWEEN
    held = np.repeat(told[:, stays[moved]], BETWEEN.size, axis=1)
    signs = _signs(equations, between.reshape(len(way), -1), held, values).reshape(-1, BETWEEN.size)
    crosses = np.zeros(stays.size, dtype=bool)
    crosses[moved] = (signs != stable).any(axis=1)
    return stays, crosses


@lru_cache(maxsize=256)
def _ends_of_rest(
    equations: Equations, start: float, limits: tuple[float, float], values_as_bytes: bytes
) -> tuple[float, float]:
    """Return `_ends` of the equilibrium from which a simulation begins, cached because most simulations share it."""
    values = np.frombuffer(values_as_bytes)
    return _ends(equations, rest_state(equations, start, values), start, limits, values)


def _ends(
    equations: Equations, rest: RestState, command: float, limits: tuple[float, float], values: np.ndarray
) -> tuple[float, float]:
    """Return the smallest and largest command to which an equilibrium can be followed within limits."""
    step, first = branch_step(equations, rest, command, values), np.concatenate([rest.x, rest.z])
    reached = []
    for limit in limits:
        at, here, lives = command, first, True
        for target in command + (limit - command) * STRIDES if limit != command else ():
            at, here, lives = followed(step, at, here, float(target), HALVINGS) if lives else (at, here, False)
        reached.append(limit if lives else at)
    return reached[0], reached[1]


def _signs(equations: Equations, unknowns: np.ndarray, inputs: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the sign of the determinant of the tangent of the equations of rest at each column, shape (m,)."""
    kept, together = resting(equations), PIECE if unknowns.shape[1] > 1 else 1
    march, signs = March(_tangents(equations, together)), np.empty(unknowns.shape[1])
    w, u, p, c = march.arguments
    p[:], c[:] = values, equations.constants
    for begin in range(0, signs.size, together):
        piece = slice(begin, begin + together)
        count = signs[piece].size
        w[:count], u[:count] = unknowns[:, piece].T, inputs[:, piece].T
        tangents = march.advance()[0].reshape(together, len(unknowns), len(unknowns))[:count]
        with np.errstate(all="ignore"):  # an impossible state of the film has no finite tangent and counts as unstable
            signs[piece] = np.linalg.slogdet(tangents[:, kept[:, None], kept]).sign
    return signs


@lru_cache(maxsize=64)
def _tangents(equations: Equations, together: int) -> ca.Function:
    """Return the function ``(w, u, p, c) ->`` derivatives of the equations of rest, for several samples side by side."""
    (w, _, u, _, p, c), (x, z, *_) = equations.symbols()
    residual = equations.rest(x, z, u, p, c)
    tangent = ca.Function("tangent_of_rest", [w, u, p, c], [ca.densify(ca.jacobian(residual, w))])
    return tangent.map("tangents_of_rest", "serial", together, [2, 3], [])

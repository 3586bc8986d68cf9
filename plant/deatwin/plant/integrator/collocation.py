"""Radau IIA collocation and one implicit step of a DAE, with sensitivities by the implicit function theorem.

A step solves M sum_j (A^-1)_ij (X_j - x_0) = h f(X_i, Z_i, u, t + c_i h) and 0 = g(...). It is L-stable and stiffly
accurate (Hairer & Wanner, Solving Ordinary Differential Equations II, 1996, IV.5, doi:10.1007/978-3-642-05221-7).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.integrator.lanes import Exchange
from deatwin.plant.integrator.newton import solved_stages
from deatwin.plant.integrator.parts import halves
from deatwin.plant.integrator.stages import Stages


def radau(stages: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (s,) and Butcher matrix (s, s) of Radau IIA."""
    legendre = np.polynomial.legendre.Legendre
    right = legendre.basis(stages) - legendre.basis(stages - 1)
    nodes = (np.sort(right.roots().real) + 1) / 2
    nodes[-1] = 1.0
    powers = np.arange(stages)
    # Collocation: A integrates every polynomial of degree s - 1 exactly up to each node.
    matrix = (nodes[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(nodes[:, None] ** powers)
    return nodes, matrix


@dataclass(frozen=True, kw_only=True, eq=False)
class StepFunctions:
    """One sample of the plant as CasADi Functions: one implicit step, or one for each of its parts."""

    plain: ca.Function
    sensitive: ca.Function
    in_lanes: Callable[[], Exchange]  # writing this code takes long, and only a compiler needs it


def step_functions(equations: Equations) -> StepFunctions:
    """Make the implicit step over a sample, or the steps over its two parts."""
    stages = Stages.of(equations, *radau(equations.stages))
    n_all, n_x = len(equations.states), stages.n_x
    x = ca.MX.sym("x", n_all)
    _, z, *known = stages.symbols()
    step = [x, z, *known]
    w, error = solved_stages(stages)(x[:n_x, :], z, *known)
    end = w[-stages.n :, :]
    x_end, z_end = ca.vertcat(end[:n_x, :], x[n_x:, :]), end[n_x:, :]
    d, u, t, h, p, c = known
    after = [x_end, z_end, d, u, t + h, p, c]
    reading = equations.outputs(*after)
    plain = ca.Function("plain", step, [x_end, z_end, reading, ca.densify(equations.watched(*after)), error])

    dx, dd = ca.MX.sym("dx", n_all, stages.n_p), ca.MX.sym("dd", stages.n_d, stages.n_p)
    solved = stages.differentiate(w, x[:n_x, :], known, dx[:n_x, :], dd)
    new = ca.vertcat(solved[:n_x, :], dx[n_x:, :], solved[n_x:, :])
    by = stages.output_derivatives(*after)
    dy = ca.densify(by[0] @ new + by[1] @ dd + by[2])
    arguments = [x, z, dx, dd, *known]
    sensitive = ca.Function("sensitive", arguments, [x_end, z_end, new[:n_all, :], reading, dy, error])
    place = equations.step_middle
    if place is not None:
        plain, sensitive = _in_two(plain, 2, place), _in_two(sensitive, 3, place)
    place = equations.sample_start
    if place is not None and (equations.integrals or equations.shifts):
        plain = _begun(plain, (0,), equations, place)
        sensitive = _begun(sensitive, (0, 2), equations, place)
    return StepFunctions(plain=plain, sensitive=sensitive, in_lanes=cache(stages.in_lanes))


def _begun(step: ca.Function, rows: Sequence[int], equations: Equations, place: int) -> ca.Function:
    """Return a step that zeroes integrals at the start of a sample; `rows` are its arguments, one for each state."""
    arguments = step.mx_in()
    u, t, h = arguments[-5:-2]
    begins = t - u[place] < h / 2  # false for a shorter step that continues within a sample
    begun = ca.sparsify(ca.DM(equations.begun))
    given = [begins * (begun @ a) + (1 - begins) * a if n in rows else a for n, a in enumerate(arguments)]
    return ca.Function(f"{step.name()}_begun", arguments, step.call(given))


def _in_two(step: ca.Function, n_states: int, place: int) -> ca.Function:
    """Return two steps of half the width, each with its own middle; some results of the first pass to the second."""
    arguments = step.mx_in()
    at, kept, (u, t, h, p, c) = arguments[:n_states], arguments[n_states:-5], arguments[-5:]
    errors = []
    for half in halves(t, h):
        told = ca.vertcat(u[:place], half.middle, u[place + 1 :])
        *found, error = step.call([*at, *kept, told, half.begin, half.width, p, c])
        at = found[:n_states]
        errors.append(error)
    first, second = errors
    larger = (first + second + ca.fabs(first - second)) / 2  # NaN if either is NaN
    return ca.Function(f"{step.name()}_in_two", arguments, [*found, larger])

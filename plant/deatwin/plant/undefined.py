"""Search for the expression of the parameters that has no finite value."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.safe_read import clipped


def undefined_by_parameters(equations: Equations, values: np.ndarray) -> str:
    """Name the innermost expression of the parameters alone, shape (n_p,), without a finite value; empty if all have."""
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
    culprit = inner[int(np.argmin(np.isfinite(found)))]  # what it is made of comes before it, and is finite
    numbers = dict(zip(equations.parameters.free, values, strict=True))
    at = ", ".join(f"{symbol} = {numbers[str(symbol)]:.4g}" for symbol in ca.symvar(culprit))
    return f"{clipped(str(culprit), 120)} has no finite value at {at}"


def _of_parameters_alone(roots: Any, p: Any) -> list[Any]:
    """The operations in an expression that depend on parameters only, each after those that it is made of."""
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

"""Newton's method on the stages of an implicit step: simplified and transformed, and in full where that fails.

The simplified method keeps the Jacobian J of the start. With A^-1 = T Lambda T^-1 it solves, for one eigenvalue of each
conjugate pair, (lambda M - h J) v = (T^-1 G)_lambda (Hairer & Wanner 1996, IV.8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.integrator.elimination import Complex, factorised
from deatwin.plant.integrator.stages import Stages, coupled

Symbol = Any  # casadi.SX or casadi.MX

SETTLED = 1e-10  # Estimated error, relative to each unknown's scale, below which the equations count as solved
FIRST_CORRECTIONS, CORRECTIONS = 2, 4
"""Number of simplified corrections after the tangent step of every sample, and largest number of further ones, each
only while the error is large. Two changes tell the rate of convergence. Smooth plants need two or three corrections.
Where friction or a limit sets in within the sample, the Jacobian of its start is the wrong one, and more corrections
would not settle it."""
UPDATES = 14
"""Largest number of full Newton updates if the simplified corrections do not settle, each only while the error is
large: first from the start of the step, then from its Euler steps."""
EULER_STEPS, EULER_UPDATES = 4, 6
"""Number of implicit Euler steps between two stages, and of Newton updates in each. A sample that even the full updates
do not settle, such as one with a kink of friction, starts anew from these steps."""
LEAST_GAIN = 1e-3  # Smallest gain of a correction, as a share of the change before, that counts as convergence
NOTHING = 1e-300  # Small number that keeps a ratio of two changes defined if a plant does not move at all


def solved_stages(stages: Stages) -> ca.Function:
    """Solve the equations of one step."""
    step = stages.symbols()
    x, z, d, u, t, h, p, c = step
    mass, here = stages.mass(p, c), ca.vertcat(x, z)
    # All stages start from the same point, so that one value and one Jacobian serve the tangent step, and the factors
    # serve every correction after it.
    value, jacobian = stages.jacobian(here, d, u, t, p, c)
    linear = _linear_systems(stages)
    factors = linear.factor(jacobian, mass, h)
    start, values = ca.repmat(here, stages.count, 1), ca.repmat(value, stages.count, 1)
    tangent, size = linear.correct(factors, start, values, x, mass, h)

    # The first correction removes the error of the tangent step, which tells nothing of the rate.
    found, known = [tangent, size, size + 1], [factors, *step]
    correction = _correction(stages, linear, factors.numel())
    for _ in range(FIRST_CORRECTIONS):
        found = correction.call([*found, *known])
    found = _until_settled("corrections", correction, CORRECTIONS, found, known)
    update = _full_update(stages, factors.numel())
    for guess in (_resting(stages), _euler(stages)):
        found = _until_settled(f"from_{guess.name()}", _restarted(update, guess), 1, found, known)
        found = _until_settled("updates", update, UPDATES, found, known)
    return ca.Function("newton", step, [found[0], found[2]])


def _until_settled(
    name: str, function: ca.Function, most: int, found: Sequence[ca.MX], known: Sequence[ca.MX]
) -> list[ca.MX]:
    """Apply a function to ``(w, size of its last change, error)`` while the error is large, at most `most` times."""
    arguments = function.mx_in()
    keep = ca.Function(f"keep_{name}", arguments, arguments[: len(found)])
    once = ca.Function.if_else(name, keep, function)  # one function for all times keeps the generated code short
    state = list(found)
    for _ in range(most):
        state = list(once(state[2] <= SETTLED, *state, *known))  # a NaN counts as a large error
    return state


def _correction(stages: Stages, linear: _LinearSystems, n_factors: int) -> ca.Function:
    """Return the simplified method, ``(w, size, error, factors, step) -> (w, size, error)``."""
    (w, size, error), factors, (x, z, *known) = _arguments(stages, n_factors)
    (values,) = stages.everywhere(stages.values, w, known)
    corrected, change = linear.correct(factors, w, ca.vec(values), x, stages.mass(*known[4:]), known[3])
    rate = change / (size + NOTHING)
    left = change * ca.fmin(rate / ca.fmax(1.0 - rate, LEAST_GAIN), 1.0 / LEAST_GAIN)
    return ca.Function("correction", [w, size, error, factors, x, z, *known], [corrected, change, left])


def _full_update(stages: Stages, n_factors: int) -> ca.Function:
    """Return ``(w, size, error, factors, step) -> (w, size, error)`` with the Jacobian of each stage."""
    (w, size, error), factors, (x, z, *known) = _arguments(stages, n_factors)
    values, entries = stages.everywhere(stages.jacobians, w, known)
    mass, h = stages.mass(*known[4:]), known[3]
    defect = stages.defect(w, values, x, mass, h)
    step = stages.all_stages(entries, mass, h, defect)
    change = ca.norm_2(step / ca.repmat(ca.DM(stages.scale), stages.count, 1))
    left = change * ca.fmin(ca.fmax(change, (change / (size + NOTHING)) ** 2), 1.0)
    return ca.Function("newton_update", [w, size, error, factors, x, z, *known], [w - step, change, left])


def _restarted(update: ca.Function, guess: ca.Function) -> ca.Function:
    """Return the update from another guess; its first change tells no rate, so it counts as the error."""
    arguments = update.mx_in()
    w, change, _ = update.call([guess(*arguments[4:]), *arguments[1:]])
    return ca.Function(f"from_{guess.name()}", arguments, [w, change, change])


def _resting(stages: Stages) -> ca.Function:
    """Return ``(x, z, d, u, t, h, p, c) -> `` a guess: all stages equal the start of the step."""
    step = stages.symbols()
    return ca.Function("resting", step, [ca.repmat(ca.vertcat(*step[:2]), stages.count, 1)])


def _euler(stages: Stages) -> ca.Function:
    """Return ``(x, z, d, u, t, h, p, c) -> `` a guess of all stages from small implicit Euler steps."""
    step = stages.symbols()
    x, z, d, u, t, h, p, c = step
    mass = stages.mass(p, c)
    w, before, last = ca.MX.sym("w", stages.n), ca.MX.sym("before", stages.n_x), ca.MX.sym("t_last")
    small, m = ca.MX.sym("h_small"), ca.MX.sym("m", stages.n_x)
    value, jacobian = stages.jacobian(w, d, u, last, p, c)
    states = m * (w[: stages.n_x, :] - before) - small * value[: stages.n_x, :]
    defect = ca.vertcat(states, -value[stages.n_x :, :])
    system = coupled(jacobian.sparsity(), stages.n_x, np.ones((1, 1)))(_entries(jacobian), m, small)
    rest = [d, u, last, small, m, p, c]
    update = ca.Function("euler_update", [w, before, *rest], [w - ca.solve(system, defect, "qr")])
    # Nested functions keep the generated code short.
    at = w
    for _ in range(EULER_UPDATES):
        at = update(at, w[: stages.n_x], *rest)
    one = ca.Function("euler_step", [w, *rest], [at])
    at = w
    for number in range(EULER_STEPS):
        at = one(at, d, u, last + (number + 1) * small, small, m, p, c)
    several = ca.Function("euler_steps", [w, *rest], [at])
    at, found = ca.vertcat(x, z), []
    for begin, end in pairwise([0.0, *stages.nodes]):
        at = several(at, d, u, t + begin * h, (end - begin) / EULER_STEPS * h, mass, p, c)
        found.append(at)
    return ca.Function("euler", step, [ca.vertcat(*found)])


def _arguments(stages: Stages, n_factors: int) -> tuple[list[ca.MX], ca.MX, list[ca.MX]]:
    found = [ca.MX.sym("w", stages.n * stages.count), ca.MX.sym("size"), ca.MX.sym("error")]
    return found, ca.MX.sym("factors", n_factors), stages.symbols()


@dataclass(frozen=True, kw_only=True, eq=False)
class _LinearSystems:
    """Systems of the simplified method: `factor` ``(J, M, h)``; `correct` ``(factors, w, f, x, M, h) -> (w, size)``."""

    factor: ca.Function
    correct: ca.Function


def _linear_systems(stages: Stages) -> _LinearSystems:
    values, vectors = np.linalg.eig(stages.inverse)
    inverse = np.linalg.inv(vectors)
    # Only one system of each conjugate pair is solved, and represents both.
    kept = np.flatnonzero(values.imag >= 0)
    weights = np.where(values[kept].imag > 0, 2.0, 1.0)
    spectrum = (values[kept], vectors[:, kept] * weights, inverse[kept])
    return _unrolled(stages, *spectrum) if stages.unrolled else _sparse(stages, *spectrum)


def _unrolled(stages: Stages, values: np.ndarray, vectors: np.ndarray, inverse: np.ndarray) -> _LinearSystems:
    """Return the linear systems as straight-line code."""
    jacobian = ca.SX.sym("J", stages.jacobian.sparsity_out(1))
    mass, h = ca.SX.sym("mass", stages.n_x), ca.SX.sym("h")
    systems = [factorised(_shifted(stages, value, jacobian, mass, h)) for value in values]
    numbers = [entry for system in systems for row in system.entries for entry in row]
    parts: list[Symbol] = [part for number in numbers for part in (number.real, number.imaginary) if not part.is_zero()]
    factor = ca.Function("factor", [jacobian, mass, h], [ca.vertcat(*parts)])

    given: Symbol = ca.SX.sym("factors", len(parts))
    named = iter(given.elements())
    systems = [system.renamed(named) for system in systems]
    w, f, x, right = _right_sides(stages, values, inverse, mass, h)
    found = [
        system.solve([Complex(a, b) for a, b in zip(re.elements(), im.elements(), strict=True)])
        for system, (re, im) in zip(systems, right, strict=True)
    ]
    parts_of = [(ca.vertcat(*(v.real for v in vector)), ca.vertcat(*(v.imaginary for v in vector))) for vector in found]
    change = _transformed_back(vectors, parts_of)
    correct = _corrected(stages, [given, ca.vec(w), ca.vec(f), x, mass, h], w, change)
    return _LinearSystems(factor=factor, correct=correct)


def _sparse(stages: Stages, values: np.ndarray, vectors: np.ndarray, inverse: np.ndarray) -> _LinearSystems:
    """Return sparse QR solvers of the real systems, of twice the size for a complex eigenvalue."""
    pattern = stages.jacobian.sparsity_out(1)
    jacobian = ca.MX.sym("J", pattern)
    sizes = {
        "factors": pattern.nnz(),
        "w": stages.n * stages.count,
        "f": stages.n * stages.count,
        "x": stages.n_x,
        "mass": stages.n_x,
        "h": 1,
    }
    arguments = entries, w, f, x, mass, h = [ca.MX.sym(name, size) for name, size in sizes.items()]
    defect = stages.defect(w, ca.reshape(f, stages.n, stages.count), x, mass, h)
    by_stage = ca.reshape(defect, stages.n, stages.count)
    parts = []
    for value, row in zip(values, inverse, strict=True):
        turn = np.array([[value.real, -value.imag], [value.imag, value.real]])
        count = 2 if value.imag else 1
        matrix = coupled(pattern, stages.n_x, turn[:count, :count])(ca.repmat(entries, 1, count), mass, h)
        side = ca.vertcat(*(by_stage @ part for part in (row.real, row.imag)[:count]))
        solution = ca.solve(matrix, side, "qr")
        parts.append((solution[: stages.n], solution[stages.n :] if value.imag else ca.MX(stages.n, 1)))
    change = _transformed_back(vectors, parts)
    return _LinearSystems(
        factor=ca.Function("factor", [jacobian, mass, h], [_entries(jacobian)]),
        correct=_corrected(stages, arguments, ca.reshape(w, stages.n, stages.count), change),
    )


def _entries(matrix: ca.MX) -> ca.MX:
    """Return the nonzero entries of a sparse matrix as a column."""
    return ca.reshape(matrix.nz[:], matrix.nnz(), 1)


def _weight(stages: Stages, h: ca.SX) -> ca.SX:
    return ca.diag(ca.vertcat(ca.repmat(h, stages.n_x), ca.SX.ones(stages.n_z)))


def _shifted(stages: Stages, value: complex, jacobian: ca.SX, mass: ca.SX, h: ca.SX) -> list[list[Complex]]:
    """Return ``lambda M - h J`` in numbers; h is 1 in rows without mass."""
    rest = -_weight(stages, h) @ jacobian
    rows = [[Complex(rest[i, j]) for j in range(stages.n)] for i in range(stages.n)]
    for i in range(stages.n_x):
        rows[i][i] = Complex(rest[i, i] + float(value.real) * mass[i], float(value.imag) * mass[i])
    return rows


def _right_sides(
    stages: Stages, values: np.ndarray, inverse: np.ndarray, mass: ca.SX, h: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX, list[tuple[ca.SX, ca.SX]]]:
    """Return symbols for unknowns, values and start, and the residual along each eigenvector."""
    w, f = ca.SX.sym("w", stages.n, stages.count), ca.SX.sym("f", stages.n, stages.count)
    x = ca.SX.sym("x", stages.n_x)
    moved, weight = w[: stages.n_x, :] - ca.repmat(x, 1, stages.count), _weight(stages, h)
    sides = []
    for value, row in zip(values, inverse, strict=True):
        # T^-1 A^-1 = Lambda T^-1
        parts = []
        for memory, drive in (((value * row).real, row.real), ((value * row).imag, row.imag)):
            inertia = ca.vertcat(mass * (moved @ ca.SX(memory)), ca.SX.zeros(stages.n_z, 1))
            parts.append(inertia - weight @ (f @ ca.SX(drive)))
        sides.append((parts[0], parts[1]))
    return w, f, x, sides


def _transformed_back(vectors: np.ndarray, parts: Sequence[tuple[Symbol, Symbol]]) -> Symbol:
    """Return the real part of the sum over eigenvectors, shape (n, s)."""
    columns = []
    for row in vectors:
        terms = [float(v.real) * re - float(v.imag) * im for v, (re, im) in zip(row, parts, strict=True)]
        columns.append(sum(terms[1:], terms[0]))
    return ca.horzcat(*columns)


def _corrected(stages: Stages, arguments: list[Symbol], w: Symbol, change: Symbol) -> ca.Function:
    size = ca.norm_2(ca.vec(change / ca.repmat(ca.DM(stages.scale), 1, stages.count)))
    return ca.Function("correct", arguments, [ca.vec(w - change), size])

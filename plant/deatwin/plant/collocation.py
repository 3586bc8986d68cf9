"""Radau IIA collocation and one implicit step of a DAE, with its sensitivities.

The scheme is L-stable and stiffly accurate: algebraic equations hold at the end of each step, and a state
whose mass is zero is an algebraic one. One step solves

.. math::
    M\\sum_j (A^{-1})_{ij}(X_j - x_0) = h f(X_i, Z_i, u, t + c_i h), \\qquad 0 = g(X_i, Z_i, u, t + c_i h)

by Newton's method, and its derivatives follow from the implicit function theorem.

References
----------
Hairer & Wanner, Solving Ordinary Differential Equations II (1996), section IV.5,
doi:10.1007/978-3-642-05221-7.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations

__all__ = ["STAGES", "StepFunctions", "radau", "step_functions"]

STAGES = 5
"""Stages of a step; the order is ``2 * STAGES - 1``. At 50 samples a second four follow the ringing
of a 16 Hz ball mode after a step to 0.2 µm, five to 0.003 µm, for a third more time (tests/validation)."""
UPDATES = (1, 1, 1, 10)
"""Newton updates after the tangent step: the first number for every sample, each further one only while the
last update is large."""
EULER_STEPS, EULER_UPDATES = 4, 6
"""A sample that even these do not settle, such as one with a kink of friction, starts anew from implicit Euler
steps, so many between two stages, with so many Newton updates each."""
SETTLED = 1e-5
"""Size of the last update, against each unknown's scale, below which Newton's quadratic convergence has
finished: what is left is of the order of its square."""


def radau(stages: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and Butcher matrix of Radau IIA.

    Parameters
    ----------
    stages : int
        Number of stages s; the order is 2s - 1.

    Returns
    -------
    nodes : ndarray, shape (s,)
        In (0, 1], the last is 1.
    matrix : ndarray, shape (s, s)
        Butcher matrix A.

    Examples
    --------
    >>> radau(2)[1].round(12).tolist()
    [[0.416666666667, -0.083333333333], [0.75, 0.25]]
    """
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
    """One sample of the plant as CasADi Functions.

    Parameters
    ----------
    plain : casadi.Function
        ``(x, z, d, u, t, h, p, c) -> (x, z, y, watched, update)`` with the size of Newton's last update.
    sensitive : casadi.Function
        ``(x, z, X, D, d, u, t, h, p, c) -> (x, z, X, y, Y, update)`` with X = dx/dp, D = dd/dp, Y = dy/dp.
    """

    plain: ca.Function
    sensitive: ca.Function


def step_functions(equations: Equations) -> StepFunctions:
    """Write one implicit step over a sample.

    Parameters
    ----------
    equations : Equations
        The DAE.

    Returns
    -------
    StepFunctions
    """
    stage = _Stage.of(equations)
    solve = _newton(equations, stage)
    names = ("x", "z", "d", "u", "t", "h", "p", "c")
    sizes = (stage.n_x, stage.n_z, stage.n_d, stage.n_u, 1, 1, stage.n_p, equations.constants.size)
    a = {n: ca.MX.sym(n, k) for n, k in zip(names, sizes, strict=True)}
    values = [a[n] for n in names]
    stages, update = solve(*values)
    end = stages[:, -1]
    x, z = end[: stage.n_x, :], end[stage.n_x :, :]
    after = [x, z, a["d"], a["u"], a["t"] + a["h"], a["p"], a["c"]]
    reading = equations.output(*after)
    plain = ca.Function("plain", values, [x, z, reading, equations.watched(*after), update])

    dx, dd = ca.MX.sym("dx", stage.n_x, stage.n_p), ca.MX.sym("dd", stage.n_d, stage.n_p)
    new = stage.differentiate(stages, dx, dd, a)
    by = stage.output_derivatives(*after)
    dy = by[0] @ new + by[1] @ dd + by[2]
    sensitive = ca.Function(
        "sensitive", [a["x"], a["z"], dx, dd, *values[2:]], [x, z, new[: stage.n_x, :], reading, dy, update]
    )
    return StepFunctions(plain=plain, sensitive=sensitive)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stage:
    """The DAE at the stages of a step: residual and derivatives."""

    n_x: int
    n_z: int
    n_d: int
    n_u: int
    n_p: int
    residual: ca.Function
    jacobian: ca.Function
    derivatives: ca.Function
    mass: ca.Function
    mass_slope: ca.Function
    output_derivatives: ca.Function

    @classmethod
    def of(cls, equations: Equations) -> _Stage:
        w = ca.SX.sym("w", len(equations.states) + len(equations.coordinates))
        n_x, n_d = len(equations.states), len(equations.held)
        n_u = equations.held_inputs(0.0).size
        d, u, t = ca.SX.sym("d", n_d), ca.SX.sym("u", n_u), ca.SX.sym("t")
        p, c = ca.SX.sym("p", len(equations.parameters.free)), ca.SX.sym("c", equations.constants.size)
        arguments = [w, d, u, t, p, c]
        split = [w[:n_x, :], w[n_x:, :], d, u, t, p, c]
        f = equations.dynamics(*split)
        y = equations.output(*split)
        mass = equations.mass(p, c)
        return cls(
            n_x=n_x,
            n_z=w.numel() - n_x,
            n_d=n_d,
            n_u=n_u,
            n_p=p.numel(),
            residual=ca.Function("stage_residual", arguments, [f]),
            jacobian=ca.Function("stage_jacobian", arguments, [f, ca.jacobian(f, w)]),
            derivatives=ca.Function(
                "stage_derivatives", arguments, [ca.jacobian(f, w), ca.jacobian(f, d), ca.jacobian(f, p)]
            ),
            mass=ca.Function("stage_mass", [p, c], [mass]),
            mass_slope=ca.Function("stage_mass_slope", [p, c], [ca.jacobian(mass, p)]),
            output_derivatives=ca.Function(
                "output_derivatives", split, [ca.jacobian(y, w), ca.jacobian(y, d), ca.jacobian(y, p)]
            ),
        )

    def assembly(self, count: int) -> ca.Function:
        """``(J_1 .. J_s, M, h) -> `` derivative of all stages' residuals by all stages' unknowns.

        Written on scalars (SX): the sparse products of MX would cost more than the plant itself.
        """
        inverse = np.linalg.inv(radau(count)[1])
        jacobians = [ca.SX.sym(f"J{i}", self.jacobian.sparsity_out(1)) for i in range(count)]
        mass, h = ca.SX.sym("mass", self.n_x), ca.SX.sym("h")
        coupling = ca.diag(ca.vertcat(mass, ca.SX(self.n_z, 1)))
        weight = ca.diag(ca.vertcat(ca.repmat(h, self.n_x), ca.SX.ones(self.n_z)))
        rows = []
        for i in range(count):
            row = [inverse[i, j] * coupling for j in range(count)]
            row[i] = row[i] - weight @ jacobians[i]
            rows.append(ca.horzcat(*row))
        return ca.Function("assembly", [*jacobians, mass, h], [ca.vertcat(*rows)])

    def defect(self, count: int) -> ca.Function:
        """``(w, f_1 .. f_s, x, M, h) -> `` residual of the collocation equations."""
        inverse = np.linalg.inv(radau(count)[1])
        n = self.n_x + self.n_z
        w, x = ca.SX.sym("w", n, count), ca.SX.sym("x", self.n_x)
        values = [ca.SX.sym(f"f{i}", n) for i in range(count)]
        mass, h = ca.SX.sym("mass", self.n_x), ca.SX.sym("h")
        moved = (w[: self.n_x, :] - ca.repmat(x, 1, count)) @ ca.SX(inverse.T)
        rows = [
            ca.vertcat(mass * moved[:, i] - h * values[i][: self.n_x, :], -values[i][self.n_x :, :])
            for i in range(count)
        ]
        return ca.Function("defect", [ca.vec(w), *values, x, mass, h], [ca.vertcat(*rows)])

    def one_step(self) -> ca.Function:
        """``(w, f, J, x, M, h) -> (residual, its Jacobian)`` of one implicit Euler step."""
        n = self.n_x + self.n_z
        w, value, x = ca.SX.sym("w", n), ca.SX.sym("f", n), ca.SX.sym("x", self.n_x)
        jacobian = ca.SX.sym("J", self.jacobian.sparsity_out(1))
        mass, h = ca.SX.sym("mass", self.n_x), ca.SX.sym("h")
        residual = ca.vertcat(mass * (w[: self.n_x, :] - x) - h * value[: self.n_x, :], -value[self.n_x :, :])
        weight = ca.diag(ca.vertcat(ca.repmat(h, self.n_x), ca.SX.ones(self.n_z)))
        system = ca.diag(ca.vertcat(mass, ca.SX(self.n_z, 1))) - weight @ jacobian
        return ca.Function("one_step", [w, value, jacobian, x, mass, h], [residual, system])

    def tangent(self, count: int) -> ca.Function:
        """``(w, F_d F_p of each stage, x, dx, dd, M, dM/dp, h) -> `` right side of the tangent system."""
        inverse = np.linalg.inv(radau(count)[1])
        n = self.n_x + self.n_z
        w, x = ca.SX.sym("w", n, count), ca.SX.sym("x", self.n_x)
        dx, dd = ca.SX.sym("dx", self.n_x, self.n_p), ca.SX.sym("dd", self.n_d, self.n_p)
        f_d = [ca.SX.sym(f"Fd{i}", self.derivatives.sparsity_out(1)) for i in range(count)]
        f_p = [ca.SX.sym(f"Fp{i}", self.derivatives.sparsity_out(2)) for i in range(count)]
        mass, h = ca.SX.sym("mass", self.n_x), ca.SX.sym("h")
        slope = ca.SX.sym("slope", self.mass_slope.sparsity_out(0))
        rows = []
        for i in range(count):
            drive = f_d[i] @ dd + f_p[i]
            moved = (w[: self.n_x, :] - ca.repmat(x, 1, count)) @ inverse[i]
            memory = inverse[i].sum() * ca.diag(mass) @ dx - ca.diag(moved) @ slope
            rows += [h * drive[: self.n_x, :] + memory, drive[self.n_x :, :]]
        inputs = [ca.vec(w), *f_d, *f_p, x, dx, dd, mass, slope, h]
        return ca.Function("tangent", inputs, [ca.densify(ca.vertcat(*rows))])

    def differentiate(self, stages: ca.MX, dx: ca.MX, dd: ca.MX, a: dict[str, ca.MX]) -> ca.MX:
        """Derivative of the last stage by the parameters."""
        nodes, _ = radau(STAGES)
        mass, slope = self.mass(a["p"], a["c"]), self.mass_slope(a["p"], a["c"])
        slopes = [
            self.derivatives(stages[:, i], a["d"], a["u"], a["t"] + nodes[i] * a["h"], a["p"], a["c"])
            for i in range(STAGES)
        ]
        f_w, f_d, f_p = zip(*slopes, strict=True)
        system = self.assembly(STAGES)(*f_w, mass, a["h"])
        right = self.tangent(STAGES)(ca.vec(stages), *f_d, *f_p, a["x"], dx, dd, mass, slope, a["h"])
        return ca.solve(system, right, "qr")[-(self.n_x + self.n_z) :, :]


def _newton(equations: Equations, stage: _Stage) -> ca.Function:
    """``(x, z, d, u, t, h, p, c) -> (stages, size of the last update)``."""
    nodes, _ = radau(STAGES)
    n = stage.n_x + stage.n_z
    scale = ca.repmat(ca.DM(equations.scale), STAGES, 1)
    w = ca.MX.sym("w", n * STAGES)
    x, z, d = ca.MX.sym("x", stage.n_x), ca.MX.sym("z", stage.n_z), ca.MX.sym("d", stage.n_d)
    u, t, h = ca.MX.sym("u", stage.n_u), ca.MX.sym("t"), ca.MX.sym("h")
    p, c = ca.MX.sym("p", stage.n_p), ca.MX.sym("c", equations.constants.size)
    step = [x, d, u, t, h, p, c]

    mass = stage.mass(p, c)
    values, jacobians = zip(
        *(stage.jacobian(w[i * n : (i + 1) * n, :], d, u, t + nodes[i] * h, p, c) for i in range(STAGES)),
        strict=True,
    )
    defect = stage.defect(STAGES)(w, *values, x, mass, h)
    change = ca.solve(stage.assembly(STAGES)(*jacobians, mass, h), defect, "qr")
    update = ca.Function("newton_update", [w, *step], [w - change, ca.norm_inf(change / scale)])

    # All stages start from the same point, so that the first step needs the plant's Jacobian there only once.
    start = ca.repmat(ca.vertcat(x, z), STAGES, 1)
    value, jacobian = stage.jacobian(ca.vertcat(x, z), d, u, t, p, c)
    defect = stage.defect(STAGES)(start, *[value] * STAGES, x, mass, h)
    tangent = start - ca.solve(stage.assembly(STAGES)(*[jacobian] * STAGES, mass, h), defect, "qr")

    def iterate(start: ca.MX, count: int) -> list[ca.MX]:
        size = ca.MX(0)
        for _ in range(count):
            start, size = update(start, *step)
        return [start, size]

    size = ca.MX.sym("size")
    done = ca.Function("done", [size, w, *step], [w, size])
    found, last = iterate(tangent, UPDATES[0])
    for number, count in enumerate(UPDATES[1:]):
        more = ca.Function(f"more_{number}", [size, w, *step], iterate(w, count))
        found, last = ca.Function.if_else(f"refine_{number}", more, done)(last > SETTLED, last, found, *step)
    euler = _euler(stage, [x, z, d, u, t, h, p, c])
    anew = ca.Function("anew", [size, z, w, *step], iterate(euler(x, z, d, u, t, h, p, c), UPDATES[-1]))
    keep = ca.Function("keep", [size, z, w, *step], [w, size])
    found, last = ca.Function.if_else("start_anew", anew, keep)(last > SETTLED, last, z, found, *step)
    return ca.Function("newton", [x, z, d, u, t, h, p, c], [ca.reshape(found, n, STAGES), last])


def _euler(stage: _Stage, arguments: list[ca.MX]) -> ca.Function:
    """``(x, z, d, u, t, h, p, c) -> `` a guess of all stages by small implicit Euler steps."""
    x, z, d, u, t, h, p, c = arguments
    n = stage.n_x + stage.n_z
    one = stage.one_step()
    mass = stage.mass(p, c)
    w, before, last = ca.MX.sym("w", n), ca.MX.sym("before", stage.n_x), ca.MX.sym("t_last")
    small, m = ca.MX.sym("h_small"), ca.MX.sym("m", stage.n_x)
    value, jacobian = stage.jacobian(w, d, u, last, p, c)
    defect, system = one(w, value, jacobian, before, m, small)
    update = ca.Function("euler_update", [w, before, d, u, last, small, m, p, c], [w - ca.solve(system, defect, "qr")])
    nodes, _ = radau(STAGES)
    at, stages, clock = ca.vertcat(x, z), [], t
    for width in np.diff(np.concatenate([[0.0], nodes])):
        for _ in range(EULER_STEPS):
            short = width / EULER_STEPS * h
            clock, start = clock + short, at[: stage.n_x]
            for _ in range(EULER_UPDATES):
                at = update(at, start, d, u, clock, short, mass, p, c)
        stages.append(at)
    return ca.Function("euler", arguments, [ca.vertcat(*stages)])

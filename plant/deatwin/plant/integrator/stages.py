"""A differential-algebraic equation at the stages of one implicit step, and its derivatives there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.integrator.dense import solved_in_lanes
from deatwin.plant.integrator.elimination import products
from deatwin.plant.integrator.lanes import Exchange, call_in_lanes, in_lanes, in_lanes_name

UNROLLED = 1600
"""Number of products in one elimination up to which linear algebra is written as straight-line code; for more, as loops
over sparse matrices. Loops take ten times as long, but a product takes some 5 ms to compile, so that more of them would
take longer than ten seconds."""
REVERSE = {"helper_options": {"ad_weight": 0.6}}
"""Options for Jacobians by reverse sweeps unless these are half as many again as forward ones: forces are gradients."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Stages:
    """Residual and derivatives of a DAE at the stages of a collocation step."""

    n_x: int  # Number of states that move
    n_z: int  # Number of coordinates
    n_d: int  # Number of held quantities
    n_u: int  # Number of inputs
    n_p: int  # Number of free parameters
    n_c: int  # Number of constants
    scale: np.ndarray  # shape (n_x + n_z,): Typical size of each unknown
    nodes: np.ndarray  # shape (s,): Nodes of the stages, in (0, 1]
    inverse: np.ndarray  # shape (s, s): Inverse of the Butcher matrix
    residual: ca.Function  # ``(w, d, u, t, p, c) -> (f; g)`` with w = (x; z)
    jacobian: ca.Function  # ``(w, d, u, t, p, c) -> ((f; g), derivative by w)``
    derivatives: ca.Function  # ``(w, d, u, t, p, c) -> `` derivatives by d and p
    mass: ca.Function  # ``(p, c) -> diag M``
    mass_slope: ca.Function  # ``(p, c) -> `` derivative of `mass` by p
    output_derivatives: ca.Function
    """``(x, z, d, u, t, p, c) -> `` derivatives of the reading by all states and z, by d and by p."""

    @classmethod
    def of(cls, equations: Equations, nodes: np.ndarray, matrix: np.ndarray) -> Stages:
        """Differentiate the equations. Shapes: `nodes` (s,); `matrix` (s, s)."""
        (every, *others), split = equations.symbols()
        (d, u, _, p, c), moving = others, equations.moving.tolist()
        n_x, w = len(equations.states) - len(equations.shifts), every[moving]
        arguments = [w, *others]
        # Common subexpressions of different forces are found before differentiation.
        f = ca.cse(equations.dynamics(*split))[moving]
        y = equations.outputs(*split)
        mass = equations.mass(p, c)[:n_x, :]
        f_w = ca.jacobian(f, w, REVERSE)
        return cls(
            n_x=n_x,
            n_z=w.numel() - n_x,
            n_d=d.numel(),
            n_u=u.numel(),
            n_p=p.numel(),
            n_c=c.numel(),
            scale=equations.scale[moving],
            nodes=nodes,
            inverse=np.linalg.inv(matrix),
            residual=ca.Function("stage_residual", arguments, [f]),
            jacobian=ca.Function("stage_jacobian", arguments, ca.cse([f, f_w])),
            derivatives=ca.Function(
                "stage_derivatives", arguments, ca.cse([ca.jacobian(f, d, REVERSE), ca.jacobian(f, p, REVERSE)])
            ),
            mass=ca.Function("stage_mass", [p, c], [mass]),
            mass_slope=ca.Function("stage_mass_slope", [p, c], [ca.jacobian(mass, p)]),
            output_derivatives=ca.Function(
                "output_derivatives", split, [ca.jacobian(y, every), ca.jacobian(y, d), ca.jacobian(y, p)]
            ),
        )

    @property
    def count(self) -> int:
        """Number of stages."""
        return self.nodes.size

    @cached_property
    def unrolled(self) -> bool:
        """True if linear algebra is written as straight-line code."""
        pattern = [{i} if i < self.n_x else set() for i in range(self.n)]
        for row, column in zip(*self.jacobian.sparsity_out(1).get_triplet(), strict=True):
            pattern[row].add(column)
        return products(pattern) <= UNROLLED

    @property
    def n(self) -> int:
        """Number of unknowns of one stage."""
        return self.n_x + self.n_z

    def symbols(self) -> list[ca.MX]:
        """``x, z, d, u, t, h, p, c`` of a step."""
        sizes = {
            "x": self.n_x,
            "z": self.n_z,
            "d": self.n_d,
            "u": self.n_u,
            "t": 1,
            "h": 1,
            "p": self.n_p,
            "c": self.n_c,
        }
        return [ca.MX.sym(name, size) for name, size in sizes.items()]

    @cached_property
    def values(self) -> ca.Function:
        """Function ``(w, d, u, t, p, c) -> `` `residual` at all stages, one column of w and t per stage."""
        return self._everywhere("stage_values", self.residual)

    @cached_property
    def slopes(self) -> ca.Function:
        """Function ``(w, d, u, t, p, c) -> `` entries of the `derivatives` at all stages, one column each."""
        return self._everywhere("stage_slopes", self.derivatives)

    @cached_property
    def jacobians(self) -> ca.Function:
        """Function ``(w, d, u, t, p, c) -> `` `residual` and entries of its derivative by w at all stages."""
        return self._everywhere("stage_jacobians", self.jacobian)

    def _everywhere(self, name: str, function: ca.Function) -> ca.Function:
        w, t = ca.MX.sym("w", self.n, self.count), ca.MX.sym("t", 1, self.count)
        _, _, d, u, _, _, p, c = self.symbols()
        columns = zip(ca.horzsplit(w), ca.horzsplit(t), strict=True)
        found = [function.call([w_i, d, u, t_i, p, c]) for w_i, t_i in columns]
        return ca.Function(
            name,
            [w, d, u, t, p, c],
            [ca.horzcat(*(ca.reshape(r.nz[:], r.nnz(), 1) for r in results)) for results in zip(*found, strict=True)],
        )

    def everywhere(self, function: ca.Function, w: ca.MX, known: Sequence[ca.MX]) -> list[ca.MX]:
        """Call `values`, `slopes` or `jacobians`. Shapes: `w` (n s,)."""
        d, u, t, h, p, c = known
        columns, times = ca.reshape(w, self.n, self.count), t + ca.DM(self.nodes).T * h
        return list(function.call([columns, d, u, times, p, c]))

    def in_lanes(self) -> Exchange:
        """Return C code with vector instructions for evaluations and solutions at several stages, if there are any."""
        pattern = self.jacobian.sparsity_out(1)
        helpers: dict[str, str] = {}
        beginnings: dict[str, str] = {}
        bodies: dict[str, str] = {}
        for system, columns, kept in ((self.all_stages, 1, self.count), (self.last_stage, self.n_p, 1)):
            solved = solved_in_lanes(pattern, self.inverse, self.n_x, columns, kept, self.scale)
            if solved is not None:
                name = in_lanes_name(system)
                helpers[name] = f"static int {name}(const double** arg, double** res) {{\n{solved}\n}}"
                beginnings[system.name()] = f"  if (!{name}(arg, res)) return 0;"
        parts = (self.residual, self.jacobian, self.derivatives)
        for part, whole in zip(parts, (self.values, self.jacobians, self.slopes), strict=True):
            helper = in_lanes(part, varying=(0, 3))
            if helper is not None:
                helpers[in_lanes_name(part)] = helper
                bodies |= {part.name(): call_in_lanes(part, 1), whole.name(): call_in_lanes(part, self.count)}
        return Exchange(bodies=bodies, beginnings=beginnings, helpers=helpers)

    def defect(self, w: ca.MX, values: ca.MX, x: ca.MX, mass: ca.MX, h: ca.MX) -> ca.MX:
        """Residual of the collocation equations. Shapes: `w` (n s,); `values` (n, s); `x` (n_x,); returns (n s,)."""
        moved = (ca.reshape(w, self.n, self.count)[: self.n_x, :] - ca.repmat(x, 1, self.count)) @ self.inverse.T
        states = ca.repmat(mass, 1, self.count) * moved - h * values[: self.n_x, :]
        return ca.vec(ca.vertcat(states, -values[self.n_x :, :]))

    def tangent(self) -> ca.Function:
        """Function ``(w, entries of F_d, of F_p, x, dx, dd, M, dM/dp, h) -> `` right side of the tangent system."""
        kind: Any = ca.SX if self.unrolled else ca.MX
        w, x = kind.sym("w", self.n, self.count), kind.sym("x", self.n_x)
        dx, dd = kind.sym("dx", self.n_x, self.n_p), kind.sym("dd", self.n_d, self.n_p)
        patterns = [self.derivatives.sparsity_out(i) for i in (0, 1)]
        entries = [kind.sym("F", pattern.nnz(), self.count) for pattern in patterns]
        f_d, f_p = (
            [kind(pattern, column) for column in ca.horzsplit(values)]
            for pattern, values in zip(patterns, entries, strict=True)
        )
        mass, h = kind.sym("mass", self.n_x), kind.sym("h")
        slope = kind.sym("slope", self.mass_slope.sparsity_out(0))
        rows = []
        for i in range(self.count):
            drive = f_d[i] @ dd + f_p[i]
            moved = (w[: self.n_x, :] - ca.repmat(x, 1, self.count)) @ self.inverse[i]
            memory = self.inverse[i].sum() * ca.diag(mass) @ dx - ca.diag(moved) @ slope
            rows += [h * drive[: self.n_x, :] + memory, drive[self.n_x :, :]]
        inputs = [ca.vec(w), *entries, x, dx, dd, mass, slope, h]
        return ca.Function("tangent", inputs, [ca.densify(ca.vertcat(*rows))])

    @cached_property
    def all_stages(self) -> ca.Function:
        """`solution` for one right-hand side at all stages."""
        return self.solution("all_stages", 1, self.count)

    @cached_property
    def last_stage(self) -> ca.Function:
        """`solution` at the last stage, for one right-hand side per parameter."""
        return self.solution("last_stage", self.n_p, 1)

    def solution(self, name: str, columns: int, kept: int) -> ca.Function:
        """Return ``(entries of J at all stages, M, h, right sides) -> `` solution of the system of all stages."""
        pattern = self.jacobian.sparsity_out(1)
        entries, mass, h = ca.MX.sym("J", pattern.nnz(), self.count), ca.MX.sym("mass", self.n_x), ca.MX.sym("h")
        right = ca.MX.sym("right", self.n * self.count, columns)
        system = coupled(pattern, self.n_x, self.inverse)(entries, mass, h)
        found = ca.solve(system, right, "qr")[-self.n * kept :, :]
        return ca.Function(name, [entries, mass, h, right], [found])

    def differentiate(self, w: ca.MX, x: ca.MX, known: Sequence[ca.MX], dx: ca.MX, dd: ca.MX) -> ca.MX:
        """Differentiate the last stage by the parameters, implicitly, (n, n_p); `w` (n s,)."""
        h, p, c = known[3:]
        mass, slope = self.mass(p, c), self.mass_slope(p, c)
        right = self.tangent()(w, *self.everywhere(self.slopes, w, known), x, dx, dd, mass, slope, h)
        _, entries = self.everywhere(self.jacobians, w, known)
        return self.last_stage(entries, mass, h, right)


def coupled(pattern: ca.Sparsity, n_x: int, coupling: np.ndarray) -> ca.Function:
    """Matrix of k stages coupled by their states' inertia, c_ij diag(M, 0) - delta_ij diag(h, 1) J_i, c (k, k)."""
    n, nnz, count = pattern.size1(), pattern.nnz(), len(coupling)
    rows, columns = (np.array(places, dtype=int) for places in pattern.get_triplet())
    size, stage = n * count, np.arange(count)[:, None]
    driven = ((stage * n + columns) * size + stage * n + rows).ravel()
    i, j = np.nonzero(coupling)
    state = np.arange(n_x)[:, None]
    inert = ((j * n + state) * size + i * n + state).ravel()

    places = np.unique(np.concatenate([driven, inert]))  # column by column
    # Places without a number look up the zero after the last number.
    of_jacobian, of_mass, weight = np.full(places.size, nnz * count), np.full(places.size, n_x), np.zeros(places.size)
    of_jacobian[np.searchsorted(places, driven)] = np.arange(nnz * count)
    of_mass[np.searchsorted(places, inert)] = np.repeat(state, i.size)
    weight[np.searchsorted(places, inert)] = np.tile(coupling[i, j], n_x)

    entries, mass, h = ca.MX.sym("J", nnz, count), ca.MX.sym("mass", n_x), ca.MX.sym("h")
    moving = np.tile(rows < n_x, count)
    drive = ca.vec(entries) * (ca.DM(moving) * h + ca.DM(~moving))
    numbers = ca.DM(weight) * _looked_up(mass, of_mass) - _looked_up(drive, of_jacobian)
    matrix = ca.MX(ca.Sparsity.triplet(size, size, (places % size).tolist(), (places // size).tolist()), numbers)
    return ca.Function("coupled", [entries, mass, h], [matrix])


def _looked_up(numbers: ca.MX, places: np.ndarray) -> ca.MX:
    """Select entries of a column to which a zero is appended."""
    return ca.reshape(ca.vertcat(numbers, 0).nz[places.tolist()], places.size, 1)

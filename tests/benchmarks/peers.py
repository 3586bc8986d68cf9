"""What a user would write with a stock solver: the peers of the plant's integrator, on the same equations.

Each takes a plant and commands and gives the reading at the end of each sample, or raises where a solver gives up.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from deatwin.plant import Plant
from deatwin.plant.integrator.compiled import compile_functions, compiler
from deatwin.plant.rest import rest_state

UPDATES = 4
"""Of Newton's method on the algebraic coordinates in each call of a right-hand side, from where the last one ended."""
Peer = Callable[[np.ndarray], np.ndarray]


def _symbols(plant: Plant) -> tuple[ca.SX, ...]:
    equations = plant.equations
    x, z = ca.SX.sym("x", len(equations.states)), ca.SX.sym("z", len(equations.coordinates))
    return x, z, ca.SX.sym("d", len(equations.held)), ca.SX.sym("u"), ca.SX.sym("t")


def _reading(plant: Plant, x: np.ndarray, z: np.ndarray, d: np.ndarray, command: float, time: float) -> float:
    equations = plant.equations
    return float(equations.output(x, z, d, [command], time, plant.free_values, equations.constants))


class RightSide:
    """``dx/dt`` and its Jacobian with the algebraic coordinates solved inside, in compiled code.

    Called through buffers, which costs a microsecond, not ten.
    """

    def __init__(self, plant: Plant) -> None:
        equations, values = plant.equations, (plant.free_values, plant.equations.constants)
        x, z, d, u, t = _symbols(plant)
        n_x = x.numel()
        residual = ca.cse(equations.dynamics(x, z, d, u, t, *values))
        rate, balance = residual[:n_x] / equations.mass(*values), residual[n_x:]
        arguments = [x, z, d, u, t]
        parts = ca.Function("parts", arguments, ca.cse([balance, ca.densify(ca.jacobian(balance, z))]))
        rates = ca.Function("rates", arguments, [rate])
        slopes = ca.Function(
            "slopes", arguments, ca.cse([ca.densify(ca.jacobian(e, v)) for e in (rate, balance) for v in (x, z)])
        )
        a = [ca.MX.sym(n, k) for n, k in (("x", n_x), ("z", z.numel()), ("d", d.numel()), ("u", 1), ("t", 1))]
        found = a[1]
        for _ in range(UPDATES):
            value, slope = parts(a[0], found, *a[2:])
            found = found - ca.solve(slope, value, "qr")
        f_x, f_z, g_x, g_z = slopes(a[0], found, *a[2:])
        functions = {
            "right_side": ca.Function("right_side", a, [rates(a[0], found, *a[2:]), found]),
            "slope": ca.Function("slope", a, [f_x - f_z @ ca.solve(g_z, g_x, "qr")]),
        }
        compiled = compile_functions(functions)
        self.x, self.z, self.d = np.zeros(n_x), np.zeros(z.numel()), np.zeros(d.numel())
        self.u, self.t = np.zeros(1), np.zeros(1)
        self._rate, self._found, self._slope = np.zeros(n_x), np.zeros(z.numel()), np.zeros((n_x, n_x), order="F")
        self._buffers = []
        for name, results in (("right_side", (self._rate, self._found)), ("slope", (self._slope,))):
            buffer, run = compiled[name].buffer()
            for number, array in enumerate((self.x, self.z, self.d, self.u, self.t)):
                buffer.set_arg(number, memoryview(array))
            for number, array in enumerate(results):
                buffer.set_res(number, memoryview(array.T if array.ndim == 2 else array))
            self._buffers.append((buffer, run))

    def rate(self, time: float, x: np.ndarray) -> np.ndarray:
        self.x[:], self.t[0] = x, time
        self._buffers[0][1]()
        self.z[:] = self._found
        return self._rate.copy()

    def slope(self, time: float, x: np.ndarray) -> np.ndarray:
        self.x[:], self.t[0] = x, time
        self._buffers[1][1]()
        return self._slope.copy()


def scipy_peer(plant: Plant, method: str, relative_tolerance: float) -> Peer:
    """`solve_ivp`, started anew at each sample since the command jumps there."""
    side = RightSide(plant)
    rest = rest_state(plant.equations, plant.rig.start.rest_command, plant.free_values)
    n_x, h = rest.x.size, plant.rig.sample_time
    options = {"rtol": relative_tolerance, "atol": relative_tolerance * plant.equations.scale[:n_x]}

    def run(commands: np.ndarray) -> np.ndarray:
        side.d[:], side.z[:] = rest.d, rest.z
        x, readings = rest.x, []
        for number, command in enumerate(commands):
            side.u[0] = command
            done = solve_ivp(side.rate, (number * h, number * h + h), x, method, jac=side.slope, **options)
            if not done.success:
                raise RuntimeError(done.message)
            x = done.y[:, -1]
            side.rate(number * h + h, x)
            readings.append(_reading(plant, x, side.z, rest.d, command, number * h + h))
        return np.array(readings)

    return run


def sundials_peer(plant: Plant, solver: str, relative_tolerance: float, count: int) -> Peer:
    """CasADi's IDAS, or CVODES with the algebraic coordinates solved inside, in one call for all samples.

    CasADi itself starts anew where the command jumps. The equations and their Jacobian are compiled.
    """
    equations, values = plant.equations, (plant.free_values, plant.equations.constants)
    rest = rest_state(equations, plant.rig.start.rest_command, plant.free_values)
    n_x, h, scale = rest.x.size, plant.rig.sample_time, equations.scale
    x, z, _, u, t = _symbols(plant)
    residual = ca.cse(equations.dynamics(scale[:n_x] * x, scale[n_x:] * z, rest.d, u, t, *values))
    rate, balance = residual[:n_x] / (equations.mass(*values) * scale[:n_x]), residual[n_x:]
    known = _compiled_with_jacobian(ca.Function("known", [x, z, u, t], [rate, balance]))
    x, z, u, t = (ca.MX.sym(name, symbol.numel()) for name, symbol in zip("xzut", (x, z, u, t), strict=True))
    rate, balance = known(x, z, u, t)
    problem = {"x": x, "t": t, "u": u, "ode": rate}
    if solver == "idas":
        problem |= {"z": z, "alg": balance}
    else:
        inside = ca.rootfinder("inside", "newton", {"x": z, "p": ca.vertcat(x, u, t), "g": balance})
        solved = inside(x0=rest.z / scale[n_x:], p=ca.vertcat(x, u, t))["x"]
        problem["ode"] = known(x, solved, u, t)[0]
    settings = {"reltol": relative_tolerance, "abstol": relative_tolerance, "max_num_steps": 1_000_000}
    grid = h * np.arange(1, count + 1)
    advance = ca.integrator("peer", solver, problem, 0.0, grid, settings)
    at_rest = {"x0": rest.x / scale[:n_x]} | ({"z0": rest.z / scale[n_x:]} if solver == "idas" else {})

    def run(commands: np.ndarray) -> np.ndarray:
        states = np.asarray(advance(u=commands[None], **at_rest)["xf"]) * scale[:n_x, None]
        # The reading of these plants depends on the states only.
        after = zip(states.T, commands, grid, strict=True)
        return np.array([_reading(plant, a, rest.z, rest.d, b, c) for a, b, c in after])

    return run


def _compiled_with_jacobian(function: ca.Function) -> ca.Function:
    generator = ca.CodeGenerator("known.c")
    for part in (function, function.forward(1), function.jacobian()):
        generator.add(part)
    folder = Path(tempfile.mkdtemp())
    code, library = folder / "known.c", folder / "known.so"
    code.write_text(generator.dump())
    subprocess.run([str(compiler()), "-O2", "-fPIC", "-shared", str(code), "-o", str(library), "-lm"], check=True)
    return ca.external(function.name(), str(library))

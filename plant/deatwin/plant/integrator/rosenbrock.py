"""A plant integrated by the Rosenbrock method RODAS with its own choice of step, without Newton iterations.

One step of M dw/dt = F(w, t) solves
(M/(gamma h) - F_w) k_i = F(w + sum_j a_ij k_j, t + alpha_i h) + M sum_j (c_ij/h) k_j + gamma_i h F_t,  j < i.
Order 4, L-stable, stiffly accurate (Hairer & Wanner 1996, VI.4, doi:10.1007/978-3-642-05221-7). Where an input jumps,
Newton's method makes the coordinates consistent before the next step.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.compiled import load_source
from deatwin.plant.rest import rest_state

TOLERANCE = 1e-5
"""Error of a step relative to each unknown's typical size. A displacement of a millimetre is then accurate to some
hundredths of a micrometre over minutes (tests/unit/plant/integrator/test_rosenbrock.py)."""
SHORTEST = 1e-7  # Shortest step, s
SAFETY, SHRINK, GROW = 0.8, 0.2, 4.0
FURTHEST = 1.0
"""Largest change of a coordinate at a jump of the input, relative to its typical size; a film that moves further has
pulled in."""
CONSISTENT = 1e-9  # Change of a coordinate, relative to its typical size, below which it counts as consistent
GAMMA = 0.25
AT = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
SLOPES = np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0])
MIX = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0, 0.0],
    ]
)
PASSED = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0, 0.0],
        [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054, 0.0],
    ]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """Result of an integration."""

    outputs: np.ndarray  # shape (n,): Reading at each requested time, SI
    at_rest: float  # Reading in the initial state of rest, SI
    steps: int  # Number of steps, including refused ones


def integrate(
    equations: Equations,
    values: np.ndarray,
    switches: np.ndarray,
    inputs: np.ndarray,
    reads: np.ndarray,
    *,
    rest_command: float = 0.0,
    tolerance: float = TOLERANCE,
) -> Trajectory:
    """Integrate from rest under inputs (n_u, m) that are constant between switching times (m,); `reads` (n,)."""
    if equations.step_middle is not None:
        raise ValueError("the equations divide a sample, of which this integrator knows nothing: give it late switches")
    rest = rest_state(equations, rest_command, values)
    if not rest.found:
        raise SimulationError(rest.fault)
    kernel, n_x, scale = _kernel(equations), len(equations.states), equations.scale
    mass = np.asarray(equations.mass(values, equations.constants)).ravel() * scale[:n_x]
    # Each state's row is divided by its mass, so that all rows have the same size.
    rows = np.concatenate([1 / np.where(mass > 0, mass, 1.0), np.ones(scale.size - n_x)])
    masses = np.concatenate([mass, np.zeros(scale.size - n_x)]) * rows
    known = [rest.d, values, equations.constants, masses, scale, rows]
    arrays = [np.ascontiguousarray(a, dtype=float) for a in known]
    plant = _Plant(*map(_address, arrays), tolerance, SHORTEST, SAFETY, SHRINK, GROW, CONSISTENT)
    outputs, at_rest, ended, steps = np.zeros(reads.size), ctypes.c_double(), ctypes.c_double(), ctypes.c_longlong()
    given = [np.concatenate([rest.x, rest.z]) / scale, switches, inputs.T, equations.held_inputs(rest_command), reads]
    start, times, held, resting, asked = (np.ascontiguousarray(a, dtype=float) for a in given)
    failed = kernel.march(
        _address(start),
        ctypes.byref(plant),
        times.size,
        _address(times),
        _address(held),
        _address(resting),
        asked.size,
        _address(asked),
        _address(outputs),
        ctypes.byref(at_rest),
        ctypes.byref(steps),
        ctypes.byref(ended),
    )
    if failed:
        raise SimulationError(f"the film is lost at {ended.value:.3f} s: it pulls in, or a mechanism is too stiff")
    return Trajectory(outputs=outputs, at_rest=at_rest.value, steps=steps.value)


class _Plant(ctypes.Structure):
    """The kernel's struct ``plant_t``."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("held", "parameters", "constants", "mass", "scale", "rows")),
        *((name, ctypes.c_double) for name in ("tolerance", "shortest", "safety", "shrink", "grow", "consistent")),
    ]


def _address(array: np.ndarray) -> int:
    return int(array.ctypes.data)


@lru_cache(maxsize=32)
def _kernel(equations: Equations) -> ctypes.CDLL:
    """Return the integrator, compiled for a plant."""
    functions = _functions(equations)
    pattern = functions[1].sparsity_out(1)
    rows, columns = (np.array(part) for part in pattern.get_triplet())
    n = equations.scale.size
    place, lower, upper = _elimination(n, rows, columns)
    generator = ca.CodeGenerator("plant.c")
    for function in functions:
        generator.add(function)
    sizes = [(f.sz_arg(), f.sz_res(), f.sz_w(), f.sz_iw()) for f in functions]
    most = np.max(np.array(sizes), axis=0)
    numbers = {
        "N": n,
        "NX": len(equations.states),
        "ND": len(equations.held),
        "NU": equations.held_inputs(0.0).size,
        "NNZ": rows.size,
        "ARGUMENTS": int(most[0]),
        "RESULTS": int(most[1]),
        "WORK_W": int(most[2]) + 1,
        "WORK_IW": int(most[3]) + 1,
        "GAMMA": GAMMA,
        "FURTHEST": FURTHEST,
        "VALUE": functions[0].name(),
        "SLOPES": functions[1].name(),
        "OUTPUT": functions[2].name(),
    }
    tables = [
        _table("ROW", rows),
        _table("COLUMN", columns),
        _table("PLACE", place),
        *_lists("LOWER", lower),
        *_lists("UPPER", upper),
        _table("AT", AT),
        _table("SLOPES_AT", SLOPES),
        _table("MIX", MIX),
        _table("PASSED", PASSED),
    ]
    defined = [f"#define {name} {value}" for name, value in numbers.items()]
    march = Path(__file__).with_name("rosenbrock.c").read_text(encoding="utf-8")
    kernel = load_source("\n".join([generator.dump(), *defined, *tables, march]))
    if kernel is None:
        raise SimulationError("the concealed apparatus needs a C compiler: install cc, gcc or clang")
    kernel.march.restype = ctypes.c_int
    pointer, number = ctypes.c_void_p, ctypes.c_longlong
    kernel.march.argtypes = (pointer, pointer, number, *(pointer,) * 3, number, *(pointer,) * 5)
    return kernel


def _functions(equations: Equations) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Return F; F with its derivatives by unknowns (sparse) and time; and the reading."""
    arguments, at = equations.symbols()
    n_x, w, t = len(equations.states), arguments[0], arguments[3]
    f = ca.cse(equations.dynamics(*at))
    f = ca.vertcat(f[:n_x], f[_partners(equations).tolist()]) if n_x < w.numel() else f
    parts = [ca.densify(f), ca.jacobian(f, w), ca.densify(ca.jacobian(f, t))]
    return (
        ca.Function("rosenbrock_value", arguments, [ca.densify(f)]),
        ca.Function("rosenbrock_slopes", arguments, ca.cse(parts)),
        ca.Function("rosenbrock_output", arguments, [ca.densify(equations.output(*at))]),
    )


def _partners(equations: Equations) -> np.ndarray:
    """Return, for each coordinate, the balance with its largest entry, shape (n_z,), so that no pivot is small."""
    from scipy.optimize import linear_sum_assignment

    n_x = len(equations.states)
    rest = rest_state(equations, 0.0, equations.free_values)
    w, z = np.concatenate([rest.x, rest.z]), ca.SX.sym("z", equations.scale.size - n_x)
    known = (equations.held_inputs(0.0), 0.0, equations.free_values, equations.constants)
    balances = equations.dynamics(w[:n_x], z, rest.d, *known)[n_x:]
    slope = np.abs(np.asarray(ca.Function("slope", [z], [ca.densify(ca.jacobian(balances, z))])(rest.z)))
    sizes = slope * equations.scale[n_x:]
    sizes = sizes / np.maximum(sizes.max(axis=1, keepdims=True), 1e-300)
    matched, coordinates = linear_sum_assignment(-np.log(sizes + 1e-30))
    return n_x + matched[np.argsort(coordinates)]


def _elimination(n: int, rows: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, list[list[int]], list[list[int]]]:
    """Order the unknowns for elimination; list the entries below and to the right of each pivot."""
    filled = np.eye(n, dtype=bool)
    filled[rows, columns] = True
    order: list[int] = []
    left, work = set(range(n)), filled.copy()
    while left:  # the unknown with the fewest products comes first
        alive = sorted(left)
        counts = (work[np.ix_(alive, alive)].sum(axis=0) - 1) * (work[np.ix_(alive, alive)].sum(axis=1) - 1)
        pivot = alive[int(np.argmin(counts))]
        left.remove(pivot)
        order.append(pivot)
        rest = np.array(sorted(left), dtype=int)
        work[np.ix_(rest[work[rest, pivot]], rest[work[pivot, rest]])] = True
    place = np.argsort(order)
    entries = work[np.ix_(order, order)]
    lower = [[i for i in range(k + 1, n) if entries[i, k]] for k in range(n)]
    upper = [[j for j in range(k + 1, n) if entries[k, j]] for k in range(n)]
    return place, lower, upper


def _table(name: str, values: np.ndarray) -> str:
    """Write a constant array in C."""
    kind = "int" if values.dtype.kind == "i" else "double"
    shape = "".join(f"[{size}]" for size in values.shape)
    numbers = ", ".join(repr(v) for v in values.ravel().tolist())
    return f"static const {kind} {name}{shape} = {{{numbers}}};"


def _lists(name: str, lists: Sequence[Sequence[int]]) -> tuple[str, str]:
    """Join lists, and return where each begins."""
    ends = np.concatenate([[0], np.cumsum([len(part) for part in lists])])
    return _table(name, np.array([*(v for part in lists for v in part), 0])), _table(f"{name}_AT", ends)

r"""A plant integrated by a Rosenbrock method with its own choice of step: no Newton iterations, no fixed stages.

One step of :math:`M\dot w = F(w, t)` from w over h solves, with one matrix for all six stages,

.. math::
    \Bigl(\frac{M}{\gamma h} - F_w\Bigr)\,k_i =
    F\Bigl(w + \sum_{j<i} a_{ij}k_j,\; t + \alpha_i h\Bigr) + M\sum_{j<i}\frac{c_{ij}}{h}k_j + \gamma_i h F_t

The scheme has order 4 with an estimate of order 3, and is L-stable and stiffly accurate, so algebraic equations
(rows of M that are zero) hold at the end of each step. Where an input jumps, the coordinates jump with it: they
are made consistent by Newton's method before the next step.

References
----------
Hairer & Wanner, Solving Ordinary Differential Equations II (1996), section VI.4 (the method RODAS),
doi:10.1007/978-3-642-05221-7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.linalg import get_lapack_funcs

from deatwin.plant.equations import Equations
from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.compiled import compile_functions
from deatwin.plant.integrator.march import March
from deatwin.plant.rest import RestState, rest_state

__all__ = ["TOLERANCE", "Trajectory", "integrate"]

TOLERANCE = 1e-5
"""Of a step's error, against each unknown's typical size; a millimetre of displacement is then right within some
hundredths of a micrometre over minutes (tests/unit/scenarios/test_concealed_generator.py)."""
SHORTEST = 1e-7
"""Of all steps, s."""
SAFETY, SHRINK, GROW = 0.8, 0.2, 4.0
CONSISTENT = 1e-9
"""Change of a coordinate, against its typical size, at which it counts as consistent."""
GAMMA = 0.25
AT = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
SLOPES = np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0])
MIX = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [1.544, 0.0, 0.0, 0.0, 0.0, 0.0],
    [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0, 0.0],
    [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0, 0.0],
    [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0, 0.0],
])  # fmt: skip
PASSED = np.array([
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-5.6688, 0.0, 0.0, 0.0, 0.0, 0.0],
    [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0, 0.0],
    [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0, 0.0],
    [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0, 0.0],
    [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054, 0.0],
])  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """What an integration gave.

    Parameters
    ----------
    outputs : ndarray, shape (n,)
        Reading at each of the times that were asked for, SI.
    at_rest : float
        Reading before anything happened, SI.
    steps : int
        Steps that were taken, refused ones included.
    """

    outputs: np.ndarray
    at_rest: float
    steps: int


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
    """Integrate from rest under inputs that are constant between switching times.

    Parameters
    ----------
    equations : Equations
        The DAE.
    values : ndarray, shape (n_p,)
        Free parameters, SI.
    switches : ndarray, shape (m,)
        Times at which a new input begins to act, ascending, s.
    inputs : ndarray, shape (n_u, m)
        What acts from each of them on.
    reads : ndarray, shape (n,)
        Times at which the output is read, ascending, none before the first switch, s. What is read where an input
        jumps is what was there before.
    rest_command : float
        Command before the first switch, V.
    tolerance : float
        Of the error of a step, against each unknown's typical size.

    Returns
    -------
    Trajectory

    Raises
    ------
    SimulationError
        If there is no state of rest, or the steps become too short, for example at pull-in.
    """
    rest = rest_state(equations, rest_command, values)
    if not rest.found:
        raise SimulationError("no state of rest was found: the film is too soft for its load")
    run = _Run(equations, values, rest, rest_command, tolerance)
    start = float(switches[0])
    at_rest = run.output(start)
    outputs = np.full(reads.size, at_rest)
    events = np.concatenate([switches[1:], [max(float(reads[-1]), float(switches[-1]))]])
    first = int(np.searchsorted(reads, start, side="right"))
    for number, until in enumerate(events):
        run.switch(inputs[:, number], float(switches[number]))
        while first < reads.size and reads[first] <= until:
            run.advance(float(reads[first]))
            outputs[first] = run.output(run.time)
            first += 1
        run.advance(float(until))
    return Trajectory(outputs=outputs, at_rest=at_rest, steps=run.steps)


class _Run:
    """The state of an integration, in units of each unknown's typical size."""

    def __init__(
        self, equations: Equations, values: np.ndarray, rest: RestState, rest_command: float, tolerance: float
    ) -> None:
        self._n_x, self._scale = len(equations.states), equations.scale
        self._functions = [March(f) for f in _functions(equations)]
        mass = np.asarray(equations.mass(values, equations.constants)).ravel()
        self._mass = np.concatenate([mass, np.zeros(self._scale.size - self._n_x)]) * self._scale
        self._tolerance = tolerance
        self._w = np.concatenate([rest.x, rest.z]) / self._scale
        sizes = np.concatenate([mass * self._scale[: self._n_x], np.ones(self._scale.size - self._n_x)])
        self._rows = 1.0 / np.where(sizes > 0, sizes, 1.0)
        self._mass *= self._rows
        for function in self._functions:
            w, d, u, t, p, c = function.arguments[:6]
            d[:], u[:], p[:], c[:] = rest.d, equations.held_inputs(rest_command), values, equations.constants
        self._factor, self._solve = get_lapack_funcs(("getrf", "getrs"), (self._w,))
        self._stages = np.zeros((6, self._w.size))
        self.time, self.steps, self._step = 0.0, 0, 1e-3

    def output(self, time: float) -> float:
        """The reading."""
        return float(self._evaluated(2, self._w, time)[0][0, 0])

    def switch(self, inputs: np.ndarray, time: float) -> None:
        """Let other inputs act from a time on, and make the coordinates consistent with them."""
        self.time = time
        for function in self._functions:
            function.arguments[2][:] = inputs
        n_x = self._n_x
        if n_x == self._w.size:
            return
        _, jacobian, _ = self._linearised()
        factors, pivots, _ = self._factor(jacobian[n_x:, n_x:])
        for _ in range(12):
            change, _ = self._solve(factors, pivots, self._value(self._w, time)[n_x:])
            self._w[n_x:] -= change
            if np.max(np.abs(change)) < CONSISTENT:
                return
        raise SimulationError(f"no balance of the film was found at {time:.3f} s: the voltage is too high")

    def advance(self, until: float) -> None:
        """Step to a time."""
        while until - self.time > SHORTEST / 2:
            left = until - self.time
            count = np.ceil(left / self._step - 1e-9)
            size = left / count if count < 3 else self._step
            self._advanced(size)

    def _advanced(self, size: float) -> None:
        """One step, shortened until its error is small."""
        value, jacobian, slope = self._linearised()
        diagonal = np.arange(self._w.size)
        while True:
            self.steps += 1
            matrix = -jacobian
            matrix[diagonal, diagonal] += self._mass / (GAMMA * size)
            factors, pivots, singular = self._factor(matrix, overwrite_a=1)
            error = np.inf if singular else self._staged(factors, pivots, size, value, slope)
            factor = SAFETY * error**-0.25 if error > 0 else GROW
            wished = size * min(max(factor, SHRINK), GROW) if np.isfinite(error) else SHRINK * size
            if error <= 1.0:
                self._w = self._w + MIX[5] @ self._stages + self._stages[5]
                self.time += size
                # A last step that was cut short to end on an event says nothing about the next.
                self._step = max(wished, self._step) if size < self._step else wished
                return
            if wished < SHORTEST:
                raise SimulationError(f"the film is lost at {self.time:.3f} s: it pulls in, or a mechanism is too stiff")
            size = self._step = wished

    def _staged(
        self, factors: np.ndarray, pivots: np.ndarray, size: float, value: np.ndarray, slope: np.ndarray
    ) -> float:
        """Solve the six stages; the error in units of what is tolerated."""
        k = self._stages
        for i in range(6):
            if i:
                value = self._value(self._w + MIX[i, :i] @ k[:i], self.time + AT[i] * size)
                right = value + self._mass * ((PASSED[i, :i] / size) @ k[:i])
            else:
                right = value.copy()
            if SLOPES[i]:
                right += SLOPES[i] * size * slope
            k[i], _ = self._solve(factors, pivots, right)
        moving = k[5, : self._n_x]
        return float(np.sqrt(moving @ moving / max(moving.size, 1))) / self._tolerance

    def _value(self, w: np.ndarray, time: float) -> np.ndarray:
        return self._evaluated(0, w, time)[0][0] * self._rows

    def _linearised(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """F, its derivative by the scaled unknowns, and by time."""
        value, jacobian, slope = self._evaluated(1, self._w, self.time)
        rows = self._rows
        return value[0] * rows, (jacobian.T * self._scale) * rows[:, None], slope[0] * rows

    def _evaluated(self, which: int, w: np.ndarray, time: float) -> list[np.ndarray]:
        function = self._functions[which]
        function.arguments[0][0] = w * self._scale
        function.arguments[3][0] = time
        return function.advance()


@lru_cache(maxsize=8)
def _functions(equations: Equations) -> tuple[ca.Function, ca.Function, ca.Function]:
    """Compiled: F; F with its derivatives by unknowns and time; the reading."""
    n_x = len(equations.states)
    w, d = ca.SX.sym("w", equations.scale.size), ca.SX.sym("d", len(equations.held))
    u, t = ca.SX.sym("u", equations.held_inputs(0.0).size), ca.SX.sym("t")
    p, c = ca.SX.sym("p", len(equations.parameters.free)), ca.SX.sym("c", equations.constants.size)
    at = [w[:n_x, :], w[n_x:, :], d, u, t, p, c]
    f = ca.cse(equations.dynamics(*at))
    parts = [ca.densify(f), ca.densify(ca.jacobian(f, w)), ca.densify(ca.jacobian(f, t))]
    arguments = [w, d, u, t, p, c]
    made = compile_functions({
        "concealed_value": ca.Function("concealed_value", arguments, [ca.densify(f)]),
        "concealed_slopes": ca.Function("concealed_slopes", arguments, ca.cse(parts)),
        "concealed_output": ca.Function("concealed_output", arguments, [ca.densify(equations.output(*at))]),
    })  # fmt: skip
    return made["concealed_value"], made["concealed_slopes"], made["concealed_output"]

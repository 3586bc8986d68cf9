"""The same equations integrated by SUNDIALS: slow, adaptive, and independent of the collocation."""

from __future__ import annotations

import casadi as ca
import numpy as np

from deatwin.plant.equations import Equations
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.plant.rest import rest_state


def reference_outputs(plant: Plant, experiment: Experiment, relative_tolerance: float = 1e-9) -> tuple[np.ndarray, ...]:
    """Readings of a plant by SUNDIALS' IDAS, started anew at each sample since the command jumps there.

    Source: Hindmarsh et al., ACM Trans. Math. Softw. 31 (2005) 363, doi:10.1145/1089014.1089020.

    Shapes: returns (1, n).
    """
    equations, timeline, values = plant.equations, plant.timeline(experiment), plant.free_values
    known = (values, equations.constants)
    command = plant.rig.start.rest_command
    rest = rest_state(equations, command, values)
    if not rest.found:
        raise SimulationError(f"the reference simulation cannot start: {rest.fault}")
    width = equations.steps(0.0, timeline.sample_time)[0].width
    system = _System(equations, values, width, relative_tolerance)
    unknowns = np.concatenate([rest.x, rest.z])
    times = timeline.start + timeline.sample_time * np.arange(timeline.commands.size)
    inputs = equations.inputs(timeline.commands, command, times, timeline.channels)
    readings = [float(equations.output(rest.x, rest.z, rest.d, equations.held_inputs(command), times[0], *known))]
    for held, time in zip(inputs.T, times, strict=True):
        try:
            for step in equations.steps(time, timeline.sample_time):
                unknowns = system.advance(unknowns, rest.d, equations.with_middle(held, step.middle), step.begin)
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise SimulationError(
                f"the reference simulation stopped at {time:.2f} s and a command of {held[0]:.3f} "
                f"{plant.rig.input_unit}: {reason}"
            ) from None
        x, z = np.split(unknowns, [len(equations.states)])
        after = time + timeline.sample_time
        readings.append(float(equations.output(x, z, rest.d, held, after, *known)))
    return tuple(np.array(readings)[None, rows + 1] for rows in timeline.readings)


class _System:
    """The DAE over one step, in units of each unknown's typical size.

    A state without mass is algebraic here, so that a vanishing time constant is exact.
    """

    def __init__(self, equations: Equations, values: np.ndarray, width: float, relative_tolerance: float) -> None:
        n_x = len(equations.states)
        mass = np.asarray(equations.mass(values, equations.constants)).ravel()
        self._scale = equations.scale
        self._moving = np.flatnonzero(mass)
        self._algebraic = np.setdiff1d(np.arange(self._scale.size), self._moving)
        moving = ca.SX.sym("moving", self._moving.size)
        algebraic = ca.SX.sym("algebraic", self._algebraic.size)
        held = ca.SX.sym("held", len(equations.held))
        inputs = ca.SX.sym("inputs", equations.held_inputs(0.0).size)
        origin, elapsed = ca.SX.sym("origin"), ca.SX.sym("elapsed")
        w = ca.SX(self._scale.size, 1)
        w[self._moving.tolist()], w[self._algebraic.tolist()] = moving, algebraic
        w *= self._scale
        residual = equations.dynamics(
            w[:n_x, :], w[n_x:, :], held, inputs, origin + elapsed, values, equations.constants
        )
        rate = residual[self._moving.tolist()] / (mass * self._scale[:n_x])[self._moving]
        problem = {
            "x": moving,
            "z": algebraic,
            "t": elapsed,
            "p": ca.vertcat(held, inputs, origin),
            "ode": rate,
            "alg": residual[self._algebraic.tolist()],
        }
        options = {"reltol": relative_tolerance, "abstol": relative_tolerance, "max_num_steps": 100_000}
        self._advance = ca.integrator("reference", "idas", problem, 0.0, width, options)

    def advance(self, unknowns: np.ndarray, held: np.ndarray, inputs: np.ndarray, time: float) -> np.ndarray:
        """States and coordinates at the end of a step, shape (n_x + n_z,), SI."""
        scaled = unknowns / self._scale
        found = self._advance(
            x0=scaled[self._moving], z0=scaled[self._algebraic], p=np.concatenate([held, inputs, [time]])
        )
        scaled[self._moving], scaled[self._algebraic] = np.asarray(found["xf"]).ravel(), np.asarray(found["zf"]).ravel()
        return scaled * self._scale

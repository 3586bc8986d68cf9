"""The number of stages that follow a plant within one sample: modes faster than the samples need more than usual."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from deatwin.plant.arrays import root_mean_square
from deatwin.plant.checks import experiment_for
from deatwin.plant.errors import DeatwinError
from deatwin.plant.integrator.collocation import radau
from deatwin.plant.model import Plant
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Experiment
from deatwin.plant.rest import rest_state
from deatwin.plant.simulation import Simulation

logger = logging.getLogger(__name__)

SLOW = 1e-5  # Error of a mode after one sample, relative to its amplitude, below which no reading is compared
FINER, FINEST = 16, 64  # Least and largest number of steps per sample of the simulation that readings are compared with
EXACT = 1e-3  # Error of a mode in that simulation, relative to its amplitude, above which it takes more steps
MORE, MOST = 2, 11  # Stages that are added at a time, and their largest number
UNSEEN = 1.0
"""Largest sum of the squared errors of the readings, in units of the noise; a log-likelihood then changes by one nat
(standard deviation)."""
WORTH = 0.1  # Share of the error that more stages must leave at most if they do not suffice, because they take longer
FINE = 1e-6  # Least noise that counts, relative to the range of the readings, because a rig may state none


def resolved(plant: Plant, experiments: Sequence[Experiment]) -> Plant:
    """Return a plant with as many stages as its first reading needs, and warn if no number is large enough."""
    stages, error = stages_for(plant, experiments)
    if error > 0.0:
        logger.warning(
            "the %s is simulated with an error of up to %s after steps of the command, because the plant moves faster "
            "than its samples; with a shorter sample time the error is smaller",
            plant.rig.output_name,
            with_unit(error, plant.rig.output_unit),
        )
    return plant if stages == plant.stages else replace(plant, stages=stages)


def stages_for(plant: Plant, experiments: Sequence[Experiment]) -> tuple[int, float]:
    """Return how many stages the first reading needs, and 0; or the best number and its largest error, SI."""
    if not plant.rig.equations_known:
        return plant.stages, 0.0
    modes, steps = free_modes(plant), FINER
    if mode_error(modes, plant.stages) < SLOW:
        return plant.stages, 0.0
    while steps < FINEST and mode_error(modes, plant.stages, steps) > EXACT:
        steps *= 2
    # A reading that comes late is stored over its sample as a polynomial with as many coefficients as there are stages.
    finest = replace(plant, stages=plant.stages + MORE) if plant.equations.shifts else plant
    exact = _readings(finest, experiments, steps)
    if exact is None:
        return plant.stages, 0.0
    noise = max(plant.rig.noise, FINE * float(np.ptp(exact)), np.finfo(float).tiny)
    errors: dict[int, float] = {}
    for stages in range(plant.stages, MOST + 1, MORE):
        found = _readings(replace(plant, stages=stages), experiments)
        if found is None:
            break
        if np.sum(((found - exact) / noise) ** 2) <= UNSEEN:
            return stages, 0.0
        errors[stages] = float(np.abs(found - exact).max())
    if not errors:
        return plant.stages, 0.0
    best = min(errors, key=errors.__getitem__)
    kept = best if errors[best] <= WORTH * errors[plant.stages] else plant.stages
    return kept, errors[kept]


def step_error(plant: Plant, experiments: Sequence[Experiment]) -> float:
    """Return the rms error of the first reading because each sample is one step, SI; 0 if it is unknown."""
    # Stages do not follow a signal that changes abruptly within a sample, such as friction; shorter steps do.
    if not plant.rig.equations_known:
        return 0.0
    found, exact = _readings(plant, experiments), _readings(plant, experiments, FINER)
    return 0.0 if found is None or exact is None else root_mean_square(found - exact)


def mode_error(modes: np.ndarray, stages: int, steps: int = 1) -> float:
    """Return the largest error of free modes (n,) after one sample, in a number of steps, relative to the amplitude."""
    butcher = radau(stages)[1]
    one, ones = np.eye(stages), np.ones(stages)
    with np.errstate(over="ignore", invalid="ignore"):  # of a mode that runs away
        errors = [
            abs(np.linalg.solve(one - mode / steps * butcher, ones)[-1] ** steps - np.exp(mode)) for mode in modes
        ]
    return float(np.nan_to_num(np.max(errors, initial=0.0)))


def free_modes(plant: Plant) -> np.ndarray:
    """Return the rates of the free modes about rest, per sample, (n,); none without rest."""
    equations, command = plant.equations, plant.rig.start.rest_command
    try:
        rest = rest_state(equations, command, plant.free_values)
        if not rest.found:
            return np.empty(0)
        (unknowns, *others), arguments = equations.symbols()
        slope = ca.jacobian(equations.dynamics(*arguments), unknowns)
        slopes = ca.Function("slopes", [unknowns, *others], [slope, equations.mass(*others[-2:])])
        here = np.concatenate([rest.x, rest.z])
        inputs = equations.held_inputs(command)
        matrix, mass = (
            np.asarray(v) for v in slopes(here, rest.d, inputs, 0.0, plant.free_values, equations.constants)
        )
        inert = np.zeros(len(here), dtype=bool)
        inert[: mass.size] = mass.ravel() != 0.0  # a state without inertia follows at once, as a coordinate does
        follows = np.linalg.solve(matrix[np.ix_(~inert, ~inert)], matrix[np.ix_(~inert, inert)])
        rates = matrix[np.ix_(inert, inert)] - matrix[np.ix_(inert, ~inert)] @ follows
        return np.linalg.eigvals(rates / mass[inert[: mass.size]].reshape(-1, 1)) * plant.rig.sample_time
    except (RuntimeError, np.linalg.LinAlgError):
        return np.empty(0)


def _readings(plant: Plant, experiments: Sequence[Experiment], steps: int = 1) -> np.ndarray | None:
    """Return the first reading in all experiments, (n,), with each sample in some steps; None if a simulation fails."""
    runner, found = plant.rig.runner(plant.simulator.in_steps(steps), plant.parameters), []
    try:
        for experiment in experiments:
            timeline = plant.timeline(experiment_for(plant.rig, experiment))
            run = runner.run(**plant.given(timeline))
            found += [rows[0] for rows in Simulation.of(run, timeline, plant.signals, plant.rig).outputs]
    except DeatwinError:
        return None
    readings = np.concatenate(found)
    return readings if np.isfinite(readings).all() else None

"""The number of stages that follow a plant within one sample: modes faster than the samples need more than usual."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from deatwin.plant.errors import DeatwinError
from deatwin.plant.integrator.collocation import radau
from deatwin.plant.model import Plant
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Experiment
from deatwin.plant.rest import rest_state
from deatwin.plant.rigs.base import ReadingTime

logger = logging.getLogger(__name__)

SLOW = 1e-5  # Error of a mode after one step, relative to its amplitude, below which no reading is compared
FINER = 16  # Number of steps per sample in the simulation with which readings are compared
MORE, MOST = 2, 11  # Stages that are added at a time, and their largest number
UNSEEN = 1.0
"""Largest sum of the squared errors of the readings, in units of the noise; a log-likelihood then changes by one nat
(standard deviation)."""
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
    """Return how many stages the first reading needs, and 0; or a plant's own number and its largest error, SI, if no
    number is large enough.
    """
    if not plant.rig.equations_known or mode_error(plant) < SLOW:
        return plant.stages, 0.0
    exact = _readings(_split(plant), [_repeated(experiment) for experiment in experiments])
    if exact is None:
        return plant.stages, 0.0
    exact = _READ[plant.rig.reading](exact.reshape(-1, FINER))
    noise = max(plant.rig.noise, FINE * float(np.ptp(exact)), np.finfo(float).tiny)
    errors = []
    for stages in range(plant.stages, MOST + 1, MORE):
        found = _readings(replace(plant, stages=stages), experiments)
        if found is None:
            return plant.stages, 0.0
        errors.append(found - exact)
        if np.sum((errors[-1] / noise) ** 2) <= UNSEEN:
            return stages, 0.0
    return plant.stages, float(np.abs(errors[0]).max())


def mode_error(plant: Plant) -> float:
    """Return the largest error of a free mode about rest after one sample, relative to its amplitude; 0 without rest."""
    equations, command = plant.equations, plant.rig.start.rest_command
    try:
        rest = rest_state(equations, command, plant.free_values)
        (unknowns, *others), arguments = equations.symbols()
        slope = ca.jacobian(equations.dynamics(*arguments), unknowns)
        slopes = ca.Function("slopes", [unknowns, *others], [slope, equations.mass(*others[-2:])])
        here = np.concatenate([rest.x, rest.z])
        inputs = equations.held_inputs(command)
        matrix, mass = (
            np.asarray(v) for v in slopes(here, rest.d, inputs, 0.0, plant.free_values, equations.constants)
        )
        n_x = len(equations.states)
        follows = np.linalg.solve(matrix[n_x:, n_x:], matrix[n_x:, :n_x])
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = (matrix[:n_x, :n_x] - matrix[:n_x, n_x:] @ follows) / mass.reshape(-1, 1)
        modes = np.linalg.eigvals(rates)
    except (RuntimeError, np.linalg.LinAlgError):
        return 0.0
    if not rest.found:
        return 0.0
    butcher = radau(equations.stages)[1]
    steps = modes * plant.rig.sample_time
    one, ones = np.eye(len(butcher)), np.ones(len(butcher))
    with np.errstate(over="ignore", invalid="ignore"):  # of a mode that runs away
        errors = [abs(np.linalg.solve(one - step * butcher, ones)[-1] - np.exp(step)) for step in steps]
    return float(np.nan_to_num(np.max(errors, initial=0.0)))


_READ: dict[ReadingTime, Callable[[np.ndarray], np.ndarray]] = {
    ReadingTime.START_OF_HOLD: lambda parts: parts[:, 0],
    ReadingTime.END_OF_HOLD: lambda parts: parts[:, -1],
    ReadingTime.MEAN_OVER_HOLD: lambda parts: parts.mean(axis=1),
}
"""Reading of each sample from those of its parts, (n, parts)."""


def _split(plant: Plant) -> Plant:
    """Return a plant whose samples are parts of the given plant's."""
    return plant.with_rig(replace(plant.rig, sample_time=plant.rig.sample_time / FINER))


def _repeated(experiment: Experiment) -> Experiment:
    """Return an experiment whose samples are parts of the given one's."""
    return replace(
        experiment,
        recordings=tuple(
            replace(
                record,
                inputs=np.repeat(record.inputs, FINER, axis=1),
                outputs=np.repeat(record.outputs, FINER, axis=1),
                extras={name: np.repeat(row, FINER) for name, row in record.extras.items()},
                sample_time=record.sample_time / FINER,
            )
            for record in experiment.recordings
        ),
    )


def _readings(plant: Plant, experiments: Sequence[Experiment]) -> np.ndarray | None:
    """Return the first reading in all experiments, (n,); None if a simulation fails."""
    try:
        runs = [plant.simulate(experiment) for experiment in experiments]
    except DeatwinError:
        return None
    found = np.concatenate([rows[0] for run in runs for rows in run.outputs])
    return found if np.isfinite(found).all() else None

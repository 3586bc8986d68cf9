"""The number of stages that follow a plant within one sample: modes faster than the samples need more than usual."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from deatwin.plant.errors import SimulationError
from deatwin.plant.integrator.collocation import radau
from deatwin.plant.model import Plant
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Experiment
from deatwin.plant.rest import rest_state

logger = logging.getLogger(__name__)

SLOW = 1e-5  # Error of a mode after one step, relative to its amplitude, below which no reading is compared
UNSEEN = 1.0
"""Largest sum of the squared changes of the readings, in units of the noise, that more stages may cause; a
log-likelihood then changes by one nat (standard deviation)."""
FINE = 1e-6  # Least noise that counts, relative to the range of a reading, because a rig may state none
MORE, MOST = 2, 11  # Stages that are added at a time, and their largest number


def resolved(plant: Plant, experiments: Sequence[Experiment]) -> Plant:
    """Return a plant with as many stages as its readings need, and warn if even the largest number is too small."""
    if not plant.rig.equations_known or mode_error(plant) < SLOW:
        return plant
    first = last = _readings(plant, experiments)
    finer = plant
    while last is not None and finer.stages + MORE <= MOST:
        coarser, before = finer, last
        finer = replace(finer, stages=finer.stages + MORE)
        last = _readings(finer, experiments)
        if last is not None and _change(plant, before, last) <= UNSEEN:
            return coarser
    if first is not None and last is not None:
        error = with_unit(float(np.abs(last - first)[0].max()), plant.rig.output_unit)
        logger.warning(
            "the %s is simulated with an error of up to %s after steps of the command, because the plant moves faster than "
            "its samples; with a shorter sample time the error is smaller",
            plant.rig.output_name,
            error,
        )
    return plant


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


def _change(plant: Plant, before: np.ndarray, after: np.ndarray) -> float:
    """Return the sum of the squared changes of readings (readings, n), in units of their noise."""
    noise = np.array([reading.noise for reading in plant.rig.readings])
    least = np.maximum(FINE * np.ptp(after, axis=1), np.finfo(float).tiny)
    return float(np.sum(((after - before).T / np.maximum(noise, least)) ** 2))


def _readings(plant: Plant, experiments: Sequence[Experiment]) -> np.ndarray | None:
    """Return the simulated readings of all experiments, shape (readings, n); None if a simulation fails."""
    try:
        runs = [plant.simulate(experiment) for experiment in experiments]
    except SimulationError:
        return None
    outputs = np.hstack([rows for run in runs for rows in run.outputs])
    return outputs if np.isfinite(outputs).all() else None

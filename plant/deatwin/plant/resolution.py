"""The number of steps that follow a plant within one sample: modes faster than the samples need more than one, and so
does friction that reverses within samples.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

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
STEPS = (2, 4, 8, 16, 32)  # Numbers of steps per sample that are tried
FINER, FINEST = 16, 64  # Least steps of the simulation that readings are compared with, and most for fast modes
EXACT = 1e-3  # Error of a mode in that simulation, relative to its amplitude, above which it takes more steps
MORE, MOST = 2, 9
"""Stages that are added at each doubling if a reading comes late, because it is stored over its sample as a polynomial
with as many coefficients as there are stages; and their largest number, because the coefficients follow from a Hilbert
matrix, whose condition number is 5e11 with nine and 5e14 with eleven."""
UNSEEN = 1.0
"""Largest sum of the squared errors of the readings, in units of the noise; a log-likelihood then changes by one nat
(standard deviation)."""
WORTH = 0.1
"""Share of the error's power that more steps must leave at most if they do not suffice, because they take longer."""
FINE = 1e-6  # Least noise that counts, relative to the range of the readings, because a rig may state none


def resolved(plant: Plant, experiments: Sequence[Experiment], hidden: float = 0.0) -> Plant:
    """Return a plant with as many steps as its first reading needs; warn if an error larger than the noise remains."""
    followed, error = followed_plant(plant, experiments, hidden)
    if error > plant.rig.noise:
        logger.warning(
            "the %s is simulated with an error of up to %s after steps of the command, because the plant moves faster "
            "than its samples or its friction reverses within them; with a shorter sample time the error is smaller",
            plant.rig.output_name,
            with_unit(error, plant.rig.output_unit),
        )
    return followed


def solved_like(plant: Plant, other: Plant) -> Plant:
    """Return a plant that is integrated with as many stages and steps as another."""
    return replace(plant, stages=other.stages, steps=other.steps)


def followed_plant(plant: Plant, experiments: Sequence[Experiment], hidden: float = 0.0) -> tuple[Plant, float]:
    """Return a plant with enough steps for its first reading, and the error that remains, SI, beside a `hidden` one."""
    if not plant.rig.equations_known:
        return plant, 0.0
    modes = free_modes(plant)
    fast = mode_error(modes, plant.stages, plant.steps) >= SLOW
    if not (fast or plant.effects):
        return plant, 0.0
    tried = [plant, *_finer(plant, MORE if fast and plant.equations.shifts else 0)]
    known: dict[tuple[int, int], np.ndarray | None] = {}

    def readings(finer: Plant) -> np.ndarray | None:
        key = finer.stages, finer.steps
        if key not in known:
            known[key] = _readings(finer, experiments)
        return known[key]

    def exact_beside(finer: Plant) -> np.ndarray | None:
        finest = replace(_exact(finer, modes), stages=tried[-1].stages)
        found = readings(finest)
        # More stages may not be solvable where friction is abrupt.
        return readings(replace(finest, stages=plant.stages)) if found is None else found

    errors: list[np.ndarray] = []
    for finer in tried:
        found = readings(finer)
        # Two numbers of steps agree only if no mode is too fast for both of them.
        only_kinks = not (errors or fast or finer is tried[-1])
        exact = readings(tried[1]) if only_kinks else exact_beside(finer)
        if exact is None or found is None:
            break
        noise = max(plant.rig.noise, FINE * float(np.ptp(exact)), np.finfo(float).tiny)
        if np.sum((found - exact) ** 2) <= max(UNSEEN * noise**2, found.size * hidden**2):
            return finer, 0.0
        if only_kinks:  # friction reverses within samples
            exact = exact_beside(finer)
            if exact is None:
                break
        errors.append(found - exact)
    if not errors:
        return plant, 0.0
    powers = [float(np.sum(error**2)) for error in errors]
    best = int(np.argmin(powers))
    kept = best if powers[best] <= WORTH * powers[0] else 0
    return tried[kept], float(np.abs(errors[kept]).max())


def _finer(plant: Plant, more: int) -> Iterator[Plant]:
    """Yield a plant with doubled numbers of steps, each time with some more stages."""
    for steps in STEPS:
        if steps > plant.steps:
            stages = plant.stages + more * round(np.log2(steps / plant.steps))
            yield replace(plant, steps=steps, stages=max(plant.stages, min(stages, MOST)))


def _exact(plant: Plant, modes: np.ndarray) -> Plant:
    """Return a plant with so many steps that its readings count as exact beside those of `plant`."""
    # With friction the error is of first order: four times as many steps leave a quarter of it.
    steps = max(FINER, 4 * plant.steps)
    while steps < FINEST and mode_error(modes, plant.stages, steps) > EXACT:
        steps *= 2
    return replace(plant, steps=steps)


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


def _readings(plant: Plant, experiments: Sequence[Experiment]) -> np.ndarray | None:
    """Return the first reading in all experiments, (n,); None if a simulation fails."""
    found: list[np.ndarray] = []
    try:
        for experiment in experiments:
            timeline = plant.timeline(experiment_for(plant.rig, experiment))
            run = plant.runner.run(**plant.given(timeline))
            found += [rows[0] for rows in Simulation.of(run, timeline, plant.signals, plant.rig).outputs]
    except DeatwinError:
        return None
    readings = np.concatenate(found)
    return readings if np.isfinite(readings).all() else None

"""What the diagnosis is given: recordings of the six actuators, and the plant that they were to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import Actuator, specification
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

VISITS = ((32.0, 80.0), (1020.0, 40.0))
"""Clock time at which the actuator is driven, and for how long, s. In between it rests at 0 V: what follows the drive
starts anew, what follows the clock goes on. The first begins when the ball of the first actuator has worn the grease
down over which it snaps from 10 to 30 s: the gate takes that for outliers, and refuses the recording."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """What is known of an actuator whose drift is concealed."""

    name: str  # ``DEA 1`` to ``DEA 6``
    plant: Plant  # The specification: six alike, with hysteresis and without a drift
    experiments: tuple[Experiment, ...]  # One for each of `VISITS`, each from rest


def case_of(actuator: Actuator) -> Case:
    """Record an actuator with the thesis' noise, and keep what an experimenter would have of it."""
    rng = np.random.default_rng((*actuator.seed, 3))
    step = actuator.plant.rig.sample_time
    experiments = []
    for start, duration in VISITS:
        commands = band_limited_noise(rng, duration, step)
        planned = Recording.from_arrays(commands, np.zeros_like(commands), step, start=start)
        experiments.append(actuator.record(Experiment(recordings=(planned,)), rng))
    return Case(name=actuator.name, plant=specification(), experiments=tuple(experiments))

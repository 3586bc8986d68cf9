"""What a plant reads under given commands."""

import numpy as np
from numpy.typing import NDArray

from deatwin.plant import Experiment, Plant, Recording, Simulation


def simulation(
    plant: Plant, commands: NDArray[np.float64], start: float = 0.0, **channels: NDArray[np.float64]
) -> Simulation:
    """Run of a plant under commands at its own clock; further inputs by their names."""
    silent = np.zeros((0, len(commands)))
    record = Recording.from_arrays(commands, silent, plant.rig.sample_time, start=start, extras=channels)
    return plant.simulate(Experiment(recordings=(record,))).require()


def blank(commands: NDArray[np.float64], step: float = 0.02, start: float = 0.0) -> Experiment:
    """One record of commands, of which nothing was read."""
    return Experiment(recordings=(Recording.from_arrays(commands, np.zeros(len(commands)), step, start=start),))


def readings(
    plant: Plant, commands: NDArray[np.float64], start: float = 0.0, **channels: NDArray[np.float64]
) -> NDArray[np.float64]:
    """First reading of a plant at each sample, shape (n,), without noise."""
    return simulation(plant, commands, start, **channels).outputs[0][0]

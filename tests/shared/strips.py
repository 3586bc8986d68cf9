"""A strip of film that is pulled, as tests of commands and of pages have it: a plant in a module, and its recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deatwin.plant import Coupon, Plant
from deatwin.plant.files import write_csv
from deatwin.plant.recording import Experiment, Recording

COLUMNS = ["--input-column", "stretch", "--output-column", "force_N"]
MODULE = """
from deatwin.plant import Coupon, Plant

def strip():
    return Plant(rig=Coupon(sample_time=0.1, noise=2e-3))
"""


def strip() -> Plant:
    return Plant(rig=Coupon(sample_time=0.1, noise=2e-3))


def record(plant: Plant, stretch: NDArray[np.float64], rng: np.random.Generator) -> Recording:
    """The force of a strip that is held at these stretches."""
    names = {"input_names": ("stretch",), "input_units": ("1",), "output_names": ("force",), "output_units": ("N",)}
    silent = Recording.from_arrays(stretch, np.zeros(stretch.size), 0.1, **names)
    return plant.record(Experiment(recordings=(silent,)), rng).recordings[0]


def pulled(plant: Plant, seed: int, corners: int) -> Recording:
    """Pulled to and fro at random, ten seconds from one corner to the next."""
    rng = np.random.default_rng(seed)
    levels = 1 + rng.uniform(0.1, 1.0, corners)
    samples = 100 * (corners - 1)
    stretch = np.interp(np.arange(samples) / 100, np.arange(corners), levels)
    stretch[:100] = np.linspace(1, levels[1], 100)
    return record(plant, stretch, rng)


def write(path: Path, record: Recording) -> None:
    write_csv(path, {"time_s": record.timepts.round(6), "stretch": record.inputs[0], "force_N": record.outputs[0]})

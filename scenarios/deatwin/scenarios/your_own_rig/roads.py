"""Roads, and the two programs that drive the car over them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deatwin.plant import Experiment, Plant, Recording, read_recording
from deatwin.plant.arrays import Array
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.files import write_recording
from deatwin.scenarios.your_own_rig.elsewhere import CAR, drive
from deatwin.scenarios.your_own_rig.quarter_car import plant
from deatwin.studies.folder import ResultFolder
from deatwin.studies.missing_physics import experiment_of

ROUGHNESS, BAND = 8e-3, 6.0  # Root mean square height of the road, m, and its band, Hz
LENGTH = 12.0  # Duration of each drive, s
BUMPS = ((1.0, 0.06, 0.5), (4.0, -0.05, 0.4), (6.5, 0.07, 0.8), (9.0, 0.05, 0.25))
"""Times, s, heights, m, and durations, s: a bump, a pothole, two more bumps."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Drives:
    """Two drives of one car, read from their files."""

    rough: Recording  # To diagnose
    over_bumps: Recording
    files: tuple[Path, Path]  # Read from


def rough_road(rng: np.random.Generator, step: float, seconds: float = LENGTH) -> Array:
    """A road of band-limited noise."""
    limit = 4 * ROUGHNESS
    return band_limited_noise(rng, seconds, step, mean=0.0, variance=ROUGHNESS**2, band=BAND, lower=-limit, upper=limit)


def bumps(step: float) -> Array:
    """Return a level road with bumps and a pothole, on which the strut moves faster than on the rough road."""
    timepts = step * np.arange(round(LENGTH / step))
    road = np.zeros(timepts.size)
    for start, height, width in BUMPS:
        inside = (timepts >= start) & (timepts < start + width)
        road[inside] += height / 2 * (1 - np.cos(2 * np.pi * (timepts[inside] - start) / width))
    return road


def concealed() -> Plant:
    """Return the car of `elsewhere` as a plant: the user's plant with other values and the catalogue's drag."""
    nominal = plant()
    drag = next(effect for effect in nominal.rig.effects() if effect.name == "quadratic_damping")
    own = {name: getattr(CAR, name) for name in ("wheel", "spring", "damper", "tyre")}
    return nominal.with_effects(drag).with_values({**own, "quadratic_damping.coefficient": CAR.orifice})


def record(driver: str, folder: ResultFolder, roads: tuple[Array, Array], rng: np.random.Generator) -> Drives:
    """Simulate a drive with one of the `DRIVERS`, write both recordings, and read them like a user's own."""
    made = [DRIVERS[driver](road, rng) for road in roads]
    names = (f"recordings/{driver}_rough_road.csv", f"recordings/{driver}_bumps.csv")
    for file, recording in zip(names, made, strict=True):
        folder.save(file, lambda path, recording=recording: write_recording(path, recording))  # type: ignore[misc]
    files = folder.path / names[0], folder.path / names[1]
    first, second = (read_recording(file, input_column="road_m", output_column="travel_m") for file in files)
    return Drives(rough=first, over_bumps=second, files=files)


def unread(road: Array) -> Recording:
    """Return the recording of a road before any drive, with zero readings."""
    return experiment_of(plant().rig, road, np.zeros(road.size)).recordings[0]


def _here(road: Array, rng: np.random.Generator) -> Recording:
    return concealed().record(Experiment(recordings=(unread(road),)), rng).recordings[0]


def _elsewhere(road: Array, rng: np.random.Generator) -> Recording:
    rig = plant().rig
    travel, _, _ = drive(CAR, road, rig.sample_time)
    return experiment_of(rig, road, travel + rig.noise * rng.standard_normal(road.size)).recordings[0]


DRIVERS: Mapping[str, Callable[[Array, np.random.Generator], Recording]] = {"here": _here, "elsewhere": _elsewhere}
"""Who lets the car move: deatwin with its own equations and integrator, or scipy with others."""

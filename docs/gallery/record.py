"""Made-up experiments for the gallery: a rig file, and recordings in which something is concealed from it.

``python docs/gallery/record.py NAME FOLDER`` writes one of them; without a name it lists them.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from deatwin.plant import Experiment, Recording, catalogue, load_plant

Array = NDArray[np.float64]
Spoil = Callable[[Array, Array, np.random.Generator], Array]

SAMPLE_TIME = 0.02
SECONDS = 150.0
DRIVE = "[drive]\ngain = {gain}\nstart_ramp_s = 2.0\nstart_hold_s = 3.0\n"
SENSOR = '[sensor]\nsample_rate_Hz = 50.0\nnoise_um = {noise}\nzero = "displacement at zero volts"\n'
DIAPHRAGM = """[film]
material = "VHB 4905"
thickness_mm = 0.5
prestretch = 3.5
frame_diameter_mm = 80.0
electrode_diameter_mm = 35.0
ball = "sliding"

[load]
mass_g = 3.0
contact_diameter_mm = 6.0
"""
DISC = """kind = "disc"

[film]
material = "Elastosil 2030"
thickness_mm = 0.1
prestretch = 1.2
frame_diameter_mm = 50.0
electrode_diameter_mm = 20.0
"""
PRESSURE = """kind = "pressure"

[film]
material = "Elastosil 2030"
thickness_mm = 0.05
prestretch = 1.2
frame_diameter_mm = 40.0

[load]
pressure_kPa = 0.5
"""
PLANAR = """kind = "planar"

[film]
material = "VHB 4905"
thickness_mm = 0.5
length_mm = 50.0
width_mm = 50.0
prestretch = 3.5

[load]
mass_g = 100.0
"""


@dataclass(frozen=True)
class Made:
    """One experiment: its rig file, the effects concealed in it, and what is done to the readings."""

    rig: str
    effects: tuple[str, ...] = ()
    seed: int = 0
    command: str = "noise"
    spoil: Spoil | None = None
    noise: float = 2.0  # um
    gain: float = 800.0
    top: float = 3.5  # V
    truth: Mapping[str, float] | None = None  # Parameters of the true rig over the file's

    @property
    def text(self) -> str:
        """The rig file."""
        return self.rig + "\n" + DRIVE.format(gain=self.gain) + "\n" + SENSOR.format(noise=self.noise)


def stuck(u: Array, y: Array, rng: np.random.Generator) -> Array:
    """Readings that stand still for four seconds."""
    at = len(y) // 2
    return np.where((np.arange(len(y)) >= at) & (np.arange(len(y)) < at + 200), y[at], y)


def wander(u: Array, y: Array, rng: np.random.Generator) -> Array:
    """A bench that is shaken: noise from 0.3 to 3 Hz that knows nothing of the command."""
    shaking = sosfiltfilt(butter(2, (0.3, 3.0), "bandpass", fs=1 / SAMPLE_TIME, output="sos"), rng.normal(size=len(y)))
    return y + 8e-6 * shaking / shaking.std()


def counted(u: Array, y: Array, rng: np.random.Generator) -> Array:
    """Wear: each passage of the command through 2.5 V adds a hundredth of what is left of 60 um."""
    passages = np.cumsum(np.abs(np.diff(u > 2.5, prepend=u[0] > 2.5)))
    return y + 60e-6 * (1 - 0.99**passages) * np.sin(4 * u)


MADE: Mapping[str, Made] = {
    "nothing-missing": Made(DIAPHRAGM, seed=0),
    "other-parameters": Made(DIAPHRAGM, truth={"shear_modulus": 1.1, "branch_time": 0.7}, seed=1),
    "creep": Made(DIAPHRAGM, ("creep",), seed=2),
    "too-short-a-sine": Made(DIAPHRAGM, ("permittivity_drift",), command="sine", seed=4),
    "stuck-sensor": Made(DIAPHRAGM, spoil=stuck, seed=6),
    "shaken-bench": Made(DIAPHRAGM, spoil=wander, seed=7),
    "wear": Made(DIAPHRAGM, spoil=counted, seed=8),
    "disc": Made(DISC, ("sensor_drift",), noise=0.5, top=3.0, seed=10),
    "pressure": Made(PRESSURE, ("electrode_rc",), top=2.0, seed=11),
    "planar": Made(PLANAR, ("dielectric_absorption",), noise=5.0, top=1.5, seed=12),
}
"""Strengths are the catalogue's typical ones."""


def command(kind: str, top: float, rng: np.random.Generator) -> Array:
    """Command, V, shape (n,): noise up to 1 Hz, or one sine."""
    n = round(SECONDS / SAMPLE_TIME)
    time = SAMPLE_TIME * np.arange(n)
    if kind == "sine":
        return (0.55 + 0.25 * np.sin(2 * np.pi * 0.1 * time))[: n // 3] * top
    noise = sosfiltfilt(butter(4, 1.0, fs=1 / SAMPLE_TIME, output="sos"), rng.normal(size=n))
    return np.clip(0.55 * top + 0.2 * top * noise / noise.std(), 0.0, top)


def record(made: Made, folder: Path, rng: np.random.Generator) -> None:
    """Write `rig.toml` and `noise.csv`."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.toml"
    rig.write_text(made.text, encoding="utf-8")
    known = {effect.name: effect for effect in catalogue()}
    plant = load_plant(rig).plant.with_effects(*(known[name] for name in made.effects))
    plant = plant.with_values(
        {name: share * plant.parameters[name].value for name, share in (made.truth or {}).items()}
    )
    u = command(made.command, made.top, rng)
    given = Experiment(recordings=(Recording.from_arrays(u, np.zeros((0, len(u))), SAMPLE_TIME),))
    y = plant.simulate(given).require().outputs[0][0]
    read = y + 1e-6 * made.noise * rng.normal(size=len(y))
    read = 1e3 * (read if made.spoil is None else made.spoil(u, read, rng))
    with (folder / "noise.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "command_V", "displacement_mm"))
        rows.writerows(
            (f"{SAMPLE_TIME * i:.2f}", f"{v:.5f}", f"{r:.6f}") for i, (v, r) in enumerate(zip(u, read, strict=True))
        )


def main() -> None:
    """Write one experiment."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", choices=MADE)
    parser.add_argument("folder", nargs="?", type=Path)
    args = parser.parse_args()
    if args.folder is None:
        parser.exit(message="\n".join(MADE) + "\n")
    record(MADE[args.name], args.folder, np.random.default_rng([2027, MADE[args.name].seed]))


if __name__ == "__main__":
    main()

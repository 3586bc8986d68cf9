"""The demo: an effect is concealed in a recording of the thesis' diaphragm, and the diagnosis has to find it.

``truth.json`` is written only after the verdict.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.app.given import GivenPlant
from deatwin.ident.mismatch import Diagnosis
from deatwin.plant.effects import Effect, effect_named
from deatwin.plant.errors import SimulationError
from deatwin.plant.excitation import band_limited_noise, random_holds
from deatwin.plant.files import write_recording
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.studies.diagnosing import DiagnosisTask
from deatwin.studies.folder import ResultFolder
from deatwin.studies.voice import Progress

RIG = """\
# What the experimenter knows of this rig.
[film]
material = "VHB 4905"
thickness_mm = 0.5          # before stretching
prestretch = 3.5            # equal-biaxial
frame_diameter_mm = 80.0
electrode_diameter_mm = 35.0
ball = "bonded"

[load]
mass_g = 3.0                # ball at the centre
contact_diameter_mm = 6.0

[drive]
gain = 800.0                # film volts per command volt
start_ramp_s = 2.0          # before time 0 the first command was ramped up from 0 V ...
start_hold_s = 3.0          # ... and held

[sensor]
sample_rate_Hz = 50.0
noise_um = 2.0              # rms, from the data sheet
zero = "displacement at zero volts"
"""
NOISE_SECONDS, HOLDS_SECONDS = 90.0, 90.0
SHARES = {"shear_modulus": 0.06, "permittivity": 0.04, "branch_modulus": 0.1, "branch_time": 0.1, "damping": 0.2}
"""Largest relative deviations of the film's values from the published ones."""


def run(
    folder: ResultFolder, effect: str, *, command: Sequence[str], jobs: int, seed: int, progress: Progress
) -> Diagnosis:
    """Conceal an effect, diagnose, and reveal the truth afterwards."""
    typical = effect_named(effect)
    folder.text("rig.toml", RIG)
    given = GivenPlant.load(str(folder.path / "rig.toml"))
    progress(0.0, "making a recording")
    try:
        truth, experiment = conceal(given.model.plant, _strong(typical, 2.0), np.random.default_rng(seed))
    except SimulationError:  # twice the typical strength is more than the film bears
        truth, experiment = conceal(given.model.plant, _strong(typical, 1.0), np.random.default_rng(seed))
    names = ["noise.csv", "holds.csv"]
    for name, record in zip(names, experiment.recordings, strict=True):
        folder.save(name, lambda path, record=record: write_recording(path, record))  # type: ignore[misc]
    files = [folder.path / name for name in names]
    task = DiagnosisTask(
        plant=given.model.plant,
        experiments=[given.experiment(files)],
        files=[given.source, *files],
        command=command,
        jobs=jobs,
        seed=seed,
    )
    diagnosis = task.run(folder, progress)
    values = {name: p.value for name, p in truth.parameters.items()}
    folder.text("truth.json", json.dumps({"effects": [effect], "parameters": values}, indent=1) + "\n")
    return diagnosis


def _strong(effect: Effect, factor: float) -> Effect:
    """Return an effect several times as strong as usual, and early, so that a short recording shows it."""
    strength = effect.described(effect.strength)
    values = {effect.strength: float(np.clip(factor * strength.value, strength.lower, strength.upper))}
    if effect.event:
        values[effect.event] = NOISE_SECONDS / 2  # among the fitted samples
    strong: Effect = replace(effect, **values)
    return strong


def conceal(nominal: Plant, effect: Effect, rng: np.random.Generator) -> tuple[Plant, Experiment]:
    """Make the recordings of a film with slightly different material values and one additional effect."""
    values = {name: nominal.parameters[name].value * (1 + share * rng.uniform(-1, 1)) for name, share in SHARES.items()}
    truth = nominal.with_values(values).with_effects(effect)
    step = nominal.rig.sample_time
    commands = [
        band_limited_noise(rng, NOISE_SECONDS, step),
        random_holds(rng, HOLDS_SECONDS, step, lower=1.1, upper=3.6, shortest=2.0, longest=10.0),
    ]
    silent = [
        Recording(inputs=c.round(5)[None], outputs=np.zeros((1, c.size)), sample_time=step, start=start)
        for c, start in zip(commands, (0.0, NOISE_SECONDS), strict=True)
    ]
    made = truth.record(Experiment(recordings=tuple(silent)), rng)
    return truth, Experiment(recordings=tuple(replace(r, outputs=r.outputs.round(8)) for r in made.recordings))

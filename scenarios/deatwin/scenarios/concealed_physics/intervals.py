"""Do the 95 % intervals of added parameters cover, if the effect is known, the reduced plant made the data, and the fit
starts from the true values?
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.greybox import Part, calibrate
from deatwin.plant import Diaphragm, Effect, Experiment, Parameter, Plant, Rig, Scale, SimulationError, effect_named
from deatwin.plant.excitation import band_limited_noise, random_holds
from deatwin.scenarios.concealed_physics.cases import IntervalSpec
from deatwin.studies.missing_physics.case import experiment_of

RIG_SPREAD, EFFECT_SPREAD = 0.1, 0.4
"""Half widths within which the logarithms of true values are drawn around the typical ones."""
SECONDS = 60.0
ATTEMPTS = 20  # Draws of true values until a plant can follow the commands
COLOUR = 0.6  # Correlation of neighbouring samples of coloured noise
TOLERANCE = 1e-6


def cover(spec: IntervalSpec) -> dict[str, Any]:
    """Simulate data with an effect, fit the same plant, and return which intervals contain the true value."""
    rng = np.random.default_rng(spec.seed)
    true, silent = _simulable(spec, rng)
    recorded = _read(true, silent, spec.coloured, rng)
    fit = calibrate(true, [Part.whole(recorded)], starts=1, tolerance=TOLERANCE)
    effect = effect_named(spec.effect)
    rows = []
    for parameter in effect.parameters:
        if parameter.name == f"{effect.name}.{effect.event}":
            continue
        low, high = fit.interval(parameter.name)
        rows.append(
            {
                "name": parameter.name,
                "true": true.parameters[parameter.name].value,
                "low": low,
                "high": high,
                "at_bound": parameter.name in fit.at_bound,
            }
        )
    return {"status": "done", "parameters": rows}


def _simulable(spec: IntervalSpec, rng: np.random.Generator) -> tuple[Plant, Experiment]:
    """Return true plant and commands, drawn again until the plant can be simulated."""
    for _ in range(ATTEMPTS):
        plant = _drawn(effect_named(spec.effect), rng)
        silent = _commands(rng, plant.rig)
        if plant.simulate(silent).status.ok:
            return plant, silent
    raise SimulationError(f"{spec.effect}: none of {ATTEMPTS} plants that were drawn can follow the commands")


def _drawn(effect: Effect, rng: np.random.Generator) -> Plant:
    plant = Plant(rig=Diaphragm(), effects=(effect,))
    values = {}
    for name in plant.parameters.free:
        spread = EFFECT_SPREAD if name.startswith(f"{effect.name}.") else RIG_SPREAD
        values[name] = _moved(plant.parameters[name], rng.uniform(-spread, spread))
    return plant.with_values(values)


def _moved(parameter: Parameter, by: float) -> float:
    """Multiply a value by an exponential factor, staying clear of the bounds of its range."""
    least, most = parameter.ends
    room = 0.02 * (most - least) if parameter.scale is not Scale.LINEAR else 0.0
    at = parameter.scale.to_coordinate(parameter.value * float(np.exp(by)))
    return parameter.scale.to_value(min(max(at, least + room), most - room))


def _commands(rng: np.random.Generator, rig: Rig) -> Experiment:
    """Return band-limited noise followed by holds, which excite fast and slow effects."""
    noise = band_limited_noise(rng, SECONDS / 2, rig.sample_time)
    holds = random_holds(rng, SECONDS / 2, rig.sample_time, lower=1.1, upper=3.75)
    commands = np.concatenate([noise, holds])
    return experiment_of(rig, commands, np.zeros_like(commands))


def _read(plant: Plant, silent: Experiment, coloured: bool, rng: np.random.Generator) -> Experiment:
    record = silent.recordings[0]
    white = rng.standard_normal(record.n_samples)
    if coloured:
        from scipy.signal import lfilter

        white = lfilter([np.sqrt(1 - COLOUR**2)], [1.0, -COLOUR], white)
    reading = plant.simulate(silent).require().outputs[0] + plant.rig.noise * white
    return Experiment(recordings=(replace(record, outputs=reading),))

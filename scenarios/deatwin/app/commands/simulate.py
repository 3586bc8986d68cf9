"""``deatwin simulate``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from deatwin.app import options
from deatwin.studies.voice import Voice

if TYPE_CHECKING:
    import numpy as np

    from deatwin.plant.calibrated import CalibratedPlant, Prediction
    from deatwin.plant.recording import Experiment, Recording


TWO_SIDED_95 = 1.959964

InputFile = Annotated[
    Path,
    typer.Argument(
        metavar="INPUT.csv",
        help="Commands to simulate, with the columns time_s,command_V; readings in this file are ignored.",
    ),
]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME",
        autocompletion=options.complete_effects,
        help="Effect of the catalogue to add to the plant, such as creep; repeatable.",
    ),
]
History = Annotated[
    list[Path] | None,
    typer.Option("--history", metavar="REC.csv", help="An earlier recording of the same experiment; repeatable."),
]
OutFile = Annotated[
    Path, typer.Option("--out", metavar="OUT.csv", help="File for the predicted readings with their 95 % bands.")
]


def simulate(
    rig: options.RigSource,
    commands: InputFile,
    out: OutFile,
    effect: Effects = None,
    history: History = None,
    input_column: options.InputColumn = None,
    time_column: options.TimeColumn = None,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Predict the readings for the commands in a file, from rest and after earlier recordings of the experiment.

    Example: deatwin simulate result/model.json check.csv --history noise.csv --out predicted.csv
    """
    from dataclasses import replace

    from deatwin.app.given import GivenPlant, clock_notes, column_of
    from deatwin.plant.files import write_csv
    from deatwin.plant.files.assemble import on_one_clock
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.plant.resolution import resolved
    from deatwin.studies.folder import require_place

    voice = Voice(as_json=as_json, quiet=quiet)
    require_place(out, [rig, commands, *(history or [])])
    asked = ReadOptions(input_column=input_column, time_column=time_column, dt=dt, resample=resample)
    given = GivenPlant.load(rig, asked)
    model = _with_effects(given.model, effect or [])
    wanted, *earlier = on_one_clock([given.commands(path) for path in (commands, *(history or []))])
    experiment = _experiment(wanted, earlier, history or [])
    for note in clock_notes(experiment.recordings):
        voice.say(note)
    model = replace(model, plant=resolved(model.plant, [experiment]))
    prediction = _finished(model.predict(experiment), model)
    at = next(k for k, record in enumerate(experiment.recordings) if record is wanted)
    name = model.plant.rig.output_name
    header, per_si = column_of(name, model.plant.rig.output_unit)
    unit = header.removeprefix(f"{name}_")
    ends = (f"low_{unit}", f"high_{unit}")
    columns = _banded((header, *ends), prediction.mean[at] * per_si, prediction.deviation[at] * per_si)
    simulation, further = model.plant.simulate(experiment), model.plant.rig.further
    for reading in further:
        column, per_si = column_of(reading.name, reading.unit)
        band = prediction.further[reading.name]
        headers = (column, f"low_{column}", f"high_{column}")
        columns |= _banded(headers, band.mean[at] * per_si, band.deviation[at] * per_si)
    write_csv(out, {"time_s": wanted.timepts.round(9), **columns})
    also = "".join(f" and of {reading.name.replace('_', ' ')}" for reading in further)
    voice.say(f"{out}: {wanted.n_samples} samples of {name}{also} with a 95 % predictive band")
    for event in simulation.events:
        voice.say(f"{'' if event.time < simulation.sound_until else 'unreliable from here on: '}{event}")
    voice.result(
        {
            "out": str(out),
            "samples": wanted.n_samples,
            "effects": list(model.plant.effect_names),
            "events": [str(event) for event in simulation.events],
        }
    )


def _banded(headers: tuple[str, str, str], mean: np.ndarray, deviation: np.ndarray) -> dict[str, np.ndarray]:
    """Return columns of a reading and its band, `mean` and `deviation` (n,), rounded to the band's resolution."""
    half = TWO_SIDED_95 * deviation
    columns = dict(zip(headers, (mean, mean - half, mean + half), strict=True))
    if not (narrowest := half.min()):  # neither noise nor model error
        return columns
    decimals = 3 - math.floor(math.log10(narrowest))
    return {name: values.round(decimals) for name, values in columns.items()}


def _with_effects(model: CalibratedPlant, names: list[str]) -> CalibratedPlant:
    """Return the model with further effects at their typical strength."""
    from dataclasses import replace

    from deatwin.plant.effects import effect_named
    from deatwin.plant.effects.places import everywhere
    from deatwin.plant.errors import RigError

    plant = model.plant
    own = {
        effect.name: effect for effect in everywhere(plant.rig.effects())
    }  # effects at the sizes of this rig, including its own
    for name in names:
        effect = own.get(name) or effect_named(name)
        if name in plant.effect_names:
            raise RigError(f"the plant has the effect {name} already; leave --effect {name} out")
        plant = plant.with_effects(effect)
    return replace(model, plant=plant)


def _experiment(wanted: Recording, earlier: list[Recording], history: list[Path]) -> Experiment:
    from deatwin.plant.errors import DataError
    from deatwin.plant.recording import Experiment

    for record, path in zip(earlier, history, strict=True):
        if record.start > wanted.start:
            raise DataError(
                f"{path}: starts at {record.start:g} s, but the input file starts at {wanted.start:g} s; "
                "a recording given as the history must lie before the input file, on the same clock"
            )
    return Experiment(recordings=(*earlier, wanted))


def _finished(prediction: Prediction, model: CalibratedPlant) -> Prediction:
    """Return the prediction if it is complete; else raise an error with time and voltage of the failure."""
    from deatwin.plant.amplitudes import amount
    from deatwin.plant.errors import SimulationError

    if prediction.status.ok:
        return prediction
    rig = model.plant.rig
    if prediction.failed_at is None or prediction.failed_command is None:
        raise SimulationError(f"the simulation stopped: {prediction.advice}")
    parameters, has_film = model.plant.parameters, "film_voltage" in model.plant.signals
    volts = prediction.failed_command * parameters["gain"].value if has_film and "gain" in parameters else None
    film = "" if volts is None else f" ({volts:.0f} V on the film)"
    raise SimulationError(
        f"the simulation stopped at {prediction.failed_at:.2f} s and a {rig.input_name} of "
        f"{amount(f'{prediction.failed_command:.3f}', rig.input_unit)}{film}: {prediction.advice}"
    )

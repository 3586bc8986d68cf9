"""``deatwin diagnose``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app import options
from deatwin.app.working import results, say_verdict
from deatwin.studies.voice import Voice

Recordings = Annotated[
    list[Path] | None,
    typer.Argument(metavar="REC.csv...", help="Recordings of one experiment, whose times continue from file to file."),
]


def diagnose(
    context: typer.Context,
    rig: options.RigSource,
    out: options.OutFolder,
    recordings: Recordings = None,
    experiment: options.Experiments = None,
    input_column: options.InputColumn = None,
    output_column: options.OutputColumn = None,
    time_column: options.TimeColumn = None,
    allow_gaps: options.AllowGaps = False,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    jobs: options.Jobs = -1,
    seed: options.Seed = 0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Find, from recordings, the physics that the model of a rig lacks, and add it to the model.

    Writes diagnosis.json, model.json, report.html, the figures' data and run.json into DIR. Ctrl-C keeps the finished
    steps in DIR/partial.

    Example: deatwin diagnose rig.toml noise.csv steps.csv --out result

    Several experiments: deatwin diagnose rig.toml --experiment a.csv b.csv --experiment c.csv --out result
    """
    groups = [[str(path) for path in recordings]] if recordings else []
    groups += [options.unfold_experiment(value) for value in experiment or []]
    if not groups:
        raise typer.BadParameter("give at least one recording", param_hint="REC.csv")
    from deatwin.app.given import GivenPlant, absent_readings, clock_notes, direction_notes
    from deatwin.ident.mismatch.say import notes_of
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.diagnosing import DiagnosisTask

    voice = Voice(as_json=as_json, quiet=quiet)
    plant = GivenPlant.load(rig, ReadOptions.of(context.params))
    experiments = [plant.experiment(files) for files in groups]
    records = [record for experiment in experiments for record in experiment.recordings]
    for note in (*clock_notes(records), *direction_notes(plant, records), *absent_readings(plant, records)):
        voice.say(note)
    task = DiagnosisTask(
        plant=plant.model.plant,
        experiments=experiments,
        files=[rig, *(file for files in groups for file in files)],
        command=context.obj,
        jobs=jobs,
        seed=seed,
    )
    with results(out, voice, "reading") as (folder, progress):
        diagnosis = task.run(folder, progress, voice.say)
    say_verdict(diagnosis, voice)
    for note in notes_of(diagnosis):
        voice.say(f"note: {note}")
    for reading in diagnosis.taught or ():
        voice.say(f"reading: {reading.sentence}")
    voice.say(f"report: {folder.path / 'report.html'}")
    voice.result(diagnosis.to_dict())

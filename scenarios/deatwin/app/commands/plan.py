"""``deatwin plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import (
    InputColumn,
    Jobs,
    Json,
    OutFolder,
    Quiet,
    Resample,
    RigSource,
    SampleTime,
    Seed,
    TimeColumn,
    positive,
)
from deatwin.app.working import results
from deatwin.studies.voice import Voice

InputFile = Annotated[
    Path | None, typer.Argument(metavar="INPUT.csv", help="Commands to judge; without them an input is advised.")
]
Seconds = Annotated[
    float | None,
    typer.Option(callback=positive("give a positive number of seconds"), help="Length of an input that is advised."),
]


def plan(
    context: typer.Context,
    rig: RigSource,
    out: OutFolder,
    commands: InputFile = None,
    seconds: Seconds = None,
    input_column: InputColumn = None,
    time_column: TimeColumn = None,
    dt: SampleTime = None,
    resample: Resample = None,
    jobs: Jobs = -1,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Before anything is recorded: which missing physics an input would show, and what it could not tell apart.

    Writes plan.json, report.html, the figure with its data and run.json into DIR, and next_input.csv if the input is
    advised.

    Example: deatwin plan rig.toml steps.csv --out planned

    To be advised: deatwin plan rig.toml --seconds 120 --out planned
    """
    if commands is not None and seconds is not None:
        raise typer.BadParameter(
            "it belongs to an advised input, but you gave an input: leave one of them out", param_hint="--seconds"
        )
    from deatwin.app.planning import plan_into

    voice = Voice(as_json=as_json, quiet=quiet)
    with results(out, voice, "planning") as (folder, progress):
        found = plan_into(folder, context.obj or [], context.params, progress)
    voice.say(found.sentence)
    for one in found.effects:
        voice.say(f"  {one.sentence}")
    if found.impossible:
        voice.say(f"note: the plant could not be simulated with {', '.join(found.impossible)}")
    voice.say(folder.summary)
    voice.result({"out": str(out), **found.to_dict()})

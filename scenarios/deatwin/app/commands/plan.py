"""``deatwin plan``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app import options
from deatwin.app.working import results
from deatwin.studies.voice import Voice

InputFile = Annotated[
    Path | None, typer.Argument(metavar="INPUT.csv", help="Input to assess; without this file, plan suggests an input.")
]
Seconds = Annotated[
    float | None,
    typer.Option(callback=options.positive("give a positive number of seconds"), help="Length of the suggested input."),
]


def plan(
    context: typer.Context,
    rig: options.RigSource,
    out: options.OutFolder,
    commands: InputFile = None,
    seconds: Seconds = None,
    input_column: options.InputColumn = None,
    time_column: options.TimeColumn = None,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    jobs: options.Jobs = -1,
    seed: options.Seed = 0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """List, before you record, which missing effects an input would reveal, and which it could not distinguish.

    Writes plan.json, report.html, the figure with its data and run.json into DIR, and next_input.csv if the input is
    suggested.

    Example: deatwin plan rig.toml steps.csv --out planned

    To have an input suggested: deatwin plan rig.toml --seconds 120 --out planned
    """
    if commands is not None and seconds is not None:
        raise typer.BadParameter(
            "this is the length of the input that plan would suggest, but you gave an input file: leave one of the two out",
            param_hint="--seconds",
        )
    from deatwin.app.plan_report import plan_into

    voice = Voice(as_json=as_json, quiet=quiet)
    with results(out, voice, "planning") as (folder, progress):
        found = plan_into(folder, context.obj or [], context.params, progress)
    voice.say(found.sentence)
    for one in found.effects:
        voice.say(f"  {one.sentence}")
    if found.impossible:
        voice.say(f"note: the model could not be simulated with {', '.join(found.impossible)}")
    voice.say(folder.summary)
    voice.result({"out": str(out), **found.to_dict()})

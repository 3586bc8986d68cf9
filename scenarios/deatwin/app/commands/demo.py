"""``deatwin demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import Jobs, Json, Quiet, Seed, complete_effects
from deatwin.app.working import results, say_verdict
from deatwin.studies.voice import Voice

OutFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; created if absent.")]
Concealed = Annotated[
    str,
    typer.Option(
        "--effect",
        metavar="NAME",
        autocompletion=complete_effects,
        help="Effect that the demonstration hides in the recording.",
    ),
]


def demo(
    context: typer.Context,
    out: OutFolder = Path("deatwin-demo"),
    effect: Concealed = "creep",
    jobs: Jobs = -1,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Hide an effect in a simulated recording, find it, and write the report. Takes about a minute.

    Example: deatwin demo --effect hysteresis --out demo
    """
    from deatwin.app.demo import run

    voice = Voice(as_json=as_json, quiet=quiet)
    with results(out, voice, "making a recording") as (folder, progress):
        diagnosis = run(folder, effect, command=context.obj, jobs=jobs, seed=seed, progress=progress)
    voice.say(f"concealed: {effect} (truth.json)")
    say_verdict(diagnosis, voice)
    voice.say(f"report: {folder.path / 'report.html'}")
    voice.result({"concealed": effect, **diagnosis.to_dict()})

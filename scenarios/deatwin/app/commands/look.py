"""``deatwin look``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from deatwin.app import options
from deatwin.studies.voice import Voice


class RigKind(StrEnum):
    """Kind of a rig that a file can describe."""

    DIAPHRAGM = "diaphragm"
    DISC = "disc"
    PLANAR = "planar"
    STACK = "stack"
    BOW_TIE = "bow_tie"
    ROLL = "roll"
    CONE = "cone"
    PRESSURE = "pressure"
    COUPON = "coupon"


Files = Annotated[
    list[Path] | None,
    typer.Argument(metavar="FILE...", help="Recordings, in any format that can be read. None are needed with --rig."),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Also write a picture and look.json into this folder.")
]
RigOption = Annotated[
    RigKind | None,
    typer.Option("--rig", metavar="KIND", help="Also write a rig file to fill in, DIR/rig.toml, and a drawing."),
]


def look(
    context: typer.Context,
    files: Files = None,
    out: OutFolder = None,
    rig: RigOption = None,
    input_column: options.InputColumn = None,
    output_column: options.OutputColumn = None,
    time_column: options.TimeColumn = None,
    allow_gaps: options.AllowGaps = False,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Describe recordings before any model is made: columns, sample times, noise, faults, excitation, response.

    If other commands would refuse a file, look suggests options that make it readable.

    Example: deatwin look lab.csv --out looked

    With a rig file to fill in: deatwin look lab.csv --rig diaphragm --out looked

    Before anything is recorded: deatwin look --rig diaphragm --out looked
    """
    from contextlib import nullcontext

    from deatwin.app.looking import draw_looks, look_at_file, next_step, result_of, rig_drawing, rig_file, together_of
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.provenance import RunRecord, hashes
    from deatwin.studies.report.story import end_run

    if not files and rig is None:
        raise typer.BadParameter("give recordings, or --rig KIND for a rig file to fill in", param_hint="FILE")
    if rig is not None and out is None:
        raise typer.BadParameter("give the folder for the rig file: --out DIR", param_hint="--rig")
    place = None if rig is None or out is None else out / "rig.toml"
    if place is not None and place.exists():
        raise typer.BadParameter(
            f"{place} exists: give another folder, so that nothing is overwritten", param_hint="--out"
        )
    voice = Voice(as_json=as_json, quiet=quiet)
    record = RunRecord(command=context.obj or [], inputs=hashes(files or []), seed=0, jobs=1)
    asked = ReadOptions.of(context.params)
    with nullcontext() if out is None else ResultFolder(out) as folder:
        seen = [look_at_file(path, asked, voice, rig) for path in files or []]
        together = together_of(seen)
        if together is not None:
            voice.say(f"all recordings together: {together}")
        following = next_step(seen, None if place is None else str(place), rig or "diaphragm")
        voice.say(f"next: {following.sentence}" + (f":\n  {following.command}" if following.command else ""))
        result = result_of(seen, together, following)
        looks = [one.look for one in seen if one.look is not None]
        if folder is not None and (looks or not seen):
            draw_looks(folder, looks, together)
            if place is not None and rig is not None:
                folder.text(place.name, rig_file(seen, rig))
                folder.text("rig.svg", rig_drawing(rig))
            end_run(folder, record, "look", result)
            voice.say(folder.summary)
        voice.result(result)
        if any(one.look is None for one in seen):
            raise typer.Exit(1)

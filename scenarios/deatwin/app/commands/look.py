"""``deatwin look``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deatwin.app import options
from deatwin.studies.voice import Voice, complain

if TYPE_CHECKING:
    from deatwin.app.look_next import Next, Seen
    from deatwin.ident.look import BestLinearApproximation, Look
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.folder import ResultFolder


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

    from deatwin.app.look_next import next_step
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
        seen = [_seen(path, asked, voice, rig) for path in files or []]
        together = _together(seen)
        if together is not None:
            voice.say(f"all recordings together: {together}")
        following = next_step(seen, None if place is None else str(place), rig or "diaphragm")
        voice.say(f"next: {following.sentence}" + (f":\n  {following.command}" if following.command else ""))
        result = _result(seen, together, following)
        looks = [one.look for one in seen if one.look is not None]
        if folder is not None and (looks or not seen):
            _draw(folder, looks, together)
            if place is not None and rig is not None:
                folder.text(place.name, _rig_file(seen, rig))
                folder.text("rig.svg", _rig_drawing(rig))
            end_run(folder, record, "look", result)
            voice.say(folder.summary)
        voice.result(result)
        if any(one.look is None for one in seen):
            raise typer.Exit(1)


def _seen(path: Path, asked: ReadOptions, voice: Voice, rig: str | None) -> Seen:
    """Read a file, for a kind of rig if one is named, describe it, and print the description."""
    import shlex

    from deatwin.app.look_next import Seen
    from deatwin.ident.look import look_at
    from deatwin.plant.errors import DeatwinError
    from deatwin.plant.files.understood import understand
    from deatwin.plant.rigs.rigkinds import KINDS

    file = understand(path, asked, units=KINDS[rig].units if rig else None)
    voice.say(str(path))
    for column in file.columns:
        unit = f", {column.unit}" if column.unit else ", unit not given" if column.role in ("input", "output") else ""
        voice.say(f'  column {column.place} "{column.header}": {column.role or "-"}{unit} ({column.how})')
    if file.recordings and file.refused:
        voice.say(f"  other commands cannot read this file as it is: {file.refused}")
        voice.say(f"  deatwin look read this file with the options {shlex.join(file.options)}")
    if not file.recordings:
        complain(file.refused)
        if file.remaining:
            complain(file.remaining)
        return Seen(file=file)
    try:
        found = look_at(file.recordings)
    except DeatwinError as error:
        complain(str(error))
        return Seen(file=file)
    for line in found.lines:
        voice.say(f"  {line}")
    return Seen(file=file, look=found)


def _together(seen: Sequence[Seen]) -> BestLinearApproximation | None:
    """Return the best linear approximation of several periodic files, whose realisations tell the distortion."""
    from deatwin.app.identify_periodic import approximated

    looks = [one.look for one in seen if one.look is not None and one.look.best_linear is not None]
    return approximated([record for look in looks for record in look.recordings]) if len(looks) > 1 else None


def _result(seen: Sequence[Seen], together: BestLinearApproximation | None, following: Next) -> dict[str, Any]:
    """Return the content of look.json."""
    files = [
        {
            "file": one.file.path,
            "columns": [asdict(column) for column in one.file.columns],
            "refused": one.file.refused or None,
            "remaining": one.file.remaining or None,
            "options": list(one.file.options),
            "look": None if one.look is None else one.look.to_dict(),
        }
        for one in seen
    ]
    of_all = {} if together is None else {"best_linear": together.to_dict()}
    return {"files": files, **of_all, "next": asdict(following)}


def _draw(folder: ResultFolder, looks: Sequence[Look], together: BestLinearApproximation | None) -> None:
    """Draw a picture of each recording."""
    from deatwin.plant.recording import label
    from deatwin.studies.report.drawing import draw, standalone

    for number, one in enumerate(looks, start=1):
        with draw((5.4, 6.4)) as figure:
            panels = one.plot(list(figure.subplots(3, 1)))
            panels[0].set_title(Path(label(one.recordings[0])).name, loc="left", fontsize="medium")
            figure.align_ylabels()
            folder.text("look.svg" if len(looks) == 1 else f"look_{number}.svg", standalone(figure))
    named = {
        "best_linear" if len(looks) == 1 else f"best_linear_{n}": one.best_linear for n, one in enumerate(looks, 1)
    }
    for name, found in {**named, **({} if together is None else {"best_linear": together})}.items():
        if found is not None:
            with draw((5.4, 5.0)) as figure:
                found.plot(list(figure.subplots(2, 1)))
                figure.align_ylabels()
                folder.text(f"{name}.svg", standalone(figure))


def _rig_file(seen: Sequence[Seen], kind: str) -> str:
    """Return a rig file to be filled in, with what is known from the first recording."""
    from deatwin.plant.checks import falls_with_voltage
    from deatwin.plant.readings import ELECTRICAL_UNITS
    from deatwin.plant.rigs.rigkeys import AGAINST
    from deatwin.plant.rigs.rigtemplate import AT_MOST, rig_template

    highest_command = 100.0  # V: no signal generator and no data-acquisition card outputs more
    noises: dict[str, float] = {}
    known: dict[str, tuple[float | str, str]] = {}
    first = next((one.look for one in seen if one.look is not None), None)
    if first is not None:
        known["sample_rate_Hz"] = (1.0 / first.sample_time, "as recorded")
        drive, reading = (next(one for one in first.channels if one.role == role) for role in ("input", "output"))
        if drive.unit == "V" and max(-drive.low, drive.high) > highest_command:
            known["input"] = ("film voltage", "because the recorded input is too high for a command")
        if reading.unit == "m" and reading.noise:
            known["noise_um"] = (1e6 * reading.noise, AT_MOST)
        if reading.unit == "N" and reading.noise:
            known["noise_mN"] = (1e3 * reading.noise, AT_MOST)
        noises = {
            one.name: one.noise for one in first.channels if one.noise and one.unit == ELECTRICAL_UNITS.get(one.name)
        }
        if falls_with_voltage(first.recordings):
            known["direction"] = (AGAINST, "in the recording the readings fall when the voltage rises")
    return rig_template(known, kind, noises)


def _rig_drawing(kind: str) -> str:
    """Draw this kind of rig with the example dimensions of the file."""
    import re
    import tomllib

    from deatwin.plant.rigs.rigfile import RigFile
    from deatwin.plant.rigs.rigtemplate import rig_template
    from deatwin.plant.rigs.sketch import draw_rig
    from deatwin.plant.sources import load_plant
    from deatwin.studies.report.drawing import draw, standalone

    filled = re.sub(r"^#(?=\w)", "", rig_template({}, kind), flags=re.MULTILINE)
    rig = load_plant(RigFile.from_dict(tomllib.loads(filled))).plant.rig
    with draw((5.4, 3.4)) as figure:
        draw_rig(rig, figure.add_subplot())
        return standalone(figure)

"""Look at recordings for `deatwin look`, and recommend what to run next, with the exact command."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from deatwin.app.identify_periodic import approximated, degree_remarks
from deatwin.app.thinning import advised
from deatwin.ident.look import BestLinearApproximation, Look, look_at
from deatwin.ident.look.inputs import InputShape
from deatwin.ident.look.link import LinkStatus
from deatwin.plant.checks import falls_with_voltage
from deatwin.plant.errors import DeatwinError
from deatwin.plant.files.understood import Understood, understand
from deatwin.plant.readings import ELECTRICAL_UNITS
from deatwin.plant.readoptions import ReadOptions
from deatwin.plant.recording import label
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.rigkeys import AGAINST
from deatwin.plant.rigs.rigkinds import COMMANDS, KINDS
from deatwin.plant.rigs.rigtemplate import AT_MOST, rig_template
from deatwin.plant.rigs.sketch import draw_rig
from deatwin.plant.sources import load_plant
from deatwin.studies.folder import ResultFolder
from deatwin.studies.report.drawing import draw, standalone
from deatwin.studies.voice import Voice, complain

LEAST = 20  # Least samples: `deatwin identify` fits 14 of them and holds out 6; fewer leave nothing to judge a model by

HIGHEST_COMMAND = 100.0  # V: no signal generator and no data-acquisition card outputs more
_FEW_FREQUENCIES = "steps, ramps or single tones"


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A file with its description."""

    file: Understood
    look: Look | None = None  # None if the file could not be read


@dataclass(frozen=True, kw_only=True)
class Next:
    """One recommendation."""

    sentence: str
    command: str = ""  # Empty if a better recording is needed first


def look_at_file(path: Path, asked: ReadOptions, voice: Voice, rig: str | None) -> Seen:
    """Read a file, for a kind of rig if one is named, describe it, and print the description."""
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


def together_of(seen: Sequence[Seen]) -> BestLinearApproximation | None:
    """Return the best linear approximation of several periodic files, whose realisations tell the distortion."""
    looks = [one.look for one in seen if one.look is not None and one.look.best_linear is not None]
    return approximated([record for look in looks for record in look.recordings]) if len(looks) > 1 else None


def result_of(seen: Sequence[Seen], together: BestLinearApproximation | None, following: Next) -> dict[str, Any]:
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


def draw_looks(folder: ResultFolder, looks: Sequence[Look], together: BestLinearApproximation | None) -> None:
    """Draw a picture of each recording."""
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


def rig_file(seen: Sequence[Seen], kind: str) -> str:
    """Return a rig file to be filled in, with what is known from the first recording."""
    noises: dict[str, float] = {}
    known: dict[str, tuple[float | str, str]] = {}
    first = next((one.look for one in seen if one.look is not None), None)
    if first is not None:
        known["sample_rate_Hz"] = (1.0 / first.sample_time, "as recorded")
        drive, reading = (next(one for one in first.channels if one.role == role) for role in ("input", "output"))
        if drive.unit == "V" and max(-drive.low, drive.high) > HIGHEST_COMMAND:
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


def rig_drawing(kind: str) -> str:
    """Draw this kind of rig with the example dimensions of the file."""
    filled = re.sub(r"^#(?=\w)", "", rig_template({}, kind), flags=re.MULTILINE)
    rig = load_plant(RigFile.from_dict(tomllib.loads(filled))).plant.rig
    with draw((5.4, 3.4)) as figure:
        draw_rig(rig, figure.add_subplot())
        return standalone(figure)


def next_step(seen: Sequence[Seen], rig: str | None = None, kind: str = "diaphragm") -> Next:
    """Recommend what to run next. `rig` is the rig file to be filled in, if any, and `kind` the kind of its rig."""
    if rig is not None and not seen:
        low, high = (name for pair in COMMANDS for _, name in pair if name in KINDS[kind].drive)
        return Next(
            sentence=f"fill in {rig}, {low} and {high} too; this command then shows, before you record, which effects an input would reveal",
            command=shlex.join(["deatwin", "plan", rig, "--out", "planned"]),
        )
    read = [(one.file, one.look) for one in seen if one.look is not None]
    if not read:
        file = next((one.file for one in seen if one.file.placeholders), None)
        if file is None:
            return Next(sentence="correct the file as the error message says, and run deatwin look again")
        command = shlex.join(["deatwin", "look", file.path, *file.options])
        return Next(
            sentence="the file does not state its sample time; replace SECONDS by the sample time in this command",
            command=command,
        )
    usable = [(file, look) for file, look in read if not _fault(file, look)]
    if not usable:
        return _fault(*read[0]) or Next(sentence="")
    first, look = usable[0]
    alike = [(file, other) for file, other in usable if file.options == first.options and _alike(other, look)]
    different = len(seen) - len(alike)
    files = "1 file" if different == 1 else f"{different} files"
    left_out = (
        f" (this leaves out {files} with different columns, units or sample times, or with a fault)"
        if different
        else ""
    )
    if rig is not None:
        return _diagnosis(rig, KINDS[kind].units, alike, left_out)
    rich = [(file, other) for file, other in alike if any(p.shape is InputShape.NOISE for p in other.patterns)]
    used = rich or alike
    paths, best = [file.path for file, _ in used], used[0][1]
    kept = [file.path for file, _ in alike if file.path not in paths]
    records = [record for _, other in used for record in other.recordings]
    words, choice = [*paths, *first.options], best.sampling
    if choice is not None and advised(records, choice):
        words += ["--decimate", "auto"]
    if degree_remarks(best.best_linear, 2):  # 2 is the degree unless one is given
        words += ["--degree", "3"]
    sentence = f"identify a NARX model, which needs no rig file{left_out}"
    if kept:
        sentence += (
            f"; use {', '.join(kept)} only to test the model, because a model fitted to {_FEW_FREQUENCIES} may diverge"
        )
    if not rich:
        words += ["--method", "semp"]
        sentence += f"; the command uses --method semp, because for {_FEW_FREQUENCIES} the default method may find a model that diverges"
    return Next(sentence=sentence, command=shlex.join(["deatwin", "identify", *words, "--out", "narx.json"]))


def _diagnosis(
    rig: str, units_of_rig: tuple[str, str], alike: Sequence[tuple[Understood, Look]], left_out: str
) -> Next:
    """Recommend a diagnosis of the recordings, as one experiment if they follow each other on one clock."""
    file, look = alike[0]
    for role, names, units, wanted in (
        ("input", look.recordings[0].input_names, look.recordings[0].input_units, units_of_rig[0]),
        ("output", look.recordings[0].output_names, look.recordings[0].output_units, units_of_rig[1]),
    ):
        if wanted == "1" and units[0] not in ("", "1"):
            return Next(
                sentence=f"the {role} of the rig is a ratio, such as a stretch, but the column {names[0]} is in "
                f"{units[0]}; compute the ratio from this column first"
            )
        if units[0] != wanted != "1":
            said = f"is in {units[0]}" if units[0] else "gives no unit"
            like = "mm" if wanted == "m" else wanted
            return Next(
                sentence=f"the {role} of the rig is in {wanted}, but the column {names[0]} {said}; name the right "
                f"column and its unit with --{role}-column NAME={like}"
            )
    ordered = sorted((one for _, one in alike), key=lambda one: one.recordings[0].start)
    follow = all(
        one.recordings[-1].end <= other.recordings[0].start + one.sample_time for one, other in pairwise(ordered)
    )
    paths = [one.path for one, _ in alike]
    given = paths if follow else [word for path in paths for word in ("--experiment", path)]
    command = ["deatwin", "diagnose", rig, *given, *file.options, "--out", "found"]
    return Next(
        sentence=f"fill in {rig}; this command then finds which physics the model of the rig lacks{left_out}",
        command=shlex.join(command),
    )


def _fault(file: Understood, look: Look) -> Next | None:
    """Recommend what to do first about a file that allows no model; None if it allows one."""
    if all(pattern.shape is InputShape.CONSTANT for pattern in look.patterns):
        return _other_columns(file, "the input is constant; name another column, or record again with a varying input")
    if look.n_samples < LEAST:
        return Next(sentence=f"{look.n_samples} samples are too few for a model; record at least {LEAST}")
    if all(channel.low == channel.high for channel in look.channels if channel.role == "output"):
        return _other_columns(file, "the output is constant; name another column, or check the sensor")
    if all(link.status is LinkStatus.UNSEEN for link in look.links):
        return _other_columns(file, "the output does not follow the input; name other columns, or check the wiring")
    return None


def _other_columns(file: Understood, sentence: str) -> Next:
    """Recommend another column that contains numbers, if there is one."""
    other = next((column.place for column in file.columns if column.numbers and not column.role), None)
    if other is None:
        return Next(sentence=sentence)
    constant = "input" if sentence.startswith("the input") else "output"
    words = ["deatwin", "look", file.path, *file.with_column(constant, other)]
    return Next(sentence=sentence, command=shlex.join(words))


def _alike(one: Look, other: Look) -> bool:
    """Return whether two recordings can be used for one model."""
    first, second = one.recordings[0], other.recordings[0]
    return abs(first.sample_time / second.sample_time - 1.0) < 1e-6 and all(
        getattr(first, kind) == getattr(second, kind)
        for kind in ("input_names", "output_names", "input_units", "output_units")
    )

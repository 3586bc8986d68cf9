"""Recommend what to run after a look, with the exact command."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from deatwin.app.identify_periodic import degree_remarks
from deatwin.app.thinning import advised
from deatwin.ident.look import Look
from deatwin.ident.look.inputs import InputShape
from deatwin.ident.look.link import LinkStatus
from deatwin.plant.files.understood import Understood
from deatwin.plant.rigs.rigkinds import COMMANDS, KINDS

LEAST = 20  # Least samples: `deatwin identify` fits 14 of them and holds out 6; fewer leave nothing to judge a model by

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

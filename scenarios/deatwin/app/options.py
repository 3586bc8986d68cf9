"""Arguments that several commands share, each defined once."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

RigSource = Annotated[
    str,
    typer.Argument(
        metavar="RIG", help="Rig file (.toml), FMU (.fmu), amended model.json, or module:function that returns a Plant."
    ),
]
OutFolder = Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the results; created if absent.")]
InputColumn = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[=UNIT]",
        help="Header of the input column, or its position (#2 for the second); add =mV to state its unit.",
    ),
]
OutputColumn = Annotated[
    str | None,
    typer.Option(
        metavar="NAME[=UNIT]", help="Header of the output column, or its position; add =mm to state its unit."
    ),
]
TimeColumn = Annotated[
    str | None,
    typer.Option(metavar="NAME[=UNIT]", help="Header of the time column, or its position; add =ms to state its unit."),
]
AllowGaps = Annotated[
    bool, typer.Option("--allow-gaps", help="Accept a recording with gaps: split it there, and keep its times.")
]


def positive(complaint: str) -> Callable[[float | None], float | None]:
    """Make the callback of an option that accepts positive numbers only; its error may show the value."""

    def require(value: float | None) -> float | None:
        if value is not None and not 0.0 < value < math.inf:
            raise typer.BadParameter(complaint.format(value))
        return value

    return require


def _some_files(values: list[str] | None) -> list[str] | None:
    if "" in (values or []):
        raise typer.BadParameter("give the files of the experiment after --experiment")
    return values


SampleTime = Annotated[
    float | None,
    typer.Option(
        "--dt",
        metavar="SECONDS",
        callback=positive("{:g} is not a positive number"),
        help="Sample time, for files without times.",
    ),
]
Resample = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS",
        callback=positive("{:g} is not a positive number"),
        help="Resample uneven or too frequent samples to an even clock with this sample time.",
    ),
]
Experiments = Annotated[
    list[str] | None,
    typer.Option(
        "--experiment",
        metavar="FILES...",
        callback=_some_files,
        help="The recordings of one experiment that starts from rest; give this option once for each experiment.",
    ),
]


def _whole_workers(value: int) -> int:
    if value != -1 and value < 1:
        raise typer.BadParameter("give 1 or more, or -1 for all cores")
    return value


Jobs = Annotated[int, typer.Option(callback=_whole_workers, help="Worker processes; -1 takes all cores.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print only errors and, with --json, the result.")]

_BETWEEN = "\x1f"  # the unit separator, which no file name contains


def complete_effects(incomplete: str) -> list[str]:
    """Effects of the catalogue for the shell's completion, without loading them."""
    names = {point.name for point in entry_points(group="deatwin.effects")}
    return sorted(name for name in names if name.startswith(incomplete))


def fold_experiments(arguments: list[str]) -> list[str]:
    """Gather the files behind each ``--experiment`` into its one value."""
    folded: list[str] = []
    files: list[str] | None = None  # files of the experiment that is being gathered
    for argument in arguments:
        if not argument.startswith("-"):
            (folded if files is None else files).append(argument)
            continue
        folded += _closed(files)
        name, sign, first = argument.partition("=")
        files = ([first] if sign else []) if name == "--experiment" else None
        if files is None:
            folded.append(argument)
    return folded + _closed(files)


def _closed(files: list[str] | None) -> list[str]:
    """Return the option with its files; empty if there are none, so that it does not consume the next option."""
    return [] if files is None else ["--experiment", _BETWEEN.join(files)]


def unfold_experiment(value: str) -> list[str]:
    """Return the files of one ``--experiment``."""
    return value.split(_BETWEEN)

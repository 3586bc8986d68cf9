"""``deatwin scenario`` and ``deatwin scenarios``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import Jobs, Json, Quiet, Seed
from deatwin.app.stories import stories, story
from deatwin.app.working import results
from deatwin.studies.voice import Voice

OutFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Folder for the results; by default deatwin-NAME.")
]


def complete_names(incomplete: str) -> list[tuple[str, str]]:
    """List the scenarios with descriptions, for the shell's completion."""
    return [(entry.name, entry.line) for entry in stories().values() if entry.name.startswith(incomplete)]


def _completion(choice: str) -> Callable[[typer.Context, str], list[str]]:
    """Return a function that lists the sizes or tasks of the named scenario, or of all, for the shell's completion."""

    def complete(context: typer.Context, incomplete: str) -> list[str]:
        known = stories()
        named = [known[word] for word in context.args if word in known]
        found = dict.fromkeys(one for entry in named or known.values() for one in getattr(entry, choice))
        return [one for one in found if one.startswith(incomplete)]

    return complete


complete_sizes, complete_tasks = _completion("sizes"), _completion("tasks")
Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME", autocompletion=complete_names, help="Name of a scenario, as listed by `deatwin scenarios`."
    ),
]
Size = Annotated[
    str | None,
    typer.Option(
        "--size", metavar="SIZE", autocompletion=complete_sizes, help="Size of the study, if there is a choice."
    ),
]
Tasks = Annotated[
    list[str] | None,
    typer.Option(
        "--task",
        metavar="TASK",
        autocompletion=complete_tasks,
        help="One of the scenario's tasks, if it has several; repeatable.",
    ),
]
DataFolder = Annotated[
    Path | None,
    typer.Option("--data", metavar="FOLDER", help="Folder of the public recordings; by default $DEATWIN_DATA."),
]


def scenario(
    context: typer.Context,
    name: Name,
    out: OutFolder = None,
    data: DataFolder = None,
    size: Size = None,
    task: Tasks = None,
    jobs: Jobs = -1,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run a scenario and write its figures, tables and report.

    Example: deatwin scenario vhb4910 --data recordings --out pulls

    A long one, in a smaller size: deatwin scenario concealed-physics --size tiny --out tiny

    One task of several: deatwin scenario standard-tasks --task emps --data recordings
    """
    from deatwin.studies.stories import Setting

    voice = Voice(as_json=as_json, quiet=quiet)
    chosen = story(name)
    chosen.require_size(size)
    chosen.require_tasks(task or ())
    with results(out or Path(f"deatwin-{name}"), voice, name) as (folder, progress):
        given = {"data": data, "command": context.obj, "jobs": jobs, "seed": seed, "size": size, "tasks": task or ()}
        result = chosen.run(Setting(folder=folder, progress=progress, **given))
    for text in (result["sentence"], *result.get("notes", ())):
        voice.say(str(text))
    voice.say(folder.summary)
    voice.result(result)


def scenarios(as_json: Json = False, quiet: Quiet = False) -> None:
    """List the scenarios, the time that each takes, and which of them can be resumed.

    Example: deatwin scenarios
    """
    voice = Voice(as_json=as_json, quiet=quiet)
    width = max(map(len, stories()))
    for entry in stories().values():
        voice.say(f"{entry.name:{width}} {entry.minutes:>4g} min  {entry.told}")
    voice.result(
        {
            entry.name: {
                "line": entry.line,
                "minutes": entry.minutes,
                "resumes": entry.resumes,
                "sizes": dict(zip(entry.sizes, entry.times, strict=True)),
            }
            for entry in stories().values()
        }
    )

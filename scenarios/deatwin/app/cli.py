"""The command line. Each command is a module that imports what it needs only when it runs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Annotated, Any

import typer

from deatwin.app.commands.check import check
from deatwin.app.commands.demo import demo
from deatwin.app.commands.diagnose import diagnose
from deatwin.app.commands.doctor import doctor
from deatwin.app.commands.export import export
from deatwin.app.commands.frequency import frequency
from deatwin.app.commands.identify import identify
from deatwin.app.commands.look import look
from deatwin.app.commands.material import material
from deatwin.app.commands.plan import plan
from deatwin.app.commands.scenario import scenario, scenarios
from deatwin.app.commands.simulate import simulate
from deatwin.app.commands.view import view
from deatwin.app.options import fold_experiments
from deatwin.app.usage import Command, Group, unwrapped
from deatwin.app.working import DONE, INTERRUPTED, WRONG_INPUT, exit_status
from deatwin.studies.interrupts import ORDINARY, forward_signals
from deatwin.studies.voice import complain


class Commands(Group):
    """The group of commands; an interrupted command says so and lists what it kept."""

    def invoke(self, ctx: Any) -> Any:
        """Run the named command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:
            complain(str(stop) or "interrupted")
            raise typer.Exit(INTERRUPTED) from None


app = typer.Typer(
    cls=Commands,
    help="Simulate, identify and diagnose dielectric elastomer actuators, and check their controllers.\n\n"
    "Start here: deatwin demo\n\nHelp on a command: deatwin diagnose --help",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
for command in (
    demo,
    look,
    material,
    simulate,
    identify,
    frequency,
    plan,
    diagnose,
    check,
    export,
    scenario,
    scenarios,
    view,
    doctor,
):
    app.command(cls=Command, help=unwrapped(command.__doc__))(command)


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"deatwin {version('deatwin')}")
        raise typer.Exit


Version = Annotated[
    bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Print the version and exit.")
]


@app.callback()
def _program(version: Version = False) -> None:  # options before a command; the help text is that of `app`
    pass


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, TextIOWrapper):  # with a locale such as POSIX it cannot encode µ, and never a broken name
        sys.stdout.reconfigure(errors="backslashreplace")
    for word in given:
        if any("\udc80" <= letter <= "\udcff" for letter in word):  # Python's stand-ins for bytes that are no text
            name = word.encode("ascii", "backslashreplace").decode()
            complain(
                f"{name}: the locale cannot represent some characters of this name; rename the file, or set a UTF-8 locale, such as LC_ALL=C.UTF-8"
            )
            return WRONG_INPUT

    def work() -> None:
        with forward_signals(*ORDINARY):
            app(args=fold_experiments(given), prog_name="deatwin", obj=["deatwin", *given])

    try:
        return exit_status(work)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else DONE

"""Result folder, printed verdict and exit status of a command."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from deatwin.studies.voice import Progress, Voice, complain

if TYPE_CHECKING:
    from deatwin.ident.mismatch import Diagnosis
    from deatwin.studies.folder import ResultFolder


DONE, WRONG_INPUT, INTERRUPTED = 0, 1, 130


@contextmanager
def results(out: Path, voice: Voice, doing: str) -> Iterator[tuple[ResultFolder, Progress]]:
    """Provide a result folder and a progress bar; an interrupt ends the command and reports what was kept."""
    import typer

    from deatwin.studies.folder import ResultFolder

    folder = ResultFolder(out)
    try:
        with folder, voice.progress(doing) as progress:
            yield folder, progress
    except KeyboardInterrupt as stop:
        complain(str(stop) or f"interrupted; {folder.summary}")
        raise typer.Exit(INTERRUPTED) from None


def say_verdict(diagnosis: Diagnosis, voice: Voice) -> None:
    """Print the verdict, how sure it is, and what to do next."""
    from deatwin.ident.mismatch import how_sure, next_step

    voice.say(f"{diagnosis.verdict.value}: {diagnosis.sentence}")
    if sure := how_sure(diagnosis):
        voice.say(f"how sure: {sure}")
    voice.say(f"next: {next_step(diagnosis)}")


def exit_status(work: Callable[[], None]) -> int:
    """Run a command, report errors of the user or the machine in one line, and return the exit status."""
    try:
        work()
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except OSError as error:  # an error of the operating system, such as a full disk
        complain(f"{error.filename or 'the system'}: {error.strerror or error}")
        return WRONG_INPUT
    except Exception as error:
        from deatwin.plant.errors import DeatwinError  # imports numpy, which help does not need

        if not isinstance(error, DeatwinError):
            raise  # an error in deatwin itself: its authors need the traceback
        complain(str(error))
        return WRONG_INPUT
    return DONE

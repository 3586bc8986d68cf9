"""Errors that deatwin raises, and suggestions for misspelt names."""

import difflib
from collections.abc import Iterable

from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.safe_read import clipped


class DeatwinError(Exception):
    """Base class of all errors that deatwin raises on purpose; the text is one line for the user."""


class DataError(DeatwinError, ValueError):
    """Error in a recording, in a data file, or in an argument of a function that makes or analyses data.

    If the error is in a file, the text names the file and, where possible, the row and the column.

    Parameters
    ----------
    text : str
        Message for the user.
    offers : ReadOptions
        Options of `read_recordings` with which the file could be read; empty by default. The text names them too.
    """

    def __init__(self, text: str, offers: ReadOptions = NO_OPTIONS) -> None:
        super().__init__(text)
        self.offers = offers


class RigError(DeatwinError, ValueError):
    """Error in a rig, in an effect or in a parameter of a plant, or in the file that describes the plant."""


class ModelError(DeatwinError, ValueError):
    """Error in a model or in its file, or in an argument of a function that makes, analyses or exports models."""


class SimulationError(DeatwinError, RuntimeError):
    """Error if a simulation cannot start, or stops before its end, for example because the film pulls in."""


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return the end of an error text that offers the known name nearest to a misspelt one; empty if none is near."""
    lowered = {candidate.lower(): candidate for candidate in known}
    found = difflib.get_close_matches(str(name).lower(), lowered, n=1, cutoff=likeness)
    return f'; did you mean "{clipped(lowered[found[0]])}"?' if found else ""

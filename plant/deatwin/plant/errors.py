"""Errors that deatwin raises, and suggestions for misspelt names."""

import difflib
from collections.abc import Iterable

from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.safe_read import clipped


class DeatwinError(Exception):
    """Base class of all errors that deatwin raises on purpose; the text is one clear line for the user."""


class DataError(DeatwinError, ValueError):
    """Error in a recording, a data file or a value; the text names file, row and column.

    Parameters
    ----------
    text : str
        Message for the user.
    offers : ReadOptions
        Options with which the file could be read, which the text names too; empty by default.
    """

    def __init__(self, text: str, offers: ReadOptions = NO_OPTIONS) -> None:
        super().__init__(text)
        self.offers = offers


class RigError(DeatwinError, ValueError):
    """Error in a rig file, or in a rig, an effect or a parameter of a plant."""


class ModelError(DeatwinError, ValueError):
    """Error in a model or a model file, or in an argument of a function that makes or analyses models."""


class SimulationError(DeatwinError, RuntimeError):
    """Raised if a simulation fails before its end, for example because of pull-in."""


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return the end of an error text that offers the known name nearest to a misspelt one; empty if none is near."""
    lowered = {candidate.lower(): candidate for candidate in known}
    found = difflib.get_close_matches(str(name).lower(), lowered, n=1, cutoff=likeness)
    return f'; did you mean "{clipped(lowered[found[0]])}"?' if found else ""

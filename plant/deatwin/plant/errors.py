"""The errors that deatwin raises, and the near name that they offer."""

import difflib
from collections.abc import Iterable

from deatwin.plant.intake import clipped


class DeatwinError(Exception):
    """Base of every error that deatwin raises on purpose; its text is one clear line for the user."""


class DataError(DeatwinError, ValueError):
    """A recording, a data file or a value is at fault; the text names file, row and column."""


class RigError(DeatwinError, ValueError):
    """A rig file or a plant description is at fault."""


class ModelError(DeatwinError, ValueError):
    """A model file is at fault, or a model cannot be made of these samples."""


class SimulationError(DeatwinError, RuntimeError):
    """A simulation could not be finished, for example for pull-in."""


def nearest(name: str, known: Iterable[str], *, likeness: float = 0.6) -> str:
    """Return the end of an error text that offers the known name nearest to a misspelt one.

    Examples
    --------
    >>> nearest("prestrech", ["material", "prestretch"])
    '; did you mean "prestretch"?'
    >>> nearest("colour", ["material", "prestretch"])
    ''
    """
    lowered = {candidate.lower(): candidate for candidate in known}
    found = difflib.get_close_matches(name.lower(), lowered, n=1, cutoff=likeness)
    return f'; did you mean "{clipped(lowered[found[0]])}"?' if found else ""

"""Exceptions for controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError


class ControlError(DeatwinError, ValueError):
    """Error in a controller, in a specification, or in an argument of a function of `deatwin.control`."""


class MissingPackageError(DeatwinError, ImportError):
    """Raised if a design needs a package that is not installed."""

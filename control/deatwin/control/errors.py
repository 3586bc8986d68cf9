"""Exceptions for controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError


class ControlError(DeatwinError, ValueError):
    """Raised if an argument of `deatwin.control` is invalid, or if a controller cannot be designed."""


class MissingPackageError(DeatwinError, ImportError):
    """Raised if a design needs a package that is not installed."""

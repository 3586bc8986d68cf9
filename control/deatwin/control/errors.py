"""Errors of controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError

__all__ = ["ControlError", "MissingPackageError"]


class ControlError(DeatwinError, ValueError):
    """A controller or a specification for one is at fault."""


class MissingPackageError(DeatwinError, ImportError):
    """A design needs a package that is not installed: nothing is known of the controller."""

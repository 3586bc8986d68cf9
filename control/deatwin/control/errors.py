"""Errors of controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError


class ControlError(DeatwinError, ValueError):
    """A controller or a specification for one is at fault."""


class MissingPackageError(DeatwinError, ImportError):
    """A design needs a package that is not installed: nothing is known of the controller."""

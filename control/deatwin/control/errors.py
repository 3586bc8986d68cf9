"""Exceptions for controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError


class ControlError(DeatwinError, ValueError):
    """Error in a controller or in a specification for one."""


class MissingPackageError(DeatwinError, ImportError):
    """A design needs a package that is not installed. The error says nothing about the controller."""

"""Errors of controllers and specifications."""

from __future__ import annotations

from deatwin.plant.errors import DeatwinError

__all__ = ["ControlError"]


class ControlError(DeatwinError, ValueError):
    """A controller or a specification for one is at fault."""

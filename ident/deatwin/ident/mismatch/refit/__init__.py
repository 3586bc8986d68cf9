"""Calibrate the base plant, and find out whether only its parameters were wrong."""

from deatwin.ident.mismatch.refit.base import Base, calibrate_base

__all__ = ["Base", "calibrate_base"]

"""The base plant, calibrated: is anything wrong but its parameters?"""

from deatwin.ident.mismatch.refit.base import Base, calibrate_base

__all__ = ["Base", "calibrate_base"]

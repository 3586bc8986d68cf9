"""Calibration of physical plants on recordings."""

from deatwin.ident.greybox.fit import Calibration, FitStatus, Part, calibrate

__all__ = ["Calibration", "FitStatus", "Part", "calibrate"]

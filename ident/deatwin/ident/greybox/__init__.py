"""Calibration of physical plants on recordings."""

from deatwin.ident.greybox.fit import Calibration, calibrate
from deatwin.ident.greybox.identifiability import Profile, profile
from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.status import FitStatus

__all__ = ["Calibration", "FitStatus", "Part", "Profile", "calibrate", "profile"]

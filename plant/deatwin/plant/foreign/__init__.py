"""Plants whose model was written elsewhere: a Python callable or an FMU."""

from deatwin.plant.foreign.drift import ParameterDrift
from deatwin.plant.foreign.rig import ForeignRig

__all__ = ["ForeignRig", "ParameterDrift"]

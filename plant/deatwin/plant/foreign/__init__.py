"""Plants whose model was written elsewhere: a Python callable or an FMU."""

from deatwin.plant.foreign.fmu import FmuModel
from deatwin.plant.foreign.modelfile import read_model_file
from deatwin.plant.foreign.rig import ForeignRig, ParameterDrift

__all__ = ["FmuModel", "ForeignRig", "ParameterDrift", "read_model_file"]

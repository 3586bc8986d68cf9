"""Physics to recordings: rigs, materials, effects, and the recordings that they make."""

from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.effects import (
    Creep,
    Effect,
    ElectrodeRC,
    Family,
    Hysteresis,
    PermittivityDrift,
    Place,
    catalogue,
    effect_named,
)
from deatwin.plant.errors import DataError, DeatwinError, ModelError, RigError, SimulationError
from deatwin.plant.files import read_experiment, read_recording
from deatwin.plant.model import Plant, Simulation
from deatwin.plant.parameters import Parameter, ParameterSet, Scale
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure
from deatwin.plant.rigs.coupon import Coupon
from deatwin.plant.rigs.diaphragm import Diaphragm
from deatwin.plant.rigs.rigfile import read_rig
from deatwin.plant.simulate import RunStatus
from deatwin.plant.sources import load_plant
from deatwin.plant.thesis import thesis_plant

__all__ = [
    "CalibratedPlant",
    "Coupon",
    "Creep",
    "DataError",
    "DeatwinError",
    "Diaphragm",
    "Effect",
    "ElectrodeRC",
    "Experiment",
    "Family",
    "Hysteresis",
    "ModelError",
    "Parameter",
    "ParameterSet",
    "PermittivityDrift",
    "Place",
    "Plant",
    "ReadingTime",
    "Recording",
    "Rig",
    "RigError",
    "RunStatus",
    "Scale",
    "Simulation",
    "SimulationError",
    "StartProcedure",
    "catalogue",
    "effect_named",
    "load_plant",
    "read_experiment",
    "read_recording",
    "read_rig",
    "thesis_plant",
]

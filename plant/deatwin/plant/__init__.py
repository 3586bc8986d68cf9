"""Physics to recordings: rigs, materials, effects, and the recordings that they make."""

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
from deatwin.plant.model import Plant, Simulation
from deatwin.plant.parameters import Parameter, ParameterSet, Scale
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure
from deatwin.plant.rigs.coupon import Coupon
from deatwin.plant.rigs.diaphragm import Diaphragm
from deatwin.plant.simulate import RunStatus
from deatwin.plant.thesis import thesis_plant

__all__ = [
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
    "thesis_plant",
]

"""Plant models: rigs, materials and effects, and the recordings that they produce."""

from deatwin.plant import effects as _effects
from deatwin.plant.actuation import ActuationCurve, actuation_curve
from deatwin.plant.builder import Builder
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.chain import MeasuringChain
from deatwin.plant.datasheets import Amplifier, Converter, Laser, Part, quantise
from deatwin.plant.effects import *  # noqa: F403  (its names stand there once)
from deatwin.plant.errors import DataError, DeatwinError, ModelError, RigError, SimulationError
from deatwin.plant.files import read_experiment, read_recording
from deatwin.plant.fleet import Actuator, History, Tolerance, fleet, specification, thesis_plant
from deatwin.plant.limits import Event
from deatwin.plant.material import MATERIALS, Branch, Material
from deatwin.plant.model import Plant
from deatwin.plant.model_error import Discrepancy
from deatwin.plant.parameters import Parameter, ParameterSet, Scale
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.resampling import resample
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure
from deatwin.plant.rigs.bow_tie import BowTie
from deatwin.plant.rigs.cone import Cone
from deatwin.plant.rigs.coupon import Coupon
from deatwin.plant.rigs.diaphragm import Diaphragm
from deatwin.plant.rigs.disc import Disc
from deatwin.plant.rigs.planar import BlockedPlanar, Planar
from deatwin.plant.rigs.pressure import Pressure
from deatwin.plant.rigs.rigfile import load_material, read_rig
from deatwin.plant.rigs.roll import Roll
from deatwin.plant.rigs.sketch import draw_rig
from deatwin.plant.rigs.stack import Stack
from deatwin.plant.simulate import RunStatus
from deatwin.plant.simulation import Simulation
from deatwin.plant.sources import load_plant
from deatwin.plant.supply import Supply

__all__ = [
    "MATERIALS",
    "ActuationCurve",
    "Actuator",
    "Amplifier",
    "BlockedPlanar",
    "BowTie",
    "Branch",
    "Builder",
    "CalibratedPlant",
    "Cone",
    "Converter",
    "Coupon",
    "DataError",
    "DeatwinError",
    "Diaphragm",
    "Disc",
    "Discrepancy",
    "Event",
    "Experiment",
    "History",
    "Laser",
    "Material",
    "MeasuringChain",
    "ModelError",
    "Parameter",
    "ParameterSet",
    "Part",
    "Planar",
    "Plant",
    "Pressure",
    "Reading",
    "ReadingTime",
    "Recording",
    "Rig",
    "RigError",
    "Roll",
    "RunStatus",
    "Scale",
    "Simulation",
    "SimulationError",
    "Stack",
    "StartProcedure",
    "Supply",
    "Tolerance",
    "actuation_curve",
    "draw_rig",
    "fleet",
    "load_material",
    "load_plant",
    "quantise",
    "read_experiment",
    "read_recording",
    "read_rig",
    "resample",
    "specification",
    "thesis_plant",
]
__all__ += _effects.__all__

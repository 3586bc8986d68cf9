"""Plant models: rigs, materials and effects, and the recordings that they produce."""

from deatwin.plant.actuation import ActuationCurve, actuation_curve
from deatwin.plant.builder import Builder
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.chain import MeasuringChain
from deatwin.plant.datasheets import Amplifier, Converter, Laser, Part, quantise
from deatwin.plant.effects import (
    Alone,
    AmplifierOffset,
    AmplifierSaturation,
    AmplifierSlew,
    Backlash,
    ChargeInjection,
    CoulombFriction,
    Creep,
    CubicStiffness,
    DeadZone,
    Delay,
    DielectricAbsorption,
    DryFriction,
    Effect,
    ElectrodeLoss,
    ElectrodeRC,
    EndStop,
    Family,
    Hysteresis,
    Leakage,
    Mullins,
    PeriodicDisturbance,
    PermittivityDrift,
    PermittivityStretch,
    Place,
    PrestretchRelaxation,
    QuadraticDamping,
    Relaxation,
    Resonance,
    SensorCurvature,
    SensorDrift,
    SensorJump,
    SensorLag,
    SensorSaturation,
    Site,
    Sizes,
    StrainStiffening,
    ThermalStiffness,
    catalogue,
    effect_named,
)
from deatwin.plant.errors import DataError, DeatwinError, ModelError, RigError, SimulationError
from deatwin.plant.files import read_experiment, read_recording
from deatwin.plant.fleet import Actuator, History, Tolerance, fleet, specification
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
from deatwin.plant.thesis import thesis_plant

__all__ = [
    "MATERIALS",
    "ActuationCurve",
    "Actuator",
    "Alone",
    "Amplifier",
    "AmplifierOffset",
    "AmplifierSaturation",
    "AmplifierSlew",
    "Backlash",
    "BlockedPlanar",
    "BowTie",
    "Branch",
    "Builder",
    "CalibratedPlant",
    "ChargeInjection",
    "Cone",
    "Converter",
    "CoulombFriction",
    "Coupon",
    "Creep",
    "CubicStiffness",
    "DataError",
    "DeadZone",
    "DeatwinError",
    "Delay",
    "Diaphragm",
    "DielectricAbsorption",
    "Disc",
    "Discrepancy",
    "DryFriction",
    "Effect",
    "ElectrodeLoss",
    "ElectrodeRC",
    "EndStop",
    "Event",
    "Experiment",
    "Family",
    "History",
    "Hysteresis",
    "Laser",
    "Leakage",
    "Material",
    "MeasuringChain",
    "ModelError",
    "Mullins",
    "Parameter",
    "ParameterSet",
    "Part",
    "PeriodicDisturbance",
    "PermittivityDrift",
    "PermittivityStretch",
    "Place",
    "Planar",
    "Plant",
    "Pressure",
    "PrestretchRelaxation",
    "QuadraticDamping",
    "Reading",
    "ReadingTime",
    "Recording",
    "Relaxation",
    "Resonance",
    "Rig",
    "RigError",
    "Roll",
    "RunStatus",
    "Scale",
    "SensorCurvature",
    "SensorDrift",
    "SensorJump",
    "SensorLag",
    "SensorSaturation",
    "Simulation",
    "SimulationError",
    "Site",
    "Sizes",
    "Stack",
    "StartProcedure",
    "StrainStiffening",
    "Supply",
    "ThermalStiffness",
    "Tolerance",
    "actuation_curve",
    "catalogue",
    "draw_rig",
    "effect_named",
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

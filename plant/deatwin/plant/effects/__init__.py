"""The effects, one module each. Other packages add theirs by the entry-point group ``deatwin.effects``."""

from deatwin.plant.effects.amplifier_offset import AmplifierOffset
from deatwin.plant.effects.amplifier_saturation import AmplifierSaturation
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.backlash import Backlash
from deatwin.plant.effects.base import Alone, Effect, Family, Place, Site
from deatwin.plant.effects.catalogue import catalogue, effect_named
from deatwin.plant.effects.charge_injection import ChargeInjection
from deatwin.plant.effects.coulomb_friction import CoulombFriction
from deatwin.plant.effects.creep import Creep
from deatwin.plant.effects.cubic_stiffness import CubicStiffness
from deatwin.plant.effects.dead_zone import DeadZone
from deatwin.plant.effects.delay import Delay
from deatwin.plant.effects.dielectric_absorption import DielectricAbsorption
from deatwin.plant.effects.dry_friction import DryFriction
from deatwin.plant.effects.electrode_loss import ElectrodeLoss
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.end_stop import EndStop
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.leakage import Leakage
from deatwin.plant.effects.mullins import Mullins
from deatwin.plant.effects.periodic_disturbance import PeriodicDisturbance
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.effects.permittivity_stretch import PermittivityStretch
from deatwin.plant.effects.prestretch_relaxation import PrestretchRelaxation
from deatwin.plant.effects.quadratic_damping import QuadraticDamping
from deatwin.plant.effects.relaxation import Relaxation
from deatwin.plant.effects.resonance import Resonance
from deatwin.plant.effects.sensor_curvature import SensorCurvature
from deatwin.plant.effects.sensor_drift import SensorDrift
from deatwin.plant.effects.sensor_jump import SensorJump
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.effects.sensor_saturation import SensorSaturation
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.effects.strain_stiffening import StrainStiffening
from deatwin.plant.effects.thermal_stiffness import ThermalStiffness

__all__ = [
    "Alone",
    "AmplifierOffset",
    "AmplifierSaturation",
    "AmplifierSlew",
    "Backlash",
    "ChargeInjection",
    "CoulombFriction",
    "Creep",
    "CubicStiffness",
    "DeadZone",
    "Delay",
    "DielectricAbsorption",
    "DryFriction",
    "Effect",
    "ElectrodeLoss",
    "ElectrodeRC",
    "EndStop",
    "Family",
    "Hysteresis",
    "Leakage",
    "Mullins",
    "PeriodicDisturbance",
    "PermittivityDrift",
    "PermittivityStretch",
    "Place",
    "PrestretchRelaxation",
    "QuadraticDamping",
    "Relaxation",
    "Resonance",
    "SensorCurvature",
    "SensorDrift",
    "SensorJump",
    "SensorLag",
    "SensorSaturation",
    "Site",
    "Sizes",
    "StrainStiffening",
    "ThermalStiffness",
    "catalogue",
    "effect_named",
]

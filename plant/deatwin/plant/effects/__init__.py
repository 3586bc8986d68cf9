"""Effects: one small file each. Others add theirs by the entry-point group ``deatwin.effects``."""

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.effects.catalogue import catalogue, effect_named
from deatwin.plant.effects.creep import Creep
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.permittivity_drift import PermittivityDrift

__all__ = [
    "Creep",
    "Effect",
    "ElectrodeRC",
    "Family",
    "Hysteresis",
    "PermittivityDrift",
    "Place",
    "catalogue",
    "effect_named",
]

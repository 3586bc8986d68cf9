"""The fleet as recorded, and what the same actuators would have been recorded as with less physics.

A model whose parameters do not change cannot follow an actuator that drifts, and a polynomial of a few past values
cannot hold rate-independent hysteresis. To say which of the two makes a test fail, each actuator is recorded twice
more: under the same commands and the same sensor's noise, without its history, and then without hysteresis too.
"""

from __future__ import annotations

from dataclasses import replace

from deatwin.plant.fleet import Actuator
from deatwin.plant.model import Plant

RECORDED, STEADY, FILM = "as recorded", "without its history", "without hysteresis too"
VARIANTS = (RECORDED, STEADY, FILM)


def as_variant(actuator: Actuator, variant: str) -> Actuator:
    """Leave physics out of an actuator; fabrication, commands and sensor's noise stay."""
    return replace(actuator, plant=_with_less(actuator.plant, variant))


def _with_less(plant: Plant, variant: str) -> Plant:
    if variant == RECORDED:
        return plant
    film = plant.without_effects()
    if variant == FILM:
        return film
    kept = [effect for effect in plant.effects if effect.name == "hysteresis"]
    values = {name: value for name, value in plant.values.items() if name.startswith("hysteresis.")}
    return film.with_effects(*kept).with_values(values)

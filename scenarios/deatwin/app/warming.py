"""Compiling plants before they are needed."""

from __future__ import annotations

from deatwin.plant.effects import catalogue
from deatwin.plant.model import Plant
from deatwin.plant.rigs.diaphragm import Diaphragm


def usual_plants() -> list[Plant]:
    """The plants that a diagnosis of a diaphragm compares."""
    plants = []
    for ball in ("bonded", "sliding"):
        rig = Diaphragm(ball=ball)
        plants += [Plant(rig=rig), Plant(rig=rig.finer()), *(Plant(rig=rig, effects=(e,)) for e in catalogue())]
    return plants


def compile_plant(plant: Plant) -> None:
    """Have the plant's equations compiled into the user's cache."""
    plant.simulator  # noqa: B018  (building it compiles it)

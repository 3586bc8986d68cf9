"""Compiling plants before they are needed."""

from __future__ import annotations

from itertools import combinations

from deatwin.plant.effects import catalogue
from deatwin.plant.model import Plant
from deatwin.plant.rigs.diaphragm import Diaphragm

__all__ = ["compile_plant", "usual_plants"]


def usual_plants() -> list[Plant]:
    """The plants that a diagnosis of a diaphragm compares.

    Returns
    -------
    list of Plant
        For each support of the ball: alone, with each effect of the catalogue, with each pair.
    """
    effects = catalogue()
    sets = [set_ for size in range(3) for set_ in combinations(effects, size)]
    return [Plant(rig=Diaphragm(ball=ball)).with_effects(*set_) for ball in ("bonded", "sliding") for set_ in sets]


def compile_plant(plant: Plant) -> None:
    """Have the plant's equations compiled into the user's cache.

    Parameters
    ----------
    plant : Plant
        Its structure counts, not its values.
    """
    plant.simulator  # noqa: B018  (building it compiles it)

"""Rigs at random: what the experimenter knows of one, and the film that is really in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.plant.model import Plant
from deatwin.plant.rigs.base import ReadingTime
from deatwin.plant.rigs.diaphragm import BALLS, Diaphragm

FILM_ERROR = 0.2
"""By how much a film's parameter may lie beside the published one, as a share."""
FITTED = ("shear_modulus", "stretch_limit", "branch_modulus", "branch_time", "permittivity", "damping")
ELEMENTS = 5
"""Of the fine film under its electrode: another mesh than that from which a plant's own error is taken."""
BALL_TOLD, READ_AT_START = 0.6, 0.15
"""How often a rig file tells how the film sits on the ball, and how often readings are taken at the start of a hold."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rigging:
    """A rig as described, and as it is."""

    nominal: Plant
    actual: Plant
    reduced: Plant
    before: tuple[tuple[float, float], ...]

    def in_usual_form(self) -> Rigging:
        """The same rig and film, the ball as most rigs hold it, which the rig file tells, readings at the end of holds.

        Rigs of one form share their compiled equations.
        """
        return replace(
            self,
            nominal=_in_usual_form(self.nominal),
            actual=_in_usual_form(self.actual),
            reduced=_in_usual_form(self.reduced),
        )


def _in_usual_form(plant: Plant) -> Plant:
    return plant.with_rig(
        replace(_diaphragm(plant), ball=Diaphragm.ball, ball_is_known=True, reading=Diaphragm.reading)
    )


def drawn_rig(rng: np.random.Generator) -> Rigging:
    """A rig at random."""
    ball = str(rng.choice(BALLS))
    told = bool(rng.random() < BALL_TOLD)
    rig = Diaphragm(
        material="VHB 4905",
        thickness=round(0.5e-3 * rng.uniform(0.9, 1.1), 6),
        prestretch=round(rng.uniform(3.3, 3.8), 2),
        frame_radius=round(40e-3 * rng.uniform(0.9, 1.1), 4),
        electrode_radius=round(17.5e-3 * rng.uniform(0.9, 1.1), 4),
        contact_radius=round(rng.uniform(1.5e-3, 3.5e-3), 4),
        mass=round(rng.uniform(2e-3, 4e-3), 5),
        start_ramp=round(rng.uniform(1.0, 3.0), 1),
        start_hold=round(rng.uniform(2.0, 4.0), 1),
        ball=ball if told else Diaphragm.ball,
        ball_is_known=told,
    )
    nominal = Plant(rig=rig)
    values = {name: nominal.parameters[name].value * (1 + FILM_ERROR * rng.uniform(-1, 1)) for name in FITTED}
    reading = ReadingTime.START_OF_HOLD if rng.random() < READ_AT_START else ReadingTime.END_OF_HOLD
    there = replace(rig, ball=ball, reading=reading)
    fine = replace(there, resolution="fine", elements=ELEMENTS)
    before = ((rng.uniform(0.5, 2.0), rng.uniform(5.0, 30.0)), (0.0, rng.uniform(60.0, 600.0)))
    return Rigging(
        nominal=nominal, actual=Plant(rig=fine, values=values), reduced=Plant(rig=there, values=values), before=before
    )


def with_added_mass(plant: Plant, added: float) -> Plant:
    """The plant of a diaphragm with a heavier ball."""
    rig = _diaphragm(plant)
    return plant.with_rig(replace(rig, mass=rig.mass + added))


def _diaphragm(plant: Plant) -> Diaphragm:
    if not isinstance(plant.rig, Diaphragm):
        raise TypeError(f"a {type(plant.rig).__name__} has no ball; the study's rigs are diaphragms")
    return plant.rig

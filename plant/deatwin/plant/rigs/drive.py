"""Chain from the command to the voltage that drives the film, the same in every rig."""

from __future__ import annotations

from typing import Any

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.film import AnyFilm


def squared_voltage(film: AnyFilm, build: Builder) -> Any:
    """Return the squared voltage of the Maxwell stress, from the command through amplifier and electrode."""
    build.watch("capacitance", film.capacitance)
    command = build.place(Place.DRIVE, "command", build.command)
    amplified = build.place(Place.DRIVE, "amplifier_voltage", build.parameter("gain") * command)
    voltage = build.watch("film_voltage", build.place(Place.DRIVE, "film_voltage", amplified))
    effective = build.share("field_voltage", build.place(Place.DRIVE, "field_voltage", voltage))
    return build.place(Place.DRIVE, "squared_voltage", effective**2)

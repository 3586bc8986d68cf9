"""From the command to what drives the film, the same chain in every rig."""

from __future__ import annotations

from typing import Any

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.film import AnyFilm

__all__ = ["squared_voltage"]


def squared_voltage(film: AnyFilm, build: Builder) -> Any:
    """From the command through amplifier and electrode to the square that makes the Maxwell stress.

    Parameters
    ----------
    film : AnyFilm
        As the effects at the place *film* left it; its capacitance is watched.
    build : Builder
        Offers command, amplifier voltage, film voltage, field voltage and squared voltage to the effects, in
        this order; watches the film voltage and shares the field voltage. The rig has a parameter ``gain``, film
        volts per command volt.

    Returns
    -------
    casadi.SX
        V².
    """
    build.watch("capacitance", film.capacitance)
    command = build.place(Place.DRIVE, "command", build.command)
    amplified = build.place(Place.DRIVE, "amplifier_voltage", build.parameter("gain") * command)
    voltage = build.watch("film_voltage", build.place(Place.DRIVE, "film_voltage", amplified))
    effective = build.share("field_voltage", build.place(Place.DRIVE, "field_voltage", voltage))
    return build.place(Place.DRIVE, "squared_voltage", effective**2)

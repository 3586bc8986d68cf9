"""An experiment with an unknown beginning: memories are fitted, fast states count as settled."""

from __future__ import annotations

from collections.abc import Sequence

from deatwin.plant.effects.base import Effect
from deatwin.plant.parameters import Parameter
from deatwin.plant.rigs.base import StartProcedure
from deatwin.plant.substance import Material

SETTLING = StartProcedure(rest_command=0.0, ramp=0.0, hold=1.0, uncounted=1.0)
"""Start procedure of an experiment with an unknown beginning. The first command is held for a second, in which
amplifier, electrode and motion settle; memories are free before it and remain so. What was still moving when the
recording began is forgotten in another second."""
FARTHEST = {"1": 0.5, "V": 20e3}
"""Largest displacement of a memory from rest, by its unit: half of the film's stretch, and a voltage beyond any
amplifier's."""


def memories(substance: Material, effects: Sequence[Effect]) -> tuple[Parameter, ...]:
    """Return the parameters that displace the memories of branches and effects from rest at the start."""
    units = {f"{branch.name}_at_start": "1" for branch in substance.branches}
    units |= {f"{effect.name}.at_start": effect.remembers for effect in effects if effect.remembers}
    return tuple(
        Parameter(
            name=name,
            value=0.0,
            unit=unit,
            lower=-FARTHEST[unit],
            upper=FARTHEST[unit],
            source="the start is not known: at rest at 0 V as a starting value",
        )
        for name, unit in units.items()
    )


def zero_of(reach: float, is_known: bool) -> Parameter:
    """Return the offset of a position sensor: near 0, or anywhere where the sensor's zero is arbitrary."""
    end, source = (reach, "sensor offset") if is_known else (ANYWHERE, "arbitrary zero of the sensor")
    return Parameter(name="zero", value=0.0, unit="m", lower=-end, upper=end, source=source)


ANYWHERE = 10.0  # Largest reading of a position sensor, m

"""Two cascaded tanks that overflow, taken as tanks without a brim."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.effects.smooth import soft_excess
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure

__all__ = ["Overflow", "TankPlace", "Tanks"]


class TankPlace(Enum):
    """Places that only tanks have."""

    BRIM = "brim"


@dataclass(frozen=True, kw_only=True)
class Tanks(Rig):
    """A pump fills the upper of two tanks, which empties into the lower one; levels in volts of the sensor."""

    sample_time: float = 4.0
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "cascaded-tanks"
    input_name: ClassVar[str] = "pump"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "level"
    output_unit: ClassVar[str] = "V"
    model_share: ClassVar[float] = 0.1
    """Outlets after Torricelli, a straight pump."""
    sizes: ClassVar[Sizes] = Sizes(
        motion=5.0, force=0.1, period=100.0, command=3.0, motion_unit="V", force_unit="V/s", body="level"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="pump", value=0.04, unit="1/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="threshold", value=0.5, unit="V", lower=0.0, upper=2.0),
            Parameter(name="upper_outlet", value=0.05, unit="V0.5/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="lower_outlet", value=0.05, unit="V0.5/s", lower=1e-4, upper=1.0, scale=log),
            Parameter(name="area_ratio", value=1.0, unit="1", lower=0.1, upper=10.0, scale=log),
            Parameter(name="upper_start", value=5.0, unit="V", lower=0.0, upper=15.0),
            Parameter(name="lower_start", value=5.0, unit="V", lower=0.0, upper=15.0),
        )

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        upper = build.watch("upper_level", build.state("upper", scale=5.0, start=build.parameter("upper_start")))
        lower = build.watch("displacement", build.state("lower", scale=5.0, start=build.parameter("lower_start")))
        above = build.place(Place.DRIVE, "command", build.command) - build.parameter("threshold")
        between = build.parameter("upper_outlet") * _root(upper)
        spilt = build.place(TankPlace.BRIM, "spill", ca.SX.zeros(3))
        build.rate(upper, build.parameter("pump") * above - between - spilt[0])
        caught = build.parameter("area_ratio") * (between + spilt[1])
        build.rate(lower, caught - build.parameter("lower_outlet") * _root(lower) - spilt[2])
        return build.place(Place.SENSOR, "reading", lower)

    def effects(self) -> tuple[Effect, ...]:
        return (*super().effects(), Overflow())


def _root(level: Any) -> Any:
    """Square root, straight where the tank is nearly empty."""
    return level / (level**2 + 0.01**2) ** 0.25


@dataclass(frozen=True, kw_only=True)
class Overflow(Effect):
    r"""Water runs over the brim of both tanks; part of what the upper one loses falls into the lower one.

    .. math:: q = r\,p(h - h_b), \qquad p(x) = w\ln(1 + e^{x/w})

    No state. The brims are equally high. Off at r = 0.

    Parameters
    ----------
    rate : float
        r in 1/s.
    brim : float
        :math:`h_b` in V of the level's sensor.
    caught : float
        Share of the upper tank's overflow that the lower one catches.
    """

    rate: float = 0.2
    brim: float = 9.5
    caught: float = 0.5

    name: ClassVar[str] = "overflow"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[TankPlace] = TankPlace.BRIM
    signal: ClassVar[str] = "spill"
    strength: ClassVar[str] = "rate"
    wording: ClassVar[str] = (
        "The tanks overflow beyond {brim}, at {rate} times the excess, and a share of {caught} of what the upper "
        "one loses falls into the lower one"
    )
    width: ClassVar[float] = 0.05
    """w in V."""

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="rate", value=self.rate, unit="1/s", lower=0.0, upper=2.0),
            Parameter(name="brim", value=self.brim, unit="V", lower=1.0, upper=20.0),
            Parameter(name="caught", value=self.caught, unit="1", lower=0.0, upper=1.0),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        rate, brim, caught = (self.own(name, build) for name in ("rate", "brim", "caught"))
        upper, lower = (
            rate * soft_excess(build.signal(name) - brim, self.width) for name in ("upper_level", "displacement")
        )
        return signal + ca.vertcat(upper, caught * upper, lower)

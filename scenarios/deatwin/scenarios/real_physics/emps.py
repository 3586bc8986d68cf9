"""EMPS: a carriage on a ball screw, recorded under its controller, taken without dry friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure

__all__ = ["ControlledCarriage"]


@dataclass(frozen=True, kw_only=True)
class ControlledCarriage(Rig):
    """A carriage with viscous friction and a force offset, driven by a motor under a cascade of two gains."""

    sample_time: float = 1e-3
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD
    model_error: float = 2.5e-6
    """The controller samples, and is taken as continuous: half a millisecond of 2 m/s² is 6 µm at its position gain."""

    kind: ClassVar[str] = "emps"
    input_name: ClassVar[str] = "reference"
    input_unit: ClassVar[str] = "m"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "m"
    sizes: ClassVar[Sizes] = Sizes(
        motion=0.1, force=50.0, period=0.1, command=0.1, command_unit="m", reading=20e-6, reading_unit="m", body="carriage"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log, known = Scale.LOGARITHMIC, {"known": True, "source": "the recordings' file"}
        return (
            Parameter(name="mass", value=80.0, unit="kg", lower=10.0, upper=1e3, scale=log),
            Parameter(name="viscosity", value=100.0, unit="N s/m", lower=-1e3, upper=1e4),
            Parameter(name="offset", value=0.0, unit="N", lower=-100.0, upper=100.0),
            Parameter(name="position_gain", value=160.18, unit="1/s", lower=100.0, upper=250.0, scale=log),
            Parameter(name="velocity_gain", value=243.45, unit="V s/m", lower=1.0, upper=1e3, **known),
            Parameter(name="motor", value=35.15, unit="N/V", lower=1.0, upper=1e3, **known),
        )

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=0.1))
        velocity = build.watch("velocity", build.state("velocity", scale=0.1))
        behind = build.place(Place.DRIVE, "command", build.command) - position
        wanted = build.parameter("position_gain") * behind - velocity
        voltage = build.watch("voltage", build.parameter("velocity_gain") * wanted + build.channel("pulse_V", 0.0))
        drive = build.parameter("motor") * voltage + build.parameter("offset")
        force = build.place(Place.BALL, "force", -build.parameter("viscosity") * velocity)
        build.rate(position, velocity)
        build.rate(velocity, drive + force, mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", position)

"""A quarter of a car on a test rig: the road lifts the tyre, and a sensor reads the travel of the suspension."""

from dataclasses import dataclass
from typing import Any, ClassVar

from deatwin.plant import Builder, Parameter, Place, Plant, Rig, Scale, Sizes


@dataclass(frozen=True, kw_only=True)
class QuarterCar(Rig):
    """A body on a spring and a damper, on a wheel, on a tyre, on a road that goes up and down; heights in metres."""

    sample_time: float = 0.01
    noise: float = 0.2e-3

    kind: ClassVar[str] = "quarter-car"
    input_name: ClassVar[str] = "road"
    input_unit: ClassVar[str] = "m"
    output_name: ClassVar[str] = "travel"
    output_unit: ClassVar[str] = "m"
    model_share: ClassVar[float] = 0.002  # these equations are right to 0.2 % of the travel
    sizes: ClassVar[Sizes] = Sizes(motion=0.02, force=400.0, period=0.7, command=0.02, command_unit="m", body="strut")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="body", value=300.0, unit="kg", lower=100.0, upper=1000.0, known=True),  # weighed
            Parameter(name="wheel", value=30.0, unit="kg", lower=5.0, upper=200.0, scale=log),
            Parameter(name="spring", value=15e3, unit="N/m", lower=1e3, upper=1e5, scale=log),
            Parameter(name="damper", value=1e3, unit="N s/m", lower=10.0, upper=1e5, scale=log),
            Parameter(name="tyre", value=150e3, unit="N/m", lower=1e4, upper=1e6, scale=log),
        )

    def write(self, build: Builder) -> Any:
        body, wheel = build.state("body", scale=0.02), build.state("wheel", scale=0.02)
        up, hop = build.state("body_velocity", scale=0.2), build.state("wheel_velocity", scale=0.5)
        travel, speed = build.watch("displacement", body - wheel), build.watch("velocity", up - hop)
        strut = -build.parameter("spring") * travel - build.parameter("damper") * speed
        force = build.watch("strut", build.place(Place.BALL, "force", strut))
        road = build.place(Place.DRIVE, "command", build.command)
        build.rate(body, up)
        build.rate(wheel, hop)
        build.rate(up, force, mass=build.parameter("body"))
        build.rate(hop, build.parameter("tyre") * (road - wheel) - force, mass=build.parameter("wheel"))
        return build.place(Place.SENSOR, "reading", travel)


def plant() -> Plant:
    """Return the plant, which the command line calls quarter_car:plant."""
    return Plant(rig=QuarterCar())

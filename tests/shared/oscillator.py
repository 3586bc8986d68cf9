"""A mass on a spring that a command pulls: each place of an effect but the pressure, and answers in closed form."""

from dataclasses import dataclass
from typing import Any, ClassVar

from made_rigs import Bare

from deatwin.plant import Builder, Parameter, Place

MASS, DAMPING, STIFFNESS = 0.01, 0.05, 40.0


@dataclass(frozen=True, kw_only=True)
class Oscillator(Bare):
    """The command is a force in mN; 10 Hz, and 1 mm for 40 of them."""

    noise: float = 2e-6
    kind: ClassVar[str] = "oscillator"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="stiffness", value=STIFFNESS, unit="N/m", lower=1.0, upper=1e3),
            Parameter(name="damping", value=DAMPING, unit="N s/m", lower=1e-3, upper=1.0),
        )

    def write(self, build: Builder) -> Any:
        x, v = build.state("x", scale=1e-3), build.state("v", scale=0.1)
        pull = 1e-3 * build.place(Place.DRIVE, "command", build.command)
        drag = build.place(Place.BALL, "force", -build.parameter("damping") * v)
        build.watch("speed", v)
        build.rate(x, v)
        build.rate(v, pull + drag - build.parameter("stiffness") * x, mass=MASS)
        return build.place(Place.SENSOR, "reading", x)

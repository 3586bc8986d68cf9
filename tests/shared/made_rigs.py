"""What rigs that tests make have in common, a mass on a spring, a wire, a tank, and a plate that pulls in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from deatwin.plant import Parameter, Place, Rig
from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class Bare(Rig):
    """A rig that begins at rest under no command; from volts to metres unless it says otherwise."""

    sample_time: float = 0.02
    noise: float = 1e-6

    kind: ClassVar[str] = "bare"
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"


@dataclass(frozen=True, kw_only=True)
class Pushed(Bare):
    """A mass between spring and damper, pushed by `push` newtons a volt; a stiffness of zero leaves it free."""

    noise: float = 0.0
    mass: float = 3e-3
    damping: float = 0.05
    stiffness: float = 30.0
    push: float = 6e-3

    kind: ClassVar[str] = "pushed mass"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="mass", value=self.mass, unit="kg", lower=1e-4, upper=10.0),
            Parameter(name="damping", value=self.damping, unit="N s/m", lower=0.0, upper=10.0),
            Parameter(name="stiffness", value=self.stiffness, unit="N/m", lower=0.0, upper=1e3),
        )

    def write(self, build: Builder) -> Any:
        y = build.watch("displacement", build.state("position", scale=1e-3))
        v = build.watch("velocity", build.state("velocity", scale=0.05))
        command = build.watch("acting", build.place(Place.DRIVE, "command", build.command))
        force = -build.parameter("stiffness") * y - build.parameter("damping") * v
        build.rate(y, v)
        build.rate(v, self.push * command + build.place(Place.BALL, "force", force), mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", y)


@dataclass(frozen=True, kw_only=True)
class Wire(Bare):
    """A capacitor behind an amplifier, and a sensor that reads its voltage."""

    noise: float = 2e-6

    kind: ClassVar[str] = "wire"
    follows_at_once: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=1e-4, unit="m/V", lower=1e-6, upper=1e-2),
            Parameter(name="zero", value=0.0, unit="m", lower=-1e-3, upper=1e-3),
        )

    def write(self, build: Builder) -> Any:
        command = build.place(Place.DRIVE, "command", build.command)
        build.watch("capacitance", 1e-9 + 0 * command)
        voltage = build.watch("film_voltage", build.place(Place.DRIVE, "film_voltage", command))
        return build.place(Place.SENSOR, "reading", build.parameter("gain") * voltage + build.parameter("zero"))


@dataclass(frozen=True, kw_only=True)
class Tank(Bare):
    """A leaking tank: the level is read first; the outflow and the filling may be read beside it."""

    sample_time: float = 0.1
    noise: float = 1e-3
    drain: float = 0.5
    area: float = 1.0

    kind: ClassVar[str] = "tank"
    input_name: ClassVar[str] = "pump"
    output_name: ClassVar[str] = "level"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="drain", value=self.drain, unit="1/s", lower=0.1, upper=2.0),
            Parameter(name="area", value=self.area, unit="m2", lower=0.2, upper=5.0),
        )

    def write(self, build: Builder) -> Any:
        level = build.state("level", scale=1.0)
        outflow = build.watch("outflow", build.parameter("drain") * level)
        build.rate(level, build.command / build.parameter("area") - outflow)
        build.measure("filling", 0.0, stored=level)
        return level


@dataclass(frozen=True, kw_only=True)
class Gap(Bare):
    """A voltage pulls a plate on a spring into a gap: u² = x (1 - x)² at rest, pull-in at x = 1/3 and 0.385 V."""

    noise: float = 1e-3
    stiffness: float = 1.0
    damping: float = 0.1

    kind: ClassVar[str] = "gap"
    input_name: ClassVar[str] = "voltage"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "mm"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="stiffness", value=self.stiffness, unit="1", lower=-10.0, upper=10.0),
            Parameter(name="damping", value=self.damping, unit="s", lower=0.0, upper=10.0),
        )

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        pull = build.command**2 / (1 - position) ** 2 - build.parameter("stiffness") * position
        build.rate(position, pull, mass=build.parameter("damping"))
        return position

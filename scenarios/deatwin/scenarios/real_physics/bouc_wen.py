"""The Bouc-Wen benchmark, which is simulated: a mass on a hysteretic spring, taken as a linear oscillator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.effects.hysteresis import Hysteresis
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure

__all__ = ["RATE", "BoucWen", "LinearOscillator"]

RATE = 750.0
"""Hz."""


@dataclass(frozen=True, kw_only=True)
class LinearOscillator(Rig):
    """A mass between a linear spring and a damper."""

    sample_time: float = 1 / RATE
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "bouc-wen"
    input_name: ClassVar[str] = "force"
    input_unit: ClassVar[str] = "N"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"
    model_share: ClassVar[float] = 0.02
    sizes: ClassVar[Sizes] = Sizes(
        motion=1e-3, force=50.0, period=1 / 35, command=50.0, command_unit="N", body="mass"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="mass", value=2.0, unit="kg", lower=0.1, upper=100.0, scale=log),
            Parameter(name="damping", value=10.0, unit="N s/m", lower=0.1, upper=1e4, scale=log),
            Parameter(name="stiffness", value=9e4, unit="N/m", lower=1e3, upper=1e7, scale=log),
        )

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=1e-3))
        velocity = build.watch("velocity", build.state("velocity", scale=0.2))
        drive = build.place(Place.DRIVE, "command", build.command)
        force = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        build.rate(position, velocity)
        build.rate(velocity, drive - build.parameter("stiffness") * position + force, mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", position)

    def effects(self) -> tuple[Effect, ...]:
        return (*(e for e in super().effects() if e.name != BoucWen.name), BoucWen())


@dataclass(frozen=True, kw_only=True)
class BoucWen(Hysteresis):
    r"""Bouc's and Wen's spring with both of their terms; the catalogue's has the first one only.

    .. math:: F = -F_h\,\zeta, \qquad x_h\,\dot\zeta = v - |v|\,\zeta + \kappa\,v\,|\zeta|

    The second term makes the spring stiffer (:math:`\kappa > 0`) or softer the further it is strained.

    Parameters
    ----------
    force : float
        :math:`F_h` in N.
    distance : float
        :math:`x_h` in m.
    hardening : float
        :math:`\kappa`.
    """

    force: float = 20.0
    distance: float = 1e-3
    hardening: float = 0.0

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="force", value=self.force, unit="N", lower=0.0, upper=1e3),
            Parameter(name="distance", value=self.distance, unit="m", lower=1e-5, upper=0.1, scale=Scale.LOGARITHMIC),
            Parameter(name="hardening", value=self.hardening, unit="1", lower=-5.0, upper=5.0),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        memory = build.state("hysteresis_memory", scale=1.0, start=0.0)
        velocity = build.signal("velocity")
        slow = 1e-6
        speed, strain = (ca.sqrt(x**2 + slow**2) - slow for x in (velocity, memory))
        change = velocity - speed * memory + self.own("hardening", build) * velocity * strain
        build.rate(memory, change, mass=self.own("distance", build))
        return signal - self.own("force", build) * memory

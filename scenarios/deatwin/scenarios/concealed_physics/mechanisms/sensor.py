"""Concealed mechanisms of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.mechanisms.base import Mechanism, PlantMechanism, Reading, Setting


@dataclass(frozen=True, kw_only=True)
class SecondOrderSensor(PlantMechanism):
    r"""A filter of second order: :math:`T^2\ddot r + 2\zeta T\dot r + r = y`."""

    time: float  # T, s
    damping_ratio: float  # :math:`\zeta`

    name: ClassVar[str] = "second_order_sensor"
    strength: ClassVar[str] = "time"
    largest: ClassVar[float] = 0.05
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    order: ClassVar[int] = 20

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(time=cls.largest * rng.uniform(0.1, 0.3), damping_ratio=rng.uniform(0.6, 1.0))

    def rewrite(self, signal: Any, build: Any) -> Any:
        time, ratio = self.symbols(build)
        shown = build.state("shown", scale=1e-3)
        # T times its rate.
        rising = build.state("rising", scale=1e-3)
        build.rate(shown, rising, mass=time)
        build.rate(rising, signal - shown - 2 * ratio * rising, mass=time)
        return shown


@dataclass(frozen=True, kw_only=True)
class WarmingSensor(Mechanism):
    """The zero moves by the same way in each decade of time."""

    change: float
    first: float  # Where the first decade begins, s

    name: ClassVar[str] = "warming_sensor"
    strength: ClassVar[str] = "change"
    largest: ClassVar[float] = 1e-4

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(change=rng.choice([-1.0, 1.0]) * cls.largest * rng.uniform(0.1, 0.3), first=rng.uniform(10.0, 60.0))

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values + self.change * np.log10(1 + np.maximum(reading.times, 0.0) / self.first)


@dataclass(frozen=True, kw_only=True)
class KnockedSensor(Mechanism):
    """A knock shifts all further readings, from one sample to the next; a fifth of it goes back within a second."""

    change: float  # That stays, m
    at: float  # s

    name: ClassVar[str] = "knocked_sensor"
    strength: ClassVar[str] = "change"
    largest: ClassVar[float] = 1e-4

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        at = setting.seconds * rng.uniform(0.2, 0.8)
        return cls(change=rng.choice([-1.0, 1.0]) * cls.largest * rng.uniform(0.1, 0.3), at=at)

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        since = np.maximum(reading.times - self.at, 0.0)
        return reading.values + (reading.times >= self.at) * self.change * (1 + 0.25 * np.exp(-since / 0.5))

    def catalogue_values(self) -> dict[str, float]:
        return {"sensor_jump.change": self.change, "sensor_jump.at": self.at}


@dataclass(frozen=True, kw_only=True)
class CrookedOptics(Mechanism):
    r"""Triangulation that was not made straight: :math:`r = y/(1 - \kappa y)`."""

    curvature: float  # :math:`\kappa`, 1/m

    name: ClassVar[str] = "crooked_optics"
    strength: ClassVar[str] = "curvature"
    largest: ClassVar[float] = 200.0

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(curvature=rng.choice([-1.0, 1.0]) * cls.largest * rng.uniform(0.1, 0.3))

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values / (1 - self.curvature * reading.values)


@dataclass(frozen=True, kw_only=True)
class HardCeiling(Mechanism):
    """A reading that stops dead at a level."""

    depth: float  # Share of the motion's range that is cut off
    top: float
    bottom: float

    name: ClassVar[str] = "hard_ceiling"
    strength: ClassVar[str] = "depth"
    largest: ClassVar[float] = 0.5

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        y = setting.displacement
        return cls(depth=cls.largest * rng.uniform(0.2, 0.5), top=float(y.max()), bottom=float(y.min()))

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return np.minimum(reading.values, self.top - self.depth * (self.top - self.bottom))

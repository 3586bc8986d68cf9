"""Concealed mechanisms from outside the rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.mechanisms.base import Mechanism, PlantMechanism, Reading, Setting, log_uniform


@dataclass(frozen=True, kw_only=True)
class ThermostatSwing(PlantMechanism):
    """A room that is heated on and off: the modulus follows its temperature, up and down exponentially."""

    change: float
    period: float  # s
    phase: float  # Share of a period that is over at clock 0

    name: ClassVar[str] = "thermostat_swing"
    strength: ClassVar[str] = "change"
    largest: ClassVar[float] = 0.1
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    order: ClassVar[int] = 2

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(
            change=rng.choice([-1.0, 1.0]) * cls.largest * rng.uniform(0.1, 0.3),
            period=rng.uniform(25.0, 70.0),
            phase=rng.uniform(0.0, 1.0),
        )

    def rewrite(self, signal: Any, build: Any) -> Any:
        change, period, phase = self.symbols(build)

        def warmth(share: Any) -> Any:
            """0 to 1: heated for 0.4 of each period, at a time constant of a fourth of it."""
            at = share - ca.floor(share)
            top, bottom = 1 - np.exp(-1.6), 1 - np.exp(-2.4)
            return ca.if_else(at < 0.4, (1 - ca.exp(-4 * at)) / top, 1 - (1 - ca.exp(-4 * (at - 0.4))) / bottom)

        swing = warmth(ca.fmax(build.time, 0.0) / period + phase) - warmth(phase)
        return replace(signal, elastic=(1 + change * swing) * signal.elastic)


@dataclass(frozen=True, kw_only=True)
class MainsHum(Mechanism):
    """A tone in the reading with a weak second harmonic, whose phase wanders a little."""

    amplitude: float  # m
    frequency: float  # Hz
    phase: float  # At clock 0, rad

    name: ClassVar[str] = "mains_hum"
    strength: ClassVar[str] = "amplitude"
    largest: ClassVar[float] = 1e-4

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        return cls(
            amplitude=cls.largest * rng.uniform(0.1, 0.3),
            frequency=log_uniform(rng, 0.05, 15.0),
            phase=rng.uniform(-np.pi, np.pi),
        )

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        passed = np.diff(reading.times, prepend=reading.times[0])
        wander = np.cumsum(0.01 * np.sqrt(passed) * rng.standard_normal(passed.size))
        angle = 2 * np.pi * self.frequency * reading.times + self.phase + wander
        return reading.values + self.amplitude * (np.cos(angle) + 0.08 * np.cos(2 * angle))

    def catalogue_values(self) -> dict[str, float]:
        return {"periodic_disturbance.amplitude": self.amplitude, "periodic_disturbance.frequency": self.frequency}

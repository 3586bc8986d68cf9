"""Concealed mechanisms of the sensor and its surroundings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.generator.mechanism import Draw, Mechanism, PlantMechanism, Reading


@dataclass(frozen=True, kw_only=True)
class SecondOrderSensor(PlantMechanism, place=Place.SENSOR, signal="reading", order=20, largest=0.05):
    r"""A filter of second order: :math:`T^2\ddot r + 2\zeta T\dot r + r = y`."""

    time: float = Draw.part()  # T, s
    damping_ratio: float = Draw.uniform(0.6, 1.0)  # :math:`\zeta`

    def law(self, signal: Any, build: Any, time: Any, ratio: Any) -> Any:
        shown = build.state("shown", scale=1e-3)
        rising = build.state("rising", scale=1e-3)  # T times the rate of what is shown
        build.rate(shown, rising, mass=time)
        build.rate(rising, signal - shown - 2 * ratio * rising, mass=time)
        return shown


@dataclass(frozen=True, kw_only=True)
class WarmingSensor(Mechanism, largest=1e-4):
    """The zero moves by the same way in each decade of time."""

    change: float = Draw.signed()
    first: float = Draw.uniform(10.0, 60.0)  # Where the first decade begins, s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values + self.change * np.log10(1 + np.maximum(reading.times, 0.0) / self.first)


@dataclass(frozen=True, kw_only=True)
class KnockedSensor(Mechanism, largest=1e-4):
    """A knock shifts all further readings, from one sample to the next; a fifth of it goes back within a second."""

    at: float = Draw.during(0.2, 0.8)  # s
    change: float = Draw.signed()  # Lasting part, m

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        since = np.maximum(reading.times - self.at, 0.0)
        return reading.values + (reading.times >= self.at) * self.change * (1 + 0.25 * np.exp(-since / 0.5))

    def catalogue_values(self) -> dict[str, float]:
        return {"sensor_jump.change": self.change, "sensor_jump.at": self.at}


@dataclass(frozen=True, kw_only=True)
class CrookedOptics(Mechanism, largest=200.0):
    r"""Triangulation that was not made straight: :math:`r = y/(1 - \kappa y)`."""

    curvature: float = Draw.signed()  # :math:`\kappa`, 1/m

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return reading.values / (1 - self.curvature * reading.values)


@dataclass(frozen=True, kw_only=True)
class HardCeiling(Mechanism, largest=0.5):
    """A reading that stops dead at a level."""

    depth: float = Draw.part(0.2, 0.5)  # Share of the motion's range that is cut off
    top: float = Draw.by(lambda rng, setting, largest: float(setting.displacement.max()))  # Ends of that range, m
    bottom: float = Draw.by(lambda rng, setting, largest: float(setting.displacement.min()))

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        return np.minimum(reading.values, self.top - self.depth * (self.top - self.bottom))


@dataclass(frozen=True, kw_only=True)
class ThermostatSwing(PlantMechanism, place=Place.FILM, signal="film", order=2, largest=0.1):
    """A room that is heated on and off: the modulus follows its temperature, up and down exponentially."""

    change: float = Draw.signed()
    period: float = Draw.uniform(25.0, 70.0)  # s
    phase: float = Draw.uniform(0.0, 1.0)  # Share of a period that is over at clock 0

    def law(self, signal: Any, build: Any, change: Any, period: Any, phase: Any) -> Any:

        def warmth(share: Any) -> Any:
            """0 to 1: heated for 0.4 of each period, at a time constant of a fourth of it."""
            at = share - ca.floor(share)
            top, bottom = 1 - np.exp(-1.6), 1 - np.exp(-2.4)
            return ca.if_else(at < 0.4, (1 - ca.exp(-4 * at)) / top, 1 - (1 - ca.exp(-4 * (at - 0.4))) / bottom)

        swing = warmth(ca.fmax(build.time, 0.0) / period + phase) - warmth(phase)
        return replace(signal, elastic=(1 + change * swing) * signal.elastic)


@dataclass(frozen=True, kw_only=True)
class MainsHum(Mechanism, largest=1e-4):
    """A tone in the reading with a weak second harmonic, whose phase wanders a little."""

    amplitude: float = Draw.part()  # m
    frequency: float = Draw.log_uniform(0.05, 15.0)  # Hz
    phase: float = Draw.uniform(-np.pi, np.pi)  # At clock 0, rad

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        passed = np.diff(reading.times, prepend=reading.times[0])
        wander = np.cumsum(0.01 * np.sqrt(passed) * rng.standard_normal(passed.size))
        angle = 2 * np.pi * self.frequency * reading.times + self.phase + wander
        return reading.values + self.amplitude * (np.cos(angle) + 0.08 * np.cos(2 * angle))

    def catalogue_values(self) -> dict[str, float]:
        return {"periodic_disturbance.amplitude": self.amplitude, "periodic_disturbance.frequency": self.frequency}

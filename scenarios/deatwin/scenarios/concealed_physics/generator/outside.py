"""Mechanisms that no effect of the catalogue describes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deatwin.plant.effects.base import Place
from deatwin.scenarios.concealed_physics.generator.mechanism import (
    Draw,
    Drive,
    Mechanism,
    PlantMechanism,
    Reading,
)


def _fading(kept: np.ndarray, pushes: np.ndarray) -> np.ndarray:
    """Sum pushes, x_k = kept_k x_{k-1} + pushes_k, from 0. Shapes: `kept, pushes` (n,); returns (n,)."""
    here, found = 0.0, np.empty(pushes.size)
    for k, (share, push) in enumerate(zip(kept, pushes, strict=True)):
        found[k] = here = share * here + push
    return found


@dataclass(frozen=True, kw_only=True)
class CrossoverDeadZone(Mechanism, largest=0.4):
    """An amplifier of two halves that leave a gap where one hands over to the other."""

    level: float = Draw.by(
        lambda rng, setting, largest: float(np.quantile(np.abs(setting.commands), rng.uniform(0.4, 0.7)))
    )
    """Centre of the gap, V of the command."""
    width: float = Draw.part()  # Half width of the gap, V

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        beyond = np.abs(drive.commands) - self.level
        passed = self.level + np.sign(beyond) * np.maximum(np.abs(beyond) - self.width, 0.0)
        # Far below the gap the lower half works alone.
        share = np.clip(np.abs(drive.commands) / self.level * 2, 0.0, 1.0)
        size = np.abs(drive.commands) + share * (passed - np.abs(drive.commands))
        return replace(drive, commands=np.sign(drive.commands) * size)


@dataclass(frozen=True, kw_only=True)
class ChargingHeat(PlantMechanism, place=Place.FILM, signal="film", order=3, largest=20.0):
    """Charging currents heat the film, each by the square of its step of voltage; the warm film is softer."""

    softening: float = Draw.part()  # Share of the modulus lost for a heat of 1: steps of 1 kV ten times a second
    time: float = Draw.uniform(3.0, 12.0)

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        steps = np.diff(drive.commands, prepend=drive.rest_command)
        passed = np.diff(drive.times, prepend=drive.times[0])
        heat = _fading(np.exp(-passed / self.time), (0.8 * steps) ** 2 / (10.0 * self.time))
        return replace(drive, channels={**drive.channels, "charging_heat": heat})

    def law(self, signal: Any, build: Any, softening: Any, _: Any) -> Any:
        return replace(signal, elastic=signal.elastic / (1 + softening * build.channel("charging_heat", 0.0)))


@dataclass(frozen=True, kw_only=True)
class GainWander(Mechanism, largest=0.08):
    """The amplifier's gain wanders at random, and comes back within some seconds."""

    deviation: float = Draw.part()  # Standard deviation, as a share
    time: float = Draw.log_uniform(0.5, 6.0)

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        kept = np.exp(-np.diff(drive.times, prepend=drive.times[0]) / self.time)
        wander = _fading(kept, np.sqrt(1 - kept**2) * rng.standard_normal(kept.size))
        return replace(drive, commands=drive.commands * (1 + self.deviation * wander))


@dataclass(frozen=True, kw_only=True)
class InterferenceBursts(Mechanism, largest=3e-4):
    """Short bursts in the reading at random times, each with its own frequency and size."""

    amplitude: float = Draw.part()  # Typical size, m
    apart: float = Draw.uniform(4.0, 12.0)  # Mean time between two, s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        disturbed, time = reading.values.copy(), float(reading.times[0])
        while (time := time + rng.exponential(self.apart)) < reading.times[-1]:
            since = reading.times - time
            size, frequency, phase = rng.exponential(), rng.uniform(2.0, 12.0), rng.uniform(0, 2 * np.pi)
            shape = np.exp(-np.abs(since) / rng.uniform(0.2, 0.8)) * np.cos(2 * np.pi * frequency * since + phase)
            disturbed += self.amplitude * size * np.where(since >= 0, shape, 0.0)
        return disturbed


@dataclass(frozen=True, kw_only=True)
class OneWayDamper(PlantMechanism, place=Place.BALL, signal="force", largest=3.0):
    """Air that leaves the chamber below the film easily, and comes back through a narrow valve."""

    coefficient: float = Draw.part()  # On the way up, N s/m

    def law(self, signal: Any, build: Any, coefficient: Any) -> Any:
        velocity = build.signal("velocity")
        return signal - coefficient * (velocity - (velocity**2 + 1e-12) ** 0.5) / 2


@dataclass(frozen=True, kw_only=True)
class CapacitiveCrosstalk(Mechanism, largest=1e-4):
    """Every change of the high voltage couples into the sensor's cable, which forgets it within a second or so."""

    coupling: float = Draw.signed()  # m for a step of one volt of the command
    time: float = Draw.log_uniform(0.1, 1.0)  # s

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        kept = np.exp(-np.median(np.diff(reading.times)) / self.time)
        steps = np.diff(reading.commands, prepend=reading.commands[0])
        return reading.values + self.coupling * _fading(np.full(steps.size, kept), steps)


@dataclass(frozen=True, kw_only=True)
class ClockSkew(Mechanism, largest=2e-3):
    """Two clocks that run apart: commands come later and later against the readings."""

    skew: float = Draw.part()  # s for each s

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        return replace(drive, times=drive.times + self.skew * np.maximum(drive.times, 0.0))

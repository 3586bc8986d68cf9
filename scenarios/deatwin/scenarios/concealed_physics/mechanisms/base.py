"""What a concealed mechanism is: it acts on the command, in the plant's equations, or on the reading."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from deatwin.plant.effects.base import Effect, Family
from deatwin.plant.parameters import Parameter

BUILT_IN = 1e12
"""No parameter is beyond this: ranges are the diagnosis' business, not nature's."""


def log_uniform(rng: np.random.Generator, lower: float, upper: float) -> float:
    """A number whose logarithm is uniformly distributed."""
    return float(np.exp(rng.uniform(np.log(lower), np.log(upper))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """What a mechanism is drawn for: a clean recording of the same film."""

    seconds: float  # Length of the records that are diagnosed, on the clock, s
    commands: np.ndarray  # shape (n,): Of these records, V
    displacement: np.ndarray  # shape (n,): Noise-free, without any mechanism, m
    gain: float  # Film volts per command volt


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """What acts on the plant, constant between switching times."""

    times: np.ndarray  # shape (m,): At which each command begins to act, ascending; the experiment's clock, s
    commands: np.ndarray  # shape (m,): V
    rest_command: float = 0.0  # Before the first of them, V
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What the sensor gives before its noise."""

    times: np.ndarray  # shape (n,): Clock, s
    values: np.ndarray  # shape (n,): Displacement, m
    commands: np.ndarray  # shape (n,): That was wished in each row, V


@dataclass(frozen=True, kw_only=True)
class Mechanism(ABC):
    """A piece of physics that the diagnosis does not see; its fields are its parameters in SI."""

    name: ClassVar[str]
    strength: ClassVar[str]
    largest: ClassVar[float]

    @classmethod
    @abstractmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        """A mechanism at random, with a tenth to a third of its largest strength."""

    @property
    def size(self) -> float:
        """Its strength without sign, SI."""
        return abs(float(getattr(self, self.strength)))

    def sized(self, size: float) -> Self:
        """The same mechanism with another strength, at most the largest."""
        sign = -1.0 if getattr(self, self.strength) < 0 else 1.0
        return replace(self, **{self.strength: sign * min(size, self.largest)})

    @property
    def effects(self) -> tuple[Effect, ...]:
        """What it writes into the plant's equations."""
        return ()

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        """What acts, of what was wished."""
        return drive

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        """What is read, of what there is to be read. Shapes: returns (n,)."""
        return reading.values

    def catalogue_values(self) -> dict[str, float]:
        """Its parameters that a catalogue effect has too, by name there, SI; most have none."""
        return {}

    def to_dict(self) -> dict[str, float]:
        """Its parameters, SI."""
        return {f.name: float(getattr(self, f.name)) for f in fields(self)}


@dataclass(frozen=True, kw_only=True)
class PlantMechanism(Effect, Mechanism):
    """A mechanism in the plant's equations."""

    family: ClassVar[Family] = Family.ENVIRONMENT
    wording: ClassVar[str] = "concealed"

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Itself."""
        return (self,)

    def describe(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(name=f.name, value=float(getattr(self, f.name)), unit="1", lower=-BUILT_IN, upper=BUILT_IN)
            for f in fields(self)
        )

    def symbols(self, build: Any) -> list[Any]:
        """The symbols of its parameters, in the order of its fields."""
        return [self.own(f.name, build) for f in fields(self)]

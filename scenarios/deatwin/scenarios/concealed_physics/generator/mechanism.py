"""Define a concealed mechanism by the fields that are drawn and by where it acts: on commands, plant or readings."""

from __future__ import annotations

import re
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, ClassVar, Self, dataclass_transform

import numpy as np

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

BUILT_IN = 1e12  # No parameter is beyond this: ranges are the diagnosis' business, not nature's


def log_uniform(rng: np.random.Generator, lower: float, upper: float) -> float:
    """Draw a number whose logarithm is uniformly distributed."""
    return float(np.exp(rng.uniform(np.log(lower), np.log(upper))))


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """A clean recording of the same film, which sets the strength of a mechanism."""

    seconds: float  # Length of the records that are diagnosed, on the clock, s
    commands: np.ndarray  # shape (n,): Commands of these records, V
    displacement: np.ndarray  # shape (n,): Noise-free, without any mechanism, m


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """Commands and channels that act on the plant, constant between switching times."""

    times: np.ndarray  # shape (m,): Clock time at which each command begins to act, ascending, s
    commands: np.ndarray  # shape (m,): V
    rest_command: float = 0.0  # Before the first of them, V
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """The sensor's input before its noise."""

    times: np.ndarray  # shape (n,): Clock, s
    values: np.ndarray  # shape (n,): Displacement, m
    commands: np.ndarray  # shape (n,): Intended command of each row, V


class Draw:
    """Fields of a mechanism, with the distributions from which they are drawn."""

    @staticmethod
    def by(draw: Callable[[np.random.Generator, Setting, float], float], strength: bool = False) -> Any:
        """Compute a field by a function of generator, setting and largest strength; one of them is the strength."""
        return field(metadata={"draw": draw, "strength": strength})

    @classmethod
    def part(cls, lower: float = 0.1, upper: float = 0.3) -> Any:
        """Draw the strength, a share of the largest."""
        return cls.by(lambda rng, setting, largest: largest * rng.uniform(lower, upper), strength=True)

    @classmethod
    def signed(cls) -> Any:
        """Draw the strength, 0.1 to 0.3 of the largest, with either sign."""
        return cls.by(
            lambda rng, setting, largest: rng.choice([-1.0, 1.0]) * largest * rng.uniform(0.1, 0.3), strength=True
        )

    @classmethod
    def uniform(cls, lower: float, upper: float) -> Any:
        """Draw from a uniform distribution."""
        return cls.by(lambda rng, setting, largest: rng.uniform(lower, upper))

    @classmethod
    def log_uniform(cls, lower: float, upper: float) -> Any:
        """Draw from a log-uniform distribution."""
        return cls.by(lambda rng, setting, largest: log_uniform(rng, lower, upper))

    @classmethod
    def during(cls, lower: float, upper: float) -> Any:
        """Draw a share of the records' duration."""
        return cls.by(lambda rng, setting, largest: setting.seconds * rng.uniform(lower, upper))


@dataclass_transform(frozen_default=True, kw_only_default=True)
@dataclass(frozen=True, kw_only=True)
class Mechanism(ABC):
    """A concealed piece of physics, a frozen data class; its fields are parameters, SI, in the order of their draws."""

    name: ClassVar[str]
    strength: ClassVar[str]
    largest: ClassVar[float]

    def __init_subclass__(cls, *, largest: float = np.nan) -> None:
        cls.name = re.sub(r"(?<!^)([A-Z])", r"_\1", cls.__name__).lower()
        drawn = {name: value.metadata for name, value in vars(cls).items() if isinstance(value, Field)}
        cls.strength, cls.largest = next((name for name, how in drawn.items() if how["strength"]), ""), largest
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def drawn(cls, rng: np.random.Generator, setting: Setting) -> Self:
        """Draw a mechanism, with a small part of its largest strength."""
        return cls(**{f.name: f.metadata["draw"](rng, setting, cls.largest) for f in fields(cls)})

    @property
    def size(self) -> float:
        """Absolute strength, SI."""
        return abs(float(getattr(self, self.strength)))

    def sized(self, size: float) -> Self:
        """Return the mechanism with another strength, at most the largest."""
        sign = -1.0 if getattr(self, self.strength) < 0 else 1.0
        return replace(self, **{self.strength: sign * min(size, self.largest)})

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects that it writes into the plant's equations."""
        return ()

    def commanded(self, drive: Drive, rng: np.random.Generator) -> Drive:
        """Convert the intended drive to the actual one."""
        return drive

    def read(self, reading: Reading, rng: np.random.Generator) -> np.ndarray:
        """Convert the motion to the reading. Shapes: returns (n,)."""
        return reading.values

    def catalogue_values(self) -> dict[str, float]:
        """Parameters shared with an effect of the catalogue, by their names there, SI; most mechanisms have none."""
        return {}


class PlantMechanism(Effect, Mechanism):
    """A mechanism in the plant's equations."""

    family: ClassVar[Family] = Family.ENVIRONMENT
    wording: ClassVar[str] = "concealed"
    law: ClassVar[Callable[..., Any]]
    """Rewrites the signal: takes the signal, the builder, and a symbol for each field, in their order."""

    def __init_subclass__(cls, *, place: Place, signal: str, largest: float, rank: int = 0) -> None:
        super().__init_subclass__(largest=largest)
        cls.place, cls.signal, cls.order = place, signal, rank

    @property
    def effects(self) -> tuple[Effect, ...]:
        return (self,)

    def describe(self) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(name=f.name, value=float(getattr(self, f.name)), unit="1", lower=-BUILT_IN, upper=BUILT_IN)
            for f in fields(self)
        )

    def rewrite(self, signal: Any, build: Any) -> Any:
        return self.law(signal, build, *(self.own(f.name, build) for f in fields(self)))

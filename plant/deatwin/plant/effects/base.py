"""What an effect is: a piece of physics that rewrites one signal of a plant."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


class Family(Enum):
    """Which part of physics an effect belongs to."""

    ELECTRICAL = "electrical"
    FILM = "film"
    MECHANICAL = "mechanical"
    SENSOR = "sensor"
    ENVIRONMENT = "environment"


class Place(Enum):
    """Where in the plant an effect enters; another plant declares its own places in an `Enum` of its own."""

    DRIVE = "drive"
    FILM = "film"
    BALL = "ball"
    SENSOR = "sensor"
    PARAMETER = "parameter"


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """A piece of physics that rewrites one signal of a plant; its off value nulls it exactly.

    The fields of a subclass are its physical parameters in SI. A subclass says in class variables what it is
    called, where it enters, and which of its parameters is the strength that `off` sets to zero.
    """

    name: ClassVar[str]
    family: ClassVar[Enum]
    """One of `Family`; like a place, another plant may declare its own."""
    place: ClassVar[Enum]
    signal: ClassVar[str]
    strength: ClassVar[str]
    order: ClassVar[int] = 0
    """Among the effects at one signal, those of lower order act first."""
    event: ClassVar[str] = ""
    """The shape that is the time of an event, if any, which is there at once from then on: a fit cannot move it, it is
    searched for."""
    threshold: ClassVar[str] = ""
    """The shape that is a level, if any: of the amplifier's voltage in the drive, else of the reading. Below it the
    effect does nothing, so that a fit must start where such levels occur."""
    becomes: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Parameters with whose smallest value this effect is another one, and that one's name."""
    wording: ClassVar[str]
    """Says in a sentence what the physics does; with ``{parameter}`` fields."""

    @abstractmethod
    def describe(self) -> tuple[Parameter, ...]:
        """Parameters with unit, range and source, named as the fields."""

    @abstractmethod
    def rewrite(self, signal: Any, build: Builder) -> Any:
        """The signal as this effect leaves it.

        Parameters
        ----------
        signal : symbol or object
            As it arrives.
        build : Builder
            Takes the states and equations that the effect brings.

        Returns
        -------
        same kind as `signal`
        """

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Where a residual says that a fit should begin.

        Parameters
        ----------
        timepts : ndarray, shape (n,)
            Clock times of the readings, s.
        residual : ndarray, shape (n,)
            Measured minus simulated without this effect, SI.

        Returns
        -------
        tuple of Effect
            This effect at the shapes that look promising; none by default, then a grid of shapes is tried.
        """
        return ()

    def cycle(self, measured: Collection[str]) -> float:
        """How long the cycle is that this effect follows: in a small part of it no more is seen than a drift.

        Parameters
        ----------
        measured : collection of str
            Further channels that the recordings bring.

        Returns
        -------
        float
            s; 0 where there is none, or where its course was measured.
        """
        return 0.0

    @property
    def entry(self) -> str | dict[str, Any]:
        """How a model file names it: what makes its equations, without the values of its parameters."""
        return self.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters under their names in a plant, ``effect.name``."""
        return tuple(replace(p, name=f"{self.name}.{p.name}") for p in self.describe())

    def described(self, name: str) -> Parameter:
        """One of the parameters.

        Parameters
        ----------
        name : str
            Field name.

        Returns
        -------
        Parameter
        """
        return next(p for p in self.describe() if p.name == name)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the parameters other than the strength."""
        return tuple(f.name for f in fields(self) if f.name != self.strength)

    def own(self, name: str, build: Builder) -> Any:
        """The symbol of one of this effect's parameters.

        Parameters
        ----------
        name : str
            Field name.
        build : Builder
            The plant under construction.

        Returns
        -------
        casadi.SX
        """
        return build.own(f"{self.name}.{name}")

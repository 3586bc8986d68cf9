"""Base class of effects: physics that rewrites one signal of a plant."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from enum import Enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from deatwin.plant.errors import RigError
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


class Family(Enum):
    """Part of the plant's physics to which an effect belongs."""

    ELECTRICAL = "electrical"
    FILM = "film"
    MECHANICAL = "mechanical"
    SENSOR = "sensor"
    ENVIRONMENT = "environment"


class Place(Enum):
    """Place in the plant where an effect acts; a plant of another kind may declare its own `Enum`."""

    DRIVE = "drive"
    FILM = "film"
    BALL = "ball"
    SENSOR = "sensor"
    PARAMETER = "parameter"


class Alone(Enum):
    """Ability of a single reading to show that an effect acts at a further place (`Site`) and not elsewhere.

    - ``TOLD``: the reading may show the place, so a diagnosis always tries the effect there;
    - ``AS_FIRST``: the reading is the same as with the effect at its first place, if the plant does not depend on the
      clock;
    - ``AS_ANOTHER``: the reading is nearly the same as with another effect, so a diagnosis tries the place only as a
      replacement for an effect that it has found.
    """

    TOLD = "told"
    AS_FIRST = "as first"
    AS_ANOTHER = "as another"


@dataclass(frozen=True, kw_only=True)
class Site:
    """A further place at which an effect may act on a plant, with the same equation.

    Parameters
    ----------
    place : Enum
        Place in the plant, as `Effect.place`.
    signal : str
        Signal that the effect rewrites at this place.
    wording : str
        Sentence about the effect at this place; see `Effect.wording`.
    title : str
        Name of the effect at this place within a sentence, such as "drift of the amplifier's gain".
    strength : Parameter, or None
        Strength with its typical value, unit and range at this place; None if they are the same as at the first place.
    family : Enum, or None
        Family of the effect at this place; None if it is the same as at the first place.
    order : int
        Number that sorts effects at this place into the order in which they act; see `Effect.order`.
    alone : Alone
        Ability of a single reading to distinguish this place from others; see `Alone`.
    covered_by : str
        Name of another effect that acts in the same way at this place. On a plant that accepts that other effect, the
        present effect cannot act at this place.
    """

    place: Enum
    signal: str
    wording: str
    title: str
    strength: Parameter | None = None
    family: Enum | None = None
    order: int = 0
    alone: Alone = Alone.TOLD
    covered_by: str = ""


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Base class of effects: physics that changes one signal of a plant and vanishes exactly at a strength of zero.

    The fields of a subclass are its physical parameters in SI units. The class variables `name`, `place`, `signal`
    and `strength` give the name of the effect, where it acts, and the parameter that is its strength.
    """

    name: ClassVar[str]
    family: ClassVar[Enum]
    """A `Family`; as for places, another plant may declare an `Enum` of its own."""
    place: ClassVar[Enum]
    signal: ClassVar[str]
    strength: ClassVar[str]
    order: ClassVar[int] = 0
    """Number that sorts the effects at one signal; those of lower order act first."""
    event: ClassVar[str] = ""
    """Name of the shape parameter that is the time of an event, if any. The effect sets in at once at that time, so a
    fit cannot move it; it is found by search."""
    threshold: ClassVar[str] = ""
    """Name of the shape parameter that is a threshold, if any: a level of the amplifier's voltage for an effect in the
    drive, else of the reading. Below it the effect does nothing, so that a fit must start from a level that occurs."""
    becomes: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Parameters at whose smallest value this effect equals another effect, with that effect's name."""
    remembers: ClassVar[str] = ""
    """Unit of a state that keeps the distant past, if any. If the start of an experiment is unknown, a parameter
    ``effect.at_start`` displaces that state from rest."""
    wording: ClassVar[str]
    """Sentence that says what the physics does, with ``{parameter}`` fields."""
    places: ClassVar[Mapping[str, Site]] = MappingProxyType({})
    """Further places at which the effect may enter, by name. The first place has the name of its signal."""
    placed_at: ClassVar[str] = ""
    """Name of the further place at which this effect enters; empty at the first one."""
    title: ClassVar[str] = ""
    """Name of the effect at a further place within a sentence; empty at the first one, where it is `name` in words."""

    @abstractmethod
    def describe(self) -> tuple[Parameter, ...]:
        """Parameters with unit, range and source, named as the fields."""

    @abstractmethod
    def rewrite(self, signal: Any, build: Builder) -> Any:
        """Return `signal`, a symbol or an object, as changed by this effect; states and equations go into `build`."""

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Suggest start points of a fit from a residual.

        Parameters
        ----------
        timepts : ndarray, shape (n,)
            Clock times of the readings, s.
        residual : ndarray, shape (n,)
            Measured minus simulated without this effect, SI.

        Returns
        -------
        tuple of Effect
            This effect with promising values; empty by default, in which case a grid of values is tried.
        """
        return ()

    def cycle(self, measured: Collection[str]) -> float:
        """Return the period of the effect's cycle, s; 0 if it has none, or a channel in `measured` shows the cycle."""
        return 0.0

    @property
    def cause(self) -> str:
        """Name of the effect without its place: the `name` that it has at its first place."""
        return self.name.removesuffix(f"_at_{self.placed_at}") if self.placed_at else self.name

    def placed(self, at: str) -> Effect:
        """Return this effect at another place, at its typical strength there.

        Parameters
        ----------
        at : str
            Name of a place among `places`.

        Returns
        -------
        Effect
            Effect with the name ``effect_at_place``.

        Raises
        ------
        RigError
            If the effect has no such place.

        Examples
        --------
        >>> from deatwin.plant import PeriodicDisturbance
        >>> PeriodicDisturbance().placed("force").describe()[0].unit
        'N'
        """
        from deatwin.plant.effects.places import placed  # that module imports this one

        return placed(type(self), at)()

    @property
    def entry(self) -> str | dict[str, Any]:
        """Return what a model file stores to identify the effect's equations, without parameter values."""
        return self.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters under their names in a plant, ``effect.name``."""
        return tuple(replace(p, name=f"{self.name}.{p.name}") for p in self.describe())

    def described(self, name: str) -> Parameter:
        """Return the description of the parameter in field `name`."""
        return next(p for p in self.describe() if p.name == name)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the parameters other than the strength."""
        return tuple(f.name for f in fields(self) if f.name != self.strength)

    def own(self, name: str, build: Builder) -> Any:
        """Return the symbol of this effect's parameter in field `name` of the builder `build`."""
        return build.own(f"{self.name}.{name}")


def require_effects(effects: object) -> tuple[Effect, ...]:
    """Return effects as a tuple; RigError for anything else, such as a name or a class."""
    if not isinstance(effects, Iterable) or isinstance(effects, str):
        raise RigError(f"effects is {effects!r}: give a tuple of effects, as (Creep(),)")
    found = tuple(effects)
    for effect in found:
        if not isinstance(effect, Effect):
            given = effect.__name__ if isinstance(effect, type) else repr(effect)
            raise RigError(
                f"{given} is not an effect: give effects one by one, each as an object such as Creep() or "
                'effect_named("creep")'
            )
    return found

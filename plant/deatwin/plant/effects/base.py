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
    from deatwin.plant.builder import Builder as Builder
else:  # the builder imports this module
    Builder = Any


class Family(Enum):
    """Part of the plant's physics to which an effect belongs."""

    ELECTRICAL = "electrical"
    FILM = "film"
    MECHANICAL = "mechanical"
    SENSOR = "sensor"
    ENVIRONMENT = "environment"


class Place(Enum):
    """Place in a plant where an effect acts. A plant with other places may declare an `Enum` of its own."""

    DRIVE = "drive"
    FILM = "film"
    BALL = "ball"
    SENSOR = "sensor"
    PARAMETER = "parameter"


class Alone(Enum):
    """Ability of a single sensor to show that an effect acts at a further place (`Site`) and not elsewhere.

    The first place of an effect is the one at which it acts unless `Effect.placed` moves it to a further place.

    - ``TOLD``: the readings may show the place. A diagnosis always tries the effect there.
    - ``AS_FIRST``: the readings are the same as for the effect at its first place, unless the plant depends on the
      clock. A diagnosis tries the place only if there are further sensors.
    - ``AS_ANOTHER``: the readings are nearly the same as for another effect. Without further sensors, a diagnosis tries
      the place only as a replacement for an effect that it has found.
    """

    TOLD = "told"
    AS_FIRST = "as first"
    AS_ANOTHER = "as another"


@dataclass(frozen=True, kw_only=True)
class Site:
    """A place, besides `Effect.place`, at which an effect may act on a plant, with the same equation.

    Parameters
    ----------
    place : Enum
        The place in the plant.
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
        Ability of a single sensor to distinguish this place from others; see `Alone`.
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


def ranged(unit: str, lower: float, upper: float, **more: Any) -> dict[str, Any]:
    """Describe a field of an effect by the arguments of its `Parameter`, as the field's metadata."""
    return {"unit": unit, "lower": lower, "upper": upper, **more}


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Base class of effects: physics that changes one signal of a plant and vanishes exactly at a strength of zero.

    The fields of a subclass are its physical parameters in SI units. One of these is the strength; the others are shape
    parameters. The class variables `name`, `place`, `signal` and `strength` give the name of the effect, the place and
    the signal at which it acts, and the name of the parameter that is the strength.
    """

    name: ClassVar[str]
    family: ClassVar[Enum]
    """A `Family`; a plant with effects of other families may declare an `Enum` of its own."""
    place: ClassVar[Enum]
    signal: ClassVar[str]
    strength: ClassVar[str]
    order: ClassVar[int] = 0
    """Number that sorts the effects at one signal; effects with a smaller number act first."""
    event: ClassVar[str] = ""
    """Name of the shape parameter that is the time of an event; empty without one. The effect begins abruptly at that
    time, so a gradient-based fit cannot change the time, and it is found by search."""
    threshold: ClassVar[str] = ""
    """Name of the shape parameter that is a threshold; empty without one. It is a value of the amplifier's voltage for
    an effect in the drive, otherwise of the reading. Below the threshold the effect does nothing, so a fit must start
    from a value that the signal exceeds."""
    surroundings: ClassVar[frozenset[str]] = frozenset()
    """Names of the shape parameters that belong to the surroundings or to the course of an experiment, such as the time
    of a drift. On a rig with another period, their ranges are extended, not shifted (`Sizes`)."""
    becomes: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Maps the name of a parameter to the name of another effect that this effect equals at the parameter's smallest
    value."""
    remembers: ClassVar[str] = ""
    """Unit of the effect's state with a long memory; empty without one. If the history before an experiment is unknown,
    the parameter ``effect.at_start`` displaces this state from rest."""
    wording: ClassVar[str]
    """Sentence that says what the effect does, with fields such as ``{strength}`` for parameter values."""
    places: ClassVar[Mapping[str, Site]] = MappingProxyType({})
    """Further places at which the effect may act, by name. The first place is `place`."""
    placed_at: ClassVar[str] = ""
    """Name of the further place at which this effect acts; empty at the first place."""
    title: ClassVar[str] = ""
    """Name of an effect at a further place, for use in a sentence; empty at the first place."""

    def describe(self) -> tuple[Parameter, ...]:
        """Return a description of each field: its value, unit, range and source, under the field's name."""
        described = [one for one in fields(self) if one.metadata]  # by `ranged`; other packages write the method
        return tuple(Parameter(name=one.name, value=getattr(self, one.name), **one.metadata) for one in described)

    @abstractmethod
    def rewrite(self, signal: Any, build: Builder) -> Any:
        """Return the changed `signal`, a symbol or an object; states and equations are added to `build`."""

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Suggest starting values for a fit of this effect from a residual.

        Parameters
        ----------
        timepts : ndarray, shape (n,)
            Clock times of the readings, s.
        residual : ndarray, shape (n,)
            Measured minus simulated readings without this effect, SI.

        Returns
        -------
        tuple of Effect
            This effect with each set of starting values. If it is empty, as by default, a grid of values is tried.
        """
        return ()

    def broadened(self) -> Effect | None:
        """Return the effect of the same name with a more general law and further parameters; None if none is known.

        A diagnosis tries it if the effect explains most of a mismatch, but not all of it.
        """
        return None

    def cycle(self, measured: Collection[str]) -> float:
        """Return the period of a periodic effect in s; 0 without one, or if a channel in `measured` shows the cycle."""
        return 0.0

    @property
    def cause(self) -> str:
        """Name of the effect without its place: the `name` that the effect has at its first place."""
        return self.name.removesuffix(f"_at_{self.placed_at}") if self.placed_at else self.name

    def placed(self, at: str) -> Effect:
        """Return this effect at another place, with the values of its parameters.

        If the strength has another unit there, it gets its typical value there.

        Parameters
        ----------
        at : str
            Name of a place among `places`.

        Returns
        -------
        Effect
            Effect with a name such as ``periodic_disturbance_at_force``.

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

        there = placed(type(self), at)()
        return replace(there, **self.shared(there))

    def shared(self, there: Effect) -> dict[str, float]:
        """Return the values of the parameters that have the same unit in this effect and `there`, at another place."""
        units = {p.name: p.unit for p in there.describe()}
        return {p.name: getattr(self, p.name) for p in self.describe() if units[p.name] == p.unit}

    @property
    def entry(self) -> str | dict[str, Any]:
        """Entry of a model file that identifies the effect's equations, without parameter values."""
        return self.name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Descriptions of the parameters under their names in a plant, such as ``creep.time``."""
        return tuple(replace(p, name=f"{self.name}.{p.name}") for p in self.describe())

    def described(self, name: str) -> Parameter:
        """Return the description of the parameter in field `name`."""
        return next(p for p in self.describe() if p.name == name)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shape parameters, which are all parameters except the strength."""
        return tuple(f.name for f in fields(self) if f.name != self.strength)

    def own(self, name: str, build: Builder) -> Any:
        """Return the symbol that the builder `build` has for this effect's parameter in field `name`."""
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

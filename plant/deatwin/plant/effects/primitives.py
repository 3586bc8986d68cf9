"""Functions of one signal s, with and without memory, that make up a free form; s is in units of its scale.

Corners are rounded: p(x) = x^2/(x + 0.001) above 0, else 0.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.effects.smooth import smooth_magnitude
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.parameters import Parameter, Scale

Symbol = Any

CORNER = 0.001  # Rounding of corners, in units of the signal's scale
PURSUIT = 0.1  # Time constant with which a play or a running extreme follows its input, in samples


@dataclass(frozen=True, kw_only=True)
class Primitive(ABC):
    """A function of one signal."""

    variable: str  # ``"command"``, ``"command_rate"``, ``"time"``, or a signal of the plant
    scale: float  # Size of the signal, SI; above 0

    kind: ClassVar[str]
    shape: ClassVar[str] = ""  # Name of the shape parameter, if there is one
    remembers: ClassVar[bool] = False

    @property
    def degree(self) -> int:
        """Exponent of the value's change if the signal and its widths are scaled by a factor."""
        return 1

    @property
    def shape_parameter(self) -> Parameter | None:
        """Shape parameter; None if there is none."""
        return None

    @abstractmethod
    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        """Return the value of the function."""

    def at_rest(self, signal: Symbol) -> Symbol:
        """Return the memory at rest."""
        return signal

    def rate(self, signal: Symbol, memory: Symbol, shape: Symbol, sample_time: float) -> Symbol:
        """Return the rate of change of the memory."""
        raise NotImplementedError(f"{self.kind} has no memory")

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without the value of the shape parameter."""
        return {"kind": self.kind, **{k: v for k, v in asdict(self).items() if k != self.shape}}


@dataclass(frozen=True, kw_only=True)
class Power(Primitive):
    r"""A power, :math:`s^n`."""

    order: int = 1  # Exponent n

    kind: ClassVar[str] = "power"

    @property
    def degree(self) -> int:
        return self.order

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return signal**self.order


@dataclass(frozen=True, kw_only=True)
class Magnitude(Primitive):
    r"""The magnitude, :math:`\sqrt{s^2 + 0.001^2} - 0.001`."""

    kind: ClassVar[str] = "magnitude"

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return smooth_magnitude(signal, CORNER)


@dataclass(frozen=True, kw_only=True)
class SignedSquare(Primitive):
    r"""The square with its sign, :math:`s|s|`."""

    kind: ClassVar[str] = "signed_square"

    @property
    def degree(self) -> int:
        return 2

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return signal * ca.fabs(signal)


@dataclass(frozen=True, kw_only=True)
class DeadBand(Primitive):
    r"""Part of a signal beyond a band about zero, :math:`p(s - w) - p(-s - w)`."""

    width: float = 1.0  # Half the band w, in units of the scale

    kind: ClassVar[str] = "dead_band"
    shape: ClassVar[str] = "width"

    @property
    def shape_parameter(self) -> Parameter:
        return _width(self.width)

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return _beyond(signal, shape)


@dataclass(frozen=True, kw_only=True)
class LowPass(Primitive):
    r"""A low-pass of first order of a power, :math:`T\dot m = s^n - m`."""

    time: float = 1.0  # Time constant T, s
    order: int = 1  # Exponent n

    kind: ClassVar[str] = "low_pass"
    shape: ClassVar[str] = "time"
    remembers: ClassVar[bool] = True

    @property
    def degree(self) -> int:
        return self.order

    @property
    def shape_parameter(self) -> Parameter:
        return Parameter(
            name="time",
            value=self.time,
            unit="s",
            lower=1e-3,
            upper=max(1e5, 10.0 * self.time),
            scale=Scale.LOGARITHMIC,
        )

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return memory

    def at_rest(self, signal: Symbol) -> Symbol:
        """The memory at rest."""
        return signal**self.order

    def rate(self, signal: Symbol, memory: Symbol, shape: Symbol, sample_time: float) -> Symbol:
        return (signal**self.order - memory) / shape


@dataclass(frozen=True, kw_only=True)
class Play(Primitive):
    """Play operator, as of a fork with clearance: T dm/dt = p(s - m - w) - p(m - s - w) (Visintin 1994, ch. III)."""

    width: float = 1.0  # Half the clearance w, in units of the scale

    kind: ClassVar[str] = "play"
    shape: ClassVar[str] = "width"
    remembers: ClassVar[bool] = True

    @property
    def shape_parameter(self) -> Parameter:
        return _width(self.width)

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return memory

    def rate(self, signal: Symbol, memory: Symbol, shape: Symbol, sample_time: float) -> Symbol:
        return _beyond(signal - memory, shape) / (PURSUIT * sample_time)


@dataclass(frozen=True, kw_only=True)
class Largest(Primitive):
    r"""The largest value so far, :math:`T\dot m = p(s - m)`, T a tenth of a sample."""

    kind: ClassVar[str] = "largest"
    remembers: ClassVar[bool] = True

    def value(self, signal: Symbol, memory: Symbol, shape: Symbol) -> Symbol:
        return memory

    def rate(self, signal: Symbol, memory: Symbol, shape: Symbol, sample_time: float) -> Symbol:
        return _excess(signal - memory) / (PURSUIT * sample_time)


@dataclass(frozen=True, kw_only=True)
class Smallest(Largest):
    r"""The smallest value so far, :math:`T\dot m = -p(m - s)`, T a tenth of a sample."""

    kind: ClassVar[str] = "smallest"

    def rate(self, signal: Symbol, memory: Symbol, shape: Symbol, sample_time: float) -> Symbol:
        return -_excess(memory - signal) / (PURSUIT * sample_time)


PRIMITIVES: Mapping[str, type[Primitive]] = {
    kind.kind: kind for kind in (Power, Magnitude, SignedSquare, DeadBand, LowPass, Play, Largest, Smallest)
}
"""Primitives by the name of their kind."""


def primitive_from(data: Mapping[str, Any]) -> Primitive:
    """Return the primitive from the data of `Primitive.to_dict`."""
    own = dict(data)
    kind = own.pop("kind", None)
    if kind not in PRIMITIVES:
        known = ", ".join(PRIMITIVES)
        raise RigError(f"there is no primitive {kind!r}{nearest(str(kind), PRIMITIVES)} (known: {known})")
    try:
        found = PRIMITIVES[kind](**own)
        if not found.scale > 0:
            raise RigError(f"the scale of a {kind} is {found.scale!r}; it must be above 0")
    except TypeError as error:
        raise RigError(f"malformed {kind}: {error}") from None
    return found


def _width(value: float) -> Parameter:
    return Parameter(name="width", value=value, unit="1", lower=1e-3, upper=1e3, scale=Scale.LOGARITHMIC)


def _beyond(value: Symbol, width: Symbol) -> Symbol:
    return _excess(value - width) - _excess(-value - width)


def _excess(value: Symbol) -> Symbol:
    above = ca.fmax(value, 0.0)
    return above**2 / (above + CORNER)

"""Named physical quantities with units, bounds and sources."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from numbers import Real

import numpy as np

from deatwin.plant.errors import RigError, nearest

WIDER = 4.0  # Factor by which the end of a range grows at a time, unless it is a physical limit
BEYOND = 1.01  # Ratio of a value just beyond the end of a range to that end


class Scale(Enum):
    """Transformation of a parameter in a fit: none, logarithm or reciprocal.

    A fit varies the transformed value, which is called the coordinate. The readings should depend on the coordinate
    nearly linearly.
    """

    LINEAR = "value"
    LOGARITHMIC = "ln(value)"
    RECIPROCAL = "1/value"

    def to_coordinate(self, value: float) -> float:
        """Return the coordinate of an SI `value`."""
        if self is Scale.LINEAR:
            return value
        return float(np.log(value)) if self is Scale.LOGARITHMIC else 1.0 / value

    def to_value(self, coordinate: float) -> float:
        """Return the SI value at a `coordinate`."""
        if self is Scale.LINEAR:
            return coordinate
        return float(np.exp(coordinate)) if self is Scale.LOGARITHMIC else 1.0 / coordinate

    def slope(self, value: float) -> float:
        """Return the derivative of an SI `value` with respect to its coordinate."""
        if self is Scale.LINEAR:
            return 1.0
        return value if self is Scale.LOGARITHMIC else -(value**2)


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Physical quantity of a plant, with its value, range and source.

    Parameters
    ----------
    name : str
        Name, unique in a plant. In a plant, a parameter of an effect is called ``effect.name``.
    value : float
        Value, SI.
    unit : str
        SI unit; ``"1"`` for a pure number.
    lower, upper : float
        Smallest and largest possible value, SI; with `widest`, smallest and largest usual value.
    source : str
        Source of the value, such as a publication.
    scale : Scale
        Transformation of the value in a fit; logarithm and reciprocal require ``lower > 0``.
    known : bool
        True if the experimenter measured the value; a calibration does not change it.
    guessed : bool
        True if the value is only a starting value for fits. A diagnosis then considers all values within the range
            equally likely.
    widest : float, optional
        Largest magnitude that physics allows, SI. If a value exceeds `upper`, then `upper` is multiplied by four until
        it includes the value, but not beyond `widest`. A negative `lower` is extended in the same way.

    Raises
    ------
    RigError
        If a field has the wrong type, or if the value lies outside the range after the range is extended as far as
        `widest` allows.
    """

    name: str
    value: float
    unit: str
    lower: float
    upper: float
    source: str = ""
    scale: Scale = Scale.LINEAR
    known: bool = False
    guessed: bool = False
    widest: float | None = None

    def __post_init__(self) -> None:
        kinds = {"name": str, "unit": str, "source": str, "scale": Scale, "known": bool, "guessed": bool}
        for name, kind in kinds.items():
            if not isinstance(given := getattr(self, name), kind):
                raise RigError(f"{name} of the parameter {self.name} is {given!r}; it must be a {kind.__name__}")
        for name in ("value", "lower", "upper"):
            if not isinstance(number := getattr(self, name), Real):
                raise RigError(f"{name} of the parameter {self.name} is {number!r}; it must be a number")
        if self.widest is not None:
            object.__setattr__(self, "upper", _grown(self.upper, self.value, self.widest))
            if self.lower < 0.0:
                object.__setattr__(self, "lower", -_grown(-self.lower, -self.value, self.widest))
        if not self.lower <= self.value <= self.upper:
            raise RigError(
                f"parameter {self.name} = {self.value:g} {self.unit} is out of range: "
                f"allowed is {self.lower:g} to {self.upper:g} {self.unit}"
            )
        if self.scale is not Scale.LINEAR and self.lower <= 0:
            raise RigError(f"parameter {self.name} moves as {self.scale.value}: its lower bound must be above 0")

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end of the range, in the coordinate of `scale`."""
        one, other = map(self.scale.to_coordinate, (self.lower, self.upper))
        return min(one, other), max(one, other)

    @property
    def beyond(self) -> float | None:
        """Value just beyond the nearer end of the range, SI; None if this end cannot be extended."""
        end = self.lower if self.is_low else self.upper
        open_end = self.widest is not None and 0.0 < abs(end) < self.widest and (end < 0.0 or not self.is_low)
        return BEYOND * end if open_end else None

    @property
    def is_low(self) -> bool:
        """True if the value is nearer to the lower than to the upper end of its range, in the coordinate of `scale`."""
        value, lower, upper = map(self.scale.to_coordinate, (self.value, self.lower, self.upper))
        return abs(value - lower) < abs(upper - value)


def _grown(end: float, value: float, widest: float) -> float:
    """Return the end of a range, extended to include the value if the widest range allows it."""
    while value > end and end < widest:
        end = min(WIDER * end, widest)
    return end


class ParameterSet(Mapping[str, Parameter]):
    """Immutable, ordered mapping of names to parameters.

    Parameters
    ----------
    parameters : iterable of Parameter
        Parameters in order; names must differ.

    Raises
    ------
    RigError
        If something is not a parameter, or a name occurs twice.
    """

    def __init__(self, parameters: Iterable[Parameter]) -> None:
        if not isinstance(parameters, Iterable):
            raise RigError(f"parameters is {parameters!r}: give a tuple of parameters")
        self._items: dict[str, Parameter] = {}
        for parameter in parameters:
            if not isinstance(parameter, Parameter):
                raise RigError(f"{parameter!r} is not a Parameter")
            if parameter.name in self._items:
                raise RigError(f"parameter {parameter.name} is given twice")
            self._items[parameter.name] = parameter

    def __getitem__(self, name: str) -> Parameter:
        try:
            return self._items[name]
        except KeyError:
            raise RigError(f"there is no parameter {name!r}{nearest(name, self._items)}") from None

    def __contains__(self, name: object) -> bool:
        return name in self._items

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        rows = (f"{p.name} = {p.value:.6g} {p.unit}" for p in self.values())
        return f"ParameterSet({', '.join(rows)})"

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a calibration changes, in order: those that are not `Parameter.known`."""
        return tuple(p.name for p in self.values() if not p.known)

    def array(self, names: Iterable[str] | None = None) -> np.ndarray:
        """Return the values of the parameters with these `names`, SI, in this order; by default of all parameters."""
        return np.array([self[name].value for name in (self if names is None else names)], dtype=float)

    def with_values(self, values: Mapping[str, float]) -> ParameterSet:
        """Return the set with new `values` by name, SI; RigError if a name is unknown or a value is out of range."""
        numbers = {}
        for name, value in values.items():
            self[name]
            try:
                numbers[name] = float(value)
            except (TypeError, ValueError):
                raise RigError(f"value of the parameter {name} is {value!r}; it must be a number") from None
        return ParameterSet(replace(p, value=numbers[p.name]) if p.name in numbers else p for p in self.values())

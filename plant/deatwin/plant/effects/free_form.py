"""Missing dynamics as a sum of functions without a physical meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

from deatwin.plant.effects.base import Builder, Effect, Family, Place
from deatwin.plant.effects.primitives import Power, Primitive, primitive_from
from deatwin.plant.errors import RigError
from deatwin.plant.parameters import Parameter


@dataclass(frozen=True, kw_only=True)
class FreeForm(Effect):
    """Add S sum_k c_k phi_k, functions of one signal, to that signal; a fit moves c_k and the shapes, and holds S."""

    size: float = 1e-3  # Strength S, in the unit of the signal
    terms: tuple[Primitive, ...] = (Power(variable="displacement", scale=1e-4, order=3),)
    coefficients: tuple[float, ...] = (-1.0,)  # Coefficient c_k of each term
    enters: Place = Place.BALL  # Place of the signal in the plant
    node: str = "force"  # Name of the signal
    unit: str = "N"

    name: ClassVar[str] = "free_form"
    family: ClassVar[Family] = Family.MECHANICAL  # Family of the default place; never used
    strength: ClassVar[str] = "size"
    order: ClassVar[int] = 100  # Last: added to the signal after all physical effects
    wording: ClassVar[str] = "A sum of functions with a size of {size} is added, which represents no physics"

    def __post_init__(self) -> None:
        if not self.terms or len(self.terms) != len(self.coefficients):
            raise RigError(f"a free form of {len(self.terms)} terms has {len(self.coefficients)} coefficients")

    @property
    def place(self) -> Place:  # type: ignore[override]
        """Place in the plant."""
        return self.enters

    @property
    def signal(self) -> str:  # type: ignore[override]
        """Signal to which the sum is added."""
        return self.node

    def describe(self) -> tuple[Parameter, ...]:
        """List the parameters: the fixed size, then the coefficient of each term with its shape, if it has one."""
        own = [Parameter(name="size", value=self.size, unit=self.unit, lower=0.0, upper=1e12, known=True)]
        for number, (term, value) in enumerate(zip(self.terms, self.coefficients, strict=True), start=1):
            own.append(Parameter(name=f"coefficient_{number}", value=value, unit="1", lower=-1e3, upper=1e3))
            if (shape := term.shape_parameter) is not None:
                own.append(replace(shape, name=f"{shape.name}_{number}"))
        return tuple(own)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the parameters other than the size."""
        return tuple(p.name for p in self.describe() if p.name != self.strength)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        total = 0.0
        for number, term in enumerate(self.terms, start=1):
            coefficient = self.own(f"coefficient_{number}", build)
            total += coefficient * self._value(term, number, self._variable(term.variable, signal, build), build)
        return signal + self.own("size", build) * total

    def _variable(self, name: str, signal: Any, build: Builder) -> Any:
        if name == self.node:
            return signal
        if name in ("command", "time"):
            return getattr(build, name)
        if name == "command_rate":
            now, before = build.past_commands(1)
            return (now - before) / build.signal("sample_time")
        return build.signal(name)

    def _value(self, term: Primitive, number: int, variable: Any, build: Builder) -> Any:
        value = variable / build.constant(f"free_form_scale_{number}", term.scale)
        shape = self.own(f"{term.shape}_{number}", build) if term.shape else None
        if not term.remembers:
            return term.value(value, None, shape)
        memory = build.state(f"free_form_memory_{number}", scale=1.0, start=term.at_rest(value))
        build.rate(memory, term.rate(value, memory, shape, build.signal("sample_time")))
        return term.value(value, memory, shape)

    @property
    def entry(self) -> dict[str, Any]:
        """Return the entry of a model file that identifies the equations, without parameter values."""
        return {
            "name": self.name,
            "place": self.enters.value,
            "signal": self.node,
            "unit": self.unit,
            "terms": [term.to_dict() for term in self.terms],
        }

    @classmethod
    def from_entry(cls, data: Mapping[str, Any]) -> Self:
        """Return the free form from the entry of a model file."""
        try:
            described, enters = tuple(data["terms"]), Place(data["place"])
            node, unit = str(data["signal"]), str(data["unit"])
        except (KeyError, TypeError, ValueError) as error:
            raise RigError(f"malformed free form: {error!r}; it needs place, signal, unit and terms") from None
        terms = tuple(primitive_from(term) for term in described)
        off = (0.0,) * len(terms)
        return cls(size=0.0, terms=terms, coefficients=off, enters=enters, node=node, unit=unit)

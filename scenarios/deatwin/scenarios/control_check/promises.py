"""What the models promised, beside what the plant did, number by number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from deatwin.scenarios.control_check.matters import Interval, Matter, Matters
from deatwin.scenarios.svb_benchmark.trials import Rate


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number that a model predicts of its closed loop."""

    key: str  # Its name in `Matter` and `Achieved`
    name: str
    unit: str
    scale: float  # From SI to the unit

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.unit else self.name

    @property
    def column(self) -> str:
        """Name and unit as the head of a column of a file."""
        unit = {"%": "_percent", "µm": "_um", "Hz": "_Hz"}.get(self.unit, "")
        return self.name.replace(" ", "_") + unit


QUANTITIES = (
    Quantity(key="bandwidth_Hz", name="bandwidth", unit="Hz", scale=1.0),
    Quantity(key="overshoot", name="overshoot", unit="%", scale=100.0),
    Quantity(key="gain", name="gain margin", unit="", scale=1.0),
    Quantity(key="rms", name="rms error", unit="µm", scale=1e6),
)


@dataclass(frozen=True, kw_only=True)
class Promise:
    """A number as a model predicted it, and as the plant made it."""

    model: str
    quantity: Quantity  # What
    predicted: Interval  # With its 95 % interval, in the quantity's unit
    achieved: float

    @property
    def kept(self) -> bool:
        """Whether the plant's number lies inside the interval."""
        return self.predicted.holds(self.achieved)


def promises(matters: Matters) -> tuple[Promise, ...]:
    """All numbers of all models that allowed a design."""
    return tuple(promise for matter in matters.models for promise in _of(matter))


def kept(made: tuple[Promise, ...]) -> Rate:
    """How many of the numbers came out as predicted."""
    return Rate.of(promise.kept for promise in made)


def _of(matter: Matter) -> Iterator[Promise]:
    if matter.achieved is None:
        return
    for quantity in QUANTITIES:
        predicted: Interval | None = getattr(matter, quantity.key)
        if predicted is not None:
            s = quantity.scale
            yield Promise(
                model=matter.name,
                quantity=quantity,
                achieved=s * getattr(matter.achieved, quantity.key),
                predicted=Interval(value=s * predicted.value, low=s * predicted.low, high=s * predicted.high),
            )

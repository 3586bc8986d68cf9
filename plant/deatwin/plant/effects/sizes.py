"""Scale effects to plants whose sizes and units differ from those of the diaphragm."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import lru_cache
from numbers import Real
from typing import Any, ClassVar

import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Place
from deatwin.plant.effects.places import Elsewhere, placed
from deatwin.plant.errors import RigError
from deatwin.plant.parameters import Parameter

MOTION, FORCE, PERIOD, COMMAND, VOLTAGE = 0.3e-3, 9e-3, 0.06, 1.5, 1.2e3
"""Sizes of the diaphragm, SI: typical displacement, force that causes it, period of the ringing, command, voltage."""
DERIVED: Mapping[str, str] = {"kg": "N s2/m", "Pa": "N/m2", "Hz": "1/s"}
SIGNALS: Mapping[str, str] = {
    "displacement": "m",
    "velocity": "m/s",
    "force": "N",
    "reading": "m",
    "command": "V",
    "amplifier_voltage": "V",
    "sample_time": "s",
}
"""Signals that can be converted to another plant's units, with their units in the diaphragm."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Typical sizes of a plant's signals, to which the effects of the catalogue are scaled.

    The typical values and ranges in the catalogue hold for the default `Diaphragm`, a film that carries a ball. On a
    plant with other sizes and units, such as an electric circuit, an effect has the same equation with scaled values.
    The unit of a value determines the factor: a stiffness in N/m, for example, is multiplied by the ratio of this
    plant's typical force to that of the diaphragm, and divided by the corresponding ratio of displacements. Surroundings
    do not follow a plant's period, so the ranges of times such as that of a drift also keep their ends in the catalogue.

    Parameters
    ----------
    motion : float
        Typical displacement, or the corresponding quantity of a plant without motion, in `motion_unit`.
    force : float
        Typical force that causes the motion, in `force_unit`.
    period : float
        Period of the plant's ringing, or another typical time of the motion, s.
    command : float
        Typical command, in `command_unit`.
    voltage : float, optional
        Typical output of the amplifier, V. By default, the output has the size and the unit of the command.
    reading : float, optional
        Typical reading, in `reading_unit`; `motion` by default.
    motion_unit, force_unit, command_unit, reading_unit : str
        Units, as products of powers such as ``"V/s2"``. The default of `reading_unit` is `motion_unit`.
    body : str
        Name of the moving part in the sentences that describe effects.

    Raises
    ------
    RigError
        If a size is not a finite number above 0, or if a unit or `body` is not text.

    Examples
    --------
    >>> from deatwin.plant import CubicStiffness
    >>> circuit = Sizes(motion=0.1, force=2e4, period=0.015, command=0.1, motion_unit="V", force_unit="V/s2")
    >>> circuit.of(CubicStiffness()).describe()[0].unit
    '1/(V2 s2)'
    """

    motion: float = MOTION
    force: float = FORCE
    period: float = PERIOD
    command: float = COMMAND
    voltage: float | None = None
    reading: float | None = None
    motion_unit: str = "m"
    force_unit: str = "N"
    command_unit: str = "V"
    reading_unit: str | None = None
    body: str = "ball"

    def __post_init__(self) -> None:
        for field in fields(self):
            value, is_text = getattr(self, field.name), field.type.startswith("str")
            if value is None and field.default is None:
                continue
            if is_text and not isinstance(value, str):
                raise RigError(f"{field.name} of the sizes is {value!r}; it must be text")
            if not is_text and not (isinstance(value, Real) and 0.0 < float(value) < np.inf):
                raise RigError(f"{field.name} of the sizes is {value!r}; it must be a number above 0")

    def of(self, effect: Effect) -> Effect:
        """Return an effect scaled to this plant.

        Parameters
        ----------
        effect : Effect
            Effect with values for the diaphragm.

        Returns
        -------
        Effect
            Effect of the same name, with values, ranges and units scaled to this plant. An effect on a signal that only
            film actuators have, such as the film itself, is returned unchanged.
        """
        if effect.signal not in SIGNALS or isinstance(effect, _Similar):
            return effect
        kind = _kind(type(effect), self)
        return kind(**{p.name: getattr(effect, p.name) * self._ratio(p.unit, effect)[0] for p in effect.describe()})

    def _ratio(self, unit: str, effect: Effect) -> tuple[float, str]:
        """Return the factor that converts a value of the diaphragm to this plant, and this plant's unit."""
        read = effect.place is Place.SENSOR
        reading, reading_unit = self.reading or self.motion, self.reading_unit or self.motion_unit
        known = {
            "m": (reading / MOTION, reading_unit) if read else (self.motion / MOTION, self.motion_unit),
            "N": (self.force / FORCE, self.force_unit),
            "s": (self.period / PERIOD, "s"),
            "V": self._drive(effect),
        }
        ratio, powers = 1.0, Counter[str]()
        for name, power in _powers(unit).items():
            factor, here = known.get(name, (1.0, name))
            ratio *= factor**power
            for own, inner in _powers(here).items():
                powers[own] += inner * power
        return float(ratio), unit if unit in DERIVED and dict(powers) == dict(_powers(unit)) else _written(powers)

    def _drive(self, effect: Effect) -> tuple[float, str]:
        """Return the factor and the unit that replace a volt, of the command or of the amplifier."""
        if effect.signal == "command":
            return self.command / COMMAND, self.command_unit
        if self.voltage is None:
            return self.command / VOLTAGE, self.command_unit
        return self.voltage / VOLTAGE, "V"


class _Similar(Effect):
    """An effect that treats the plant as if it had the units and sizes of the diaphragm."""

    sizes: ClassVar[Sizes]
    original: ClassVar[type[Effect]]

    def describe(self) -> tuple[Parameter, ...]:
        own = []
        for p in self.original().describe():
            ratio, unit = self.sizes._ratio(p.unit, self)
            widest = None if p.widest is None else p.widest * ratio
            value, lower, upper = getattr(self, p.name), p.lower * ratio, p.upper * ratio
            if p.name in self.surroundings:  # they change as slowly or fast beside a slower or faster rig
                lower, upper = min(lower, p.lower), max(upper, p.upper)
            own.append(replace(p, value=value, lower=lower, upper=upper, unit=unit, widest=widest))
        return tuple(own)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        ratio = self.sizes._ratio(SIGNALS[self.signal], self)[0]
        view: Any = _View(build, self)
        return ratio * self.original.rewrite(self, signal / ratio, view)

    def broadened(self) -> Effect | None:
        wide = self.original().broadened()
        return wide and self.sizes.of(wide)

    def placed(self, at: str) -> Effect:
        here = self.original()
        there = here.placed(at)
        return replace(self.sizes.of(there), **{name: getattr(self, name) for name in here.shared(there)})

    def __reduce__(self) -> tuple[Any, ...]:
        first = self.original.first if issubclass(self.original, Elsewhere) else self.original
        return _made, (first, self.placed_at, self.sizes, {f.name: getattr(self, f.name) for f in fields(self)})


def sizes_of(effect: Effect) -> dict[str, Any]:
    """Return the sizes to which an effect is scaled, without those that it shares with the diaphragm."""
    if not isinstance(effect, _Similar):
        return {}
    own, usual = asdict(effect.sizes), asdict(Sizes())
    return {name: value for name, value in own.items() if value != usual[name]}


def with_sizes(effect: Effect, sizes: object) -> Effect:
    """Return an effect at the sizes in a model file, as `sizes_of` writes them; RigError if they are malformed."""
    usual = effect.original() if isinstance(effect, _Similar) else effect
    try:
        return Sizes(**sizes).of(usual) if sizes != {} else usual  # type: ignore[arg-type]
    except TypeError as error:
        raise RigError(f"malformed sizes: {error}") from None


class _View:
    """Builder that presents a plant to an effect as if it were the diaphragm."""

    def __init__(self, build: Builder, effect: _Similar) -> None:
        self._build, self._effect = build, effect
        self._units = {f"{effect.name}.{p.name}": p.unit for p in effect.original().describe()}

    def _ratio(self, unit: str) -> float:
        return self._effect.sizes._ratio(unit, self._effect)[0]

    def __getattr__(self, name: str) -> Any:
        return getattr(self._build, name)

    @property
    def command(self) -> Any:
        return self._build.command / self._ratio("V")

    @property
    def time(self) -> Any:
        return self._build.time / self._ratio("s")

    @property
    def sample_start(self) -> Any:
        return self._build.sample_start / self._ratio("s")

    @property
    def sample_time(self) -> Any:
        return self._build.sample_time / self._ratio("s")

    def own(self, name: str) -> Any:
        return self._build.own(name) / self._ratio(self._units[name])

    def reach(self, name: str) -> float:
        return self._build.reach(name) / self._ratio(self._units[name])

    def signal(self, name: str, otherwise: Any = None) -> Any:
        return self._build.signal(name, otherwise) / self._ratio(SIGNALS.get(name, "1"))

    def past_commands(self, count: int) -> list[Any]:
        return [command / self._ratio("V") for command in self._build.past_commands(count)]

    def rate(self, state: Any, value: Any, *, mass: Any = 1.0) -> None:
        self._build.rate(state, value / self._ratio("s"), mass=mass)


@lru_cache(maxsize=1024)
def _kind(original: type[Effect], sizes: Sizes) -> type[Effect]:
    # The name contains the sizes, because plants with different equations must have differently named effect types.
    own = {
        "sizes": sizes,
        "original": original,
        "wording": original.wording.replace("ball", sizes.body),
        "__qualname__": f"{original.__qualname__} of {sizes}",
        "__module__": original.__module__,
    }
    return type(original.__name__, (_Similar, original), own)


def _made(first: type[Effect], at: str, sizes: Sizes, values: Mapping[str, float]) -> Effect:
    return _kind(placed(first, at) if at else first, sizes)(**values)


def _powers(unit: str) -> Counter[str]:
    """Return the powers of a unit's factors: ``"N s2/m2"`` is N to the 1, s to the 2 and m to the -2."""
    above, _, below = unit.partition("/")
    found: Counter[str] = Counter()
    for text, sign in ((above, 1), (below.strip("()"), -1)):
        for name, power in re.findall(r"([^\W\d]+)(\d*)", text):
            count = sign * int(power or 1)
            for inner, times in (_powers(DERIVED[name]) if name in DERIVED else {name: 1}).items():
                found[inner] += count * times
    return found


def _written(powers: Mapping[str, int]) -> str:
    def side(sign: int) -> list[str]:
        chosen = sorted((name, sign * p) for name, p in powers.items() if sign * p > 0)
        return [name if p == 1 else f"{name}{p}" for name, p in chosen]

    above, below = side(1), side(-1)
    if not below:
        return " ".join(above) or "1"
    return f"{' '.join(above) or '1'}/{below[0] if len(below) == 1 else '(' + ' '.join(below) + ')'}"

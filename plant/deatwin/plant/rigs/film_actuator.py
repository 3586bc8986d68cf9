"""Common base of planar, stacked, bow-tie and rolled actuators: a flat film, one moved part, dead loads, a drive."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.film import AnyFilm
from deatwin.plant.laws.stress import nominal_stress
from deatwin.plant.limits import BREAKDOWN, breakdown_shares, watch_limits
from deatwin.plant.material import Material, material
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import Rig, StartProcedure
from deatwin.plant.rigs.kinematics import Kinematics, material_film, squared_voltage
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.scaling import Mounted, scaled_to_film

Symbol = Any
SETTLING = StartProcedure(rest_command=0.0, ramp=0.0, hold=1.0, uncounted=1.0)
"""Start procedure of an experiment with an unknown beginning. The first command is held for a second, in which
amplifier, electrode and motion settle; memories are free before it and remain so. What was still moving when the
recording began is forgotten in another second."""
FARTHEST = {"1": 0.5, "V": 20e3}
"""Largest displacement of a memory from rest, by its unit: half of the film's stretch, and a voltage beyond any
amplifier's."""
ANYWHERE = 10.0  # Largest reading of a position sensor, m


@dataclass(frozen=True, kw_only=True)
class FilmActuator(Rig):
    r"""A flat film that moves one part against dead loads and springs; command in, motion out.

    .. math:: m\,\dot v = -\frac{\partial}{\partial x}(E + U) + \frac{V^2}{2}\frac{\partial C}{\partial x} - c\,v,
              \qquad \dot x = v

    with the position x of the moved part, which grows with the reading, the energy E of the film and the
    potential U of loads and springs. Further coordinates of the film have no inertia; its own mass is left out.
    Damping makes the part creep rather than ring; at rest it is gone, so statics are those of the film. With a
    mass of zero the part follows the force at once.
    """

    material: str | Material = "VHB 4905"  # Material, or its name in `deatwin.plant.material.MATERIALS`
    thickness: float = 0.5e-3  # Thickness of the film before stretching, m
    mass: float = 5e-3  # Inertia of the moved part, kg; the force that pulls it is a separate load
    damping: float = 1.0  # Damping of its guide, from which a fit starts, N s/m
    gain: float = 800.0  # Film volts per command volt
    start_ramp: float = 0.0  # Ramp of the start procedure, from 0 V, s
    start_hold: float = 0.0  # Hold after the ramp, s
    start_is_known: bool = True  # If False, there is no start procedure, and each memory's distance from rest is fitted
    zero_is_known: bool = True  # True if the sensor's zero lies near the position without voltage
    direction: float = 1.0  # -1 if the reading falls as the displacement grows
    sample_time: float = 0.02
    noise: float = 2e-6

    has_film: ClassVar[bool] = True
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "displacement"
    output_unit: ClassVar[str] = "m"

    def scaled(self, effect: Effect) -> Effect:
        """Return an effect of the catalogue with lengths, forces and commands in proportion to those of this rig."""
        first, second = self._prestretches
        thickness = self.thickness / (first * second)
        return scaled_to_film(effect, self, Mounted(gain=self.gain, thickness=thickness, size=self._size))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        known: dict[str, Any] = {"source": "the rig", "known": True}
        return (
            *self.substance.parameters,
            Parameter(
                name="damping",
                value=self.damping,
                unit="N s/m",
                lower=1e-6,
                upper=1e4,
                scale=Scale.LOGARITHMIC,
                guessed=True,
                source="chosen so that the part does not ring",
            ),
            zero_of(1e-2, self.zero_is_known),
            Parameter(name="mass", value=self.mass, unit="kg", lower=0.0, upper=10.0, **known),
            Parameter(name="gain", value=self.gain, unit="V/V", lower=1e-3, upper=1e5, **known),
            Parameter(name="thickness", value=self.thickness, unit="m", lower=1e-6, upper=0.1, **known),
            *(
                Parameter(name=name, value=value, unit=unit, lower=-1e6, upper=1e6, **known)
                for name, value, unit in self._outside
            ),
        )

    @property
    def start(self) -> StartProcedure:
        """Start from rest at 0 V, with ramp and hold; with an unknown start, the first command is held for a second."""
        known = StartProcedure(rest_command=0.0, ramp=self.start_ramp, hold=self.start_hold)
        return known if self.start_is_known else SETTLING

    def starts_of(self, effects: tuple[Effect, ...]) -> tuple[Parameter, ...]:
        return () if self.start_is_known else memories(self.substance, effects)

    @property
    def substance(self) -> Material:
        """The material with its published values."""
        return material(self.material)

    @classmethod
    def from_rig_file(cls, described: RigFile) -> Self:
        """Make the rig from a rig file, whose keys are named after the fields of the rig."""
        own: dict[str, Any] = {**described.film, **described.load}
        whole = {field.name for field in fields(cls) if field.type == "int"}
        stated = {name: int(value) if name in whole else value for name, value in own.items()}
        rig = cls(**{**described.shared, **stated})
        relaxed_stresses(rig.substance, *rig._prestretches)  # refuses a prestretch beyond the film's limit
        return rig

    def write(self, build: Builder) -> Symbol:
        size = self._size
        position = build.state("position", scale=size)
        velocity = build.watch("velocity", build.state("velocity", scale=size))
        displacement = build.watch("displacement", position - build.at_rest("rest_position", position))
        build.guess(position, self._rest_position)
        shape = self._kinematics(position, build)
        film = build.place(Place.FILM, "film", material_film(shape, self.substance, self._prestretches, build))
        squared = squared_voltage(build.share("film", film), build, self.supply)
        watch_field(film, build)
        self._watch_limits(film, squared, build)

        unknowns = ca.vertcat(position, *shape.coordinates)
        forces = film.force(unknowns, squared) + ca.gradient(self._potential(position, shape, build), unknowns)
        build.rate(position, velocity)
        self._move(velocity, shape, forces, build)
        return build.place(Place.SENSOR, "reading", self.direction * displacement + build.parameter("zero"))

    def _move(self, velocity: Symbol, shape: Kinematics, forces: Symbol, build: Builder) -> None:
        """Write the motion: `forces` of film and loads hold back the position, and then each further coordinate."""
        friction = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        build.rate(velocity, friction - forces[0], mass=build.parameter("mass"))
        for number in range(1, forces.numel()):
            build.balance(forces[number])

    @property
    @abstractmethod
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        """Return name, value and unit of the known parameters of loads and springs."""

    @property
    @abstractmethod
    def _size(self) -> float:
        """Length of the film along the motion, m: the displacement for a stretch of one."""

    @property
    @abstractmethod
    def _rest_position(self) -> float:
        """Return a starting value for the position at rest, m."""

    @property
    @abstractmethod
    def _prestretches(self) -> tuple[float, float]:
        """Return the film's stretches as mounted."""

    @property
    def _watch_limits(self) -> Callable[[AnyFilm, Symbol, Builder], None]:
        """Watch the limits of the film, including its tension, because it is held in its plane."""
        return watch_limits

    @abstractmethod
    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        """Return the film for a position of the moved part."""

    @abstractmethod
    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        """Return the potential energy of loads and springs, J."""


def memories(substance: Material, effects: Sequence[Effect]) -> tuple[Parameter, ...]:
    """Return the parameters that displace the memories of branches and effects from rest at the start."""
    units = {f"{branch.name}_at_start": "1" for branch in substance.branches}
    units |= {f"{effect.name}.at_start": effect.remembers for effect in effects if effect.remembers}
    return tuple(
        Parameter(
            name=name,
            value=0.0,
            unit=unit,
            lower=-FARTHEST[unit],
            upper=FARTHEST[unit],
            source="the start is not known: at rest at 0 V as a starting value",
        )
        for name, unit in units.items()
    )


def zero_of(reach: float, is_known: bool) -> Parameter:
    """Return the offset of a position sensor: near 0, or anywhere where the sensor's zero is arbitrary."""
    end, source = (reach, "sensor offset") if is_known else (ANYWHERE, "arbitrary zero of the sensor")
    return Parameter(name="zero", value=0.0, unit="m", lower=-end, upper=end, source=source)


def relaxed_stresses(substance: Material, stretch_1: float, stretch_2: float) -> tuple[float, float]:
    """Return the nominal stresses along 1 and 2 of a relaxed film with its published values, Pa."""
    values = [p.value for p in substance.elastic]
    first, second = (float(s) for s in nominal_stress(substance.energy, stretch_1, stretch_2, *values))
    if not (np.isfinite(first) and np.isfinite(second)):
        raise RigError(
            f"{substance.name} has no stress at stretches of {stretch_1:g} and {stretch_2:g}: both must be above 0 "
            f"and below its limit{_limit_below(substance, stretch_1, stretch_2)}"
        )
    return first, second


def _limit_below(substance: Material, stretch_1: float, stretch_2: float) -> str:
    """Say how far a film can be stretched in the same proportion of logarithms; empty if there is no such limit."""
    values = [p.value for p in substance.elastic]

    def finite(share: float) -> bool:
        stresses = nominal_stress(substance.energy, stretch_1**share, stretch_2**share, *values)
        return all(np.isfinite(float(stress)) for stress in stresses)

    if min(stretch_1, stretch_2) <= 0.0 or not finite(0.0):
        return ""
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if finite(middle) else (low, middle)
    return f", here {stretch_1**low:.3g} and {stretch_2**low:.3g}"


def watch_breakdown(film: AnyFilm, squared_voltage: Symbol, build: Builder) -> None:
    """Watch how near the film is to breakdown; a film that is free in its plane does not wrinkle."""
    if shares := breakdown_shares(film, build):
        build.watch(BREAKDOWN, ca.mmax(ca.vertcat(*shares)))


def watch_field(film: AnyFilm, build: Builder) -> None:
    """Watch the largest true field. `build` has the signal ``film_voltage`` and gets ``field`` in V/m."""
    thickness, voltage = build.parameter("thickness"), ca.fabs(build.signal("film_voltage"))
    thinnings = ca.vertcat(*(p.stretches[0] * p.stretches[1] for p in film.points if p.active))
    build.watch("field", voltage * ca.mmax(thinnings) / thickness)


Sides = Callable[[str, Symbol, float, Builder], tuple[Symbol, list[Symbol]]]


def _equal(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    return along, []


def _free(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    side = build.coordinate(name, scale=1.0)
    build.guess(side, across)
    return side, [side]


def _clamped(name: str, along: Symbol, across: float, build: Builder) -> tuple[Symbol, list[Symbol]]:
    return build.constant(name, across), []


SIDES: Mapping[str, Sides] = MappingProxyType({"equal": _equal, "free": _free, "clamped": _clamped})
"""``SIDES[how](name, along, across, build)`` returns the stretch across a film and the coordinates that it needs, from
the stretch `along` the motion (a symbol) and the stretch `across` at rest."""
LIMITS: Mapping[str, Callable[[AnyFilm, Symbol, Builder], None]] = MappingProxyType(
    {"equal": watch_breakdown, "free": watch_breakdown, "clamped": watch_limits}
)
"""Limits to watch, by sides. A film with free sides has no tension to lose."""


def check_sides(sides: str, known: Collection[str]) -> None:
    """Raise an error for sides that a rig does not have."""
    if sides not in known:
        raise RigError(f"unknown sides {sides!r}{nearest(sides, known)} (known: {', '.join(known)})")

"""A rectangular film with electrodes all over: free, under dead load, with clamped sides, or blocked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Effect, Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.errors import RigError
from deatwin.plant.film import AnyFilm
from deatwin.plant.limits import watch_limits
from deatwin.plant.material import Material, material
from deatwin.plant.parameters import Parameter
from deatwin.plant.rigs.base import Rig, StartProcedure
from deatwin.plant.rigs.film_actuator import LIMITS, SIDES, FilmActuator, check_sides, relaxed_stresses, watch_field
from deatwin.plant.rigs.kinematics import Kinematics, material_film, squared_voltage, uniform_film
from deatwin.plant.rigs.scaling import command_size

Symbol = Any
ROUNDED = 0.01  # Share by which a rounded side stretch may miss that of a film without side load


@dataclass(frozen=True, kw_only=True)
class Planar(FilmActuator):
    r"""Film between a fixed and a moving bar; the reading is the elongation of the film under voltage.

    .. math:: H L_2\Bigl(\frac{\partial W}{\partial\lambda_1}
              - \varepsilon\frac{V^2}{H^2}\lambda_1\lambda_2^2\Bigr) = F_1

    This equation holds along the motion, that is in direction 1. H is the thickness before stretching, :math:`L_2` the
    width before stretching, W the strain energy density, :math:`\varepsilon` the permittivity and V the voltage.
    :math:`\lambda_1` and :math:`\lambda_2` are the stretches along and across the motion. The dead load :math:`F_1` is
    computed from the prestretch with the published material values, and is then constant. The sides are

    - ``"equal"``: the stretch and the nominal stress are the same in both directions;
    - ``"free"``: the equation also holds across the motion, with 1 and 2 exchanged and a dead load :math:`F_2`, which
      is computed like :math:`F_1`. With a `side_prestretch` of :math:`\lambda_1^{-1/2}`, :math:`F_2` is 0;
    - ``"clamped"``: rails hold :math:`\lambda_2` constant (pure shear).

    Parameters
    ----------
    length, width : float
        Dimensions along and across the motion before stretching, m.
    prestretch : float
        Stretch along the motion, without voltage.
    side_prestretch : float, or None
        Stretch across the motion, without voltage; None for the value of `prestretch`.
    sides : {"equal", "free", "clamped"}
        Support of the sides.
    mass, damping : float
        Mass (kg) and damping constant (N s/m) of the moving bar; the damping is a starting value for a fit. Both act on
        the motion in direction 1 only. With equal sides, the forces in both directions drive this motion: the total
        force is twice the difference between the right and the left side of the equation above.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Zhao & Suo, Appl. Phys. Lett. 91 (2007) 061921, doi:10.1063/1.2768641.
    """

    length: float = 50e-3
    width: float = 50e-3
    prestretch: float = 3.0
    side_prestretch: float | None = None
    sides: str = "equal"

    kind: ClassVar[str] = "planar"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_sides(self.sides, SIDES)
        if self.sides == "equal" and self.across != self.prestretch:
            raise RigError(
                f"equal sides have one prestretch, here are {self.prestretch:g} and {self.across:g}: leave out "
                'side_prestretch, or take sides = "free" or "clamped"'
            )
        if self.sides == "free" and self.across < (least := self.prestretch**-0.5) * (1 - ROUNDED):
            raise RigError(
                f"a dead load cannot push: free sides of a prestretch of {self.prestretch:g} need a side_prestretch of "
                f"at least {least:.4g}, not {self.across:g}"
            )

    @property
    def across(self) -> float:
        """Stretch across the motion, without voltage."""
        return self.prestretch if self.side_prestretch is None else self.side_prestretch

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        along, across = relaxed_stresses(self.substance, self.prestretch, self.across)
        return (
            ("load", along * self.width * self.thickness, "N"),
            ("side_load", across * self.length * self.thickness, "N"),
        )

    @property
    def _size(self) -> float:
        return self.length

    @property
    def _rest_position(self) -> float:
        return self.prestretch * self.length

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.across

    @property
    def _watch_limits(self) -> Callable[[AnyFilm, Symbol, Builder], None]:
        return LIMITS[self.sides]

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        length, width = build.constant("length", self.length), build.constant("width", self.width)
        along = position / length
        across, coordinates = SIDES[self.sides]("side_stretch", along, self.across, build)
        volume = length * width * build.parameter("thickness")
        return uniform_film(volume, (along, across), build, coordinates)

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        across = build.constant("reference_width", self.width) * shape.points[0].stretches[1]
        return -build.parameter("load") * position - build.parameter("side_load") * across


@dataclass(frozen=True, kw_only=True)
class BlockedPlanar(Rig):
    r"""Film between two fixed bars; the reading is the force with which the film pulls the bars together.

    .. math:: F = H L_2\Bigl(\frac{\partial W}{\partial\lambda_1}
              - \varepsilon\frac{V^2}{H^2}\lambda_1\lambda_2^2\Bigr)

    F is the force. H is the thickness before stretching, :math:`L_2` the width before stretching, W the strain energy
    density, :math:`\varepsilon` the permittivity and V the voltage. :math:`\lambda_1` is the stretch from bar to bar,
    and :math:`\lambda_2` the stretch perpendicular to it. Because the film does not move, the change of the force with
    the voltage depends on the drive and the permittivity, but not on the elasticity.

    Parameters
    ----------
    material : str or Material
        Material, or its key in `deatwin.plant.MATERIALS`.
    thickness, length, width : float
        Dimensions before stretching, m; the length is measured from bar to bar.
    prestretch, side_prestretch : float
        :math:`\lambda_1` and :math:`\lambda_2`, which are constant.
    gain : float
        Gain of the amplifier: film volts per command volt.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`. The noise is that of a load cell, N.
    """

    material: str | Material = "VHB 4905"
    thickness: float = 0.5e-3
    length: float = 50e-3
    width: float = 50e-3
    prestretch: float = 3.0
    side_prestretch: float = 3.0
    gain: float = 800.0
    sample_time: float = 0.02
    noise: float = 1e-3

    has_film: ClassVar[bool] = True
    kind: ClassVar[str] = "blocked_planar"
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "force"
    output_unit: ClassVar[str] = "N"
    follows_at_once: ClassVar[bool] = True
    sizes: ClassVar[Sizes] = Sizes(voltage=1.2e3, reading=1.5, reading_unit="N")
    """The typical voltage is that of the diaphragm. The force is 2.2 N without voltage, and 1.2 N at 3 kV."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        known: dict[str, Any] = {"source": "the rig", "known": True}
        return (
            *self._material.parameters,
            Parameter(name="zero", value=0.0, unit="N", lower=-10.0, upper=10.0, source="load cell's offset"),
            Parameter(name="gain", value=self.gain, unit="V/V", lower=1e-3, upper=1e5, **known),
            Parameter(name="thickness", value=self.thickness, unit="m", lower=1e-6, upper=0.1, **known),
        )

    @property
    def start(self) -> StartProcedure:
        """Start of an experiment: at rest under a command of 0, without a ramp."""
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def scaled(self, effect: Effect) -> Effect:
        """Return an effect of the catalogue at the rig's `sizes`, with commands in proportion to those that move it."""
        return replace(self.sizes, command=command_size(self.gain)).of(effect)

    def write(self, build: Builder) -> Symbol:
        along = build.constant("prestretch", self.prestretch)
        across = build.constant("side_prestretch", self.side_prestretch)
        length, width = build.constant("length", self.length), build.constant("width", self.width)
        shape = uniform_film(length * width * build.parameter("thickness"), (along, across), build)
        mounted = (self.prestretch, self.side_prestretch)
        film = build.place(Place.FILM, "film", material_film(shape, self._material, mounted, build))
        squared = squared_voltage(build.share("film", film), build, self.supply)
        watch_field(film, build)
        watch_limits(film, squared, build)
        pull = build.watch("force", film.force(along, squared) / length)
        return build.place(Place.SENSOR, "reading", pull + build.parameter("zero"))

    @cached_property
    def _material(self) -> Material:
        return material(self.material)

"""A film wound around a compressed spring: voltage lets the spring lengthen it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from deatwin.plant.builder import Builder
from deatwin.plant.errors import RigError
from deatwin.plant.rigs.film_actuator import FilmActuator, relaxed_stresses
from deatwin.plant.rigs.kinematics import Kinematics, uniform_film

Symbol = Any


@dataclass(frozen=True, kw_only=True)
class Roll(FilmActuator):
    r"""Film wound around a compressed spring (spring roll); the reading is the elongation of the roll.

    .. math:: B H\Bigl(\frac{\partial W}{\partial\lambda} - \varepsilon\frac{V^2}{H^2}\lambda\lambda_h^2\Bigr)
              = k\,(\ell_0 - \lambda L) + F

    H is the thickness before stretching, W the strain energy density, :math:`\varepsilon` the permittivity and V the
    voltage. :math:`\lambda` is the axial stretch and :math:`\lambda_h` the hoop stretch. The hoop stretch is constant,
    because the layers hold each other around the core: the film is in pure shear. The wound film is assumed to be thin
    compared with the core, so that the stretches are the same in all layers. :math:`\ell_0` is the free length of the
    spring. It is computed from the prestretch with the published material values, and is then constant.

    Parameters
    ----------
    length : float
        L, the length of the unstretched film along the axis, m.
    width : float
        B, the length of the unstretched film along the winding, m; if two films are wound together, the sum of both.
    prestretch, hoop_prestretch : float
        Stretches along and around the axis, without voltage.
    spring_rate : float
        k, the stiffness of the spring, N/m.
    load : float
        F, a dead load that elongates the roll, N.
    mass : float
        Mass of the moving part, kg.
    damping : float
        Damping constant of the moving part, N s/m; a starting value for a fit.
    material, thickness, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film, amplifier, start procedure and sensor; see `Diaphragm`.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Lu, Foo, Huang, Zhu & Suo, J. Appl. Phys. 115 (2014) 184105: a film rolled to a tube under hoop prestretch between
    rigid rings; this rig is the limit of rings far apart.
    """

    length: float = 15e-3
    width: float = 0.5
    prestretch: float = 3.0
    hoop_prestretch: float = 4.5
    spring_rate: float = 250.0
    load: float = 0.0
    mass: float = 20e-3
    damping: float = 15.0

    kind: ClassVar[str] = "roll"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.spring_rate > 0.0:
            raise RigError(f"a spring of {self.spring_rate:g} N/m cannot hold the film: its rate must be above 0")

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        axial, _ = relaxed_stresses(self.substance, self.prestretch, self.hoop_prestretch)
        tension = axial * self.width * self.thickness
        return (
            ("load", self.load, "N"),
            ("spring_rate", self.spring_rate, "N/m"),
            ("spring_length", self._rest_position + (tension - self.load) / self.spring_rate, "m"),
        )

    @property
    def _size(self) -> float:
        return self.length

    @property
    def _rest_position(self) -> float:
        return self.prestretch * self.length

    @property
    def _prestretches(self) -> tuple[float, float]:
        return self.prestretch, self.hoop_prestretch

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        length = build.constant("length", self.length)
        volume = length * build.constant("width", self.width) * build.parameter("thickness")
        stretches = (position / length, build.constant("hoop_prestretch", self.hoop_prestretch))
        return uniform_film(volume, stretches, build)

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        compressed = build.parameter("spring_length") - position
        return build.parameter("spring_rate") / 2 * compressed**2 - build.parameter("load") * position

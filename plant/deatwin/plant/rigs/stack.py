"""Films on top of each other that contract across their faces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.film import AnyFilm, FilmPoint, PointwiseFilm
from deatwin.plant.rigs.film_actuator import FilmActuator, watch_breakdown
from deatwin.plant.rigs.kinematics import Kinematics, electrode_share

Symbol = Any
MIDDLE = 0.5**0.5  # Radius of a uniform film's only point, as a share of the electrode's; half of the area lies within


@dataclass(frozen=True, kw_only=True)
class Stack(FilmActuator):
    r"""Stack of layers in series across their thickness; the reading is its contraction under voltage.

    The n layers have the height h, so that the in-plane stretches are :math:`\lambda = \sqrt{nH/h}`.

    .. math:: n A\Bigl(H\,\frac{dW}{dh} - \frac{\varepsilon V^2}{2H}\,\frac{d\lambda^4}{dh}\Bigr) = F

    H is the thickness of a layer before stretching, W the strain energy density of the film, :math:`\varepsilon` its
    permittivity, V the voltage across each layer, and F the load, which lengthens the stack. Electrodes and end plates
    do not constrain the film in its plane, so a stack without load is a free equal-biaxial film: at small strain it
    shortens by :math:`nH\,\varepsilon E^2/Y`, with the field E and Young's modulus Y. The stack in W. R. Jacobs' thesis
    (2.2.3) is assumed to work by contraction.

    Parameters
    ----------
    layers : int
        n, the number of layers.
    area : float
        A, the area of each layer before stretching, m².
    load : float
        F, a dead load on the lower end, N; positive lengthens the stack.
    material, thickness, mass, damping, gain, start_ramp, start_hold, start_is_known, zero_is_known, direction
        Film and start procedure, as in every film actuator: material, undeformed thickness in m, moved mass in kg,
        damping in N s/m, film volts per command volt, ramp and hold in s. `start_is_known` is False if the film's
        history before the first sample is unknown, `zero_is_known` is False if the sensor's zero is arbitrary, and
        `direction` is -1 if the reading falls as the displacement grows.
    sample_time, noise, reading, model_error, command_range, chain, further, supply
        Drive and sensor; see `Rig`.

    References
    ----------
    Kovacs, Düring, Michel & Terrasi, Sens. Actuators A 155 (2009) 299, doi:10.1016/j.sna.2009.08.027 (unconfirmed).
    """

    layers: int = 100
    area: float = 4e-4
    load: float = 0.5
    thickness: float = 0.1e-3
    mass: float = 50e-3
    damping: float = 40.0

    kind: ClassVar[str] = "stack"

    @property
    def _outside(self) -> tuple[tuple[str, float, str], ...]:
        return (("load", self.load, "N"),)

    @property
    def _size(self) -> float:
        return self.layers * self.thickness

    @property
    def _rest_position(self) -> float:
        return 0.0

    @property
    def _prestretches(self) -> tuple[float, float]:
        return 1.0, 1.0

    @property
    def _watch_limits(self) -> Callable[[AnyFilm, Symbol, Builder], None]:
        return watch_breakdown

    def _kinematics(self, position: Symbol, build: Builder) -> Kinematics:
        layers = build.constant("layers", float(self.layers))
        thickness = build.parameter("thickness")
        stretch = ca.sqrt(1 / (1 - position / (layers * thickness)))
        volume = layers * build.constant("area", self.area) * thickness
        point = FilmPoint(volume=volume, stretches=(stretch, stretch), radius=MIDDLE, coverage=electrode_share(build))
        return Kinematics(points=[point], coordinates=[], film=PointwiseFilm)

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        return build.parameter("load") * position

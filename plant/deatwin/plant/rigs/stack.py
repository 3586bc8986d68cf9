"""Films on top of each other that contract across their faces."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.builder import Builder
from deatwin.plant.film import AnyFilm
from deatwin.plant.rigs.film_actuator import FilmActuator, watch_breakdown
from deatwin.plant.rigs.kinematics import Kinematics, uniform_film

Symbol = Any


@dataclass(frozen=True, kw_only=True)
class Stack(FilmActuator):
    r"""Stack of film layers that are loaded in series; the reading is the contraction of the stack under voltage.

    .. math:: n A\Bigl(H\,\frac{dW}{dh} - \frac{\varepsilon V^2}{2H}\,\frac{d\lambda^4}{dh}\Bigr) = F, \qquad
              \lambda = \sqrt{nH/h}

    h is the height of the stack, n the number of layers, A the area and H the thickness of a layer before stretching.
    :math:`\lambda` is the equal-biaxial in-plane stretch, W the strain energy density, :math:`\varepsilon` the
    permittivity, V the voltage across each layer, and F the load, which lengthens the stack. Electrodes and end plates
    do not constrain the layers in their plane. At small strain, a stack without load therefore contracts by
    :math:`nH\,\varepsilon E^2/Y`, where E is the field and Y Young's modulus.

    Parameters
    ----------
    layers : int
        n, the number of layers.
    area : float
        A, the area of each layer before stretching, m².
    load : float
        F, a dead load on the lower end, N; positive lengthens the stack.
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
    Kovacs, Düring, Michel & Terrasi, Sens. Actuators A 155 (2009) 299, doi:10.1016/j.sna.2009.08.027 (not
    checked against the paper).
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
        return uniform_film(volume, (stretch, stretch), build)

    def _potential(self, position: Symbol, shape: Kinematics, build: Builder) -> Symbol:
        return build.parameter("load") * position

"""A modulus that changes with the temperature."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.lines import slow_cycles
from deatwin.plant.film import AnyFilm
from deatwin.plant.parameters import Scale
from deatwin.plant.readings import ROOM_TEMPERATURE


@dataclass(frozen=True, kw_only=True)
class ThermalStiffness(Effect):
    r"""The stiffness of the film changes with the room temperature.

    .. math:: W \to W\,(1 + k_T\,\Delta T), \qquad \Delta T = T - T_0 \quad\text{or} \qquad
              \Delta T = (1\,\text{K})\,\Bigl[\cos\Bigl(\frac{2\pi t}{P} + \varphi\Bigr) - \cos\varphi\Bigr]

    W is the strain energy density of the film without its Maxwell branches. The effect has no state. If the recording
    has a channel ``temperature`` T (K), the first equation for :math:`\Delta T` holds, with :math:`T_0` = 293.15 K.
    Without this channel, the second equation holds: the room temperature is assumed to vary sinusoidally by ±1 K with
    period P, as under a thermostat, and the rig's modulus is the modulus at time 0. A further reading of the rig may be
    ``room_temperature``, :math:`T_0 + \Delta T`.

    Typical: :math:`k_T` of a few percent per kelvin, with periods from minutes to a day. VHB tape softens as it warms.
    Signature: the displacement at all voltages varies with a period that the command does not contain, and so does the
    sag of the film under the ball at 0 V. For the film of `thesis_plant`, the displacement at 1.9 kV varies by about
    2.4 % if the sag varies by 1 %. A `permittivity_drift` changes in one direction only, and does not change the sag.
    The effect is off at :math:`k_T = 0`.

    Parameters
    ----------
    change_per_kelvin : float
        :math:`k_T`, the relative change of the stiffness per kelvin, 1/K.
    period : float
        P, the assumed period of the room temperature, s; without influence if the temperature is recorded.
    phase : float
        :math:`\varphi`, the assumed phase of the room temperature at time 0, rad; without influence if the temperature
        is recorded.

    References
    ----------
    Liao et al., Int. J. Non-Linear Mech. 118 (2020) 103263, doi:10.1016/j.ijnonlinmec.2019.103263 (VHB 4905
    softens); Alkhoury et al., Int. J. Solids Struct. (2022) 111523, doi:10.1016/j.ijsolstr.2022.111523 (VHB 4910:
    the elastic part stiffens, the viscous part weakens).
    """

    change_per_kelvin: float = field(default=-0.02, metadata=ranged("1/K", -0.2, 0.2))
    period: float = field(default=1200.0, metadata=ranged("s", 20.0, 100e3, scale=Scale.LOGARITHMIC))
    phase: float = field(default=-np.pi / 2, metadata=ranged("rad", -2 * np.pi, 2 * np.pi))

    name: ClassVar[str] = "thermal_stiffness"
    family: ClassVar[Family] = Family.ENVIRONMENT
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "film"
    strength: ClassVar[str] = "change_per_kelvin"
    order: ClassVar[int] = 2
    wording: ClassVar[str] = (
        "The modulus follows the temperature by {change_per_kelvin} for each kelvin "
        "(unless it was measured: a swing of one kelvin with a period of {period} and a phase of {phase})"
    )
    reference: ClassVar[float] = ROOM_TEMPERATURE
    """:math:`T_0`, the temperature at which the rig's modulus holds, K."""
    not_measured: ClassVar[float] = 0.0
    """Value of the channel ``temperature`` in recordings without a thermometer, K."""

    def rewrite(self, signal: AnyFilm, build: Builder) -> AnyFilm:
        room = build.channel("temperature", self.not_measured)
        phase = self.own("phase", build)
        swing = ca.cos(2 * np.pi * build.time / self.own("period", build) + phase) - ca.cos(phase)
        departure = ca.if_else(room > self.not_measured, room - self.reference, swing)
        build.measure("room_temperature", self.reference + departure)
        return signal.with_elastic(1 + self.own("change_per_kelvin", build) * departure)

    def cycle(self, measured: Collection[str]) -> float:
        return 0.0 if "temperature" in measured else self.period

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        """Return up to three copies of this effect, with the periods of slow cycles in `residual` (SI) over `timepts` (s)."""
        known = self.described("period")
        softer = replace(self, change_per_kelvin=-abs(self.change_per_kelvin))
        cycles = slow_cycles(timepts, residual, (known.lower, known.upper), count=3)
        periods = np.clip([1 / c.frequency for c in cycles], known.lower, known.upper)
        return tuple(replace(softer, period=float(p), phase=c.phase) for p, c in zip(periods, cycles, strict=True))

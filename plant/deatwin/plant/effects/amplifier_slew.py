"""Rate limit of the amplifier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter, Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class AmplifierSlew(Effect):
    r"""The amplifier's voltage changes no faster than a limit, which may differ between rise and fall.

    .. math:: s\,\dot V\,\sqrt{w^2 + (x/\rho)^2} = x, \qquad x = V_a - V, \qquad
              \rho = \begin{cases} 1 & x > 0 \\ r & x < 0 \end{cases}

    One state V (V) and its rate (V/s). Far from the command the rate is 1/s up and -r/s down; near it the amplifier
    is a lag of sw, which w keeps near :math:`T_0` = 2 ms: :math:`w^{-2} = (s/T_0)^2 + w_0^{-2}`, where
    :math:`w_0 = 400(1 + 1/r)` V matters only for limits far above typical, which no sample resolves. Typical: 1 to
    50 kV/s; a source that cannot sink current falls slowly, r < 1. Signature: only fast (or only falling) parts are
    late, by a share that grows with amplitude and frequency; `electrode_rc` delays small signals as much as large
    ones. "Up" is towards positive voltage, so r other than 1 breaks evenness y(V) = y(-V). Off at s = 0, where
    :math:`V = V_a`. To first order in s only the lag :math:`sw_0` remains: a limit that is never reached cannot be
    seen.

    Parameters
    ----------
    slowness : float
        s in s/V, the time for one volt upwards.
    ratio : float
        r, the falling rate divided by the rising rate.

    Notes
    -----
    The equation is the usual :math:`s\dot V = g(x)` with a bounded g, multiplied by x/g(x), so that Newton's method
    converges from a distant command and s = 0 is exact. If the voltage catches up within a sample, the step's
    polynomial rounds the corner and overshoots by up to 3 % of the jump until the next sample.

    References
    ----------
    Slew rate, as amplifier data sheets state it; corner: :math:`g(x) = x/\sqrt{w^2 + x^2}`.
    """

    slowness: float = 1e-4
    ratio: float = 0.2

    name: ClassVar[str] = "amplifier_slew"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "amplifier_voltage"
    strength: ClassVar[str] = "slowness"
    order: ClassVar[int] = 1
    """After clipping, because a command beyond the amplifier's range must not wind up the state."""
    wording: ClassVar[str] = "The output of the amplifier needs {slowness} to rise, and falls {ratio} times as fast"
    lag: ClassVar[float] = 2e-3
    """Lag near the command, :math:`T_0`, s."""
    width: ClassVar[float] = 400.0
    """Value of :math:`w_0` for r far above 1, V."""

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="slowness", value=self.slowness, unit="s/V", lower=0.0, upper=5e-3),
            Parameter(name="ratio", value=self.ratio, unit="1", lower=0.05, upper=5.0, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        voltage = build.state("amplifier_output", scale=1e3)
        rate = build.coordinate("amplifier_rate", scale=1e4)
        build.rate(voltage, rate)
        behind = signal - voltage
        slowness, ratio = self.own("slowness", build), self.own("ratio", build)
        width = self.width * (1 + 1 / ratio)
        width = width / ca.sqrt(1 + (slowness * width / self.lag) ** 2)
        size = ca.if_else(behind > 0, behind, behind / ratio)
        build.balance(behind - slowness * rate * ca.sqrt(width**2 + size**2))
        return voltage

"""Rate limit of the amplifier."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class AmplifierSlew(Effect):
    r"""The amplifier's voltage changes no faster than a limit, which may differ between rise and fall.

    .. math:: s\,\dot V\,\sqrt{w^2 + (x/\rho)^2} = x, \qquad x = V_a - V, \qquad
              \rho = \begin{cases} 1 & x > 0 \\ r & x < 0 \end{cases}

    The state V (V) is the amplifier's voltage, with the rate :math:`\dot V` (V/s), and :math:`V_a` is the commanded
    voltage. Far from :math:`V_a` the rate is 1/s upwards and -r/s downwards. Near :math:`V_a`, within the width w, the
    amplifier is a first-order lag with the time constant sw. At typical rates, sw is nearly :math:`T_0` = 2 ms. At much
    higher rates, sw is smaller, because :math:`w^{-2} = (s/T_0)^2 + w_0^{-2}` with :math:`w_0 = 400(1 + 1/r)` V.
    Typical: 1 to 50 kV/s; r < 1 if the source cannot sink current, so that its voltage falls slowly. Signature: fast
    changes are late (for small r, mainly falling ones), and the lateness grows with amplitude and frequency.
    `electrode_rc` delays small signals as much as large ones. Upwards means towards positive voltage, so with r other
    than 1 the response is not even in the voltage. The effect is off at s = 0, where :math:`V = V_a`.

    Parameters
    ----------
    slowness : float
        s, the time for one volt upwards, s/V.
    ratio : float
        r, the falling rate divided by the rising rate.

    Notes
    -----
    The equation is :math:`s\dot V = g(x)` with a bounded g, multiplied by x/g(x). In this form, Newton's method
    converges even if V is far from :math:`V_a`, and s = 0 is exact. If V reaches :math:`V_a` within a sample, the
    computed V overshoots by up to 3 % of the jump until the next sample.

    References
    ----------
    Slew rate, as amplifier data sheets state it; corner: :math:`g(x) = x/\sqrt{w^2 + x^2}`.
    """

    slowness: float = field(default=1e-4, metadata=ranged("s/V", 0.0, 5e-3))
    ratio: float = field(default=0.2, metadata=ranged("1", 0.05, 5.0, scale=Scale.LOGARITHMIC))

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

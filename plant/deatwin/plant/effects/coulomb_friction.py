"""Dry friction at the ball."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import soft_clip
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class CoulombFriction(Effect):
    r"""Coulomb friction on the ball: the ball sticks, or creeps slowly, until the driving force exceeds the friction.

    .. math:: F = -F_c\,\zeta, \qquad \zeta = P\Bigl(\frac{v_r\zeta + v}{v_r + v_s}\Bigr), \qquad
              P(x) = \tfrac12\Bigl[\sqrt{(x + 1)^2 + w^2} - \sqrt{(x - 1)^2 + w^2}\Bigr]

    v is the ball's velocity. The effect has one dimensionless algebraic unknown :math:`\zeta` between -1 and 1. P
    limits its argument to the range from -1 to 1, with corners rounded by w = 0.0001. While the ball slides,
    :math:`\zeta` is 1 or -1, with the sign of v. While it sticks, it creeps at :math:`v = v_s\zeta`, which is no faster
    than :math:`v_s`. With :math:`v_s` = 1 nm/s the ball practically stands still; in a greased guide :math:`v_s` may
    be a millimetre per second. The numerical constant :math:`v_r = v_s + bF_c` does not change the solution. With b of
    the order of sample time divided by mass, it makes Newton's method converge. Typical: 1 to 5 % of the ball's weight,
    0.3 to 1.5 mN, which displaces a film of stiffness k by 10 to 50 µm. The default :math:`v_s` = 0.1 mm/s is a
    starting value from which a fit can reach both firm sticking and fast creep.

    Signature, if the motion is much faster than :math:`v_s`: after each reversal, the ball rests until the driving
    force has changed by :math:`2F_c`. The loop of reading over command has the height :math:`2F_c/k` at any rate, and
    at any amplitude above this height. In slower motion the friction acts as a damper with the constant
    :math:`F_c/v_s`, and the ball does not rest. `hysteresis` instead resists motions smaller than its `distance`
    elastically, with hardly a loop. The effect is off at :math:`F_c = 0`.

    Parameters
    ----------
    force : float
        :math:`F_c`, the friction force while the ball slides, N.
    slip : float
        :math:`v_s`, the largest speed at which a sticking ball creeps, m/s.

    References
    ----------
    Projection form: Alart & Curnier, Comput. Methods Appl. Mech. Eng. 92 (1991) 353,
    doi:10.1016/0045-7825(91)90022-X. Friction laws compared: Pennestrì et al., Nonlinear Dyn. 83 (2016) 1785,
    doi:10.1007/s11071-015-2485-3.
    """

    force: float = field(default=0.7e-3, metadata=ranged("N", 0.0, 0.02, widest=0.3))
    slip: float = field(default=1e-4, metadata=ranged("m/s", 1e-9, 5e-3, scale=Scale.LOGARITHMIC))

    name: ClassVar[str] = "coulomb_friction"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "force"
    wording: ClassVar[str] = "The ball moves against a dry friction of {force}"
    mobility: ClassVar[float] = 2.0
    """Mobility b in :math:`v_r = v_s + bF_c`, m/(s N)."""
    corner: ClassVar[float] = 1e-4
    """Rounding w of the corners of P."""

    def rewrite(self, signal: Any, build: Builder) -> Any:
        direction = build.coordinate("friction_direction", scale=1.0)
        force, slip = self.own("force", build), self.own("slip", build)
        trust = slip + self.mobility * force
        trial = (trust * direction + build.signal("velocity")) / (trust + slip)
        build.balance(direction - soft_clip(trial, 1.0, self.corner))
        return signal - force * self._resistance(direction, build)

    def _resistance(self, direction: Any, build: Builder) -> Any:
        """Return the friction force divided by its level."""
        return direction

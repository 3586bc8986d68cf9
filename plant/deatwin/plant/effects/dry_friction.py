"""Dry friction that depends on speed and direction."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import ranged
from deatwin.plant.effects.coulomb_friction import CoulombFriction
from deatwin.plant.parameters import Scale

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class DryFriction(CoulombFriction):
    r"""Dry friction of a machine, which may depend on speed and direction.

    .. math:: F = -F_c\,\zeta\,(1 + a\,\zeta)\,\bigl(1 + s\,e^{-(v/v_S)^2}\bigr)

    v is the velocity. :math:`\zeta` is 1 in forward and -1 in backward sliding. Between these values, the part sticks
    and creeps at :math:`v = v_s\zeta` (`CoulombFriction` gives the equation). On rigs that are not film actuators, this
    class replaces `CoulombFriction` under the same name.

    s > 0 gives stiction with the Stribeck curve: for a = 0, the part breaks loose at :math:`(1 + s)F_c`, and far above
    the speed :math:`v_S` the friction is :math:`F_c`. a > 0 gives more friction forwards than backwards, as in a drive
    that lifts or a seal with one lip. Typical: s from 0 to 1, a from -0.3 to 0.3, and :math:`v_S` from 2 to 40 % of the
    usual speed. A smaller :math:`v_S` is hidden by the creep of the sticking part, and a larger one looks like viscous
    damping. Signature of s: in small motion the part sticks, breaks loose with a jump and may oscillate (stick-slip).
    Signature of a: a shift of the force by :math:`aF_c` while the part moves, whereas the shift by an
    `amplifier_offset` is also present at rest. The effect is off at :math:`F_c = 0`.

    Parameters
    ----------
    force : float
        :math:`F_c`, the friction force in fast motion, N.
    slip : float
        :math:`v_s`, the largest speed at which a sticking part creeps, m/s.
    stiction : float
        s, the excess of the friction at rest over :math:`F_c`, divided by :math:`F_c`.
    speed : float
        :math:`v_S` in m/s, the speed at which stiction fades.
    unevenness : float
        a, the forward friction minus the backward friction, divided by the sum of both.

    References
    ----------
    Armstrong-Hélouvry, Dupont & Canudas de Wit, Automatica 30 (1994) 1083, doi:10.1016/0005-1098(94)90209-7, for the
    Stribeck curve; asymmetric friction of drives: Swevers et al., IEEE Trans. Autom. Control 45 (2000) 675,
    doi:10.1109/9.847103.
    """

    stiction: float = field(default=0.0, metadata=ranged("1", 0.0, 2.0))
    speed: float = field(default=1e-3, metadata=ranged("m/s", 1e-4, 2e-3, scale=Scale.LOGARITHMIC))
    unevenness: float = field(default=0.0, metadata=ranged("1", -0.9, 0.9))

    wording: ClassVar[str] = (
        "The ball moves against a dry friction of {force}, increased by a share of {stiction} at rest and by a share of "
        "{unevenness} in forward motion"
    )

    def _resistance(self, direction: Any, build: Builder) -> Any:
        """Return the friction force divided by its level."""
        rising = 1 + self.own("stiction", build) * ca.exp(-((build.signal("velocity") / self.own("speed", build)) ** 2))
        return direction * (1 + self.own("unevenness", build) * direction) * rising

"""Dead zone of the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import soft_excess


@dataclass(frozen=True, kw_only=True)
class DeadZone(Effect):
    r"""Small commands have no effect, and larger ones are reduced by half the width of the zone.

    .. math:: u \to p(u - w) - p(-u - w), \qquad p(x) = \epsilon\ln(1 + e^{x/\epsilon})

    The effect has no state. u is the command. The corners are rounded over :math:`\epsilon` = 5 mV. Typical: the
    overlap of a valve's spool, 2 to 20 % of its stroke; the base-emitter voltages of an output stage. Signature: the
    loss of command is static, odd in the command, and the same at all frequencies. `coulomb_friction` and `backlash`
    cause a loop; a dead zone does not. The effect is off at w = 0.

    Parameters
    ----------
    width : float
        w in V, half the width of the zone.

    References
    ----------
    Tao & Kokotović, Adaptive Control of Systems with Actuator and Sensor Nonlinearities (1996), chapter 2. The
    rounded corner is a softplus function.
    """

    width: float = field(default=0.1, metadata=ranged("V", 0.0, 3.0))

    name: ClassVar[str] = "dead_zone"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "width"
    wording: ClassVar[str] = (
        "Commands below {width} have no effect, and larger commands act as if they were smaller by this amount"
    )
    rounding: ClassVar[float] = 5e-3
    """Rounding of the corners, :math:`\\epsilon` in V."""

    def rewrite(self, signal: Any, build: Builder) -> Any:
        width = self.own("width", build)
        return soft_excess(signal - width, self.rounding) - soft_excess(-signal - width, self.rounding)

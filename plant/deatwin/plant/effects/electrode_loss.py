"""Loss of a part of the electrode."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.onset import LATEST, steps_of
from deatwin.plant.effects.smooth import smooth_step


def rate_of(share: Any, time: Any) -> Any:
    """Return the rate of the share of the electrode with contact, 1/s; 0 at rest, and for a plain number."""
    return 0.0 if isinstance(share, float) else ca.if_else(time == 0, 0.0, ca.jacobian(share, time))


@dataclass(frozen=True, kw_only=True)
class ElectrodeLoss(Effect):
    r"""Part of the electrode's area loses contact at some time; in a round electrode, this part is the rim.

    .. math:: A(t) = A\,[1 - l\;S(4(t - t_0)/h)], \qquad S(x) = \frac{1}{1 + e^{-x}}

    A is the electrode's area and h the sample time, so that the loss takes about one sample. The effect has no state.
    Typical: steps of 1 to 50 % of the area. Signature: from :math:`t_0` on, the motion is smaller by a share that
    hardly depends on the voltage (half the relative change of the area), while the sag at 0 V stays the same. A
    `sensor_jump` shifts all readings alike, and the relative effect of a `permittivity_drift` grows with the voltage.
    The effect is off at l = 0.

    Parameters
    ----------
    share : float
        l, the lost share of the area.
    at : float
        :math:`t_0`, the time of the loss on the experiment's clock, s.

    References
    ----------
    Jumps by contacts in ageing actuators: J. Appl. Phys. 115 (2014) 214105.
    """

    share: float = field(default=0.2, metadata=ranged("1", 0.0, 0.9))
    at: float = field(default=100.0, metadata=ranged("s", 0.0, LATEST))

    name: ClassVar[str] = "electrode_loss"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.FILM
    signal: ClassVar[str] = "electrode_share"
    strength: ClassVar[str] = "share"
    event: ClassVar[str] = "at"
    wording: ClassVar[str] = "At {at} the electrode loses a share of {share} of its area"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        width = build.constant("electrode_loss_width", build.signal("sample_time") / 4)
        return signal * (1 - self.own("share", build) * smooth_step((build.time - self.own("at", build)) / width))

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        return tuple(replace(self, at=time) for time, height in steps_of(timepts, residual) if height < 0)

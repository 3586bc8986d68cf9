"""A stop below the ball."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import smooth_sign, soft_excess
from deatwin.plant.parameters import Scale


@dataclass(frozen=True, kw_only=True)
class EndStop(Effect):
    r"""Beyond a certain position, the ball meets an elastic stop, which may absorb energy.

    .. math:: F = -k\,d\,\Bigl(1 + \frac{\lambda v}{\sqrt{1 + \lambda^2 v^2}}\Bigr), \qquad
              d = w\ln\bigl(1 + e^{(y - y_s)/w}\bigr)

    The effect has no state. y is the displacement from rest, downwards, and v is the ball's velocity. d is the depth of
    contact; the onset of contact is rounded over w = 5 µm. With λ = 0 the force is kd at any speed, and no energy is
    lost. Otherwise the force is larger than kd on the way in and smaller on the way out: at speeds far above 1/λ, it is
    2kd on the way in and zero on the way out. The stop never pulls. An impact at a speed :math:`v_0` far below 1/λ loses
    the share :math:`4/3\,\lambda v_0` of the energy; a faster impact loses less than this formula says. Typical:
    k = 100 N/m for foam; λ = 20 s/m, which takes 22 % of the energy of an impact at 10 mm/s. A stop of 3 kN/m is 100
    times stiffer than the film and practically rigid.

    Signature: no effect at :math:`y < y_s`. At :math:`y > y_s` and well below the resonance, the stroke grows by only
    :math:`k_f/(k_f + k)` of its growth without a stop; :math:`k_f` is the film's stiffness. :math:`y_s` is the same at
    any voltage and frequency. The ball's ringing is cut off on one side. An `amplifier_saturation` limits the stroke, too, but does not keep the ball from overshooting. The
    effect is off at k = 0.

    Parameters
    ----------
    stiffness : float
        k, the stiffness of the stop, N/m.
    position : float
        :math:`y_s`, the displacement at which the ball touches the stop, m.
    loss : float
        :math:`\lambda`, which determines the energy lost in an impact, s/m; 0 for no loss.

    References
    ----------
    Force proportional to depth times a function of speed: Hunt & Crossley, J. Appl. Mech. 42 (1975) 440,
    doi:10.1115/1.3423596. Their function is :math:`1 + 3/2\,\alpha v`; the present one stays between 0 and 2, with
    :math:`\lambda = 3/2\,\alpha` for slow impacts.
    """

    stiffness: float = field(default=300.0, metadata=ranged("N/m", 0.0, 3e3))
    position: float = field(default=0.25e-3, metadata=ranged("m", 50e-6, 20e-3, scale=Scale.LOGARITHMIC))
    loss: float = field(default=20.0, metadata=ranged("s/m", 0.0, 500.0))

    name: ClassVar[str] = "end_stop"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.BALL
    signal: ClassVar[str] = "force"
    strength: ClassVar[str] = "stiffness"
    threshold: ClassVar[str] = "position"
    wording: ClassVar[str] = "The ball meets a stop of {stiffness} at {position}"
    width: ClassVar[float] = 5e-6
    """Rounding w of the onset of contact, m."""

    def rewrite(self, signal: Any, build: Builder) -> Any:
        depth = soft_excess(build.signal("displacement") - self.own("position", build), self.width)
        direction = smooth_sign(self.own("loss", build) * build.signal("velocity"), 1.0)
        return signal - self.own("stiffness", build) * depth * (1 + direction)

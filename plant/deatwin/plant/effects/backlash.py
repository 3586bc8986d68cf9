"""Play between the command and what it moves."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged
from deatwin.plant.effects.smooth import soft_clip


@dataclass(frozen=True, kw_only=True)
class Backlash(Effect):
    r"""The command drives the plant through a clearance, which the command must cross after each reversal.

    .. math:: u \to e = u - C_w(u - m), \qquad (t_e - t + \delta)\,\dot m = e - m

    u is the command and e the transmitted command. :math:`C_w` limits its argument to the range from -w to w, with
    corners rounded by :math:`10^{-6}w`. The effect has one state m (V). At the start of each sample, m is the
    transmitted command of the previous sample. During the sample, m changes linearly and reaches e at the end of the
    sample, the time :math:`t_e`; :math:`\delta`, which is :math:`10^{-4}` of a sample, avoids a division by zero. For
    commands held constant within each sample, e is exactly the output of the play operator. The state starts in the
    middle of the clearance. Typical: gears, linkages and the stems of valves, 1 to 10 % of the stroke.

    Signature: a rate-independent loop whose parallel sides are 2w apart along the command, whatever the size of the
    motion. Commands that vary by less than 2w have no effect. With `coulomb_friction`, the inertia of the moved part
    can carry this part across the loop; if the command sets a position, backlash and Coulomb friction look alike. A
    `dead_zone` has no loop. The effect is off at w = 0.

    Parameters
    ----------
    width : float
        w in V, half the clearance.

    References
    ----------
    Play operator: Visintin, Differential Models of Hysteresis (1994), chapter III; Tao & Kokotović, Adaptive Control
    of Systems with Actuator and Sensor Nonlinearities (1996), chapter 2.
    """

    width: float = field(default=0.05, metadata=ranged("V", 0.0, 1.5))

    name: ClassVar[str] = "backlash"
    family: ClassVar[Family] = Family.MECHANICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "width"
    wording: ClassVar[str] = "The command is transmitted with a backlash of {width} to either side"
    corner: ClassVar[float] = 1e-6
    """Rounding of the corners as a share of the width: sharp enough that a state at rest in the clearance stays."""
    floor: ClassVar[float] = 1e-9
    """Least rounding of the corners, V, so that they have a slope at a width of zero."""
    late: ClassVar[float] = 1e-4
    """Margin :math:`\\delta` after a sample's end, in samples."""

    def rewrite(self, signal: Any, build: Builder) -> Any:
        width = self.own("width", build)
        moved = build.state("transmitted_command", scale=1.0, start=signal)
        transmitted = signal - soft_clip(signal - moved, width, self.corner * width + self.floor)
        left = build.sample_start - build.time + (1 + self.late) * build.sample_time
        build.rate(moved, (transmitted - moved) / left)
        return transmitted

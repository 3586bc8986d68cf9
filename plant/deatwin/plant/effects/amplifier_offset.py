"""Offset of the command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from deatwin.plant.effects.base import Builder, Effect, Family, Place, ranged


@dataclass(frozen=True, kw_only=True)
class AmplifierOffset(Effect):
    r"""The amplifier adds a constant offset to the command, also at rest.

    .. math:: u \to u + u_0

    The effect has no state. u is the command. Typical: 2.5 to 12.5 mV. With a gain of 800, this is 2 to 10 V at the
    film. Signature: the response y is shifted along the command axis, so it is no longer even in u. If the response
    without offset is :math:`y = u^2`, then y(u) and y(-u) differ by :math:`4u_0u`. Under commands of one polarity, the
    offset looks nearly like a gain error. The effect is off at :math:`u_0 = 0`.

    Parameters
    ----------
    offset : float
        :math:`u_0`, the offset of the command, V.

    References
    ----------
    Offset referred to the input, as amplifier data sheets state it.
    """

    offset: float = field(default=0.01, metadata=ranged("V", -1.0, 1.0))

    name: ClassVar[str] = "amplifier_offset"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "offset"
    wording: ClassVar[str] = "The amplifier adds {offset} to its command"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal + self.own("offset", build)

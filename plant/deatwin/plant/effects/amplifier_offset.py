"""Offset of the command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class AmplifierOffset(Effect):
    r"""The amplifier adds a constant offset to the command, also at rest.

    .. math:: u \to u + u_0

    The effect has no state. Typical: 2 to 10 V at the film, that is 2.5 to 12.5 mV of the command u at a gain of 800.
    Signature: a shift of the response y along the voltage axis, :math:`y(-u; u_0) = y(u; -u_0)`, so y is no longer even
    in u: with y proportional to :math:`u^2` at zero offset, y(u) and y(-u) differ by :math:`4u_0u`, and their sum is
    about :math:`2u^2`. Under commands of one polarity the offset looks nearly like a gain error. The effect is off at
    :math:`u_0 = 0`.

    Parameters
    ----------
    offset : float
        :math:`u_0`, the offset referred to the command, V.

    References
    ----------
    Offset referred to the input, as amplifier data sheets state it.
    """

    offset: float = 0.01

    name: ClassVar[str] = "amplifier_offset"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "offset"
    wording: ClassVar[str] = "The amplifier adds {offset} to its command"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="offset", value=self.offset, unit="V", lower=-1.0, upper=1.0),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal + self.own("offset", build)

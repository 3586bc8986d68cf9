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
    r"""The amplifier adds an offset to its command, at rest too.

    .. math:: u \to u + u_0

    No state. Typical: 2 to 10 V at the film, 2.5 to 12.5 mV at the command of a gain of 800. Signature: a shift
    along the voltage axis, so :math:`y(-u; u_0) = y(u; -u_0)` and evenness is lost: the two branches differ by
    about :math:`4u_0u` relative to :math:`2u^2`. With one polarity it looks nearly like a gain error. Off at
    :math:`u_0 = 0`.

    Parameters
    ----------
    offset : float
        :math:`u_0` in V of the command.

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

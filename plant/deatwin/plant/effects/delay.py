"""Dead time of the command."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Effect, Family, Place
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder

__all__ = ["Delay"]

LONGEST = 0.1
"""Upper end of the dead time, s."""


@dataclass(frozen=True, kw_only=True)
class Delay(Effect):
    r"""The command acts a dead time late.

    With the shift :math:`s = \tau_d/h` in samples and :math:`d_k = u_{-k-1} - u_{-k}`,

    .. math:: u \to u_0 + d_0 s + \sum_{k\ge1}(d_k - d_{k-1})\,R(s - k)

    No state: past commands are inputs. R is the ramp max(x, 0). Between whole samples this mixes two neighbours, as
    the mean of a late held command over a sample does; at whole samples it is the exact shift. There the ramp's
    corner would put a corner into the sum of squares, so within a quarter of a sample it is rounded such that its
    value stays and only its slope passes smoothly from 0 to 1. Typical: 0 to 40 ms. Signature: phase linear in
    frequency, 7.2° per 20 ms at 1 Hz, without a change of gain, for all harmonics of the command alike; below 1 Hz a
    short `electrode_rc` or `sensor_lag` looks the same, from 5 Hz on they roll off. Off at :math:`\tau_d = 0`.

    Parameters
    ----------
    time : float
        :math:`\tau_d` in s.

    References
    ----------
    Laakso et al., IEEE Signal Process. Mag. 13 (1996) 30, doi:10.1109/79.482137 (fractional delays).
    """

    time: float = 0.03

    name: ClassVar[str] = "delay"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "time"
    order: ClassVar[int] = -1
    """Before what else happens to the command: only the bare one has a past."""
    wording: ClassVar[str] = "The command acts {time} late"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=LONGEST),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        sample_time = build.signal("sample_time")
        past = build.past_commands(ceil(LONGEST / sample_time) + 1)
        shift = self.own("time", build) / build.constant("delay_sample_time", sample_time)
        changes = [earlier - later for later, earlier in pairwise(past)]
        shifted = past[0] + changes[0] * shift
        for k in range(1, len(changes)):
            shifted += (changes[k] - changes[k - 1]) * _ramp(shift - k)
        return signal + shifted - build.command


def _ramp(value: Any, reach: float = 0.25) -> Any:
    """max(x, 0) at 0 and beyond `reach`; between, a cubic of |x| replaces |x| that starts with slope 0."""
    size = ca.fabs(value)
    near = ca.fmin(size, reach)
    return (value + size - near + 2 * near**2 / reach - near**3 / reach**2) / 2

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


USUAL, LONGEST = 0.1, 1.6
"""Upper end of the dead time, s: usual, and the longest one; a command that comes later has gone through a queue."""
ROUNDING = 1e-10
"""Tolerance in samples: a shift this close to a whole sample counts as whole."""


@dataclass(frozen=True, kw_only=True)
class Delay(Effect):
    r"""The command acts after a dead time.

    The shift in samples is :math:`s = \tau_d/h`, with k whole samples and a remainder :math:`\sigma = s - k`:

    .. math:: u \to u_{-k-1} \ \text{in the first part of a sample, that of the share} \ \sigma, \quad
              u_{-k} \ \text{in the second}

    No state: past commands are inputs. A sample is divided where the command jumps, and each part is solved in its own
    step, so that the jump costs no accuracy. A reading that follows the command at once (`Rig.follows_at_once`) does
    not reveal when within a sample the command came: such a rig gets :math:`u_{-k} + \sigma\,(u_{-k-1} - u_{-k})`, as
    if the command were sampled and not held, so that a fit can move from one whole sample to the next. Typical: 0 to 40
    ms. Signature: phase linear in frequency, 7.2° per 20 ms at 1 Hz, without a change of gain, for all harmonics of the
    command alike. Below 1 Hz a short `electrode_rc` or `sensor_lag` looks the same; above 5 Hz they roll off. Off at
    :math:`\tau_d = 0`.

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
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=USUAL, widest=LONGEST),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        past = build.past_commands(ceil(build.reach(f"{self.name}.time") / build.signal("sample_time") - ROUNDING) + 1)
        shift = self.own("time", build) / build.sample_time
        whole = ca.fmin(ca.fmax(ca.floor(shift + ROUNDING), 0.0), len(past) - 2.0)
        share = ca.fmin(shift - whole, 1.0)
        after, before = past[0], past[1]
        for number, (later, earlier) in enumerate(pairwise(past)):
            after, before = (ca.if_else(whole == number, new, old) for new, old in ((later, after), (earlier, before)))
        if build.signal("follows_at_once", otherwise=False):
            acting = after + share * (before - after)
        else:
            acting = ca.if_else(build.divide(share).in_first, before, after)
        return signal + acting - build.command

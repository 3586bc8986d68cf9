"""Dead time of the command, or of the reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca

from deatwin.plant.effects.base import Alone, Effect, Family, Place, Site
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


USUAL, LONGEST = 0.1, 1.6
"""Upper end of the dead time, s: usual, and the longest one; a command that comes later has gone through a queue."""
POLES = 8
"""Number of poles of the approximant of a late reading."""
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

    Further place: the ``reading``, as of a camera. There the delay is the Padé approximant of :math:`e^{-\tau_d s}` with
    7 zeros and 8 poles, which errs by less than 0.1 % up to :math:`1.3/\tau_d`, 13 Hz at 100 ms. It smooths the corners
    at which a held command changes: behind a lag T the reading comes :math:`h^2/12T` early, 0.7 ms if h is 20 ms and T
    is 50 ms, and a fitted delay errs as much. One reading alone cannot distinguish the two places; a second reading that
    is not delayed can.

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
    places: ClassVar[Mapping[str, Site]] = MappingProxyType(
        {
            "reading": Site(
                place=Place.SENSOR,
                signal="reading",
                family=Family.SENSOR,
                order=21,  # behind the sensor's lag
                strength=Parameter(name="time", value=0.03, unit="s", lower=0.0, upper=0.15),
                alone=Alone.AS_FIRST,
                wording="The reading comes {time} late",
            )
        }
    )

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=USUAL, widest=LONGEST),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        if self.placed_at:
            return _late(signal, self.own("time", build), build)
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


def _late(signal: Any, time: Any, build: Builder) -> Any:
    """A signal after a dead time, by a rational function of POLES poles and one zero fewer."""
    states = [build.state(f"late_{k}", scale=1e-3) for k in range(POLES)]
    last = signal - sum(states)
    for k, (state, following) in enumerate(zip(states, [*states[1:], last], strict=True)):
        build.rate(state, following * (2 * POLES - 1 - k) * (k + 1) / (POLES - k), mass=time)
    return sum((-1) ** k * (1 - k / POLES) * state for k, state in enumerate(states))

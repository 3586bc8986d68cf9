"""Dead time of the command, or of the reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Alone, Effect, Family, Place, Site
from deatwin.plant.parameters import Parameter

if TYPE_CHECKING:
    from deatwin.plant.builder import Builder


USUAL, LONGEST = 0.1, 1.6
"""Upper ends of the range of the dead time, s: the usual one, and the largest to which a fit may extend it. A command
that arrives later has gone through a queue."""
ROUNDING = 1e-10  # Tolerance in samples: a shift this close to a whole sample counts as whole


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

    Further place: the ``reading``, as of a camera. All that it shows comes late then, noise excepted. Within the sample in
    which it left the plant, the reading is the polynomial through its values at the integrator's stages, s of them, which
    moments of the reading over the sample tell:

    .. math:: y(t_{k+1} - \sigma h) = \sum_{i,j} \sigma^i (H^{-1})_{ij} m_j, \qquad
              m_j = \frac1h \int_{t_k}^{t_{k+1}} \Big(\frac{t_{k+1}-t}{h}\Big)^j y\,dt, \qquad
              H_{ij} = \frac{1}{i+j+1}

    With five stages it errs by at most :math:`(\omega h)^5/15000` of a component of the angular frequency
    :math:`\omega`, and by nothing at whole samples; the corners at which a held command changes lie between samples, and cost nothing. A command and a
    reading that are both late by parts of a sample have a corner within one, which the polynomial rounds. One reading
    alone cannot distinguish the two places; a second reading that is not delayed can.

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
    """Before all other effects on the command, because past values are known of the bare command only."""
    wording: ClassVar[str] = "The command acts {time} late"
    places: ClassVar[Mapping[str, Site]] = MappingProxyType(
        {
            "reading": Site(
                place=Place.SENSOR,
                signal="reading",
                family=Family.SENSOR,
                order=21,  # after the sensor's lag
                strength=Parameter(name="time", value=0.03, unit="s", lower=0.0, upper=0.15),
                alone=Alone.AS_FIRST,
                wording="The reading comes {time} late",
                title="delay of the reading",
            )
        }
    )

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=USUAL, widest=LONGEST),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        count = 1 + ceil(build.reach(f"{self.name}.time") / build.signal("sample_time") - ROUNDING)
        shift = self.own("time", build) / build.sample_time
        whole = ca.fmin(ca.fmax(ca.floor(shift + ROUNDING), 0.0), count - 1.0)
        share = ca.fmin(shift - whole, 1.0)
        if self.placed_at:
            build.at_last(lambda reading, last: _late(reading, last, whole, share, count))
            return signal
        past = build.past_commands(count)
        after, before = past[0], past[1]
        for number, (later, earlier) in enumerate(pairwise(past)):
            after, before = (ca.if_else(whole == number, new, old) for new, old in ((later, after), (earlier, before)))
        if build.signal("follows_at_once", otherwise=False):
            acting = after + share * (before - after)
        else:
            acting = ca.if_else(build.divide(share).in_first, before, after)
        return signal + acting - build.command


def _late(reading: Any, build: Builder, whole: Any, share: Any, count: int) -> Any:
    """Return a reading after a dead time of `whole` samples, less than `count`, and a `share` of a sample."""
    if build.signal("averages"):
        now = _inside(reading, build, share, 2)
    elif build.signal("follows_at_once"):
        now = (1 - share) * reading
    else:
        return _past([_inside(reading, build, share, 1)], build, whole, [count])
    return _past([now, reading - now], build, whole, [count, count + 1])  # the reading combines parts of two samples


def _past(parts: Sequence[Any], build: Builder, whole: Any, counts: Sequence[int]) -> Any:
    """Return the sum of values at sample ends: the first `whole` samples back, each further part one sample earlier."""
    size = build.signal("reading_size")
    first = [build.state(f"late_{n}", scale=size, start=part) for n, part in enumerate(parts)]
    for state, part in zip(first, parts, strict=True):
        build.rate(state, part - state, mass=0.0)
    total = 0.0
    for n, (state, part, count) in enumerate(zip(first, parts, counts, strict=True)):
        chain = [state, *(build.state(f"late_{n}_{k}_ago", scale=size, start=part) for k in range(1, count))]
        for before, after in pairwise(chain):
            build.rate(after, 0.0)
            build.begin(after, before)
        total += sum(ca.if_else(whole + n == k, past, 0.0) for k, past in enumerate(chain))
    return total


def _inside(reading: Any, build: Builder, share: Any, growth: int) -> Any:
    """Return the reading within a sample; at rest it is constant or, with `growth` 2, grows from 0."""
    size = build.signal("reading_size")
    width, moments = build.sample_time, []
    above = reading
    for j in range(build.stages):
        at_rest = 1 / (j + 1) if growth == 1 else 1 / ((j + 1) * (j + 2))
        moment = build.state(f"late_moment_{j}", scale=size, start=at_rest * reading)
        build.rate(moment, max(j, 1) * above / width)
        build.begin(moment, at_rest=1 / (j + growth))
        moments.append(moment)
        above = moment
    powers = np.arange(build.stages)
    of_moments = np.linalg.inv(1 / (1 + np.add.outer(powers, powers)))  # coefficients of a polynomial
    rows = [sum(float(weight) * moment for weight, moment in zip(row, moments, strict=True)) for row in of_moments]
    return sum(share**i * row for i, row in enumerate(rows))

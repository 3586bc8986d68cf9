"""Dead time of the command, or of the reading."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import ceil
from operator import mul
from types import MappingProxyType
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from deatwin.plant.effects.base import Alone, Builder, Effect, Family, Place, Site, ranged
from deatwin.plant.parameters import Parameter

USUAL, LONGEST = 0.1, 1.6
"""Upper ends of the range of the dead time, s: the usual one, and the largest to which a fit may extend it. A command
that arrives later has gone through a queue."""
ROUNDING = 1e-10  # Tolerance in samples: a shift this close to a whole sample counts as whole


@dataclass(frozen=True, kw_only=True)
class Delay(Effect):
    r"""The command acts after a dead time.

    With the sample time h, the delay is :math:`\tau_d/h = k + \sigma` samples: k whole samples and the fraction
    :math:`\sigma`. The command of k samples ago is :math:`u_{-k}`.

    .. math:: u \to u_{-k-1} \ \text{during the first fraction} \ \sigma \ \text{of a sample}, \qquad
              u_{-k} \ \text{during the rest}

    The effect has no state, because the earlier commands are inputs. A sample is divided at the time at which the
    command jumps. Each part is solved in its own step, so that the jump does not reduce the accuracy. If the reading
    follows the command instantaneously (`Rig.follows_at_once`), the reading does not show when within a sample the
    command jumped. On such a rig, the command becomes the interpolated :math:`u_{-k} + \sigma\,(u_{-k-1} - u_{-k})`, so
    that the reading is a continuous function of :math:`\tau_d`. Typical: 0 to 40 ms. Signature: a phase lag
    proportional to frequency, 7.2° per 20 ms at 1 Hz, without a change of gain. Below 1 Hz, an `electrode_rc` or
    `sensor_lag` with a short time constant looks like a delay; above 5 Hz, both reduce the gain. The effect is off at
    :math:`\tau_d = 0`.

    ``Delay().placed("reading")`` delays the reading instead, such as that of a camera. A delay by a fraction of a
    sample is computed from the polynomial through the values of the reading y at the n stages of the integrator. The
    coefficients of this polynomial follow from the moments :math:`m_j` of the reading over the sample (i and j run from
    0 to n - 1):

    .. math:: y(t_{k+1} - \sigma h) = \sum_{i,j} \sigma^i (H^{-1})_{ij} m_j, \qquad
              m_j = \frac1h \int_{t_k}^{t_{k+1}} \Big(\frac{t_{k+1}-t}{h}\Big)^j y\,dt, \qquad
              H_{ij} = \frac{1}{i+j+1}

    With five stages, the error of a component with the angular frequency :math:`\omega` is at most
    :math:`(\omega h)^5/15000` of its amplitude; for whole samples the error is zero. A step of the held
    command causes a corner of the motion. The corners lie on sample boundaries, so they cause no error. If both command and reading are
    delayed by fractions of a sample, the corners lie within a sample, and the polynomial rounds them. A single sensor
    cannot distinguish a delay of the command from a delay of the reading; a second sensor without delay can.

    Parameters
    ----------
    time : float
        :math:`\tau_d`, the dead time, s.

    References
    ----------
    Laakso et al., IEEE Signal Process. Mag. 13 (1996) 30, doi:10.1109/79.482137 (fractional delays).
    """

    time: float = field(default=0.03, metadata=ranged("s", 0.0, USUAL, widest=LONGEST))

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

    def rewrite(self, signal: Any, build: Builder) -> Any:
        count = 1 + ceil(build.reach(f"{self.name}.time") / build.signal("sample_time") - ROUNDING)
        shift = self.own("time", build) / build.sample_time
        whole = ca.fmin(ca.fmax(ca.floor(shift + ROUNDING), 0.0), count - 1.0)
        share = ca.fmin(shift - whole, 1.0)
        if self.placed_at:
            build.at_last(lambda reading, last: _late(reading, last, whole, share, count))
            return signal
        past = build.past_commands(count)
        at = [whole == number for number in range(len(past) - 1)]
        after, before = (sum(map(mul, at, acted)) for acted in (past[:-1], past[1:]))
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

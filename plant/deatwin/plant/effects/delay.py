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
MOMENTS = 4
"""Of the jump within a sample, that the polynomial has: a step of five stages integrates its products with others."""


@dataclass(frozen=True, kw_only=True)
class Delay(Effect):
    r"""The command acts a dead time late.

    With the shift :math:`s = \tau_d/h` in samples and :math:`d_k = u_{-k-1} - u_{-k}`,

    .. math:: u \to u_0 + \sum_{k\ge0} d_k\,W(\varphi;\, \min(\max(s - k, 0), 1))

    No state: past commands are inputs. Within a sample, at the phase :math:`0 < \varphi \le 1`, the command before
    acts until :math:`\varphi = s`. One implicit step over the sample cannot follow a jump in its middle; W is the
    polynomial of degree 4 in :math:`\varphi` that has the first four moments of the jump, and s at the sample's end,

    .. math:: W(\varphi; s) = s + \tfrac12\sum_{n=1}^{3} P_n(\varphi)\,[P_{n+1}(s) - P_{n-1}(s)]
              + P_4(\varphi)\,[s - \tfrac12 P_3(s) - \tfrac12 P_4(s)]

    with Legendre polynomials shifted to 0 to 1. The moments, of the command and not of its square, are what the
    step's quadrature sees; the end is what a reading sees that follows without any dynamics, for which the command is
    so interpolated between samples. Where the polarity is reversed the sizes are interpolated, under the later sign:
    the pull goes with the square, of which a reversal changes little, and no polynomial jumps from u to -u without a
    gap. At whole samples it is the exact shift. Typical: 0 to 40 ms. Signature: phase
    linear in frequency, 7.2° per 20 ms at 1 Hz, without a change of gain, for all harmonics of the command alike;
    below 1 Hz a short `electrode_rc` or `sensor_lag` looks the same, from 5 Hz on they roll off. Off at
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
        return (Parameter(name="time", value=self.time, unit="s", lower=0.0, upper=LONGEST),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        sample_time = build.signal("sample_time")
        past = build.past_commands(ceil(LONGEST / sample_time) + 1)
        width = build.constant("delay_sample_time", sample_time)
        shift, phase = self.own("time", build) / width, (build.time - build.sample_start) / width
        shifted = past[0]
        for k, (later, earlier) in enumerate(pairwise(past)):
            # A dead time is never negative: at 0 the slope is to be that of a longer one.
            passed = ca.fmin(shift - k if k == 0 else ca.fmax(shift - k, 0.0), 1.0)
            reversed_within = ca.logic_and(earlier * later < 0.0, passed < 1.0)
            shifted += (ca.if_else(reversed_within, -earlier, earlier) - later) * _until(passed, phase)
        return signal + shifted - build.command


def _until(end: Any, phase: Any) -> Any:
    """The polynomial in the phase that has the moments of a 1 until `end` and a 0 from there on, and is `end` at 1."""
    at_end, here = _legendre(end, MOMENTS), _legendre(phase, MOMENTS)
    terms = (here[n] * (at_end[n + 1] - at_end[n - 1]) / 2 for n in range(1, MOMENTS))
    # All polynomials are 1 at 1, so that the sum there telescopes; the last one has none of the moments.
    return sum(terms, start=end) + here[MOMENTS] * (end - (at_end[MOMENTS - 1] + at_end[MOMENTS]) / 2)


def _legendre(x: Any, degree: int) -> list[Any]:
    """Legendre polynomials on 0 to 1 by their recurrence."""
    found = [1.0, 2 * x - 1]
    for n in range(1, degree):
        found.append(((2 * n + 1) * (2 * x - 1) * found[n] - n * found[n - 1]) / (n + 1))
    return found

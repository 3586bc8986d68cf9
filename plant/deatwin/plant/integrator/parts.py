"""Division of a sample into two parts, each solved in its own step, at a place that depends on parameters.

Each step takes half of the sample's width, and the clock runs faster or slower, so no width depends on a parameter:
t = t_k + h theta(p), where theta is 2 s p in the first part (share s, phase p), and s + (1 - s)(2 p - 1) in the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca

Symbol = Any  # casadi.SX

LEAST = 1e-9  # Least share of a part; in a part without width, a state without inertia would be free


class Step(NamedTuple):
    """A step over a sample or half of it."""

    begin: Any  # Start, s
    middle: Any  # Middle, s, which identifies the half, because the ends may lie on a border
    width: Any


def halves(begin: Any, width: Any) -> tuple[Step, Step]:
    """Return the two steps of a divided sample, which starts at `begin` and lasts `width`, s."""
    half = width / 2
    return Step(begin, begin + width / 4, half), Step(begin + half, begin + 3 * width / 4, half)


@dataclass(frozen=True, kw_only=True, eq=False)
class Parts:
    """A sample that is divided into two parts."""

    first: Symbol  # Share of the first part, 0 to 1
    start: Symbol
    middle: Symbol
    width: Symbol

    @property
    def in_first(self) -> Symbol:
        """True if the present step is in the first part."""
        return self.middle - self.start < self.width / 2

    @property
    def _in_step(self) -> Symbol:
        """True if a step is being taken, rather than the equations being evaluated after one."""
        return self.middle - self.start < self.width

    @property
    def speed(self) -> Symbol:
        """Speed of the clock relative to the time of the step."""
        share = self._share
        return ca.if_else(self._in_step, 2 * ca.if_else(self.in_first, share, 1 - share), 1.0)

    def clock(self, time: Symbol) -> Symbol:
        """Return the clock time, s, at a `time` within the step, s."""
        share, phase = self._share, (time - self.start) / self.width
        passed = ca.if_else(self.in_first, 2 * share * phase, share + (1 - share) * (2 * phase - 1))
        return ca.if_else(self._in_step, self.start + self.width * passed, time)

    @property
    def _share(self) -> Symbol:
        return LEAST + (1 - 2 * LEAST) * self.first

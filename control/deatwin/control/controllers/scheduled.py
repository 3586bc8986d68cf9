"""A controller with several linear laws, one for each operating point; the present command selects among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import each, instance, numbers, require_fields
from deatwin.control.controllers.base import Controller, require_factor
from deatwin.control.controllers.law import READING, REFERENCE, Law
from deatwin.control.errors import ControlError
from deatwin.ident.arguments import keep_read_only, read_only
from deatwin.plant.arrays import Array

_ROUNDING = 1e-9  # Rounding error of the equations of rest, in units of the states' steps


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduledController(Controller):
    """Gain-scheduled controller: laws at several operating inputs, interpolated at the smoothed command.

    The smoothed command s is the command u after a first-order lag with the closed-loop time T:
    ``s(k+1) = s(k) + (h/T) (u(k) - s(k))``, where h is the sampling time. Without smoothing, the command could jump
    from limit to limit if the gains of the laws differ much.

    All laws have the same state of rest: while reading and reference are equal and constant, the same state gives the
    same command in each law. The interpolation therefore does not change the command at rest.

    Parameters
    ----------
    name, sample_time, operating_input, operating_output, command_min, command_max, closed_loop_time
        See `Controller`.
    points : ndarray, shape (m,)
        Operating inputs of the laws, increasing, in the input's unit.
    laws : tuple of Law
        One law for each operating input. The laws of `PidGains.law` have the same state of rest.
    windup : ndarray, shape (m, n) or (n,)
        Anti-windup gains as in `LinearController`: one row for each law, or the same n gains for all laws.

    Raises
    ------
    ControlError
        If there are fewer than two points, if the points do not increase, if the laws differ in the number of states or
        in the state of rest, or if the states would diverge while the command is at a limit.

    References
    ----------
    W. J. Rugh and J. S. Shamma, "Research on gain scheduling", Automatica 36 (2000) 1401-1425: why the schedule
    must not change the command at rest ("hidden coupling").
    """

    points: Array
    laws: tuple[Law, ...]
    windup: Array

    kind = "scheduled"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_fields(self, points=numbers, laws=each(instance(Law)), windup=numbers)
        keep_read_only(self, "points", "windup")
        if self.windup.ndim == 1:
            object.__setattr__(self, "windup", read_only(np.tile(self.windup, (self.points.size, 1))))
        increasing = np.isfinite(self.points).all() and np.all(np.diff(self.points) > 0.0)
        if self.points.size < 2 or not increasing or self.points.size != len(self.laws):
            raise ControlError(f"a schedule needs two or more increasing points, a law at each; got {self.points}")
        first = self.laws[0]
        if any(law.c.size != first.c.size for law in self.laws):
            counts = ", ".join(f"{law.c.size} at {point:g}" for law, point in zip(self.laws, self.points, strict=True))
            raise ControlError(f"the laws of a schedule must have one structure; they have as states {counts}")
        shape = (self.points.size, first.c.size)
        if self.windup.shape != shape:
            raise ControlError(f"windup has the shape {self.windup.shape}: it must be {shape}, a row for each law")
        if not np.isfinite(self.windup).all():
            raise ControlError("windup must be finite")
        for law, point, windup in zip(self.laws, self.points, self.windup, strict=True):
            if not _rest_alike(first, law):
                raise ControlError(
                    f"the laws of a schedule must hold the same command with the same states at rest; that at "
                    f"{point:g} differs from that at {self.points[0]:g}: schedule PI or PID laws"
                )
            held = np.abs(np.linalg.eigvals(law.a - np.outer(windup, law.c))).max(initial=0.0)
            if not held < 1.0:
                raise ControlError(f"at a limit the states would drift away at {point:g} (eigenvalue {held:.4g})")

    @property
    def states(self) -> int:
        """Number of states: the states of one law, and the smoothed command."""
        return int(self.laws[0].c.size) + 1

    def start(self) -> Array:
        """State at the moment at which the loop is closed: zeros, then the operating input, shape (states,)."""
        return np.append(np.zeros(self.states - 1), self.operating_input)

    def command(self, reference: ArrayLike, reading: ArrayLike, state: Array) -> tuple[Array, Array]:
        x, smooth = state[:-1], state[-1]
        asked, seen = np.asarray(reference) - self.operating_output, np.asarray(reading) - self.operating_output
        a, b, c, d, windup = self._at(smooth)
        wanted = self.operating_input + (c * x).sum(axis=0) + d[REFERENCE] * asked + d[READING] * seen
        applied = np.minimum(np.maximum(wanted, self.command_min), self.command_max)
        moved = (a * x).sum(axis=1) + b[:, REFERENCE] * asked + b[:, READING] * seen
        after = moved + windup * (applied - wanted)
        smooth = smooth + min(self.sample_time / self.closed_loop_time, 1.0) * (applied - smooth)
        return applied, np.concatenate([after, smooth[None]])

    def local(self, operating_input: float) -> Law:
        """Return the law interpolated at an `operating_input`; beyond the points, the first or last law."""
        a, b, c, d, _ = self._at(np.asarray(operating_input, dtype=np.float64))
        return Law(a=a, b=b, c=c, d=d)

    def scaled(self, factor: float) -> Self:
        require_factor(factor)
        laws = tuple(law.scaled(factor) for law in self.laws)
        return replace(self, laws=laws, windup=self.windup / factor)

    def details(self) -> dict[str, Any]:
        return {
            "points": self.points.tolist(),
            "laws": [law.to_dict() for law in self.laws],
            "windup": self.windup.tolist(),
        }

    @classmethod
    def from_details(cls, common: Mapping[str, Any], details: Mapping[str, Any]) -> Self:
        laws = tuple(Law.from_dict(law) for law in details["laws"])
        points, windup = (np.array(details[name], dtype=float) for name in ("points", "windup"))
        return cls(**common, points=points, laws=laws, windup=windup)

    @cached_property
    def _tables(self) -> tuple[Array, ...]:
        """Return A, B, C, D and L of all laws, points last: (n, n, m), (n, 2, m), (n, m), (2, m) and (n, m)."""
        laws = tuple(np.stack([getattr(law, name) for law in self.laws], axis=-1) for name in ("a", "b", "c", "d"))
        return (*laws, self.windup.T)

    def _at(self, command: Array) -> tuple[Array, ...]:
        """Return A, B, C, D and L at given commands; the last axes have the shape of the commands."""
        inside = np.clip(command, self.points[0], self.points[-1])
        place = np.clip(np.searchsorted(self.points, inside, side="right") - 1, 0, self.points.size - 2)
        share = (inside - self.points[place]) / (self.points[place + 1] - self.points[place])
        return tuple(t[..., place] + share * (t[..., place + 1] - t[..., place]) for t in self._tables)


def _rest_alike(first: Law, other: Law) -> bool:
    """Return whether two laws have the same states of rest, and the same commands there, at equal references."""
    units = np.maximum(np.abs(first.b).max(axis=1), np.abs(other.b).max(axis=1))
    units[units == 0.0] = 1.0  # states differ by many orders of magnitude
    manifolds = []
    for law in (first, other):
        # Equations of rest in (x, r), (A - 1) x + (B_r + B_y) r = 0, and the command at rest.
        steps = np.column_stack([law.a - np.eye(units.size), law.b.sum(axis=1)])
        command = np.append(law.c, law.d.sum())
        scales = np.append(units, 1.0)
        manifolds.append((steps * scales / units[:, None], command * scales))
    (steps, command), (others, its) = manifolds
    _, sizes, vectors = np.linalg.svd(steps)
    rank = np.count_nonzero(sizes > _ROUNDING)
    at_rest = vectors[rank:].T
    if rank != np.count_nonzero(np.linalg.svd(others, compute_uv=False) > _ROUNDING):
        return False
    if np.abs(others @ at_rest).max(initial=0.0) > _ROUNDING:
        return False
    size = max(np.abs(command).max(), np.abs(its).max())
    return bool(np.abs((command - its) @ at_rest).max(initial=0.0) <= _ROUNDING * size)

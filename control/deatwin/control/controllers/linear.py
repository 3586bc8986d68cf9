"""A linear law with limits and anti-windup: PI, PID, LQG and H-infinity controllers are of this kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import instance, numbers, require_fields
from deatwin.control.controllers.base import Controller, require_factor
from deatwin.control.controllers.law import READING, REFERENCE, Law
from deatwin.control.errors import ControlError
from deatwin.ident.arguments import keep_read_only
from deatwin.plant.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearController(Controller):
    """Linear controller ``v = u_0 + C x + D w``, ``u = v`` within the limits, ``x(k+1) = A x + B w + L (u - v)``.

    w = (reference, reading) are deviations from the operating output. x is the state, v the wanted command, u the
    applied command, and u_0 the operating input. At a limit, the term L (u - v) makes the state follow the applied
    command (back-calculation).

    Parameters
    ----------
    name, sample_time, operating_input, operating_output, command_min, command_max, closed_loop_time
        See `Controller`.
    law : Law
        Linear law with matrices A, B, C and D.
    windup : ndarray, shape (n,)
        Anti-windup gain L. All eigenvalues of A - L C must lie inside the unit circle; otherwise the states would
        diverge while the command is at a limit.

    Raises
    ------
    ControlError
        If the shapes do not match, or an eigenvalue of A - L C does not lie inside the unit circle.

    References
    ----------
    Åström & Wittenmark, Computer-Controlled Systems (3rd ed. 1997), section 3.5: observers and anti-windup.
    """

    law: Law
    windup: Array

    kind = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_fields(self, law=instance(Law), windup=numbers)
        keep_read_only(self, "windup")
        if self.windup.shape != self.law.c.shape:
            raise ControlError(f"windup has the shape {self.windup.shape}: it must be {self.law.c.shape}")
        if not np.isfinite(self.windup).all():
            raise ControlError("windup must be finite")
        held = np.abs(np.linalg.eigvals(self.law.a - np.outer(self.windup, self.law.c))).max(initial=0.0)
        if not held < 1.0:
            raise ControlError(f"at a limit the controller's states would drift away (eigenvalue {held:.4g})")

    @property
    def states(self) -> int:
        """Number of states."""
        return int(self.law.c.size)

    def start(self) -> Array:
        """State at the moment at which the loop is closed: zeros, shape (states,)."""
        return np.zeros(self.states)

    def command(self, reference: ArrayLike, reading: ArrayLike, state: Array) -> tuple[Array, Array]:
        law, x = self.law, np.asarray(state)
        asked, seen = np.asarray(reference) - self.operating_output, np.asarray(reading) - self.operating_output
        wanted = self.operating_input + np.tensordot(law.c, x, 1) + law.d[REFERENCE] * asked + law.d[READING] * seen
        applied = np.minimum(np.maximum(wanted, self.command_min), self.command_max)
        after = np.tensordot(law.a, x, 1) + (
            np.multiply.outer(law.b[:, REFERENCE], asked)
            + np.multiply.outer(law.b[:, READING], seen)
            + np.multiply.outer(self.windup, applied - wanted)
        )
        return applied, after

    def local(self, operating_input: float) -> Law:
        """Return the linear law, which is the same at every `operating_input`."""
        return self.law

    def scaled(self, factor: float) -> Self:
        require_factor(factor)
        return replace(self, law=self.law.scaled(factor), windup=self.windup / factor)

    def details(self) -> dict[str, Any]:
        return {"law": self.law.to_dict(), "windup": self.windup.tolist()}

    @classmethod
    def from_details(cls, common: Mapping[str, Any], details: Mapping[str, Any]) -> Self:
        law = Law.from_dict(details["law"])
        return cls(**common, law=law, windup=np.array(details["windup"], dtype=float))

"""Outcomes of a calibration."""

from __future__ import annotations

from enum import Enum


class FitStatus(Enum):
    """Outcome of a calibration. The value of each member is a message for the user."""

    SETTLED = "the fit settled"
    STOPPED = "the fit stopped before its minimum: its parameters may still change"
    INTERRUPTED = "the fit was interrupted: its parameters are the best that had been found"
    UNSETTLED = (
        "the fit stopped where its gradient is not small: start it elsewhere, or continue with a smaller tolerance"
    )
    OTHER_MINIMA = (
        "the error has several minima, and only one of the starts reached the smallest error found: "
        "give starting values that are nearer, or more starts"
    )
    EQUAL_MINIMA = (
        "other values of the parameters leave the same error: narrow their ranges, or write the equations so that only "
        "one of them is possible"
    )
    GIVEN_UP = "the fit was abandoned: even its linearised minimum leaves a far larger error than another fit does"
    IMPOSSIBLE = "the plant cannot be simulated at its starting values: it pulls in or finds no state of rest"

    @property
    def ok(self) -> bool:
        """False only if the plant cannot be simulated, so that there is no fit."""
        return self is not FitStatus.IMPOSSIBLE

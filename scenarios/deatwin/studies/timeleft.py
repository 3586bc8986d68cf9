"""Estimate the remaining time of work from the completed share."""

from __future__ import annotations

import time
from collections.abc import Callable

_GROWTH = 1.25  # Largest ratio of an estimate to the one before, so that a reader who plans by it is not set back
_KNOWN = 0.05  # Share of the work after which its pace is known
_KEPT = 5.0  # Least time between two increases of an estimate, s: on a terminal, each look would increase it


class TimeLeft:
    """An estimate of the remaining time, from the mean pace so far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._share = 0.0
        self._first: tuple[float, float] | None = None  # work done by an earlier run took none of this run's time
        self._told: tuple[float, float] | None = None  # time and value of the last estimate, s

    def tell(self, share: float) -> None:
        """Update with the completed share."""
        if self._first is None:
            self._first = (self._clock(), share)
        self._share = share

    @property
    def seconds(self) -> float | None:
        """Seconds left; None before the pace is known."""
        if self._first is None:
            return None
        now, (began, before) = self._clock(), self._first
        done = self._share - before
        if done <= 0.0 or done < _KNOWN * (1.0 - before):
            return None
        estimate = (now - began) * (1.0 - self._share) / done
        told = (now, estimate) if self._told is None else self._told
        if now - told[0] < _KEPT:
            self._told = (told[0], min(estimate, told[1]))
        else:
            self._told = (now, min(estimate, _GROWTH * told[1]))
        return self._told[1]

    @property
    def text(self) -> str:
        """The estimate in words; empty when nothing remains."""
        if self._share > 1.0 - 1e-9:  # sums of shares are rounded
            return ""
        seconds = self.seconds
        return "a few minutes left" if seconds is None else f"about {duration_in_words(seconds)} left"


def duration_in_words(seconds: float) -> str:
    """Write a time in a suitable unit."""
    minutes = seconds / 60
    if minutes >= 180:
        return f"{minutes / 60:.0f} h"
    return f"{minutes:.0f} min" if minutes >= 1.5 else f"{max(seconds, 1):.0f} s"

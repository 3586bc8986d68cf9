"""Estimate the remaining time of work from the completed share."""

from __future__ import annotations

import time
from collections.abc import Callable

_GROWTH = 1.25  # An estimate is at most so many times the one before: a reader who plans by it is not sent back
_KNOWN = 0.05  # Share of the work after which its pace is known
_KEPT = 5.0  # An estimate grows at most once in so many seconds: on a terminal it would grow with each look


class TimeLeft:
    """An estimate of the remaining time, from the mean pace so far."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._share = 0.0
        self._first: tuple[float, float] | None = None  # work that an earlier run did took no time of this one
        self._told: tuple[float, float] | None = None  # when, and the seconds that were told

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
        if self._share > 1.0 - 1e-9:  # sums of shares round
            return ""
        seconds = self.seconds
        return "some minutes left" if seconds is None else f"about {duration_in_words(seconds)} left"


def duration_in_words(seconds: float) -> str:
    """Write a time in a suitable unit."""
    minutes = seconds / 60
    if minutes >= 180:
        return f"{minutes / 60:.0f} h"
    return f"{minutes:.0f} min" if minutes >= 1.5 else f"{max(seconds, 1):.0f} s"

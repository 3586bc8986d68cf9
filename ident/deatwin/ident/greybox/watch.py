"""Track the progress of a calibration, and end it by an interrupt without losing its result."""

from __future__ import annotations

from collections.abc import Callable

from deatwin.plant.interrupts import obey

Progress = Callable[[float, str], None]  # Called with the completed share, 0 to 1, and the current work
_STAGE = 1 / 3  # Share of the remaining work that a further fit takes: a search usually consists of about three fits
_USUAL = 8  # Simulations after which a fit is reported as half done; most settle in ten to fifteen


class Watch:
    """Counts simulations, reports progress, and raises an interrupt that CasADi did not pass on."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._left, self._within, self._count, self._doing = 1.0, 0, 0, ""

    def begin(self, doing: str) -> None:
        """Begin the next fit."""
        self._left *= 1.0 - _STAGE if self._doing else 1.0
        self._within, self._doing = 0, doing

    def __call__(self) -> None:
        """Count a simulation."""
        obey()
        self._within += 1
        self._count += 1
        done = self._within / (self._within + _USUAL)
        self._progress(1.0 - self._left * (1.0 - _STAGE * done), f"{self._doing}, {self._count} simulations")


def unwatched() -> Watch:
    """Return a watch that reports to nobody."""
    return Watch(lambda share, doing: None)

"""Ctrl-C that is not lost: CasADi drops one that comes while it converts arguments, and the work would go on."""

from __future__ import annotations

import signal

__all__ = ["obey"]


def obey() -> None:
    """Raise the interrupt that was asked for and has not ended the work.

    Raises
    ------
    KeyboardInterrupt
        If the program's handler of SIGINT has an event `asked`, and that is set.
    """
    asked = getattr(signal.getsignal(signal.SIGINT), "asked", None)
    if asked is not None and asked.is_set():
        raise KeyboardInterrupt

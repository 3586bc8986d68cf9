"""Ctrl-C that is not lost: CasADi drops one that comes while it converts arguments, and the work would go on."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["heard", "obey"]

_ASKED = threading.Event()


@contextmanager
def heard() -> Iterator[None]:
    """Remember Ctrl-C while a command runs, where it is what ends a program of Python; it is raised as ever."""
    _ASKED.clear()
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def obey() -> None:
    """Raise what was asked for and has not ended the work.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C came since the command began.
    """
    if _ASKED.is_set():
        raise KeyboardInterrupt


def _remember(number: int, frame: FrameType | None) -> None:
    _ASKED.set()
    signal.default_int_handler(number, frame)

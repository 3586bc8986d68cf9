"""Ctrl-C that is remembered, for `deatwin.plant.interrupts.obey`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["heard"]


class _Remembering:
    """Python's own handler of SIGINT, with an event that tells that it was called."""

    def __init__(self) -> None:
        self.asked = threading.Event()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked.set()
        signal.default_int_handler(number, frame)


@contextmanager
def heard() -> Iterator[None]:
    """Remember Ctrl-C while a command runs, where it is what ends a program of Python; it is raised as ever.

    What CasADi makes of one ends the command as that does.
    """
    ours = threading.current_thread() is threading.main_thread()
    if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _Remembering())
    try:
        yield
    except Exception:
        from deatwin.plant.interrupts import obeying  # which comes with numpy: help does without

        with obeying():
            raise
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)

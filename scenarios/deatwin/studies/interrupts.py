"""Remember Ctrl-C and the signal of a batch system, for `deatwin.plant.interrupts.obey`."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

ORDINARY: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
"""Signals that end a Python program, and Python's own handlers of them."""


class _Remembering:
    """Python's handler of SIGINT, which also sets an event."""

    def __init__(self) -> None:
        self.asked = threading.Event()

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self.asked.set()
        signal.default_int_handler(number, frame)


@contextmanager
def forward_signals(*signals: signal.Signals) -> Iterator[None]:
    """Remember Ctrl-C while a command runs, if Python handles it; it is raised as usual."""
    ours = threading.current_thread() is threading.main_thread()
    taken = [s for s in signals or (signal.SIGINT,) if ours and signal.getsignal(s) is ORDINARY[s]]
    handler, hook, of_threads = _Remembering(), sys.unraisablehook, threading.excepthook
    running: list[threading.Thread] = []  # when this context ended after an interrupt

    def unraisable(told: Any) -> None:
        if told.exc_type is not KeyboardInterrupt:  # one that a callback swallows is remembered by the handler
            hook(told)

    def in_a_thread(told: threading.ExceptHookArgs) -> None:
        # After an interrupt, threads fail that still send jobs to the ended workers. A session may go on with others.
        if not handler.asked.is_set() or (running and told.thread not in running):
            of_threads(told)

    if taken:
        sys.unraisablehook, threading.excepthook = unraisable, in_a_thread
    for number in taken:
        signal.signal(number, handler)
    try:
        yield
    except Exception:
        from deatwin.plant.interrupts import obeying  # imports numpy, which help does not need

        with obeying():
            raise
    finally:
        if taken:
            sys.unraisablehook = hook
            if handler.asked.is_set():
                running += threading.enumerate()
            else:
                threading.excepthook = of_threads
        if handler.asked.is_set() and (parallel := sys.modules.get("deatwin.ident.parallel")):
            parallel.end_workers()
        for number in taken:
            signal.signal(number, ORDINARY[number])

"""Ctrl-C and SIGTERM that are not lost: CasADi drops one that comes while it converts, and the work would go on, or
makes an error of it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = (signal.SIGINT, signal.SIGTERM)  # Signals from a terminal, and from a batch system that is about to kill
MISTAKEN = (SystemError, NotImplementedError)
"""Errors that CasADi's wrappers raise if an interrupt comes while a matrix is converted."""


def obey() -> None:
    """Raise a requested interrupt that has not ended the work yet."""
    for number in ENDING:
        asked = getattr(signal.getsignal(number), "asked", None)
        if asked is not None and asked.is_set():
            raise KeyboardInterrupt


@contextmanager
def obeying() -> Iterator[None]:
    """Convert an error that CasADi made of an interrupt back to that interrupt."""
    try:
        yield
    except MISTAKEN:
        obey()
        raise


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while workers start, which inherit a mask; this process receives it at the end."""
    # This thread's mask is not enough: another may take the signal, and Python raises it in the main thread.
    asked: list[int] = []
    handler = signal.getsignal(signal.SIGINT)
    handled = callable(handler) and threading.current_thread() is threading.main_thread()
    if handled:
        signal.signal(signal.SIGINT, lambda number, frame: asked.append(number))
    try:
        with _masked():
            yield
    finally:
        if handled:
            signal.signal(signal.SIGINT, handler)
        if asked:
            signal.raise_signal(signal.SIGINT)


@contextmanager
def _masked() -> Iterator[None]:
    """Block Ctrl-C in this thread, and in threads and processes that it starts."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # started before, because its start would let the signal through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the parent process, in workers whose mask does not block it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

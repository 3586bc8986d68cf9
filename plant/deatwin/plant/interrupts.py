"""Ctrl-C and SIGTERM that are not lost: CasADi drops one that comes while it converts, and the work would go on, or
makes an error of it."""

from __future__ import annotations

import signal
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
    """Hold Ctrl-C back while workers start, and the threads that start more of them: they inherit the mask, so that
    they never receive it; this process receives it at the end."""
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

"""Ctrl-C and SIGTERM that are not lost: CasADi drops one that comes while it converts, and the work would go on, or
makes an error of it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals of a terminal, and of a batch system that is about to kill."""
MISTAKEN = (SystemError, NotImplementedError)
"""Errors that CasADi's wrappers raise if an interrupt comes while a matrix is converted."""


def obey() -> None:
    """Raise the interrupt that was requested but has not ended the work."""
    for number in ENDING:
        asked = getattr(signal.getsignal(number), "asked", None)
        if asked is not None and asked.is_set():
            raise KeyboardInterrupt


@contextmanager
def obeying() -> Iterator[None]:
    """Turn an error that CasADi made of an interrupt back into that interrupt."""
    try:
        yield
    except MISTAKEN:
        obey()
        raise

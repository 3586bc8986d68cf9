"""Ctrl-C that is not lost: CasADi drops one that comes while it converts, and the work would go on, or makes an error
of it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["obey", "obeying"]

MISTAKEN = (SystemError, NotImplementedError)
"""What CasADi's wrappers raise where an interrupt comes while a matrix is converted."""


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


@contextmanager
def obeying() -> Iterator[None]:
    """Let what CasADi makes of an interrupt be that interrupt.

    Raises
    ------
    KeyboardInterrupt
        As `obey` does, in place of an error of that kind.
    """
    try:
        yield
    except MISTAKEN:
        obey()
        raise

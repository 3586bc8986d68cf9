"""Ctrl-C that is not lost: CasADi drops one that comes while it converts, and the work would go on, or makes an error
of it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["obey", "obeying"]


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
    """Let an error that comes after an interrupt was asked for be that interrupt.

    Raises
    ------
    KeyboardInterrupt
        As `obey` does, in place of any `Exception`.
    """
    try:
        yield
    except Exception:
        obey()
        raise

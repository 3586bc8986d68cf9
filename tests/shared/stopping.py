"""Ctrl-C: a function in whose place it comes, and a progress that interrupts the work that tells it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn


def interrupted(*_: object, **__: object) -> NoReturn:
    raise KeyboardInterrupt


class StopAt:
    """Ctrl-C at the call of a number, or at the first whose last word meets a condition; `told` holds all calls."""

    def __init__(self, when: int | Callable[[str], bool]) -> None:
        self.when, self.told = when, []  # type: ignore[var-annotated]

    def __call__(self, *words: object) -> None:
        self.told.append(words)
        if len(self.told) == self.when if isinstance(self.when, int) else self.when(str(words[-1])):
            raise KeyboardInterrupt

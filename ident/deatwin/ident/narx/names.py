"""Names of signals in written terms: those of the recording, and u1, u2, y1 by position."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from deatwin.plant.errors import ModelError, nearest

_NAMED = re.compile(r"\s*\*?\s*([^\W\d][^()*^|]*?)\s*\(\s*k\s*(?:-\s*\d+\s*)?\)")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_WORD = re.compile(r"[^\W\d]\w*")
# Names that recordings and models give to signals if the user gave none.
_UNTOLD = re.compile(r"(input|output)(_?\d+)?|command|displacement")


@dataclass(frozen=True)
class SignalNames:
    """Names of the signals in a term."""

    inputs: tuple[str, ...] = ()  # Names of the channels; empty if only names by position are understood
    outputs: tuple[str, ...] = ()

    @cached_property
    def _signals(self) -> dict[str, list[tuple[str, int]]]:
        """Return kind and channel of all signals with a name."""
        found: dict[str, list[tuple[str, int]]] = {}
        for kind, names in (("u", self.inputs), ("y", self.outputs)):
            for number, name in enumerate(names, start=1):
                found.setdefault(name, []).append((kind, number if len(names) > 1 else 0))
        return found

    @cached_property
    def factor(self) -> re.Pattern[str]:
        """Pattern of a factor of a term; its groups are name, or kind and channel, then lag and power."""
        longest_first = sorted((name for name in self._signals if name), key=len, reverse=True)
        name = "|".join(map(re.escape, longest_first)) or "(?!)"
        return re.compile(rf"\s*\*?\s*(?:({name})|([yue])(\d*))\(\s*k\s*(?:-\s*(\d+)\s*)?\)(?:\s*\^\s*([1-9]\d*))?\s*")

    function = re.compile(r"\s*\*?\s*(?:\||([^\W\d]\w*)\s*\((?!\s*k\s*[-)]))")
    """Opening of a function, with its name; none for |...|."""
    minus = re.compile(r"\s*-")

    @staticmethod
    def closing(name: str | None) -> re.Pattern[str]:
        """Pattern of the end of a function: the numbers after commas, and the power."""
        end = r"\|()" if name is None else rf"((?:\s*,\s*{_NUMBER})*)\s*\)"
        return re.compile(rf"\s*{end}(?:\s*\^\s*([1-9]\d*))?\s*")

    def signal(self, name: str) -> tuple[str, int]:
        """Return kind and channel of the signal with a name."""
        kind, channel = self._signals[name][0]
        if len(self._signals[name]) > 1:
            placed = ", ".join(f"{kind}{channel or ''}" for kind, channel in self._signals[name])
            raise ModelError(f"{name!r} names several signals; give them different names, which {placed} have now")
        return kind, channel

    def unread(self, text: str, position: int) -> str:
        """Return a message on what is wrong at a position of a term."""
        named = _NAMED.match(text, position)
        if named is None or not self._signals:
            return (
                f"cannot read the term {text[:80]!r} from {text[position : position + 20]!r} on; "
                "write terms as 1, y(k-1), y(k-1)u(k-2)^2 or |u(k-1)|"
            )
        sides = {
            side: ", ".join(
                name if name == f"{kind}{number}" else f"{name} (or {kind}{number})"
                for name, number in zip(names, _numbers(names), strict=True)
            )
            for side, kind, names in (("inputs", "u", self.inputs), ("outputs", "y", self.outputs))
        }
        return (
            f"the term {text[:80]!r} names the signal {named.group(1)[:40]!r}; there are "
            + ", ".join(f"{side}: {names or 'none'}" for side, names in sides.items())
            + nearest(named.group(1), self._signals)
        )


def symbols_of(input_names: Sequence[str], output_names: Sequence[str]) -> dict[tuple[str, int], str]:
    """Return a model's signal symbols by kind and row: distinct user-given words, else u1, y1, ... by position."""
    placed = {
        (kind, row): f"{kind}{number}"
        for kind, names in (("y", output_names), ("u", input_names), ("e", output_names))
        for row, number in enumerate(_numbers(names))
    }
    told = dict(placed)
    for kind, names in (("y", output_names), ("u", input_names)):
        if all(_WORD.fullmatch(name) for name in names) and not all(_UNTOLD.fullmatch(name) for name in names):
            told |= {(kind, row): name for row, name in enumerate(names)}
    return told if len(set(told.values())) == len(told) else placed


def _numbers(names: Sequence[str]) -> list[str]:
    """Return a number for each of several channels; a single channel gets none."""
    return [str(number) for number in range(1, len(names) + 1)] if len(names) > 1 else [""] * len(names)

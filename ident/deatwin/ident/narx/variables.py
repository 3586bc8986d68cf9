"""Names of signals, lagged signals and functions of them: the factors of terms, written and read."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, total_ordering

from deatwin.ident.narx.shapes import Shape
from deatwin.plant.arrays import Array
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


_KINDS = "yue"  # kinds of signals in the order in which factors are written

MOST_CHANNELS, MOST_LAG, MOST_POWER = 1000, 100_000, 100
"""Largest numbers in a written term: a larger one is a mistake, and its model would need gigabytes."""


@total_ordering
@dataclass(frozen=True, slots=True)
class Variable:
    """Lagged signal, such as y(k-1), or a function of a lagged signal, such as |u(k-1)|.

    Parameters
    ----------
    kind : str
        Kind of the signal: "y" for an output, "u" for an input, "e" for the noise of an output.
    channel : int
        Number of the channel from 1; 0 for a single channel, which is written u or y instead of u1 or y1.
    lag : int
        Delay in samples, at least 0 for an input and at least 1 otherwise.
    shape : Shape, optional
        Function of the lagged signal; the signal itself if omitted.
    """

    kind: str
    channel: int
    lag: int
    shape: Shape | None = None

    @property
    def index(self) -> int:
        """Row of the channel in ``Recording.inputs`` or ``Recording.outputs``."""
        return max(self.channel - 1, 0)

    @property
    def reach(self) -> int:
        """Largest lag of the signal that the variable depends on, in samples."""
        return self.lag + (0 if self.shape is None else self.shape.difference)

    @property
    def _key(self) -> tuple[object, ...]:
        return _KINDS.index(self.kind), self.channel, self.lag, () if self.shape is None else (self.shape,)

    def __lt__(self, other: Variable) -> bool:
        return self._key < other._key

    @property
    def symbol(self) -> str:
        """Symbol of the signal without its lag, such as y or u2."""
        return f"{self.kind}{self.channel or ''}"

    def written(self, symbol: str) -> str:
        """Return the variable as text with another `symbol` for its signal."""
        return symbol + _delay(self.lag) if self.shape is None else self.shape.written(symbol, _delay, self.lag)

    def __str__(self) -> str:
        return self.written(self.symbol)


def _delay(lag: int) -> str:
    """Write a lag, such as (k-1)."""
    return f"(k-{lag})" if lag else "(k)"


def read_factor(text: str, position: int, names: SignalNames) -> tuple[Variable, int, int]:
    """Read a factor of a term; also return its power and where the next factor begins."""
    opened = names.function.match(text, position)
    if opened is None:
        return _signal(text, position, names)
    variable, inner, position = _signal(text, opened.end(), names)
    difference = 0
    if minus := names.minus.match(text, position):
        earlier, _, position = _signal(text, minus.end(), names)
        difference = earlier.lag - variable.lag
        if (earlier.kind, earlier.channel) != (variable.kind, variable.channel) or difference < 1:
            raise ModelError(
                f"term {text[:80]!r}: a function takes the difference of one signal and an earlier sample of it, as "
                "sign(y(k-1)-y(k-2))"
            )
    closed = names.closing(opened.group(1)).match(text, position)
    if closed is None or inner > 1 or variable.kind == "e":
        raise ModelError(names.unread(text, position))
    numbers = [float(number) for number in (closed.group(1) or "").split(",")[1:]]
    shape = Shape.of(opened.group(1) or "abs", numbers, difference)
    return replace(variable, shape=shape), _bounded(text, closed.group(2), MOST_POWER, "power") or 1, closed.end()


def _signal(text: str, position: int, names: SignalNames) -> tuple[Variable, int, int]:
    """Read a lagged signal with its power."""
    match = names.factor.match(text, position)
    if match is None:
        raise ModelError(names.unread(text, position))
    name, kind, number, lag, power = match.groups()
    position_of, delay = _bounded(text, number, MOST_CHANNELS, "channel"), _bounded(text, lag, MOST_LAG, "lag")
    kind, channel = names.signal(name) if name else (kind, position_of)
    if kind != "u" and delay < 1:
        held = "output" if kind == "y" else "noise"
        raise ModelError(f"term {text!r} holds the {held} at the present sample; its lag must be at least 1")
    return Variable(kind, channel, delay), _bounded(text, power, MOST_POWER, "power") or 1, match.end()


def _bounded(text: str, digits: str | None, most: int, what: str) -> int:
    """Read a number of a term; 0 if it is omitted."""
    if len(digits or "") > 6 or int(digits or 0) > most:
        raise ModelError(f"term {text[:80]!r}: a {what} is above {most}")
    return int(digits or 0)


def argument_of(variable: Variable, lagged: Callable[[Variable, int], Array]) -> Array:
    """Return the argument of a variable's function: its signal, or a difference of the signal."""
    now = lagged(variable, variable.lag)
    return now if variable.reach == variable.lag else now - lagged(variable, variable.reach)


def value_of(variable: Variable, lagged: Callable[[Variable, int], Array]) -> Array:
    """Return the value of a variable."""
    argument = argument_of(variable, lagged)
    return argument if variable.shape is None else variable.shape.value(argument)

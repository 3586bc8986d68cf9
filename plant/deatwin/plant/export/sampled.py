"""C source of sampled systems: the common code of models, plants and controllers, one file of C99.

With the prefix ``narx``, ``narx_init(state)`` starts at rest, and ``narx_step(state, u, y)`` computes a sample and
returns 0. The code allocates nothing and has no other state, so that several instances can run beside each other.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from string import Template
from textwrap import wrap

import numpy as np
from numpy.typing import ArrayLike

from deatwin.plant.errors import ModelError

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,40}")
_WIDTH = 116


@dataclass(frozen=True, kw_only=True)
class Signal:
    """An input or output of a system."""

    name: str
    unit: str = ""  # Unit; empty if unknown
    start: float = 0.0  # Value at rest, in `unit`

    def __str__(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True, kw_only=True)
class SampledSource:
    """Sampled system as C source with a step function, which computes one sample per call.

    Parameters
    ----------
    name : str
        Prefix of all names in the source; a valid C identifier.
    text : str
        Content of the C file.
    sample_time : float
        Sample time, s.
    inputs, outputs : tuple of Signal
        Names, units and values at rest of the inputs and outputs, in the order of the arrays ``u`` and ``y`` of the
        step function.
    description : str
        Description of the system in one line.
    has_clock : bool
        True if the C structure of the state has a member ``start``, the clock time of the first sample in s.
    """

    name: str
    text: str
    sample_time: float
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    description: str
    has_clock: bool = False


def require_identifier(name: str) -> str:
    """Return the name if it is a valid prefix of C functions."""
    if not isinstance(name, str) or _IDENTIFIER.fullmatch(name) is None:
        raise ModelError(
            f"{name!r} cannot be a prefix of C names: give a letter, then at most 40 letters, digits and underscores"
        )
    return name


def number(value: float) -> str:
    """Format a number in C so that it reads back as the same number."""
    if not isfinite(value):
        raise ModelError(f"a number of the model is {value}; only finite ones can be written as C")
    return repr(float(value))


def table(declaration: str, values: ArrayLike) -> str:
    """Constant array in C; an empty one gets one entry, since C has no empty arrays."""
    array = np.asarray(values, dtype=np.float64)
    if array.size == 0:
        array = np.zeros(tuple(max(n, 1) for n in array.shape))
    sizes = "".join(f"[{n}]" for n in array.shape)
    head = f"static const {declaration}{sizes} = "
    whole = f"{head}{_braces(array)};"
    return whole if len(whole) <= _WIDTH else "\n    ".join(wrap(whole, _WIDTH - 4, break_long_words=False))


def _braces(array: np.ndarray) -> str:
    inner = map(number, array.tolist()) if array.ndim == 1 else map(_braces, array)
    return "{" + ", ".join(inner) + "}"


def comment(lines: Sequence[str]) -> str:
    """Format lines as a comment of C."""
    safe = [part for line in lines for part in (wrap(line.replace("*/", "* /"), _WIDTH - 3) or [""])]
    return "/* " + "\n * ".join(safe) + "\n */\n"


def filled(template: str, **fields: object) -> str:
    """Fill in a template of C with ``$name`` and ``$NAME``."""
    texts = {key: number(value) if isinstance(value, float) else str(value) for key, value in fields.items()}
    return Template(template).substitute(texts)

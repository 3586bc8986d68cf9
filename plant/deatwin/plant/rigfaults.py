"""Errors in the equations of a user's rig, in one line that names the equation."""

from __future__ import annotations

import re
import traceback
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.errors import RigError
from deatwin.plant.safe_read import clipped

Symbol = Any  # casadi.SX
NUMBERS: tuple[Any, ...] = (int, float, np.number, np.ndarray, ca.DM, ca.SX)
WHERE_IN_CASADI = re.compile(r"^\S*\.(?:cpp|hpp|i):\d+:\s*")


def number(value: Any, what: str) -> Symbol:
    """Return an expression of one number, or raise RigError."""
    if not isinstance(value, NUMBERS):
        kind = "casadi.MX; rigs are written in casadi.SX" if isinstance(value, ca.MX) else type(value).__name__
        raise RigError(f"{what} is of the type {kind}; it must be an expression of what the builder gave, or a number")
    expression = ca.SX(value)
    if expression.shape != (1, 1):
        rows, columns = expression.shape
        raise RigError(f"{what} has {rows} rows and {columns} columns; it must be one number")
    if expression.is_constant() and np.isnan(float(expression)):
        raise RigError(f"{what} is not a number (NaN)")
    return expression


def size(value: Any, what: str) -> float:
    """Return a typical size, or raise RigError."""
    if not isinstance(value, (int, float, np.number)) or not 0.0 < value < np.inf:
        raise RigError(f"{what} is {clipped(value)}; it must be a finite number above 0")
    return float(value)


def unknown_symbols(arguments: Iterable[Symbol], equations: Mapping[str, Symbol]) -> str:
    """Name the equation that contains a symbol on which it may not depend."""
    given = list(arguments)
    if not equations or not _free(given, ca.vertcat(*equations.values())):
        return ""
    for what, value in equations.items():
        if free := _free(given, value):
            return f"{what} depends on {', '.join(map(str, free))}, which it must not: "
    return ""


def _free(arguments: list[Symbol], value: Symbol) -> list[Symbol]:
    return list(ca.Function("equation", arguments, [value], {"allow_free": True}).free_sx())


def in_users_code(error: Exception, what: str) -> RigError:
    """Error of a rig or effect whose own code raised an exception."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if Path(f.filename).parent.name != "casadi"]
    lines = [WHERE_IN_CASADI.sub("", line.strip()) for line in str(error).splitlines() if line.strip()]
    text = clipped(lines[0] if isinstance(error, NotImplementedError) else lines[-1], 200) if lines else ""
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno}: {frames[-1].line})" if frames else ""
    return RigError(f"{what} raised {type(error).__name__}: {text or 'without a word'}{place}")

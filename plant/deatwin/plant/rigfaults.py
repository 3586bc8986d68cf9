"""Report errors in the equations of a user's rig in one line that names the equation."""

from __future__ import annotations

import re
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import RLock
from typing import Any

import casadi as ca
import numpy as np

from deatwin.plant.errors import DeatwinError, RigError
from deatwin.plant.safe_read import clipped

Symbol = Any  # casadi.SX
NUMBERS: tuple[Any, ...] = (int, float, np.number, np.ndarray, ca.DM, ca.SX)
LIBRARIES = {"casadi", "numpy", "scipy"}  # Folders whose code is not the user's
REMEDIES = {
    "truth value": "if, and, or, min and max need a value: use casadi.if_else, fmin and fmax",
    "array element with a sequence": "NumPy needs a number there: use functions of casadi",
}
_WRITING = RLock()
WHERE_IN_CASADI = re.compile(r"^\S*\.(?:cpp|hpp|i):\d+:\s*")


def number(value: Any, what: str) -> Symbol:
    """Return an expression as one number, or raise RigError."""
    if not isinstance(value, NUMBERS):
        kind = "casadi.MX; rigs are written in casadi.SX" if isinstance(value, ca.MX) else type(value).__name__
        raise RigError(f"{what} is of the type {kind}; it must be an expression of what the builder gave, or a number")
    expression = ca.SX(value)
    if expression.shape != (1, 1):
        rows, columns = expression.shape
        raise RigError(f"{what} has {rows} rows and {columns} columns; it must be one number")
    return expression


def known(value: Any, what: str) -> np.ndarray:
    """Return known numbers, shape (n,), or raise RigError."""
    if isinstance(value, ca.SX | ca.MX):
        raise RigError(f"{what} is the expression {clipped(value)}; it must be a number, or a row of numbers")
    try:
        numbers = np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError):
        numbers = np.empty((0, 0))
    if numbers.ndim != 1:
        raise RigError(f"{what} is {clipped(value)}; it must be a number, or a row of numbers")
    if np.isnan(numbers).any():
        raise RigError(f"{what} is not a number (NaN)")
    return numbers


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


def not_a_number(equations: Mapping[str, Symbol]) -> str:
    """Name the equation that contains a constant which is not a number."""
    if not equations or not _has_nan(ca.vertcat(*equations.values())):  # What equations share is looked at once
        return ""
    return next((what for what, value in equations.items() if _has_nan(value)), "")


def _has_nan(value: Symbol) -> bool:
    made = ca.Function("equation", [], [value], {"allow_free": True})
    constants = (k for k in range(made.n_instructions()) if made.instruction_id(k) == ca.OP_CONST)
    return any(np.isnan(made.instruction_constant(k)) for k in constants)


@contextmanager
def users_code(what: str) -> Iterator[None]:
    """Convert any exception from a rig's or effect's code, or from the CasADi and NumPy calls in it, to one line."""
    with _WRITING:
        to_float = ca.SX.__float__

        def strict(value: Symbol) -> float:
            # CasADi would return NaN, and a branch that depends on it would be taken without an error.
            if not value.is_constant():
                raise TypeError("an expression has no value yet, so use functions of casadi for float() and math")
            return float(to_float(value))

        ca.SX.__float__ = strict  # type: ignore[method-assign]
        try:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message=r"\s*casadi: a numpy function", category=FutureWarning)
                yield
        except DeatwinError:
            raise
        except Exception as error:
            raise _in_one_line(error, what) from error
        finally:
            ca.SX.__float__ = to_float  # type: ignore[method-assign]


def _in_one_line(error: Exception, what: str) -> RigError:
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not LIBRARIES & set(Path(f.filename).parts)]
    own = [f for f in frames if Path(f.filename).parent != Path(__file__).parent] or frames
    lines = [WHERE_IN_CASADI.sub("", line.strip()) for line in str(error).splitlines() if line.strip()]
    # If arguments do not fit, CasADi lists those that would, between the fault and the given ones.
    told = dict.fromkeys([lines[0], lines[-1]]) if isinstance(error, NotImplementedError) else lines[-1:]
    text = clipped(" ".join(told), 200).rstrip(".") if lines else "without a word"
    hint = next((f"; {remedy}" for sign, remedy in REMEDIES.items() if sign in text), "")
    place = f" ({Path(own[-1].filename).name}, line {own[-1].lineno}: {own[-1].line})" if own else ""
    return RigError(f"{what} raised {type(error).__name__}: {text}{hint}{place}")

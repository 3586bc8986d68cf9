"""Functions of a lagged signal that terms may hold besides powers: |u(k-1)|, sat(u(k-1),0.5), sign(y(k-1)-y(k-2)).

>>> import numpy as np
>>> from deatwin.ident.narx import Fixed, Recording
>>> u = np.sin(np.arange(20.0) ** 2)
>>> y = np.append(0.0, 2.0 * np.abs(u[:-1]))
>>> Fixed(terms=["|u(k-1)|"]).fit(Recording.from_arrays(u, y, 1.0)).model_.theta.round(12).tolist()
[2.0]
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError, nearest

Function = Callable[[Array], Array]

_STEP = float(np.cbrt(np.finfo(float).eps))
"""Step of a central difference, as a share of the argument, at which rounding and truncation errors are about equal."""


@dataclass(frozen=True)
class _Kind:
    """A function of a signal x and up to two numbers."""

    parameters: tuple[str, ...]
    degree: int  # Power of the unit of x in the function's unit if its numbers scale with x; 0 for a pure number
    value: Callable[..., Array]
    slope: Callable[..., Array]
    kinks: Callable[..., tuple[float, ...]]  # Arguments at which there is no derivative
    source: str = ""  # Value as a C expression of x, p and q; empty if it exists in Python only
    slope_source: str = ""  # Derivative as a C expression, likewise


def _above(x: Array, knot: float) -> Array:
    return np.maximum(x - knot, 0.0)


def _bell(x: Array, centre: float, width: float) -> Array:
    return np.asarray(np.exp(-(((x - centre) / width) ** 2)))


_KINDS: dict[str, _Kind] = {
    "abs": _Kind((), 1, np.abs, np.sign, lambda: (0.0,), "fabs(x)", "(x > 0) - (x < 0)"),
    "sign": _Kind((), 0, np.sign, np.zeros_like, lambda: (0.0,), "(x > 0) - (x < 0)", "0"),
    "sat": _Kind(
        ("limit",),
        1,
        lambda x, p: np.clip(x, -p, p),
        lambda x, p: (np.abs(x) < p) * 1.0,
        lambda p: (-p, p),
        "x > p ? p : x < -p ? -p : x",
        "fabs(x) < p",
    ),
    "dead": _Kind(
        ("width",),
        1,
        lambda x, p: x - np.clip(x, -p, p),
        lambda x, p: (np.abs(x) > p) * 1.0,
        lambda p: (-p, p),
        "x > p ? x - p : x < -p ? x + p : 0",
        "fabs(x) > p",
    ),
    "hinge": _Kind(("knot",), 1, _above, lambda x, p: (x > p) * 1.0, lambda p: (p,), "x > p ? x - p : 0", "x > p"),
    "spline": _Kind(
        ("knot",),
        3,
        lambda x, p: _above(x, p) ** 3,
        lambda x, p: 3.0 * _above(x, p) ** 2,
        lambda p: (),
        "x > p ? (x - p) * (x - p) * (x - p) : 0",
        "x > p ? 3 * (x - p) * (x - p) : 0",
    ),
    "rbf": _Kind(
        ("centre", "width"),
        0,
        _bell,
        lambda x, p, q: -2.0 * (x - p) / q**2 * _bell(x, p, q),
        lambda p, q: (),
        "exp(-((x - p) / q) * ((x - p) / q))",
        "-2 * (x - p) / (q * q) * exp(-((x - p) / q) * ((x - p) / q))",
    ),
    "tanh": _Kind(
        ("width",),
        0,
        lambda x, p: np.tanh(x / p),
        lambda x, p: (1.0 - np.tanh(x / p) ** 2) / p,
        lambda p: (),
        "tanh(x / p)",
        "(1 - tanh(x / p) * tanh(x / p)) / p",
    ),
}
SOURCES = tuple(_KINDS)  # Names of the built-in functions, in the order of their numbers in C
_OWN: dict[str, tuple[Function, Function | None]] = {}  # Registered functions and their slopes, as given


def register_function(name: str, function: Function, slope: Function | None = None) -> None:
    """Register your own function for use in terms, such as ``name(u(k-1))``.

    Parameters
    ----------
    name : str
        Name of the function in terms: a word that is not the name of a built-in function. If you registered the name
        before, the new function replaces the old one.
    function : callable
        Function that takes an array of any shape and returns a float64 array of the same shape. The argument is the
        signal in its unit.
    slope : callable, optional
        Derivative of `function`, called in the same way; if omitted, central differences are used.

    Raises
    ------
    ModelError
        If the name is not a word or belongs to a built-in function, or `function` or `slope` is not callable.

    Notes
    -----
    Worker processes and pickles receive the registered functions that an estimator or a model contains. Any function
    can be sent to worker processes (``GridSearchCV(n_jobs=2)``). A pickle requires a function that is defined at the
    top level of a module, so a lambda cannot be pickled.

    Examples
    --------
    >>> import numpy as np
    >>> from deatwin.ident.narx import Term
    >>> register_function("softly", np.tanh)
    >>> str(Term.parse("y(k-1) softly(u(k-2))"))
    'y(k-1)softly(u(k-2))'
    """
    if not (isinstance(name, str) and name.isidentifier() and name.isascii()) or name in SOURCES:
        raise ModelError(
            f"{name!r} cannot name a function of your own, because the name is built in or invalid; built in are {', '.join(SOURCES)}"
        )
    if not callable(function) or not (slope is None or callable(slope)):
        raise ModelError(f"the function {name} and its slope must be callables that take an array")

    def difference(x: Array) -> Array:
        step = _STEP * np.maximum(np.abs(x), 1e-3 * np.abs(x).max(initial=0.0) or 1.0)
        return (function(x + step) - function(x - step)) / (2.0 * step)

    _KINDS[name] = _Kind((), 0, function, slope or difference, lambda: ())
    _OWN[name] = function, slope


def own_functions(text: str) -> dict[str, tuple[Function, Function | None]]:
    """Return the registered functions that a text mentions, for another process."""
    return {name: own for name, own in _OWN.items() if re.search(rf"\b{name}\(", text)}


def rebuilt(
    own: dict[str, tuple[Function, Function | None]], make: Callable[..., Any], arguments: tuple[Any, ...]
) -> Any:
    """Register functions in a process that may not know them, and make what uses them."""
    for name, functions in own.items():
        register_function(name, *functions)
    return make(*arguments)


@dataclass(frozen=True, order=True, slots=True)
class Shape:
    """A function of a lagged signal, or of its change over some samples."""

    name: str
    parameters: tuple[float, ...] = ()
    difference: int = 0  # Samples d of x(k) - x(k-d), if that is the function's argument; 0 if it is x(k)
    gain: float = 1.0  # Size of the unit in which the signal is given; the parameters stay as they are

    def __reduce__(self) -> tuple[Any, ...]:
        fields = self.name, self.parameters, self.difference, self.gain
        return rebuilt, (own_functions(f"{self.name}("), Shape, fields)

    @classmethod
    def of(cls, name: str, parameters: Iterable[float], difference: int) -> Shape:
        """Return a shape after checks."""
        chosen = tuple(parameters)
        if name not in _KINDS:
            raise ModelError(
                f"no function is called {name!r}{nearest(name, list(_KINDS))}; known are {', '.join(_KINDS)}, and "
                "register_function adds your own"
            )
        wanted = _KINDS[name].parameters
        if len(chosen) != len(wanted) or not np.isfinite(chosen).all():
            form = ", ".join(["u(k-1)", *wanted])
            raise ModelError(
                f"the function {name} must be written as {name}({form}), but {len(chosen)} numbers were given"
            )
        positive = [p for key, p in zip(wanted, chosen, strict=True) if key in ("limit", "width")]
        if positive and positive[0] <= 0.0:
            raise ModelError(f"the function {name} needs a positive {wanted[-1]}; got {positive[0]:g}")
        return cls(name, chosen, difference)

    @property
    def _kind(self) -> _Kind:
        if self.name not in _KINDS:  # registered in another process only
            raise ModelError(f"the function {self.name!r} is not known here: call register_function first")
        return _KINDS[self.name]

    @property
    def degree(self) -> int:
        """Power of the signal's unit in the unit of the values."""
        return self._kind.degree

    @property
    def unit(self) -> float:
        """Size of the unit of the values."""
        return self.gain**self.degree

    @property
    def source(self) -> str:
        """The value as a C expression of x, p and q; empty for a user's own function."""
        return self._kind.source

    def value(self, x: Array) -> Array:
        """Evaluate the function of a signal, or of its change."""
        found = np.asarray(self._kind.value(self.gain * np.asarray(x), *self.parameters), dtype=np.float64)
        if found.shape != np.shape(x):
            raise ModelError(f"the function {self.name} returns the shape {found.shape} for {np.shape(x)}")
        return found / self.unit

    def along(self, signal: Array) -> Array:
        """Evaluate the function of a signal (n,); a change before the first sample counts as zero."""
        changed = signal
        if self.difference:
            changed = np.zeros_like(signal)
            changed[self.difference :] = signal[self.difference :] - signal[: -self.difference]
        return self.value(changed)

    def slope(self, x: Array) -> Array:
        """Return the derivative; at a kink, that on one side or the mean of both."""
        found = self._kind.slope(self.gain * np.asarray(x), *self.parameters)
        return np.asarray(found, dtype=np.float64) * (self.gain / self.unit)

    def curvature(self, x: Array) -> Array:
        """Return the second derivative, by central differences."""
        step = _STEP * max(float(np.abs(x).max(initial=0.0)), *map(abs, (*self.parameters, 1e-3)))
        return (self.slope(x + step) - self.slope(x - step)) / (2.0 * step)

    def bends_at(self, x: float) -> bool:
        """Return whether the function has no derivative at a value."""
        return bool(np.isin(self.gain * x, self._kind.kinks(*self.parameters)))

    def written(self, signal: str, delay: Callable[[int], str], lag: int) -> str:
        """Return the function as text."""
        inner = signal + delay(lag) + (f"-{signal}{delay(lag + self.difference)}" if self.difference else "")
        if self.name == "abs":
            return f"|{inner}|"
        return f"{self.name}({','.join([inner, *map(_number, self.parameters)])})"


def _number(value: float) -> str:
    return repr(value).removesuffix(".0")


def switch_source() -> str:
    """Return C functions that evaluate a built-in function, given its number, and its derivative."""
    found = "#include <math.h>\n"
    for name, field in (("shape", "source"), ("shape_slope", "slope_source")):
        cases = "\n".join(f"    case {i}: return {getattr(_KINDS[one], field)};" for i, one in enumerate(SOURCES))
        head = f"static inline double {name}(int number, double x, double p, double q) {{\n    switch (number) {{\n"
        found += f"{head}{cases}\n    }}\n    return NAN;\n}}\n"
    return found

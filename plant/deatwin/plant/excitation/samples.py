"""Check the numbers of excitations, and convert times to whole samples."""

import math
from collections.abc import Callable
from functools import partial
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arguments import taking
from deatwin.plant.arrays import real_numbers
from deatwin.plant.errors import DataError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def with_numbers(make: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a function so that its arguments that are annotated as float or int are checked first."""
    kinds = {name: one.annotation for name, one in signature(make).parameters.items()}
    return taking(**{n: partial(_require_number, kind=kind) for n, kind in kinds.items() if kind in (float, int)})(make)


def _require_number(value: Any, name: str, kind: type) -> None:
    array = np.asarray(value) if np.isscalar(value) or hasattr(value, "dtype") else np.empty(0)
    if array.ndim or array.dtype.kind not in ("iu" if kind is int else "iuf") or np.isnan(array):
        raise DataError(f"{name} is {value!r}; it must be {'an integer' if kind is int else 'a number'}")


def sample_count(name: str, time: float, sample_time: float) -> int:
    """Return the whole number of samples in a time, `sample_time` s apart; DataError if there is none."""
    samples = time / sample_time if sample_time > 0.0 else 0.0
    n = round(samples) if math.isfinite(samples) else 0
    if n < 1:
        raise DataError(f"{name} {time:g} s, sample time {sample_time:g} s: need at least one sample")
    return n


def command_array(commands: ArrayLike) -> NDArray[np.float64]:
    """Return commands as an array, shape (n,), V; raise DataError if they are not a row of finite numbers."""
    array = real_numbers(commands, "commands")
    if array.ndim != 1 or array.size == 0 or not np.isfinite(array).all():
        raise DataError(f"commands of shape {array.shape}: need one row of at least one finite number")
    return array

"""Turn samples and times that a user gives into read-only float arrays and numbers, or raise one clear error."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.errors import DataError, ModelError

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Integers = NDArray[np.int64]
Indices = NDArray[np.intp]
Booleans = NDArray[np.bool_]


def seconds(value: object, what: str) -> float:
    """Return one number of seconds; DataError for anything else, such as a time vector."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        raise DataError(
            f"{what} must be one number, in s; got a {type(value).__name__} (of evenly spaced times t, sample_time is "
            "t[1] - t[0], and start is t[0])"
        ) from None


def real_numbers(values: ArrayLike, what: str) -> Array:
    """Return real numbers as an array, with NaN where a masked array hides a value; DataError for anything else."""
    try:
        given = np.ma.filled(values.astype(np.float64), np.nan) if isinstance(values, np.ma.MaskedArray) else values
        array = np.asarray(given)
        if array.dtype.kind not in "biufO":
            raise TypeError
        return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{what} must be an array of real numbers, with rows of the same length") from None


def rows_of_signals(values: ArrayLike, what: str) -> Array:
    """Return signals as rows; DataError if there is no sample, or if they stand in columns."""
    rows = np.atleast_2d(real_numbers(values, what))
    if len(rows) and not rows.shape[1]:
        raise DataError(f"{what} have the shape {rows.shape}: there is no sample")
    if rows.ndim == 2 and rows.shape[1] < rows.shape[0]:
        raise DataError(
            f"{what} have the shape {rows.shape}, more rows than samples: there must be a row for each signal; "
            "transpose a table with a column for each"
        )
    return rows


def texts(given: Sequence[str]) -> tuple[str, ...]:
    """Return names or units as a tuple; a text alone, or what is no sequence at all, is one of them."""
    return tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else (given,)


def read_only(array: Array) -> Array:
    """Return values as a read-only array, without a copy if nobody can change them."""
    part: object = array
    # The columns of a data frame are read-only views of an array that changes with the frame.
    while isinstance(part, np.ndarray):
        if part.flags.writeable:
            array = array.copy()
            array.flags.writeable = False
            break
        part = part.base
    return array


def root_mean_square(values: ArrayLike) -> float:
    """Return the root mean square of the magnitudes of all values."""
    return float(np.sqrt(np.mean(np.abs(values) ** 2)))


def require_generator(rng: object) -> None:
    """Raise ModelError for anything but a generator of NumPy, such as a seed."""
    if not isinstance(rng, np.random.Generator):
        raise ModelError(f"rng = {rng!r}; it must be a numpy.random.Generator, as numpy.random.default_rng(0)")


def require_seed(seed: object) -> None:
    """Raise ModelError for anything but an integer of at least 0."""
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ModelError(f"seed = {seed!r}; it must be an integer of at least 0")

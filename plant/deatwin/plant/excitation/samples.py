"""Convert times to whole samples."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import real_numbers, seconds
from deatwin.plant.errors import DataError


def sample_count(name: str, time: float, sample_time: float) -> int:
    """Return the whole number of samples in a time, `sample_time` s apart; DataError if there is none."""
    time, sample_time = seconds(time, name), seconds(sample_time, "sample_time")
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

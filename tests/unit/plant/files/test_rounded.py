"""Times that were stored with too few digits are read as the even clock that they keep; uneven ones are not."""

import re

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import even_pieces
from deatwin.plant.files.rounded import rounded_clock

ROWS = 6000


def read(times: np.ndarray, **options):
    return even_pieces(times, lambda row: f"row {row}", allow_gaps=False, **options)


def single(times: np.ndarray) -> np.ndarray:
    return times.astype(np.float32).astype(np.float64)


def printed(times: np.ndarray) -> np.ndarray:
    return np.array([float(str(value)) for value in times.astype(np.float32)])


STORED = {
    "single precision, two hours in": (0.001, 7200.0, single),
    "its shortest text": (0.0013, 7200.0, printed),
    "in ms": (0.0013, 7200.0, lambda times: single(1e3 * times) / 1e3),
    "three decimals, a sample of 1.4 digits": (1 / 700, 0.0, lambda times: np.round(times, 3)),
    "three decimals, a third of a digit": (0.0003125, 0.1, lambda times: np.round(times, 3)),
    "cut off": (0.0013, 0.0, lambda times: np.floor(1e3 * times) / 1e3),
    "six digits": (0.0031, 990.0, lambda times: np.array([float(f"{t:.6g}") for t in times])),
}


@pytest.mark.parametrize("kind", STORED)
def test_the_clock_is_the_one_before_rounding(kind):
    step, start, store = STORED[kind]
    times = start + step * np.arange(ROWS)
    found, (piece,) = read(store(times))
    assert found == pytest.approx(step, rel=1e-12)
    digit = rounded_clock(store(times)).digit
    assert np.abs(piece.clock - times).max() <= 0.55 * digit
    assert bool(piece.remark) == (digit > 0.5 * step)
    assert piece.last == ROWS and not piece.interpolated
    assert read(store(times), stated=step)[0] == step


@pytest.mark.parametrize("seed", range(5))
def test_an_uneven_clock_is_no_rounded_one(seed):
    rng = np.random.default_rng(seed)
    even = 0.001 * np.arange(ROWS)
    for times in (
        np.round(even + 0.0008 * rng.uniform(-1, 1, ROWS), 3),  # as far off as a digit
        np.round(np.cumsum(rng.choice([0.001, 0.002], ROWS)), 3),  # it drifts
        np.round(np.sort(rng.uniform(0, 6, ROWS)), 3),
        np.round(np.append(even, 0.05 + even[-1] + even), 3)[::3] / 7,
    ):
        assert rounded_clock(times) is None or 0.5 * rounded_clock(times).digit < 1e-6


def test_rows_that_stand_twice_are_no_rounding():
    for at in (3, 7):
        with pytest.raises(DataError, match="times do not increase"):
            read(np.insert(np.arange(20.0), at, float(at)))


def test_times_that_each_stand_as_often_may_belong_to_several_channels():
    times = np.repeat(np.arange(30.0), 4)
    with pytest.raises(DataError, match=r"state the sample time: --dt 0.25") as error:
        read(times)
    step = float(re.search(r"--dt (\S+)", str(error.value))[1])
    assert read(times, stated=step)[0] == step

"""The clock of records whose times are rounded or have gaps, and pieces of it."""

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files.clock import even_pieces


@pytest.mark.parametrize("start", [0.0, 1.0 / 600.0, 7.0 + 1.0 / 600.0])
def test_rounded_times_begin_where_all_of_them_say(start: float) -> None:
    """300 Hz with 3 decimals: the rounding errors are 0 and ±1/3 ms in turn, so their middle is 0.

    The first time alone is up to 1/3 ms = 10 % of a sample off; a start within 0.25 % is kept as it is.
    """
    times = np.round(start + np.arange(3000) / 300.0, 3)
    _, (piece,) = even_pieces(times, str, allow_gaps=False)
    assert piece.clock[0] == pytest.approx(start, abs=0.0025 / 300.0)


def test_exact_times_keep_their_start() -> None:
    times = 240.1 + 0.02 * np.arange(500)
    _, (piece,) = even_pieces(times, str, allow_gaps=False)
    assert piece.clock[0] == times[0]


def test_pieces_stay_on_the_clock_of_the_file_where_times_are_rounded() -> None:
    """The row after the gap is alone, so that only the clock before it tells how much its time was rounded."""
    exact = np.arange(3000) / 48.7
    after = 2900 + int(np.argmax(np.abs(np.round(exact, 3) - exact)[2900:]))
    times = np.round(np.append(exact[:2500], exact[after]), 3)
    sample_time, pieces = even_pieces(times, str, allow_gaps=True)
    assert abs(times[-1] - exact[after]) > 0.02 * sample_time
    offset = (pieces[1].clock[0] - pieces[0].clock[0]) / sample_time
    assert offset == pytest.approx(after, abs=1e-6)


def test_gap_of_half_a_sample_more_is_not_rounded_away() -> None:
    times = 0.02 * np.arange(100)
    times[50:] += 0.05
    _, pieces = even_pieces(times, str, allow_gaps=True)
    assert pieces[1].clock[0] == pytest.approx(1.05)


def test_stated_sample_time() -> None:
    times = np.arange(300) / 3.0
    assert even_pieces(times, str, allow_gaps=False)[0] != 1 / 3  # 9 digits are found without it
    assert even_pieces(times, str, allow_gaps=False, stated=1 / 3)[0] == 1 / 3
    with pytest.raises(DataError, match=r"the stated sample time is 0\.3 s, but the times advance by"):
        even_pieces(times, str, allow_gaps=False, stated=0.3)
    sample_time, (piece,) = even_pieces(np.array([5.0]), str, allow_gaps=False, stated=0.5)
    assert (sample_time, piece.clock.tolist()) == (0.5, [5.0])


def test_a_day_that_begins_again_and_a_clock_that_was_set_back_are_named() -> None:
    times = 86399.0 + 0.02 * np.arange(100)
    for spoilt, said in (
        (times % 86400.0, "began again at 0: add 86400 s from there on"),
        (
            np.where(times < 86399.99, times, times - 0.35),
            r"the clock was set back: add 0\.35 s from there on, or give each",
        ),
        (times[[*range(40), 41, 40, *range(42, 100)]], "put the rows in order"),
        (times[[*range(40), *range(60, 80), *range(40, 60), *range(80, 100)]], "put the rows in order"),
    ):
        with pytest.raises(DataError, match=said):
            even_pieces(spoilt, str, allow_gaps=False)


@pytest.mark.parametrize(("bits", "rate"), [(32, 1e6), (32, 1e3), (24, 1e6), (16, 1e3)])
def test_a_counter_that_begins_again_is_named(bits: int, rate: float) -> None:
    size = 2.0**bits / rate
    times = (size - 1.0 + 0.02 * np.arange(100)) % size
    with pytest.raises(DataError, match=f"the counter of the times began again at 0: add {size:.10g} s from there on"):
        even_pieces(times, str, allow_gaps=False)
    even_pieces(np.where(times < 2.0, times + size, times), str, allow_gaps=False)


@pytest.mark.parametrize(("unit", "decimals"), [(60.0, 9), (60.0, 7), (3600.0, 11), (1.0, 9)])
@pytest.mark.parametrize("step", [0.02, 0.0125, 1.0 / 3.0])
def test_the_step_of_times_rounded_in_another_unit_is_exact(unit: float, decimals: int, step: float) -> None:
    """Each step differs from the true one by up to a digit of its unit, all steps together by no more."""
    timepts = np.round(np.arange(600) * step / unit, decimals) * unit
    found, _ = even_pieces(timepts, str, allow_gaps=False)
    digit = 10.0**-decimals * unit
    assert abs(found - step) <= (1e-12 * step if step != 1.0 / 3.0 else digit / 600)


def test_the_step_of_large_times_is_not_that_of_their_last_bits() -> None:
    """Seconds since 1904, as LabVIEW counts: a float holds them to half a microsecond."""
    found, _ = even_pieces(3793262400.0 + 0.02 * np.arange(500), str, allow_gaps=False)
    assert found == pytest.approx(0.02, rel=1e-9)


@pytest.mark.parametrize("step", [0.02, 0.0200013, 0.0123456])
def test_the_step_of_times_with_jitter_is_off_by_no_more_than_the_jitter(step: float) -> None:
    """The clock is at both ends up to 2.25 times the jitter off: 1.25 times with the step of few digits, and once more with jitter."""
    rng, count, jitter = np.random.default_rng(7), 400, 1e-4
    found, _ = even_pieces(step * np.arange(count) + jitter * rng.uniform(-1.0, 1.0, count), str, allow_gaps=False)
    assert abs(found - step) <= 2.25 * jitter / (count / 2.0)


def test_recordings_of_one_clock_have_one_step_although_their_jitter_differs() -> None:
    steps = set()
    for seed in range(10):
        jitter = np.random.default_rng(seed).uniform(-1e-4, 1e-4, 400)
        steps.add(even_pieces(0.02 * np.arange(400) + jitter, str, allow_gaps=False)[0])
    assert steps == {0.02}

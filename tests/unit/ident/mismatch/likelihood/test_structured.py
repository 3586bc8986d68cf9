"""Columns of the plant's own error and of an effect's law."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import lfilter

from deatwin.ident.mismatch.likelihood.structured import FILTERS, begun, bends, known, law, limited, slope, slow

TIMES = 0.02 * np.arange(3000)
MOTION = 1e-4 * np.sin(0.7 * TIMES) + 3e-5 * np.sin(3.1 * TIMES + 1.0)


def test_bends_are_orthogonal_to_what_parameters_take_up_and_of_the_stated_size():
    columns = bends(MOTION, 3e-7)
    assert columns.shape == (3000, 6)
    products = columns.T @ columns
    np.testing.assert_allclose(products, products[0, 0] * np.eye(6), atol=1e-9 * products[0, 0])
    np.testing.assert_allclose(columns.T @ np.column_stack([np.ones(3000), MOTION / 1e-4]), 0.0, atol=1e-12)
    assert np.sqrt(np.mean(columns**2, axis=0).sum()) == pytest.approx(3e-7)
    left = (
        MOTION**3
        - np.column_stack([np.ones(3000), MOTION, columns])
        @ np.linalg.lstsq(np.column_stack([np.ones(3000), MOTION, columns]), MOTION**3, rcond=None)[0]
    )
    assert np.abs(left).max() < 1e-9 * np.abs(MOTION**3).max()


@pytest.mark.parametrize("values", [[3e-4], [0.0, 1e-4], [0.0, 1e-4, 5e-4]])
def test_an_error_that_repeats_is_the_same_wherever_the_reading_is(values):
    """A function of a reading with two values is a straight line, which parameters take up, and one of three has a bend."""
    reading = np.random.default_rng(0).choice(values, 300)
    covariance = bends(reading, 3e-7) @ bends(reading, 3e-7).T
    of_values = [covariance[np.flatnonzero(reading == value)[0]] for value in reading]
    np.testing.assert_allclose(covariance, of_values, atol=1e-9 * 3e-7**2)
    assert np.mean(np.diag(covariance)) == pytest.approx(3e-7**2 if len(values) > 2 else 0.0)


def test_the_slope_of_a_reading_has_no_step_where_a_recording_ends():
    records = (TIMES >= 30.0).astype(int)
    times = TIMES + 500.0 * records
    column = slope(MOTION, times, records)
    exact = 0.7e-4 * np.cos(0.7 * TIMES) + 9.3e-5 * np.cos(3.1 * TIMES + 1.0)
    inside = np.r_[1:1499, 1501:2999]
    np.testing.assert_allclose(column[inside], exact[inside], atol=1e-3 * exact.max())
    np.testing.assert_allclose(column, exact, atol=0.05 * exact.max())


def test_known_directions_come_with_their_sizes():
    directions = np.column_stack([MOTION, np.zeros(3000), MOTION**2])
    np.testing.assert_allclose(np.sqrt(np.mean(known(directions, [2e-6, 1e-6, 3e-7]) ** 2, axis=0)), [2e-6, 0.0, 3e-7])


def test_slow_modes_hold_nearly_all_of_a_slow_process():
    columns = slow(TIMES, np.zeros(TIMES.size), 2e-7, 60.0, 4)
    whole = 4e-14 * np.exp(-np.abs(TIMES[::50, None] - TIMES[::50]) / 60.0)
    left = np.trace(whole - columns[::50] @ columns[::50].T) / np.trace(whole)
    # Karhunen and Loève of an exponential covariance: eigenvalues 2c/(w² + c²), c = T/tau = 1, w tan(w/2) = 1 and so on
    w = np.array([1.3065, 3.6732, 6.5846, 9.6317])
    assert left == pytest.approx(1.0 - np.sum(2.0 / (w**2 + 1.0)), abs=0.005)


def test_slow_errors_do_not_depend_on_the_order_of_recordings():
    """Each recording has the process of one alone, whatever came before it and whenever that was."""
    sizes, pause = (400, 900, 250), 1e4
    alone = [slow(TIMES[:n], np.zeros(n), 2e-7, 60.0, 4) for n in sizes]
    times = np.concatenate([TIMES[:n] + k * pause for k, n in enumerate(sizes)])
    together = slow(times, np.repeat(np.arange(3), sizes), 2e-7, 60.0, 4)
    np.testing.assert_allclose(together @ together.T, block_diag(*(c @ c.T for c in alone)), atol=1e-9 * 2e-7**2)


def test_another_law_of_an_effect_is_bent_or_has_other_times():
    """A film that creeps by a power of time is a sum of exponentials; of their sum none of one time is a part."""
    contribution = np.where(TIMES > 10.0, 1e-5 * (1.0 - np.exp(-(TIMES - 10.0) / 20.0)), 0.0)
    basis = law(contribution, TIMES, np.zeros(TIMES.size))
    np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-9)

    def outside(signal: np.ndarray) -> float:
        return float(np.linalg.norm(signal - basis @ (basis.T @ signal)) / np.linalg.norm(signal))

    power = np.where(TIMES > 10.0, np.abs(TIMES - 10.0) ** 0.3, 0.0)
    assert outside(contribution**2) < 1e-5
    assert outside(power) < 0.1
    assert outside(np.sin(2.0 * np.pi * 3.0 * TIMES)) > 0.99


@pytest.mark.parametrize("pause", [0.0, 3600.0])
def test_another_law_begins_anew_in_each_recording(pause):
    """A lag of what an effect does is a part of the laws in each of several recordings, as in one."""
    one = np.exp(-((TIMES[:600] - 9.0) ** 2))
    keep = np.exp(-0.02 / np.geomspace(0.02, TIMES[599], FILTERS)[4])
    lagged = lfilter([1.0 - keep], [1.0, -keep], one)
    records = np.repeat(np.arange(5), 600)
    basis = law(np.tile(one, 5), TIMES + pause * records, records)
    late = np.tile(lagged, 5)
    assert np.linalg.norm(late - basis @ (basis.T @ late)) < 1e-6 * np.linalg.norm(late)


def test_another_law_remembers_what_an_effect_did_while_samples_are_missing():
    """A straight line over a missing sample is off by (2 w h)² / 8, 1 % of the faster tone, at one sample of twenty."""
    tones = np.sin(2.0 * np.pi * 0.4 * TIMES) + 0.5 * np.sin(2.0 * np.pi * 1.1 * TIMES + 1.0)
    seen = np.arange(TIMES.size) % 20 != 7
    basis = law(tones[seen], TIMES[seen], np.zeros(seen.sum()))
    for time in np.geomspace(0.02, np.ptp(TIMES), FILTERS):
        late = lfilter([1.0 - np.exp(-0.02 / time)], [1.0, -np.exp(-0.02 / time)], tones)[seen]
        assert np.linalg.norm(late - basis @ (basis.T @ late)) < 0.01 / 20 * np.linalg.norm(late)


def test_a_change_is_limited_where_the_effect_does_less():
    """A slow tone passes, a fast one is cut to what the effect does there; each recording keeps its own ends."""
    times, records = 0.02 * np.arange(3000), np.repeat([0, 1], [2000, 1000])
    slow, fast = (np.cos(2.0 * np.pi * f * (times + 0.01)) for f in (0.05, 5.0))  # whole half periods in each recording
    some = times, records
    np.testing.assert_allclose(limited(slow + fast, slow + 0.2 * fast, *some), slow + 0.2 * fast, atol=1e-12)
    np.testing.assert_allclose(limited(slow, fast, *some), slow, atol=1e-12)  # a square, say, has slow parts
    np.testing.assert_allclose(limited(np.full(3000, 2.0), slow, *some), 2.0, atol=1e-12)  # constants are kept


def test_an_effect_does_not_err_before_it_acts():
    """Nothing before its time, its size afterwards even where it passes zero, and each recording begins anew."""
    does, records = np.array([0.0, 0.0, 3.0, -1.0, 0.0, 0.0, 2.0]), np.array([0, 0, 0, 0, 0, 1, 1])
    level = np.array([1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 4.0])
    change = np.array([5.0, -5.0, 5.0, -5.0, 2.0, 5.0, 1.0])
    expected = np.array([0.0, 0.0, 3.0, -3.0, 2.0, 0.0, 1.0])
    np.testing.assert_array_equal(begun(change, does, records), expected)
    np.testing.assert_array_equal(begun(change / level, does / level, records, level) * level, expected)


def test_missing_samples_and_noise_that_varies_do_not_free_a_law():
    """A slow effect has no jump, in whatever samples and units of the noise a jump is seen.

    A straight line over one missing sample is off by (2 * 0.02 s / 50 s)² / 8 = 8e-8 of the drift, and the limit by a few
    times that share of the jump, which is known on both sides.
    """
    times = 0.02 * np.arange(6000)
    drift, jump = 1.0 - np.exp(-times / 50.0), 0.02 * ((times > 62.0) - 0.5)
    whole = limited(jump, drift, times, np.zeros(times.size))
    edge = np.flatnonzero(jump > 0.0)[0]
    assert whole[edge] - whole[edge - 1] < 0.2 * 0.02
    seen = np.arange(times.size) % 20 != 7
    few = limited(jump[seen], drift[seen], times[seen], np.zeros(seen.sum()))
    np.testing.assert_allclose(few, whole[seen], atol=1e-6 * 0.02)
    level = np.where(np.arange(times.size) % 3 > 0, 0.5, 2.0)
    np.testing.assert_allclose(limited(jump / level, drift / level, times, np.zeros(times.size), level) * level, whole)

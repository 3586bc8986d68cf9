"""References: their levels, rises, tones."""

import numpy as np
import pytest

from deatwin.control import sine_reference, step_reference, tone_reference

H = 0.02


def test_a_smooth_step_is_half_a_cosine_between_its_levels():
    reference = step_reference(5.0, 2.0, 40, rise=9)
    assert reference.shape == (200,)
    # After j of rise + 1 equal parts of the way it is at (1 - cos(pi j / 10)) / 2 of it.
    way = (1 - np.cos(np.pi * np.arange(11) / 10)) / 2
    np.testing.assert_allclose(reference[39:50], 5.0 + 2.0 * way, atol=1e-14)
    np.testing.assert_allclose(reference[79:90], 7.0 - 2.0 * way, atol=1e-14)
    np.testing.assert_allclose(reference[119:130], 5.0 - 2.0 * way, atol=1e-14)
    for first, level in ((0, 5.0), (50, 7.0), (90, 5.0), (130, 3.0), (170, 5.0)):
        np.testing.assert_array_equal(reference[first : 40 * (first // 40 + 1)], level)


def test_a_sharp_step_is_the_limit_of_no_rise():
    np.testing.assert_array_equal(np.unique(step_reference(0.0, 1.0, 7)), [-1.0, 0.0, 1.0])
    assert np.count_nonzero(np.diff(step_reference(0.0, 1.0, 7))) == 4


def test_a_sine_has_whole_periods():
    reference = sine_reference(1.0, 0.5, 0.5, H, 3)
    assert reference.size == 300
    assert reference.mean() == pytest.approx(1.0, abs=1e-12)
    assert np.abs(np.fft.rfft(reference))[3] * 2 / 300 == pytest.approx(0.5, rel=1e-12)


def test_tones_begin_at_the_centre_and_are_of_equal_size():
    frequencies = np.array([0.1, 0.3, 0.7])
    reference = tone_reference(2.0, 0.5, frequencies, H, 4000, np.random.default_rng(3))
    assert reference[0] == 2.0
    assert np.abs(reference - 2.0).max() <= 0.5
    late = reference[1000:]  # 60 s, whole periods of all tones, after the first 10 s in which they grow
    lines = np.abs(np.fft.rfft(late - 2.0))
    found = lines[np.round(frequencies * 60.0).astype(int)]
    np.testing.assert_allclose(found, found[0], rtol=1e-9)
    assert np.sum(found**2) == pytest.approx(np.sum(lines**2), rel=1e-9)


def test_the_phases_come_from_the_generator_alone():
    first, same, other = (
        tone_reference(0.0, 1.0, [0.1, 0.2], H, 900, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 0.1

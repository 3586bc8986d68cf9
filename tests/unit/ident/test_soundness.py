"""What single readings give away of a sensor."""

import numpy as np
import pytest

from deatwin.ident.soundness import at_limit, neighbours_deviation, noise_of_bends


def test_a_cubic_has_no_deviation_and_a_spike_has_its_size():
    t = np.arange(20.0)
    assert np.abs(neighbours_deviation(0.3 * t**3 - t**2 + 5 * t)).max() < 1e-9
    spike = np.where(t == 10, 3.0, 0.0)
    np.testing.assert_allclose(neighbours_deviation(spike)[8:13], [0.5, -2.0, 3.0, -2.0, 0.5])
    step = np.where(t >= 10, 3.0, 0.0)
    np.testing.assert_allclose(neighbours_deviation(step)[8:12], [0.5, -1.5, 1.5, -0.5])


def test_white_noise_beside_slow_motion():
    rng = np.random.default_rng(1)
    signal = 100 * np.sin(np.arange(5000) / 500) + 2.0 * rng.standard_normal(5000)
    # the median of 5000 correlated bends scatters by about 2 %
    assert noise_of_bends(signal) == pytest.approx(2.0, rel=0.06)


def test_readings_at_a_limit():
    signal = np.sin(np.arange(1000) / 20)
    assert at_limit(signal) == {}
    clipped = at_limit(np.minimum(signal, 0.8))
    assert list(clipped) == ["largest"]
    np.testing.assert_array_equal(np.concatenate(clipped["largest"]), np.flatnonzero(signal >= 0.8))

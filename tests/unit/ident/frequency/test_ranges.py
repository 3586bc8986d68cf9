"""Output frequency ranges against all sums of integer lines."""

from itertools import product

import numpy as np
import pytest

from deatwin.ident.frequency.output_responses.ranges import output_frequencies
from deatwin.plant.errors import ModelError


def sums(low, high, order):
    """All |w_1 + ... + w_n| of integer lines of either sign."""
    lines = [sign * k for sign in (-1, 1) for k in range(low, high + 1)]
    return {abs(sum(chosen)) for chosen in product(lines, repeat=order)}


def integers_in(bands):
    return {k for low, high in bands for k in range(int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1)}


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("band", [(0, 3), (1, 4), (3, 5), (7, 9), (5, 5)])
def test_the_bands_hold_the_sums_of_lines_and_nothing_else(band, order):
    # Lines one apart fill every interval of sums, except those of a single line, whose intervals are points.
    assert integers_in(output_frequencies(band, order)) == sums(*band, order)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize(("band", "n_samples"), [((1, 4), 16), ((3, 5), 11), ((6, 8), 16), ((5, 5), 13), ((0, 3), 7)])
def test_sampling_folds_the_sums(band, n_samples, order):
    # n lines to the circle: line k of a period of n samples is 2 pi k / n rad per sample
    step = 2 * np.pi / n_samples
    bands = output_frequencies(np.array(band) * step, order, sample_time=1.0)
    folded = {min(k % n_samples, -k % n_samples) for k in sums(*band, order)}
    assert integers_in(bands / step) == folded


def test_a_band_beyond_many_half_sampling_rates_fills_everything():
    nyquist = np.pi / 0.1
    np.testing.assert_allclose(output_frequencies((1.0, nyquist), 5, sample_time=0.1), [[0.0, nyquist]])


@pytest.mark.parametrize(
    ("band", "order", "sample_time", "text"),
    [
        ((2.0, 1.0), 2, None, "low <= high"),
        ((-1.0, 1.0), 2, None, "low <= high"),
        ((1.0, np.nan), 2, None, "low <= high"),
        ((1.0, np.inf), 2, None, "low <= high"),
        ((1.0, 2.0, 3.0), 2, None, "low, high"),
        ((1.0, 2.0), 0, None, "order = 0"),
        ((1.0, 2.0), 1.5, None, "order = 1.5"),
        ((1.0, 2.0), 2, -1.0, "sample_time"),
        ((1.0, 40.0), 2, 0.1, "half the sampling rate"),
        ((0.0, 1e308), 3, None, "sums of 3 such frequencies overflow"),
        ((1.0, 2.0), 2, "a", "sample_time must be real numbers"),
    ],
)
def test_what_cannot_be_is_said(band, order, sample_time, text):
    with pytest.raises(ModelError, match=text):
        output_frequencies(band, order, sample_time=sample_time)

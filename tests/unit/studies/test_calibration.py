"""Calibration of stated probabilities, and intervals of a median, against closed forms."""

import numpy as np
import pytest
from scipy.stats import binom

from deatwin.studies.rates import brier_score, expected_calibration_error, median_interval, reliability


@pytest.mark.parametrize("count", [6, 25, 88])
def test_the_interval_of_a_median_holds_it_with_95_percent_and_no_narrower_one_does(count):
    low, high = median_interval(np.arange(1.0, count + 1))
    # The r-th and the (n + 1 - r)-th of n values hold the median with 1 - 2 P(B < r), B binomial of n halves.
    rank = int(low)
    assert high == count + 1 - rank
    assert 1 - 2 * binom.cdf(rank - 1, count, 0.5) >= 0.95 > 1 - 2 * binom.cdf(rank, count, 0.5)


def test_calibration_error_and_brier_score_by_hand():
    stated = [(0.95, True), (0.95, True), (0.95, True), (0.95, False), (0.62, True), (0.62, False)]
    bins = reliability(stated)
    assert [(b.stated, b.came_true.hits, b.came_true.count) for b in bins] == [
        (pytest.approx(0.62), 1, 2),
        (pytest.approx(0.95), 3, 4),
    ]
    assert expected_calibration_error(bins) == pytest.approx((4 * 0.20 + 2 * 0.12) / 6)
    assert brier_score(stated) == pytest.approx((3 * 0.05**2 + 0.95**2 + 0.38**2 + 0.62**2) / 6)
    assert reliability([(1.0, True)])[0].came_true.count == 1  # certainty belongs to the highest bin

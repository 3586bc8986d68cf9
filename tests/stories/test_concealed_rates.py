"""The study of concealed effects: its calibration against closed forms, its baselines on a residual that is known."""

import numpy as np
import pytest
from scipy.stats import binom

from deatwin.plant.effects.catalogue import catalogue
from deatwin.scenarios.concealed_physics.baselines import VARIABLES, Track, gaussian_process, narx, sparse_dynamics
from deatwin.scenarios.concealed_physics.key import TERM_NAMES
from deatwin.scenarios.concealed_physics.score import (
    brier_score,
    expected_calibration_error,
    median_interval,
    reliability,
)

# --- rates ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [6, 25, 88])
def test_the_interval_of_a_median_holds_it_with_95_percent_and_no_narrower_one_does(count: int) -> None:
    low, high = median_interval(np.arange(1.0, count + 1))
    # The r-th and the (n + 1 - r)-th of n values hold the median with 1 - 2 P(B < r), B binomial of n halves.
    rank = int(low)
    assert high == count + 1 - rank
    assert 1 - 2 * binom.cdf(rank - 1, count, 0.5) >= 0.95 > 1 - 2 * binom.cdf(rank, count, 0.5)


def test_calibration_error_and_brier_score_by_hand() -> None:
    stated = [(0.95, True), (0.95, True), (0.95, True), (0.95, False), (0.62, True), (0.62, False)]
    bins = reliability(stated)
    assert [(b.stated, b.came_true.hits, b.came_true.count) for b in bins] == [
        (pytest.approx(0.62), 1, 2),
        (pytest.approx(0.95), 3, 4),
    ]
    assert expected_calibration_error(bins) == pytest.approx((4 * 0.20 + 2 * 0.12) / 6)
    assert brier_score(stated) == pytest.approx((3 * 0.05**2 + 0.95**2 + 0.38**2 + 0.62**2) / 6)
    assert reliability([(1.0, True)])[0].came_true.count == 1  # certainty belongs to the highest bin


# --- baselines ------------------------------------------------------------------------------------------------------


def residual_dynamics(count: int = 4000, cut: int = 3000) -> Track:
    """A residual that obeys e' = -0.5 e + 0.3 x^2, along a second-order response x to random holds."""
    rng = np.random.default_rng(5)
    drive = np.repeat(rng.uniform(0.2, 2.0, count // 50), 50)
    reading, rate, residual = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count - 1):
        rate[k + 1] = rate[k] + 0.02 * (25 * (drive[k] - reading[k]) - 3 * rate[k])
        reading[k + 1] = reading[k] + 0.02 * rate[k + 1]
        residual[k + 1] = residual[k] + 0.02 * (-0.5 * residual[k] + 0.3 * reading[k] ** 2)
    noisy = residual + 0.005 * rng.standard_normal(count)
    return Track(residual=noisy, reading=reading, rate=rate, drive=drive, cut=cut, sample_time=0.02, size=1.0)


def test_baselines_learn_a_residual_with_known_dynamics() -> None:
    track = residual_dynamics()
    judged = track.judged.residual
    found = {learn: learn(track) for learn in (sparse_dynamics, narx, gaussian_process)}
    left = {learn: float(np.std(judged - correction.predicted)) for learn, correction in found.items()}
    # Both kinds of dynamics hold the true ones: little more than the noise of 0.005 may be left. A Gaussian process of
    # a few hundred lagged samples only comes near: it must take out three quarters of the variance.
    assert left[sparse_dynamics] < 1.5 * 0.005
    assert left[narx] < 1.5 * 0.005
    assert left[gaussian_process] < 0.5 * float(np.std(judged))
    assert found[sparse_dynamics].term in ("e", "x^2")  # the only two that the rate of the residual has


def test_every_term_of_the_sparse_dynamics_stands_for_some_effect_of_the_catalogue() -> None:
    from pysindy import PolynomialLibrary

    monomials = PolynomialLibrary(degree=2).fit(np.zeros((2, len(VARIABLES)))).get_feature_names(list(VARIABLES))
    assert set(TERM_NAMES) == set(monomials)
    assert frozenset().union(*TERM_NAMES.values()) <= {effect.name for effect in catalogue()}

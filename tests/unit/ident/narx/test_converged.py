"""The gradient condition at the end of a search, against regressions whose minimum is known."""

import numpy as np
import pytest

from deatwin.ident.narx import Fixed, refine
from deatwin.ident.narx.converged import converged
from deatwin.plant import Recording


@pytest.mark.parametrize(("away", "near"), [(0.0, True), (0.04, True), (-0.06, False), (3.0, False)])
def test_the_distance_is_told_in_standard_deviations(away, near):
    # y = a t + e: at a + d sigma / |t|, d deviations from the least squares, the relative offset is d.
    rng = np.random.default_rng(0)
    t, e = rng.normal(size=(2, 200))
    e -= t * (t @ e) / (t @ t)
    deviation = np.sqrt(e @ e / 199.0 / (t @ t))
    slopes = np.c_[t, np.zeros(200)]  # a parameter that moves nothing has no gradient
    assert converged(slopes, e - away * deviation * t, 200, 100.0) is near


def test_errors_of_rounding_have_no_gradient():
    assert converged(np.ones((9, 1)), np.full(9, 1e-16), 9, 3.0)


def test_a_refined_model_says_if_its_search_was_stopped():
    # With noise on the readings, the start (least squares one step ahead) is biased by many deviations.
    rng = np.random.default_rng(1)
    u, y = rng.normal(size=500), np.zeros(500)
    for k in range(1, 500):
        y[k] = 0.8 * y[k - 1] + u[k - 1]
    record = Recording.from_arrays(u, y + 0.5 * rng.normal(size=500), 0.1)
    start = Fixed(terms=["y(k-1)", "u(k-1)"]).fit(record).model_
    least = refine(start, record)
    for steps, stopped in ((2, True), (50, False)):
        model = refine(start, record, max_steps=steps)
        away = (model.theta - least.theta) / np.sqrt(np.diag(least.theta_cov))
        assert ("stopped" in model.provenance["refined"]) is stopped is bool(np.abs(away).max() > 0.05)

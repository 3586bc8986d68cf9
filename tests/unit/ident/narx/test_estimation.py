"""Estimators against closed forms written another way, other libraries, and Monte Carlo."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import gamma, multivariate_normal

from deatwin.ident.narx import Fixed, refine
from deatwin.ident.narx.bayes import Priors
from deatwin.ident.narx.estimate import Bayesian, LeastSquares, Ridge, TotalLeastSquares, converged, least_squares
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def regression(n=60, k=4, seed=0, noise=0.3, constant=False):
    """Regressors of unequal size and an output; the second regressor is 1 where there is a constant."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(k, n)) * np.geomspace(0.01, 10, k)[:, None]
    rows[-1] += 0.7 * rows[0] * 100
    if constant:
        rows += 0.5
        rows[1] = 2.0
    theta = np.array([3.0, -1.0, 0.5, 0.1])[:k]
    return rows, theta @ rows + noise * rng.normal(size=n), theta


def test_least_squares_on_longley_data():
    """The Longley data of NIST's Statistical Reference Datasets, condition number 5e9 unscaled: certified values."""
    data = np.array(LONGLEY)
    target, rows = data[:, 0], np.vstack([np.ones(16), data[:, 1:].T])
    found = least_squares(rows, target)
    certified = [
        -3482258.63459582,
        15.0618722713733,
        -0.0358191792925910,
        -2.02022980381683,
        -1.03322686717359,
        -0.0511041056535807,
        1829.15146461355,
    ]
    deviations = [
        890420.383607373,
        84.9149257747669,
        0.0334910077722432,
        0.488399681651699,
        0.214274163161675,
        0.226073200069370,
        455.478499142212,
    ]
    np.testing.assert_allclose(found.theta, certified, rtol=1e-10)
    np.testing.assert_allclose(np.sqrt(np.diag(found.theta_cov)), deviations, rtol=1e-9)
    assert found.noise_variance == pytest.approx(304.854073561965**2, rel=1e-9)
    assert found.dof == math.inf


@pytest.mark.parametrize("estimate", [least_squares, TotalLeastSquares()])
def test_too_few_samples_or_dependent_regressors_are_refused(estimate):
    rows, target, _ = regression(n=4)
    with pytest.raises(ModelError, match="4 samples do not determine 4"):
        estimate(rows, target)


@pytest.mark.parametrize("row", [[0.0] * 9, [2.0] * 9])
def test_dependent_regressors_are_refused(row):
    rng = np.random.default_rng(1)
    rows = np.array([rng.normal(size=9), np.ones(9), row])
    with pytest.raises(ModelError, match="depend on each other"):
        LeastSquares()(rows, rng.normal(size=9))


@pytest.mark.parametrize("constant", [False, True])
def test_ridge_against_scikit_learn(constant):
    from sklearn import linear_model

    rows, target, _ = regression(constant=constant)
    others = np.delete(rows, 1, axis=0) if constant else rows
    means = others.mean(axis=1) if constant else np.zeros(len(others))
    sizes = np.sqrt(np.mean((others - means[:, None]) ** 2, axis=1))
    found = Ridge(penalty=0.2)(rows, target)
    standard = (others - means[:, None]) / sizes[:, None]
    peer = linear_model.Ridge(alpha=0.2 * 60, fit_intercept=constant).fit(standard.T, target)
    expected = peer.coef_ / sizes
    np.testing.assert_allclose(np.delete(found.theta, 1) if constant else found.theta, expected, rtol=1e-9)
    if constant:
        assert found.theta[1] == pytest.approx((peer.intercept_ - expected @ means) / 2.0, rel=1e-9)
    # The covariance: the penalty is a normal prior of each standardised parameter, flat for the constant.
    prior = np.insert(60 * 0.2 * sizes**2, 1, 0.0) if constant else 60 * 0.2 * sizes**2
    inverse = np.linalg.inv(rows @ rows.T + np.diag(prior))
    freedom = 60 - np.trace(inverse @ rows @ rows.T)
    variance = np.sum((target - found.theta @ rows) ** 2) / freedom
    assert found.noise_variance == pytest.approx(variance, rel=1e-9)
    np.testing.assert_allclose(found.theta_cov, variance * inverse, rtol=1e-7, atol=1e-12)


def test_ridge_with_more_regressors_than_samples():
    rng = np.random.default_rng(14)
    rows = rng.normal(size=(12, 8))
    target = rows[0] + 0.1 * rng.normal(size=8)
    z = rows / np.sqrt(np.mean(rows**2, axis=1, keepdims=True))
    found = Ridge(penalty=0.3)(rows, target)
    inverse = np.linalg.inv(z @ z.T + 8 * 0.3 * np.eye(12))
    sizes = np.sqrt(np.mean(rows**2, axis=1))
    np.testing.assert_allclose(found.theta, inverse @ z @ target / sizes, rtol=1e-9)
    shape = found.theta_cov * np.outer(sizes, sizes) / found.noise_variance
    np.testing.assert_allclose(shape, inverse, rtol=1e-8, atol=1e-12)


def test_gcv_chooses_the_penalty_of_least_score():
    """The score written with the hat matrix: n |y - Hy|^2 / tr(I - H)^2."""
    rows, target, _ = regression(n=25, noise=3.0, seed=2)
    z = rows / np.sqrt(np.mean(rows**2, axis=1, keepdims=True))

    def score(penalty):
        hat = z.T @ np.linalg.solve(z @ z.T + 25 * penalty * np.eye(4), z)
        return 25 * np.sum((target - hat @ target) ** 2) / np.trace(np.eye(25) - hat) ** 2

    best = min(np.geomspace(1e-4, 1e2, 2001), key=score)
    chosen = Ridge(penalty="gcv")(rows, target)
    np.testing.assert_allclose(chosen.theta, Ridge(penalty=float(best))(rows, target).theta, rtol=5e-3)
    assert 1e-3 < best < 50  # within: the test would not see a wrong one at the border


def test_evidence_chooses_the_penalty_of_largest_marginal_likelihood():
    rows, target, _ = regression(n=25, noise=3.0, seed=3)
    z = rows / np.sqrt(np.mean(rows**2, axis=1, keepdims=True))

    def minus_evidence(penalty):
        cov = np.eye(25) + z.T @ z / (25 * penalty)
        variance = target @ np.linalg.solve(cov, target) / 25  # the best one
        return -multivariate_normal.logpdf(target, cov=variance * cov)

    best = min(np.geomspace(1e-4, 1e2, 1001), key=minus_evidence)
    chosen = Ridge(penalty="evidence")(rows, target)
    np.testing.assert_allclose(chosen.theta, Ridge(penalty=float(best))(rows, target).theta, rtol=1e-2)
    assert 1e-3 < best < 50


def test_ridge_bears_dependent_regressors_and_noise_free_data():
    rng = np.random.default_rng(4)
    row = rng.normal(size=30)
    found = Ridge(penalty=1e-6)(np.array([row, row, 0 * row]), 2 * row)
    np.testing.assert_allclose(found.theta, [1, 1, 0], atol=1e-5)
    for choice in ("gcv", "evidence"):
        assert Ridge(penalty=choice)(row[None], 2 * row).theta == pytest.approx([2.0], rel=1e-6)


def test_total_least_squares_of_a_line_is_orthogonal_regression():
    """One regressor and a constant: the slope of Deming (1943) for equal errors, in closed form."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=40) + 3
    y = 2 * x - 1 + 0.2 * rng.normal(size=40)
    x = x + 0.2 * rng.normal(size=40)
    sxx, syy = np.var(x), np.var(y)
    sxy = np.mean((x - x.mean()) * (y - y.mean()))
    slope = (syy - sxx + math.sqrt((syy - sxx) ** 2 + 4 * sxy**2)) / (2 * sxy)
    found = TotalLeastSquares()(np.array([x, np.full(40, 0.5)]), y)
    np.testing.assert_allclose(found.theta, [slope, (y.mean() - slope * x.mean()) / 0.5], rtol=1e-10)


def test_total_least_squares_is_consistent_and_its_intervals_cover():
    """Errors of 0.2 in regressors and output, 300 draws: bias below least squares', 95 % intervals at 91 to 98 %.

    The standard deviation of the coverage over 900 parameters, correlated in threes, is about 1.2 %.
    """
    rng, theta = np.random.default_rng(8), np.array([1.0, -2.0, 0.5])
    found, ordinary, hits = [], [], 0
    for _ in range(300):
        exact = rng.normal(size=(3, 200))
        target = theta @ exact + 0.2 * rng.normal(size=200)
        rows = exact + 0.2 * rng.normal(size=(3, 200))
        estimate = TotalLeastSquares()(rows, target)
        found.append(estimate.theta)
        ordinary.append(least_squares(rows, target).theta)
        hits += np.sum(np.abs(estimate.theta - theta) < 1.96 * np.sqrt(np.diag(estimate.theta_cov)))
        assert 0.1 < estimate.noise_variance < 0.45  # (1 + 5.25) 0.04 = 0.25
    error, scatter = np.abs(np.mean(found, axis=0) - theta), np.std(found, axis=0) / math.sqrt(300)
    assert np.all(error < 4 * scatter)
    # Attenuation 1/(1 + 0.04) of each parameter.
    np.testing.assert_allclose(np.mean(ordinary, axis=0), theta / 1.04, rtol=0.02)
    assert 0.91 < hits / 900 < 0.98


def test_bayesian_regression_against_numerical_integration():
    """Marginal likelihood and posterior mean by quadrature over tau of the normal law of y given tau."""
    rng = np.random.default_rng(9)
    rows = rng.normal(size=(2, 8))
    target = np.array([0.5, -0.3]) @ rows + 0.4 * rng.normal(size=8)
    priors, alpha = Priors(a0=2.0, b0=0.5), 0.7
    found = Bayesian(precision=alpha, priors=priors)(rows, target)
    sizes = np.exp2(np.round(np.log2(np.sqrt(np.mean(rows**2, axis=1)))))
    z = rows / sizes[:, None]
    cov = np.eye(8) + z.T @ z / alpha
    unit = multivariate_normal(cov=cov)
    law = gamma(priors.a0, scale=1 / priors.b0)

    def joint(tau):  # y | tau ~ N(0, cov / tau)
        return math.exp(unit.logpdf(math.sqrt(tau) * target) + 4 * math.log(tau)) * law.pdf(tau)

    evidence = quad(joint, 0, 60, epsabs=0, epsrel=1e-10, limit=200)[0]
    assert found.log_evidence == pytest.approx(math.log(evidence), abs=1e-8)
    inverse = quad(lambda tau: joint(tau) / tau, 1e-12, 60, epsabs=0, epsrel=1e-10, limit=200)[0] / evidence
    assert found.noise_variance == pytest.approx(inverse, rel=1e-7)
    spread = np.linalg.inv(alpha * np.eye(2) + z @ z.T)
    np.testing.assert_allclose(found.theta, spread @ z @ target / sizes, rtol=1e-10)
    np.testing.assert_allclose(found.theta_cov, inverse * spread / np.outer(sizes, sizes), rtol=1e-7)
    assert found.dof == 2 * (2 + 4)


def test_bayesian_regression_takes_the_precision_of_largest_evidence():
    rows, target, _ = regression(n=30, noise=0.3, seed=10)
    found = Bayesian()(rows, target)
    others = [Bayesian(precision=found.precision * factor)(rows, target).log_evidence for factor in (0.8, 1.25)]
    assert found.log_evidence > max(others)
    assert 1e-6 < found.precision < 1e5


def recording(n=300, seed=0):
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, n), np.zeros(n)
    for k in range(2, n):
        y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] ** 2 + 0.05 * rng.normal()
    return Recording.from_arrays(u * 100, y / 1000, 0.1)


@pytest.mark.parametrize("estimator", [least_squares, Ridge(), TotalLeastSquares(), Bayesian()])
def test_given_terms_are_estimated_in_their_order_and_units(estimator):
    fixed = Fixed(terms=["u(k-2)^2", "y(k-1)"], estimator=estimator).fit(recording())
    assert list(map(str, fixed.model_.terms)) == ["u(k-2)^2", "y(k-1)"]
    np.testing.assert_allclose(fixed.model_.theta, [0.8e-7, 0.5], rtol=0.1)
    assert fixed.model_.noise_variance == pytest.approx(25e-10, rel=0.5)
    assert type(estimator).__name__ in fixed.model_.provenance["identifier"]


def test_given_terms_of_several_outputs():
    rng = np.random.default_rng(3)
    u, y = rng.uniform(-1, 1, 200), np.zeros((2, 200))
    for k in range(1, 200):
        y[:, k] = 0.5 * y[0, k - 1], 0.2 * y[1, k - 1] + y[0, k - 1] * u[k - 1]
        y[:, k] += u[k - 1], 0.0
    both = Recording.from_arrays(u, y, 1.0)
    terms = {"y1": ["y1(k-1)", "u(k-1)"], "y2": ["y2(k-1)", "y1(k-1)u(k-1)"]}
    model = Fixed(terms=terms).fit(both).model_
    np.testing.assert_allclose(model.theta, [0.5, 1.0, 0.2, 1.0], rtol=1e-10)
    assert model.equations == (0, 0, 1, 1)
    with pytest.raises(ModelError, match="2 outputs"):
        Fixed(terms=["u(k-1)"]).fit(both)
    with pytest.raises(ModelError, match="the outputs are y1, y2"):
        Fixed(terms={"y1": ["u(k-1)"]}).fit(both)


LONGLEY = [
    (60323, 83.0, 234289, 2356, 1590, 107608, 1947),
    (61122, 88.5, 259426, 2325, 1456, 108632, 1948),
    (60171, 88.2, 258054, 3682, 1616, 109773, 1949),
    (61187, 89.5, 284599, 3351, 1650, 110929, 1950),
    (63221, 96.2, 328975, 2099, 3099, 112075, 1951),
    (63639, 98.1, 346999, 1932, 3594, 113270, 1952),
    (64989, 99.0, 365385, 1870, 3547, 115094, 1953),
    (63761, 100.0, 363112, 3578, 3350, 116219, 1954),
    (66019, 101.2, 397469, 2904, 3048, 117388, 1955),
    (67857, 104.6, 419180, 2822, 2857, 118734, 1956),
    (68169, 108.4, 442769, 2936, 2798, 120445, 1957),
    (66513, 110.8, 444546, 4681, 2637, 121950, 1958),
    (68655, 112.6, 482704, 3813, 2552, 123366, 1959),
    (69564, 114.2, 502601, 3931, 2514, 125368, 1960),
    (69331, 115.7, 518173, 4806, 2572, 127852, 1961),
    (70551, 116.9, 554894, 4007, 2827, 130081, 1962),
]


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

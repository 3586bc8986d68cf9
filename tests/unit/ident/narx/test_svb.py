"""SvbNarx: the posterior, the bound, the pruning."""

import math

import numpy as np
import pytest
from scipy import integrate
from scipy.special import gammaln

from deatwin.ident.narx import SvbNarx
from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance, posterior
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def statistics(phi, y):
    return Statistics(gram=phi.T @ phi, moment=phi.T @ y, power=float(y @ y), n_samples=y.size)


def problem(seed, n=60, m=8, noise=0.3):
    rng = np.random.default_rng(seed)
    phi = rng.normal(size=(n, m)) * 10 ** rng.uniform(-1, 1, m)
    theta = np.where(rng.uniform(size=m) < 0.5, rng.normal(size=m), 0.0)
    return phi, phi @ theta + noise * rng.normal(size=n)


def test_with_relevances_held_the_posterior_is_the_closed_form():
    """Normal-gamma conjugacy by the inverse of the marginal covariance: another route than the code's."""
    phi, y = problem(0)
    alpha = np.random.default_rng(1).uniform(0.1, 10, 8)
    priors = Priors(a0=0.7, b0=0.4)
    q = posterior(statistics(phi, y), alpha, priors)
    marginal = np.eye(y.size) + phi @ np.diag(1 / alpha) @ phi.T
    gain = np.diag(1 / alpha) @ phi.T @ np.linalg.inv(marginal)
    np.testing.assert_allclose(q.mean, gain @ y, rtol=1e-10)
    v = np.diag(1 / alpha) - gain @ phi @ np.diag(1 / alpha)
    np.testing.assert_allclose(q.root.T @ q.root, v, rtol=1e-10, atol=1e-10 * np.abs(v).max())
    np.testing.assert_allclose(q.spread, np.diag(v), rtol=1e-10)
    assert q.a == 0.7 + y.size / 2
    assert q.b == pytest.approx(0.4 + 0.5 * y @ np.linalg.solve(marginal, y), rel=1e-10)
    assert q.log_det == pytest.approx(np.linalg.slogdet(v)[1], rel=1e-10)
    np.testing.assert_allclose(q.covariance, v * q.b / (q.a - 1), rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("seed", range(25))
def test_the_bound_never_falls(seed):
    rng = np.random.default_rng(seed)
    phi, y = problem(
        seed, n=int(rng.integers(5, 200)), m=int(rng.integers(1, 30)), noise=10 ** rng.uniform(-4, 1)
    )
    fit = fit_relevance(
        statistics(phi, y), Priors(), np.full(phi.shape[1], 100.0), tolerance=0.0, max_iterations=200
    )
    bounds = np.array(fit.bounds)
    assert np.all(np.diff(bounds) >= -1e-9 * np.abs(bounds[1:]))


def test_the_bound_lies_just_below_the_evidence():
    """One term: ln p(y) by numerical integration over its relevance."""
    rng = np.random.default_rng(2)
    phi = rng.normal(size=(40, 1))
    y = 0.8 * phi[:, 0] + 0.2 * rng.normal(size=40)
    priors = Priors(a0=1.0, b0=0.5, c0=1.5, d0=0.8)
    data = statistics(phi, y)

    def density(log_alpha):
        alpha = math.exp(log_alpha)
        q = posterior(data, np.array([alpha]), priors)
        given = (
            -20 * math.log(2 * math.pi)
            + 0.5 * (log_alpha + q.log_det)
            + priors.a0 * math.log(priors.b0)
            - gammaln(priors.a0)
            + gammaln(q.a)
            - q.a * math.log(q.b)
        )
        prior = (
            priors.c0 * math.log(priors.d0) - gammaln(priors.c0) + priors.c0 * log_alpha - priors.d0 * alpha
        )
        return math.exp(given + prior)

    evidence = math.log(integrate.quad(density, -25, 8, limit=400)[0])
    fit = fit_relevance(data, priors, np.array([1.0]), tolerance=0.0, max_iterations=500)
    assert evidence - 0.5 < fit.bounds[-1] < evidence


def bilinear(n=400, seed=0, units=(1.0, 1.0)):
    rng = np.random.default_rng(seed)
    u, e, y = rng.uniform(-1, 1, n), 0.02 * rng.normal(size=n), np.zeros(n)
    for k in range(2, n):
        y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] - 0.3 * y[k - 1] * u[k - 1] + e[k]
    return Recording.from_arrays(u * units[0], y * units[1], 0.1)


def test_pruning_goes_down_to_one_term_and_the_largest_bound_is_chosen():
    svb = SvbNarx(output_lags=2, input_lags=2, degree=2)
    assert svb.fit(bilinear()) is svb
    counts = [len(step.terms) for step in svb.path_]
    assert counts[0] == 15 and counts[-1] == 1 and np.all(np.diff(counts) < 0)
    bounds = [step.lower_bound for step in svb.path_]
    assert svb.lower_bound_ == max(bounds)
    best = svb.path_[int(np.argmax(bounds))]
    assert svb.terms_ == best.terms
    assert {str(term) for term in svb.terms_} == {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}
    for before, after in zip(svb.path_, svb.path_[1:], strict=False):
        kept = {
            term
            for term, value in zip(before.terms, before.relevance, strict=True)
            if value > before.threshold * (1 + 1e-9)
        }
        assert kept <= set(after.terms) < set(before.terms)


def test_posterior_of_the_model_is_close_to_least_squares():
    recording = bilinear()
    model = SvbNarx().fit(recording).model_
    phi = model.table.rows(recording.inputs, recording.outputs, 2, recording.n_samples).T
    theta, residual, *_ = np.linalg.lstsq(phi, recording.outputs[0, 2:])
    sigma = residual[0] / (phi.shape[0] - 3)
    np.testing.assert_allclose(model.theta, theta, rtol=1e-3)
    # b0 = 1e-4 of the scaled noise adds a few per cent
    np.testing.assert_allclose(model.theta_cov, sigma * np.linalg.inv(phi.T @ phi), rtol=0.05, atol=1e-8)
    assert model.noise_variance == pytest.approx(4e-4, rel=0.2)
    assert model.theta_dof == pytest.approx(398 + 0.02)


def test_units_change_nothing_but_the_units():
    plain, small = SvbNarx().fit(bilinear()), SvbNarx().fit(bilinear(units=(2.0**11, 2.0**-13)))
    assert plain.terms_ == small.terms_ and plain.lower_bound_ == small.lower_bound_
    volts = {"y(k-1)": 0, "u(k-2)": -24, "y(k-1)u(k-1)": -11}
    factors = np.array([2.0 ** volts[str(term)] for term in plain.terms_])
    np.testing.assert_array_equal(small.model_.theta, plain.model_.theta * factors)


def test_scikit_learn_contract():
    base = pytest.importorskip("sklearn.base")
    svb = SvbNarx(resolution=20.0, d0=1e-3)
    assert base.clone(svb).get_params() == svb.get_params()
    assert not [name for name in vars(svb) if name.endswith("_")]


@pytest.mark.parametrize(
    "arguments", [{"resolution": 1.0}, {"b0": 0.0}, {"max_iterations": 0}, {"degree": 0}]
)
def test_senseless_arguments_are_refused(arguments):
    with pytest.raises(ModelError):
        SvbNarx(**arguments).fit(bilinear())

"""The posterior of the parameters: intervals, densities, draws, and what ArviZ gets of them."""

import math

import numpy as np
import pytest
from scipy import stats

from deatwin.ident.narx import NarxModel, SvbNarx
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

TERMS = {"y(k-1)": 0.6, "u(k-1)": 0.3, "y(k-1)u(k-2)": -0.2}
COV = np.array([[4.0, -1.0, 0.5], [-1.0, 2.0, 0.0], [0.5, 0.0, 1.0]]) * 1e-4


def model(dof=9.0, **details):
    return NarxModel.from_terms(TERMS, sample_time=0.1, theta_cov=COV, noise_variance=0.01, theta_dof=dof, **details)


@pytest.mark.parametrize("dof", [5.0, 40.0, math.inf])
def test_intervals_are_those_of_the_law(dof):
    posterior = ThetaPosterior(model=model(dof))
    shrink = 1.0 if math.isinf(dof) else (dof - 2) / dof
    for m, (interval, value) in enumerate(zip(posterior.interval(0.9), TERMS.values(), strict=True)):
        law = stats.norm if math.isinf(dof) else stats.t(dof)
        expected = value + law.ppf([0.05, 0.95]) * math.sqrt(COV[m, m] * shrink)
        np.testing.assert_allclose(interval, expected, rtol=1e-12)


def test_draws_have_the_moments_of_the_law():
    """60 000 draws, 12 degrees of freedom: standard errors from the moments of Student-t and inverse gamma."""
    dof, n = 12.0, 60_000
    draws = ThetaPosterior(model=model(dof)).sample(np.random.default_rng(0), n)
    assert draws.theta.shape == (n, 3) and draws.noise_variance.shape == (n, 1)
    deviation = draws.theta - list(TERMS.values())
    sizes = np.sqrt(np.diag(COV))
    # 4 standard errors; the fourth moment of Student-t is 3 (dof - 2)/(dof - 4) of its squared variance
    np.testing.assert_allclose(deviation.mean(axis=0) / sizes, 0, atol=4 / math.sqrt(n))
    kurtosis = 3 * (dof - 2) / (dof - 4)
    found = deviation.T @ deviation / n / np.outer(sizes, sizes)
    np.testing.assert_allclose(found, COV / np.outer(sizes, sizes), atol=4 * math.sqrt(kurtosis / n))
    # 1/tau is inverse gamma with a = 6 and mean 0.01
    law = stats.invgamma(dof / 2, scale=0.01 * (dof / 2 - 1))
    assert stats.kstest(draws.noise_variance[:, 0], law.cdf).pvalue > 0.01
    # theta is Student-t, and normal once divided by the root of its own noise variance
    scale = math.sqrt(COV[0, 0] * (dof - 2) / dof)
    assert stats.kstest(deviation[:, 0] / scale, stats.t(dof).cdf).pvalue > 0.01
    given = deviation[:, 0] / sizes[0] / np.sqrt(draws.noise_variance[:, 0] / 0.01)
    assert stats.kstest(given, stats.norm.cdf).pvalue > 0.01


def test_normal_draws_keep_the_noise():
    draws = ThetaPosterior(model=model(math.inf)).sample(np.random.default_rng(1), 50)
    np.testing.assert_array_equal(draws.noise_variance, 0.01)


def test_equations_have_a_noise_of_their_own():
    two = NarxModel.from_terms(
        {"y1": {"y1(k-1)": 0.5}, "y2": {"y1(k-1)": 0.2, "u(k-1)": 1.0}},
        sample_time=1.0,
        theta_cov=np.diag([1.0, 2.0, 3.0]),
        noise_variance=[0.1, 0.2],
        theta_dof=8.0,
    )
    draws = ThetaPosterior(model=two).sample(np.random.default_rng(2), 20_000)
    ratio = draws.noise_variance / [0.1, 0.2]
    assert abs(np.corrcoef(ratio.T)[0, 1]) < 0.05
    squares = (draws.theta - [0.5, 0.2, 1.0]) ** 2 / [1.0, 2.0, 3.0]
    # E[x^2 | tau] = ratio of the own equation; of the other equation's ratio it is independent
    for term, own in ((0, 0), (1, 1), (2, 1)):
        assert np.mean(squares[:, term] / ratio[:, own]) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 20_000))


@pytest.mark.extras
def test_arviz_gets_draws_predictions_and_likelihood():
    """Its own summary and its own leave-one-out agree with the law and with the predictive density."""
    arviz = pytest.importorskip("arviz", reason="the extra bayes is not installed")
    rng = np.random.default_rng(4)
    u, y = rng.uniform(-1, 1, 300), np.zeros(300)
    for k in range(2, 300):
        y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] + 0.1 * rng.normal()
    recording = Recording.from_arrays(u, y, 0.1)
    found = SvbNarx(clean_up="evidence").fit(recording).model_
    data = ThetaPosterior(model=found).to_arviz(np.random.default_rng(5), recording=recording, n_chains=4, n_draws=1000)
    theta = data["posterior"]["theta"]
    assert theta.dims == ("chain", "draw", "term") and theta.shape == (4, 1000, 2)
    assert list(theta["term"].values) == [str(term) for term in found.terms]
    sd = np.sqrt(np.diag(found.theta_cov))
    np.testing.assert_allclose(theta.mean(("chain", "draw")), found.theta, atol=0.08 * sd.max())
    assert data["observed_data"]["y"].shape == (1, 298)
    assert data["posterior_predictive"]["y"].shape == data["log_likelihood"]["y"].shape == (4, 1000, 1, 298)
    elpd = arviz.loo(data)
    expected = stats.norm.logpdf(found.predict(recording).residuals, scale=math.sqrt(found.noise_variance)).sum()
    # leave-one-out is below the fit's own density by about one nat for each parameter, noise included
    value = float(getattr(elpd, "elpd", getattr(elpd, "elpd_loo", np.nan)))
    assert expected - 6 < value < expected


def test_without_arviz_the_error_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "arviz", None)
    with pytest.raises(ModelError, match=r"pip install .arviz"):
        ThetaPosterior(model=model()).to_arviz(np.random.default_rng(0))

"""The posterior of the parameters: intervals, densities, draws, and what ArviZ gets of them."""

import math

import numpy as np
import pytest
from scipy import stats

from deatwin.ident.narx import NarxModel, SvbNarx, refine
from deatwin.ident.narx.posterior import BandStatus, ThetaPosterior, free_run_band, one_step_band, regressors
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

TERMS = {"y(k-1)": 0.6, "u(k-1)": 0.3, "y(k-1)u(k-2)": -0.2}
COV = np.array([[4.0, -1.0, 0.5], [-1.0, 2.0, 0.0], [0.5, 0.0, 1.0]]) * 1e-4


def law_model(dof=9.0, **details):
    return NarxModel.from_terms(TERMS, sample_time=0.1, theta_cov=COV, noise_variance=0.01, theta_dof=dof, **details)


@pytest.mark.parametrize("dof", [5.0, 40.0, math.inf])
def test_intervals_are_those_of_the_law(dof):
    posterior = ThetaPosterior(model=law_model(dof))
    shrink = 1.0 if math.isinf(dof) else (dof - 2) / dof
    for m, (interval, value) in enumerate(zip(posterior.interval(0.9), TERMS.values(), strict=True)):
        law = stats.norm if math.isinf(dof) else stats.t(dof)
        expected = value + law.ppf([0.05, 0.95]) * math.sqrt(COV[m, m] * shrink)
        np.testing.assert_allclose(interval, expected, rtol=1e-12)


def test_draws_have_the_moments_of_the_law():
    """60 000 draws, 12 degrees of freedom: standard errors from the moments of Student-t and inverse gamma."""
    dof, n = 12.0, 60_000
    draws = ThetaPosterior(model=law_model(dof)).sample(np.random.default_rng(0), n)
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
    draws = ThetaPosterior(model=law_model(math.inf)).sample(np.random.default_rng(1), 50)
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
        ThetaPosterior(model=law_model()).to_arviz(np.random.default_rng(0))


def recording(n=400, seed=0, noise=0.05):
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, n), np.zeros(n)
    for k in range(2, n):
        y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] - 0.3 * y[k - 1] * u[k - 1] + noise * rng.normal()
    return Recording.from_arrays(u, y, 0.1)


@pytest.fixture(scope="module")
def model():
    """Learned from so few samples that the parameters matter in the band."""
    return SvbNarx(rule=lambda t: str(t) in {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}).fit(recording(24)).model_


def test_one_step_band_is_that_of_draws(model):
    """Quantiles of 40 000 joint draws; their standard error is sqrt(p (1 - p)/n) over the density."""
    new, n = recording(30, seed=7), 40_000
    band = one_step_band(model, new, level=0.8)
    draws = ThetaPosterior(model=model).sample(np.random.default_rng(1), n)
    rows = regressors(model, new)
    noise = np.random.default_rng(2).standard_normal((n, rows.shape[1])) * np.sqrt(draws.noise_variance)
    ends = np.quantile(draws.theta @ rows + noise, [0.1, 0.9], axis=0)
    scale = (band.upper - band.lower)[0, 2:] / (2 * stats.t.ppf(0.9, model.theta_dof))
    error = math.sqrt(0.1 * 0.9 / n) / stats.t.pdf(stats.t.ppf(0.1, model.theta_dof), model.theta_dof)
    assert np.abs((ends[0] - band.lower[0, 2:]) / scale).max() < 4 * error
    assert np.abs((ends[1] - band.upper[0, 2:]) / scale).max() < 4 * error
    np.testing.assert_allclose(band.outputs, model.predict(new).outputs)
    for values in (band.lower, band.upper):
        np.testing.assert_array_equal(values[:, :2], new.outputs[:, :2])


def test_few_draws_hold_as_many_new_measurements_as_many_draws():
    """New measurements and draws are of one law, independent at each of 20 000 samples: the share held is 0.95 with a
    standard deviation of 0.0015. Ends at the ranks 1 + (n - 1) p would hold 0.903.
    """
    known, rng = NarxModel.from_terms({"u(k-1)": 1.0}, sample_time=1.0, noise_variance=1.0), np.random.default_rng(1)
    u = rng.normal(size=20_000)
    y = np.concatenate([[0.0], u[:-1]]) + rng.normal(size=u.size)
    band = free_run_band(known, Recording.from_arrays(u, y, 1.0), rng, n_draws=39)
    assert abs(band.coverage[0] - 0.95) < 0.005
    assert band.coverage[0] == np.mean((y[1:] >= band.lower[0, 1:]) & (y[1:] <= band.upper[0, 1:]))
    assert band.status is BandStatus.OK and (band.draws, band.diverged) == (39, 0)


def test_free_run_noise_of_a_known_linear_model_has_its_closed_form():
    """y(k) = a y(k-1) + e(k): the variance after j steps is s^2 (1 - a^(2j)) / (1 - a^2)."""
    known = NarxModel.from_terms({"y(k-1)": 0.9, "u(k-1)": 1.0}, sample_time=0.1, noise_variance=0.04)
    new, n = recording(20, seed=11), 20_000
    band = free_run_band(known, new, np.random.default_rng(4), n_draws=n, level=0.9)
    steps = np.arange(1, 20)
    sigma = np.sqrt(0.04 * (1 - 0.81**steps) / (1 - 0.81))
    error = math.sqrt(0.05 * 0.95 / n) / stats.norm.pdf(stats.norm.ppf(0.05))
    middle = known.simulate(new).outputs[0, 1:]
    z = stats.norm.ppf(0.95)
    assert np.abs((band.upper[0, 1:] - middle) / sigma - z).max() < 4.5 * error
    assert np.abs((band.lower[0, 1:] - middle) / sigma + z).max() < 4.5 * error


def test_free_run_parameters_without_noise_have_their_closed_form():
    """y(k) = theta u(k-1): the band is theta's interval times the input."""
    known = NarxModel.from_terms(
        {"u(k-1)": 0.5}, sample_time=0.1, theta_cov=[[0.01]], noise_variance=0.0, theta_dof=6.0
    )
    new, n = recording(12, seed=12), 20_000
    band = free_run_band(known, new, np.random.default_rng(5), n_draws=n, level=0.8)
    half = stats.t.ppf(0.9, 6) * math.sqrt(0.01 * 4 / 6)
    error = math.sqrt(0.1 * 0.9 / n) / stats.t.pdf(stats.t.ppf(0.1, 6), 6) * math.sqrt(0.01 * 4 / 6)
    width = (band.upper - band.lower)[0, 1:] / np.abs(new.inputs[0, :-1])
    assert np.abs(width / 2 - half).max() < 4 * error


def test_past_noise_acts_in_one_step_and_free_run():
    """y(k) = e(k) + 0.8 e(k-1): one step ahead sigma, in free run sigma sqrt(1.64)."""
    colour = NarxModel.from_terms({"u(k-1)": 1.0, "e(k-1)": 0.8}, sample_time=0.1, noise_variance=1.0)
    new = recording(200, seed=13)
    one = one_step_band(colour, new, level=0.9)
    free = free_run_band(colour, new, np.random.default_rng(6), n_draws=8000, level=0.9)
    z = stats.norm.ppf(0.95)
    np.testing.assert_allclose((one.upper - one.lower)[0, 1:], 2 * z, rtol=1e-12)
    np.testing.assert_allclose(one.outputs[0, 1:], colour.predict(new).outputs[0, 1:])
    # the mean of 198 widths of 8000 draws each
    assert np.mean((free.upper - free.lower)[0, 2:]) / 2 == pytest.approx(z * math.sqrt(1.64), rel=0.01)


def test_each_output_has_the_band_of_its_equation():
    two = NarxModel.from_terms(
        {"y1": {"u(k-1)": 0.5}, "y2": {"y1(k-1)": 1.0}},
        sample_time=0.1,
        theta_cov=np.diag([0.04, 0.0]),
        noise_variance=[0.0, 0.09],
    )
    rng = np.random.default_rng(8)
    new = Recording.from_arrays(rng.uniform(-1, 1, 50), rng.normal(size=(2, 50)), 0.1)
    half = (lambda band: (band.upper - band.lower)[:, 1:] / 2)(one_step_band(two, new))
    z = stats.norm.ppf(0.975)
    np.testing.assert_allclose(half[0], z * 0.2 * np.abs(new.inputs[0, :-1]), rtol=1e-12)
    np.testing.assert_allclose(half[1], z * 0.3, rtol=1e-12)


def test_diverged_draws_are_counted_and_told():
    wild = NarxModel.from_terms({"y(k-1)": 1.0, "u(k-1)": 1.0}, sample_time=0.1, theta_cov=[[0.3, 0], [0, 0]])
    band = free_run_band(wild, recording(200), np.random.default_rng(7), n_draws=100)
    assert 0 < band.diverged < 100 and band.status is BandStatus.DIVERGED and not band.status.ok
    assert np.all(np.isfinite(band.lower)) and np.all(np.isfinite(band.upper))
    lost = NarxModel.from_terms({"y(k-1)": 3.0, "u(k-1)": 1.0}, sample_time=0.1, noise_variance=0.1)
    with pytest.raises(ModelError, match="all 20 draws"):
        free_run_band(lost, recording(200), np.random.default_rng(7), n_draws=20)


def test_the_picture_shows_the_band(model):
    band = one_step_band(model, recording(50, seed=7))
    axes = band.plot()
    middle, measured = axes.get_lines()
    np.testing.assert_array_equal(middle.get_ydata(), band.outputs[0])
    np.testing.assert_array_equal(measured.get_ydata(), band.measured[0])
    shaded = axes.collections[0].get_paths()[0].vertices[:, 1]
    assert shaded.min() == band.lower.min() and shaded.max() == band.upper.max()


def test_with_noise_on_the_readings_the_band_holds_new_readings():
    """40 records of a resonance with noise on the readings: 92 to 98 % of new readings lie in the 95 % band of the
    refined model, which is little wider than the noise. Taken as noise of the equation it is several times as wide.
    """
    rng, noise = np.random.default_rng(11), 0.1
    plant = NarxModel.from_terms({"y(k-1)": 1.7, "y(k-2)": -0.85, "u(k-1)": 0.2, "y(k-1)^3": -0.01}, sample_time=1.0)

    def drawn():
        u = rng.normal(size=300)
        clean = plant.simulate(Recording.from_arrays(u, 0 * u, 1.0)).outputs
        return Recording.from_arrays(u, clean + noise * rng.normal(size=300), 1.0)

    coverages, widths = [], []
    for _ in range(40):
        training, unseen = drawn(), drawn()
        model = refine(plant, training)
        band = free_run_band(model, unseen, rng, n_draws=200, output_noise=model.simulate(training).rms_error)
        coverages.append(band.coverage[0])
        widths.append((band.upper - band.lower)[0, band.first :].mean() / (2 * 1.96 * noise))
    assert 0.92 <= np.mean(coverages) <= 0.98
    assert np.median(widths) < 1.3
    wide = free_run_band(model, unseen, rng)
    assert np.mean(wide.upper - wide.lower) > 2 * np.mean(band.upper - band.lower)

"""Narmax and extended least squares: bias, intervals and choice of noise terms, against simulation and plain loops."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import Frols, NarxModel
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.noise import Narmax, NoiseStatus, _slopes, extended_least_squares
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

ARMAX = {"y(k-1)": 0.8, "u(k-1)": 1.0, "e(k-1)": 0.7}


def armax(seed, n=500, noise=0.5):
    """y(k) = 0.8 y(k-1) + u(k-1) + e(k) + 0.7 e(k-1)."""
    rng = np.random.default_rng(seed)
    u, e, y = rng.uniform(-1, 1, n), noise * rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + e[k] + 0.7 * e[k - 1]
    return Recording.from_arrays(u, y, 1.0)


def given(recordings, terms, noise_terms, first):
    """A regression on given process terms, and noise terms, ready for extended least squares."""
    data = Regression.on(recordings, TermTable(tuple(map(Term.parse, terms))))
    return replace(data, first=first), tuple(map(Term.parse, noise_terms))


def test_it_ends_where_the_innovations_reproduce_themselves():
    """At the fixed point e is the model's own one-step error, computed sample by sample; here by a plain loop."""
    recording = armax(0)
    data, noise_terms = given(recording, ["y(k-1)", "u(k-1)"], ["e(k-1)"], 1)
    fit = extended_least_squares(data, noise_terms, tolerance=1e-12)
    assert fit.status is NoiseStatus.CONVERGED and fit.changes[-1] <= 1e-12 < fit.changes[0]
    scale = data.output_scale
    a, b, c = fit.estimate.theta * [1, scale / data.input_scales[0], 1]
    u, y, e = recording.inputs[0], recording.outputs[0], np.zeros(500)
    for k in range(1, 500):
        e[k] = y[k] - a * y[k - 1] - b * u[k - 1] - c * e[k - 1]
    np.testing.assert_allclose(fit.noise[0][0] * scale, e, atol=1e-9)
    # and the parameters are the least squares of y on the regressors made of it
    rows = np.array([y[:-1], u[:-1], e[:-1]])
    np.testing.assert_allclose([a, b, c], np.linalg.lstsq(rows.T, y[1:])[0], rtol=1e-8)


def test_without_noise_terms_it_is_least_squares():
    data, _ = given(armax(0), ["y(k-1)", "u(k-1)"], [], 1)
    fit = extended_least_squares(data, ())
    rows, target = data.matrix()
    np.testing.assert_allclose(fit.estimate.theta, np.linalg.lstsq(rows.T, target)[0], rtol=1e-10)
    assert fit.status.ok and fit.changes == ()


def test_the_bias_of_least_squares_goes_and_the_intervals_cover():
    """150 draws of an ARMAX system. Coverage of 450 parameters at 95 %: 1 % standard deviation if independent."""
    theta = np.array(list(ARMAX.values()))
    plain, found, hits = [], [], 0
    for seed in range(150):
        recording = armax(seed)
        plain.append(Fixed(terms=["y(k-1)", "u(k-1)"]).fit(recording).model_.theta[0])
        data, noise_terms = given(recording, ["y(k-1)", "u(k-1)"], ["e(k-1)"], 1)
        fit = extended_least_squares(data, noise_terms)
        whole = replace(data, table=TermTable(data.table.terms + noise_terms))
        model = whole.model(fit.estimate.theta, fit.estimate.theta_cov, fit.estimate.noise_variance, identifier=None)
        found.append(model.theta)
        hits += np.sum(np.abs(model.theta - theta) < 1.96 * np.sqrt(np.diag(model.theta_cov)))
        assert fit.status.ok
    # E[y(k-1) v(k)] / E[y^2] with v = e + 0.7 e(k-1): 0.7 s^2 / var(y), var(y) = (1/3 + s^2 (1 + 0.49 + 1.12)) / 0.36
    bias = 0.7 * 0.25 / ((1 / 3 + 0.25 * 2.61) / 0.36)
    assert np.mean(plain) - 0.8 == pytest.approx(bias, abs=0.005)
    scatter = np.std(found, axis=0) / np.sqrt(150)
    assert np.all(np.abs(np.mean(found, axis=0) - theta) < 4 * scatter + 1 / 500)  # bias of order 1/n is left
    assert 0.92 < hits / 450 < 0.98


@pytest.mark.study
def test_the_noise_model_of_s5_covers():
    """S5, true structure, 300 draws of 500 samples; 1800 parameters, standard deviation of the coverage 0.5 %.

    Its noise terms are uncorrelated with its process terms (u has mean zero), so that least squares is not biased
    there: the noise model lowers the noise variance by 0.2^2 + 0.3^2/3 = 7 % and gives the intervals of all six.
    """
    system = SYSTEMS["S5"]
    hits, variances = [], []
    for seed in range(300):
        recording = system.draw(np.random.default_rng(seed)).recording
        noise_terms = [text for text in system.equation if "e(" in text]
        data, parsed = given(recording, map(str, system.terms), noise_terms, 2)
        fit = extended_least_squares(data, parsed)
        whole = replace(data, table=TermTable(data.table.terms + parsed))
        model = whole.model(fit.estimate.theta, fit.estimate.theta_cov, fit.estimate.noise_variance, identifier=None)
        truth = [system.equation[str(term)] for term in model.terms]
        hits.append(np.abs(model.theta - truth) < 1.96 * np.sqrt(np.diag(model.theta_cov)))
        variances.append(model.noise_variance)
    assert 0.93 < np.mean(hits) < 0.97
    assert np.all(np.mean(hits, axis=0) > 0.90)
    assert np.mean(variances) == pytest.approx(system.noise_std**2, rel=0.02)


def test_slopes_against_finite_differences():
    """de/dtheta of the recursion, with noise terms of all kinds and two recordings."""
    recordings = [armax(1, 60), armax(2, 40)]
    data, noise_terms = given(
        recordings, ["y(k-1)", "u(k-1)"], ["e(k-1)", "u(k-1)e(k-2)", "e(k-1)e(k-2)", "y(k-1)e(k-1)^2"], 2
    )
    table = TermTable(data.table.terms + noise_terms)
    theta = np.array([0.7, 0.9, 0.5, -0.3, 0.4, 0.2])

    def errors(theta):
        model = replace(data, table=table).model(theta, np.zeros((6, 6)), 0.0, identifier=None)
        return [model.predict(record).residuals / data.output_scale for record in recordings]

    noise = [np.pad(e, ((0, 0), (2, 0))) for e in errors(theta)]
    rows = np.concatenate(
        [table.rows(*data.scaled(r), 2, r.n_samples, e) for r, e in zip(recordings, noise, strict=True)], axis=1
    )
    slopes = _slopes(data, TermTable(noise_terms), theta[2:], rows, noise)
    for j in range(6):
        step = np.eye(6)[j] * 1e-6
        up, down = (np.concatenate(errors(theta + sign * step), axis=1)[0] for sign in (1, -1))
        np.testing.assert_allclose(slopes[j], -(up - down) / 2e-6, rtol=1e-6, atol=1e-7)


def test_the_noise_model_is_the_invertible_one_and_too_few_iterations_say_so():
    rng = np.random.default_rng(5)
    e = rng.normal(size=400)
    y = e + np.concatenate([[0], 3.0 * e[:-1]])  # its innovations are those of 1 + e(k-1)/3
    data, noise_terms = given(Recording.from_arrays(rng.normal(size=400), y, 1.0), ["u(k-1)"], ["e(k-1)"], 1)
    fit = extended_least_squares(data, noise_terms)
    assert fit.status is NoiseStatus.CONVERGED
    assert fit.estimate.theta[1] == pytest.approx(1 / 3, abs=0.15)
    few = extended_least_squares(data, noise_terms, max_iterations=1)
    assert few.status is NoiseStatus.NOT_CONVERGED and "more iterations" in few.status.value
    assert np.all(np.isfinite(few.estimate.theta_cov))


def test_noise_terms_are_chosen():
    """2000 samples of S5: both noise terms in at least 8 of 10 draws, and at most 2 false ones."""
    system, both, false = SYSTEMS["S5"], 0, 0
    truth = {Term.parse(text) for text in system.equation if "e(" in text}
    for seed in range(10):
        recording = system.draw(np.random.default_rng(seed), 2000).recording
        narmax = Narmax(Fixed(terms=system.terms), noise_lags=3).fit(recording)
        both += truth <= set(narmax.noise_terms_)
        false += len(set(narmax.noise_terms_) - truth)
        assert narmax.noise_status_.ok and narmax.model_.terms == system.terms + narmax.noise_terms_
    assert both >= 8 and false <= 2


def test_white_noise_gets_no_noise_model():
    """S4, 20 draws: the extended criterion takes a false term of 21 candidates with about 1 % probability a draw."""
    system = SYSTEMS["S4"]
    taken = 0
    for seed in range(20):
        narmax = Narmax(Fixed(terms=system.terms)).fit(system.draw(np.random.default_rng(seed)).recording)
        taken += bool(narmax.noise_terms_)
    assert taken <= 3


def test_it_goes_with_any_identifier_and_predicts_and_simulates():
    training, unseen = armax(3, 800), armax(4, 400)
    process = Frols(output_lags=2, input_lags=2, degree=1, max_terms=4)
    narmax = Narmax(process, noise_lags=2, noise_degree=1).fit(training)
    assert not hasattr(process, "model_") and narmax.process_.terms_ == narmax.model_.deterministic.terms
    assert isinstance(narmax.model_, NarxModel) and Term.parse("e(k-1)") in narmax.noise_terms_
    white = narmax.model_.predict(unseen).residuals[0]
    plain = narmax.process_.model_.predict(unseen).residuals[0]
    assert np.var(white) < np.var(plain) and np.var(white) == pytest.approx(0.25, rel=0.2)
    assert narmax.model_.simulate(unseen).status.ok


def test_several_recordings_and_outputs():
    rng = np.random.default_rng(6)
    u, e, y = rng.uniform(-1, 1, 900), 0.3 * rng.normal(size=(2, 900)), np.zeros((2, 900))
    for k in range(1, 900):
        y[0, k] = 0.6 * y[0, k - 1] + u[k - 1] + e[0, k] + 0.7 * e[0, k - 1]
        y[1, k] = 0.3 * y[0, k - 1] + 0.5 * u[k - 1] + e[1, k] - 0.6 * e[1, k - 1]
    whole = Recording.from_arrays(u, y, 1.0)
    process = Fixed(terms={"y1": ["y1(k-1)", "u(k-1)"], "y2": ["y1(k-1)", "u(k-1)"]})
    narmax = Narmax(process, noise_lags=1, noise_degree=1)
    narmax.fit([whole.section(0, 400), whole.section(400, 900)])
    written = {(row, str(term)): value for row, term, value in
               zip(narmax.model_.equations, narmax.model_.terms, narmax.model_.theta, strict=True)}  # fmt: skip
    assert written[0, "e1(k-1)"] == pytest.approx(0.7, abs=0.1)
    assert written[1, "e2(k-1)"] == pytest.approx(-0.6, abs=0.1)
    assert written[0, "y1(k-1)"] == pytest.approx(0.6, abs=0.05)


def test_an_interrupt_keeps_the_process_model():
    told = []

    def interrupt(share, doing):
        told.append(doing)
        if "noise model" in doing:
            raise KeyboardInterrupt

    narmax = Narmax(Fixed(terms=["y(k-1)", "u(k-1)"])).fit(armax(0), progress=interrupt)
    assert narmax.status_ is FitStatus.INTERRUPTED and narmax.noise_terms_ == ()
    plain = Fixed(terms=["y(k-1)", "u(k-1)"]).fit(armax(0).section(1, 500))  # e(k-2) takes one sample more
    np.testing.assert_allclose(narmax.model_.theta, plain.model_.theta, rtol=1e-9)


def test_the_covariance_counts_the_recursion():
    """The plain s^2 (ZZ')^-1 takes e(k-1) for measured: it makes the interval of y(k-1) a third too narrow here.

    100 draws: the standard deviation of a standard deviation is 7 %.
    """
    found, told, plain = [], [], []
    for seed in range(100):
        data, noise_terms = given(armax(seed), ["y(k-1)", "u(k-1)"], ["e(k-1)"], 1)
        fit = extended_least_squares(data, noise_terms)
        rows = np.vstack([data.matrix()[0], fit.noise[0][:, :-1]])
        own = [0, 2]  # the parameter of u(k-1) comes in a scale of its own for each draw
        found.append(fit.estimate.theta[own])
        told.append(np.sqrt(np.diag(fit.estimate.theta_cov))[own])
        plain.append(np.sqrt(fit.estimate.noise_variance * np.diag(np.linalg.inv(rows @ rows.T)))[own])
    scatter = np.std(found, axis=0)
    np.testing.assert_allclose(np.mean(told, axis=0), scatter, rtol=0.2)
    assert np.mean(plain, axis=0)[0] < 0.7 * scatter[0]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"process": "frols"}, "give an identifier"),
        ({"process": Frols(max_terms=0)}, "max_terms"),
        ({"noise_lags": 0}, "no lag"),
        ({"noise_lags": [0]}, "at least 1"),
        ({"noise_degree": 0}, "noise_degree"),
        ({"criterion": "press"}, "known are ebic"),
        ({"tolerance": 0.0}, "tolerance"),
    ],
)
def test_senseless_arguments_are_refused(arguments, says):
    with pytest.raises(ModelError, match=says):
        Narmax(**{"process": Frols(), **arguments}).fit(armax(0))

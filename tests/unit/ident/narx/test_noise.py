"""Narmax and prediction errors: bias, intervals and choice of noise terms, against simulation, loops and Armax."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import least_squares
from scipy.signal import lfilter
from slopes import differences
from stopping import StopAt

from deatwin.ident.narx import Frols, NarxModel
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.noise import Narmax
from deatwin.ident.narx.prediction_error import _PredictionErrors, prediction_error_fit
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.recording import Recording


def armax(seed, n=500, noise=0.5):
    """y(k) = 0.8 y(k-1) + u(k-1) + e(k) + 0.7 e(k-1)."""
    rng = np.random.default_rng(seed)
    u, e, y = rng.uniform(-1, 1, n), noise * rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + e[k] + 0.7 * e[k - 1]
    return Recording.from_arrays(u, y, 1.0)


def given(recordings, terms, noise_terms, first):
    """A regression on given process terms, and noise terms, ready for an estimation."""
    data = Regression.on(recordings, TermTable(tuple(map(Term.parse, terms))))
    return replace(data, first=first), tuple(map(Term.parse, noise_terms))


def test_errors_and_slopes_of_noise_terms_of_all_kinds():
    """Products of e with itself and other signals, two recordings: errors by the model's own prediction."""
    recordings = [armax(1, 60), armax(2, 40)]
    data, noise_terms = given(
        recordings, ["y(k-1)", "u(k-1)"], ["e(k-1)", "u(k-1)e(k-2)", "e(k-1)e(k-2)", "y(k-1)e(k-1)^2"], 2
    )
    errors = _PredictionErrors.of(data, TermTable(noise_terms))
    theta, rest = np.array([0.7, 0.9, 0.5, -0.3, 0.4, 0.2]), np.zeros(4)  # both recordings start with e = 0, twice
    zero = np.zeros(errors.target.size)

    def at(unknowns):
        return errors.at(unknowns[:6], unknowns[6:].reshape(2, 2), zero)

    point = at(np.append(theta, rest))
    whole = replace(data, table=TermTable(data.table.terms + noise_terms))
    model = whole.model(theta, np.zeros((6, 6)), 0.0, identifier=None)
    for record, e in zip(recordings, errors.spread(point.errors), strict=True):
        np.testing.assert_allclose(e[0, 2:] * data.output_scale, model.predict(record).residuals[0], atol=1e-11)
    slopes = differences(lambda t: -at(t).errors, np.append(theta, rest), 1e-6)
    np.testing.assert_allclose(np.concatenate(point.slopes)[:, 2:], slopes[:, :6], rtol=1e-6, atol=1e-7)
    starts = block_diag(*(slope[:, :2] for slope in point.slopes))  # the start of one recording does not move the other
    np.testing.assert_allclose(starts, slopes[:, 6:], rtol=1e-6, atol=1e-7)


def test_what_does_not_forget_its_start_is_refused():
    """Roots of the noise polynomial just inside and just outside of the unit circle, and a slope that alternates."""
    data, noise_terms = given(armax(1, 100), ["y(k-1)"], ["e(k-1)", "e(k-2)"], 2)
    errors = _PredictionErrors.of(data, TermTable(noise_terms))
    zero = np.zeros(errors.target.size)
    for radius, invertible in ((0.99, True), (1.01, False)):
        polynomial = np.poly(radius * np.exp([0.7j, -0.7j])).real
        assert (errors.at(np.append(0.0, polynomial[1:]), errors.rest, zero) is not None) == invertible
    u = np.tile([2.0, 0.1], 50)  # at half its size, for signals are scaled by powers of two: 0.5 and 0.025
    alternating = Recording.from_arrays(u, armax(1, 100).outputs[0], 1.0)
    data, noise_terms = given(alternating, ["y(k-1)"], ["u(k-1)e(k-1)"], 1)
    errors = _PredictionErrors.of(data, TermTable(noise_terms))
    for size, invertible in ((8.0, True), (10.0, False)):  # size^2 * 0.5 * 0.025 against 1: 8.94
        assert (errors.at(np.array([0.0, size]), errors.rest, np.zeros(100)) is not None) == invertible


def test_the_noise_model_is_the_invertible_one_and_too_few_iterations_say_so():
    rng = np.random.default_rng(5)
    e = rng.normal(size=400)
    y = e + np.concatenate([[0], 3.0 * e[:-1]])  # its innovations are those of 1 + e(k-1)/3
    data, noise_terms = given(Recording.from_arrays(rng.normal(size=400), y, 1.0), ["u(k-1)"], ["e(k-1)"], 1)
    fit = prediction_error_fit(data, noise_terms)
    assert fit.converged
    assert fit.estimate.theta[1] == pytest.approx(1 / 3, abs=0.15)
    few = prediction_error_fit(data, noise_terms, max_iterations=2)
    assert not few.converged
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
        assert narmax.status_.ok and narmax.model_.terms == system.terms + narmax.noise_terms_
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
    # e(k-1), or e(k-2): with one lag more of y and u, (1 + 0.7/q)(1 - 0.7/q) = 1 - 0.49/q^2 is the same model
    assert isinstance(narmax.model_, NarxModel) and narmax.noise_terms_
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
    written = {
        (row, str(term)): value
        for row, term, value in zip(narmax.model_.equations, narmax.model_.terms, narmax.model_.theta, strict=True)
    }
    assert written[0, "e1(k-1)"] == pytest.approx(0.7, abs=0.1)
    assert written[1, "e2(k-1)"] == pytest.approx(-0.6, abs=0.1)
    assert written[0, "y1(k-1)"] == pytest.approx(0.6, abs=0.05)
    named = Narmax(process, noise_terms={"y1": ["e1(k-1)"], "y2": ["e2(k-1)"]})
    named.fit([whole.section(0, 400), whole.section(400, 900)])
    assert named.model_.terms == narmax.model_.terms
    np.testing.assert_allclose(named.model_.theta, narmax.model_.theta, rtol=1e-9)


A = [1.0, -1.5, 0.7]
RESONANT = ["y(k-1)", "y(k-2)", "u(k-1)", "u(k-2)"]
NONLINEAR = [*RESONANT, "u(k-1)^2"]


def resonant(seed, process, noise, n=2000):
    """y(k) = 1.5 y(k-1) - 0.7 y(k-2) + f(u) + C(q) e(k); with C = A that is white noise e on the readings.

    The recursion is linear in y, so that this holds exactly for f with a square of the input as well.
    """
    rng = np.random.default_rng(seed)
    u = rng.normal(size=n)
    force = lfilter([0, 1, 0.5], [1], u)
    if process is NONLINEAR:
        force[1:] += 0.4 * u[:-1] ** 2
    clean = lfilter([1], A, force)
    std = 0.3 if process is RESONANT else 0.1 * 3.3  # a tenth of what the clean output varies by, see below
    return Recording.from_arrays(u, clean + lfilter(noise, A, std * rng.normal(size=n)), 1.0), std


CASES = {"on the readings": (RESONANT, A), "coloured": (RESONANT, [1, 0.8, 0.4]), "nonlinear": (NONLINEAR, A)}


def truth_of(process, noise):
    return np.array([1.5, -0.7, 1.0, 0.5, *([0.4] if process is NONLINEAR else []), *noise[1:]])


def resonant_fits(process, noise, seeds):
    """Status, noise variance over the true one and which 95 % intervals hold the truth, for each seed."""
    narmax, found = Narmax(Fixed(terms=process), noise_terms=["e(k-1)", "e(k-2)"]), []
    for seed in seeds:
        recording, std = resonant(seed, process, noise)
        model = narmax.fit(recording).model_
        held = np.abs(model.theta - truth_of(process, noise)) < 1.96 * np.sqrt(np.diag(model.theta_cov))
        found.append((narmax.status_.ok, model.noise_variance / std**2, held))
    return zip(*found, strict=True)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    ("seeds", "near", "low", "high"),
    [(10, 0.03, 0.85, 1.0), pytest.param(200, 0.02, 0.92, 0.97, marks=pytest.mark.study)],
)
def test_a_resonance_converges_and_its_intervals_cover(case, seeds, near, low, high):
    """The variance is known to sqrt(2 / 20000) = 1 % of ten seeds; of their 60 or 70 intervals at least 50 hold."""
    converged, variances, held = resonant_fits(*CASES[case], range(seeds))
    print(f"{case}: {sum(converged)} converged, variance {np.mean(variances):.4f}, held {np.mean(held, axis=0)}")
    assert all(converged)
    assert np.mean(variances) == pytest.approx(1.0, abs=near)
    assert low < np.mean(held) <= high


def test_an_exact_recording_leaves_no_noise_and_says_so():
    u = np.random.default_rng(1).normal(size=300)
    narmax = Narmax(Fixed(terms=RESONANT), noise_terms=["e(k-1)"])
    narmax.fit(Recording.from_arrays(u, lfilter([0, 1, 0.5], A, u), 1.0))
    assert narmax.status_.ok
    np.testing.assert_allclose(narmax.model_.theta[:4], [1.5, -0.7, 1.0, 0.5], rtol=1e-9)


def test_it_ends_where_the_sum_of_squares_is_least():
    """Three recordings, two unknown errors before each whose squares count: by a plain loop and a general minimiser."""
    recordings = [armax(seed, n) for seed, n in ((1, 60), (2, 7), (3, 90))]
    data, noise_terms = given(recordings, ["y(k-1)", "u(k-1)"], ["e(k-1)", "e(k-2)"], 2)
    fit = prediction_error_fit(data, noise_terms, tolerance=1e-10)
    assert fit.converged and fit.changes[-1] <= 1e-10 < fit.changes[0]
    scale = data.output_scale

    def errors(unknowns):
        (a, b, c, d), found = unknowns[:4], []
        for record, start in zip(recordings, unknowns[4:].reshape(3, 2), strict=True):
            u, y, e = record.inputs[0], record.outputs[0], [*start]
            for k in range(2, y.size):
                e.append(y[k] - a * y[k - 1] - b * u[k - 1] - c * e[-1] - d * e[-2])
            found += e
        return np.array(found)

    least = least_squares(errors, np.zeros(10), xtol=1e-13, ftol=1e-14, gtol=1e-12)
    units = np.array([1, scale / data.input_scales[0], 1, 1])
    np.testing.assert_allclose(fit.estimate.theta * units, least.x[:4], atol=1e-6)
    np.testing.assert_allclose(np.concatenate(fit.noise, axis=1)[0] * scale, least.fun, atol=1e-6)
    variance = np.sum(least.fun**2) / (151 - 4)
    assert fit.estimate.noise_variance * scale**2 == pytest.approx(variance, rel=1e-8)
    covariance = variance * np.linalg.inv(least.jac.T @ least.jac)[:4, :4]
    np.testing.assert_allclose(fit.estimate.theta_cov * np.outer(units, units), covariance, rtol=1e-4)


def test_the_starts_of_many_recordings_cost_no_matrix_of_their_own():
    """100 recordings of 30 samples: with a column for each of their 200 starts, one matrix would hold 4.8 MB."""
    data, noise_terms = given([armax(seed, 30) for seed in range(100)], ["y(k-1)", "u(k-1)"], ["e(k-1)", "e(k-2)"], 2)
    tracemalloc.start()
    prediction_error_fit(data, noise_terms, max_iterations=1)  # each iteration fills the same matrices
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3e6


def test_memory_grows_with_the_samples_and_not_with_their_square():
    """An array of 6000 x 6000 numbers is 288 MB; 100 rows of 6000 samples are 5 MB."""
    recording = armax(0, n=6000)
    tracemalloc.start()
    Narmax(Fixed(terms=["y(k-1)", "u(k-1)"]), noise_terms=["e(k-1)"]).fit(recording)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 50e6


def test_an_interrupt_keeps_the_process_model():
    stop = StopAt(lambda doing: "noise model" in doing)
    narmax = Narmax(Fixed(terms=["y(k-1)", "u(k-1)"])).fit(armax(0), progress=stop)
    assert narmax.status_ is FitStatus.INTERRUPTED and narmax.noise_terms_ == ()
    plain = Fixed(terms=["y(k-1)", "u(k-1)"]).fit(armax(0).section(1, 500))  # e(k-2) takes one sample more
    np.testing.assert_allclose(narmax.model_.theta, plain.model_.theta, rtol=1e-9)

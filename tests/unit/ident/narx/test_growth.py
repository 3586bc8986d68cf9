"""Growth by the free-run error: held-out errors against refitting, the choice along a path, noise on the readings."""

import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.narx import Fixed, NarxModel, Semp, refine
from deatwin.ident.narx.growth import held_out_errors, smallest_adequate, white, worse
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.recording import Recording


def slow_plant(seed, n=1000, noise=0.0):
    """A tank: y(k) = 0.97 y(k-1) + 0.03 u(k-1) + 0.02 u(k-1)^2 - 0.01 y(k-1)^2, noise on the readings alone."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0, 2, n // 10), 10)
    terms = {"y(k-1)": 0.97, "u(k-1)": 0.03, "u(k-1)^2": 0.02, "y(k-1)^2": -0.01}
    plant = NarxModel.from_terms(terms, sample_time=1.0)
    clean = plant.simulate(Recording.from_arrays(u, 0 * u, 1.0)).outputs[0]
    return Recording.from_arrays(u, clean + noise * rng.normal(size=n), 1.0)


def test_held_out_errors_are_those_of_a_regression_refitted_without_the_section():
    """Without lags of y the free run is linear in the parameters: first order is exact."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=101)
    recording = Recording.from_arrays(u, np.append(0, u[:-1] - 0.3 * u[:-1] ** 2) + rng.normal(size=101), 1.0)
    data = Regression.on(recording, TermTable(tuple(map(Term.parse, ["u(k-1)", "u(k-1)^2", "1"]))))
    model = Fixed(terms=data.table.terms).fit(recording).model_
    found = held_out_errors(model, data, [5])
    phi = np.column_stack([u[:-1], u[:-1] ** 2, np.ones(100)])
    for error, out in zip(found, np.array_split(np.arange(100), 5), strict=True):
        kept = np.setdiff1d(np.arange(100), out)
        theta = np.linalg.lstsq(phi[kept], recording.outputs[0, 1:][kept])[0]
        assert error == pytest.approx(np.sum((recording.outputs[0, 1:][out] - phi[out] @ theta) ** 2), rel=1e-9)


def test_a_section_that_alone_determines_a_parameter_has_no_held_out_error():
    u = np.zeros(101)
    u[30:35] = 1.0
    recording = Recording.from_arrays(u, np.random.default_rng(1).normal(size=101), 1.0)
    data = Regression.on(recording, TermTable(tuple(map(Term.parse, ["u(k-1)", "1"]))))
    found = held_out_errors(Fixed(terms=data.table.terms).fit(recording).model_, data, [5])
    assert np.isinf(found[1]) and np.all(np.isfinite(np.delete(found, 1)))


def test_the_path_goes_on_beyond_an_addition_that_does_not_help():
    rng = np.random.default_rng(2)
    level = np.array([4.0, 4.1, 1.0, 0.99, 1.01])  # nothing, then much, then chance
    errors = level[:, None] * (1 + 0.05 * rng.normal(size=(5, 20)))
    assert smallest_adequate(errors, 0.01) == 2
    errors[2, 3] = np.inf
    assert smallest_adequate(errors, 0.01) == 3
    assert smallest_adequate(np.ones((3, 20)), 0.01) == 0
    assert smallest_adequate(np.full((2, 20), np.inf), 0.01) == 0


def test_the_paired_test_is_that_of_scipy():
    from scipy.stats import ttest_rel

    rng = np.random.default_rng(3)
    for shift in np.linspace(0, 1, 21):
        one, other = rng.normal(size=(2, 20))
        expected = ttest_rel(one + shift, other, alternative="greater").pvalue < 0.05
        assert worse(one + shift, other, 0.05) == expected


def test_noise_on_the_readings_of_a_slow_plant_no_longer_spoils_the_free_run():
    """Four draws: the free run misses the clean output of another record by far less than before."""
    unseen, misses, plain = slow_plant(100), [], []
    for seed in range(4):
        recording = slow_plant(seed, noise=0.1)
        semp = Semp(output_lags=2, input_lags=2, degree=2).fit(recording)
        published = Semp(output_lags=2, input_lags=2, degree=2, max_exchanges=0).fit(recording)
        misses.append(semp.model_.simulate(unseen).rms_error)
        plain.append(published.model_.simulate(unseen).rms_error)
        assert len(semp.terms_) <= 15 and semp.path_[-1].terms == semp.terms_
        assert semp.msse_[-1] == pytest.approx(np.mean(semp.model_.simulate(recording).residuals[0] ** 2), rel=0.02)
    assert np.median(misses) < 0.3 * np.median(plain) and np.median(misses) < 0.03


def test_white_errors_are_left_to_least_squares():
    rng = np.random.default_rng(4)
    u, y = rng.normal(size=600), np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + 0.1 * rng.normal()
    recording = Recording.from_arrays(u, y, 1.0)
    data = Regression.of(recording, output_lags=1, input_lags=1, degree=2)
    assert white(Fixed(terms=["y(k-1)", "u(k-1)"]).fit(recording).model_, data)
    readings = Recording.from_arrays(u, y + rng.normal(size=600), 1.0)
    assert not white(Fixed(terms=["y(k-1)", "u(k-1)"]).fit(readings).model_, data)


def test_an_interrupt_of_the_growth_is_noted():
    stop = StopAt(lambda doing: "growing" in doing and "4 terms" in doing)
    semp = Semp(output_lags=2, input_lags=2, degree=2).fit(slow_plant(0, noise=0.1), progress=stop)
    assert not semp.status_.ok and semp.model_.simulate(slow_plant(0)).status.ok
    assert isinstance(refine(semp.model_, slow_plant(0)), NarxModel)

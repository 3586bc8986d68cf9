"""Frols: the choice, its arithmetic, its criteria, and scikit-learn's contract."""

import math
from functools import partial

import made_narx
import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.narx import Frols, regression
from deatwin.ident.narx.estimate import Ridge
from deatwin.ident.narx.forward import criterion_values, forward_selection
from deatwin.plant.recording import Recording

bilinear = partial(made_narx.bilinear, noise=0.01)


def test_finds_terms_parameters_and_noise():
    frols = Frols(output_lags=3, input_lags=3, degree=2, max_terms=10)
    assert frols.fit(bilinear()) is frols
    found = dict(zip(map(str, frols.terms_), frols.model_.theta, strict=True))
    assert set(found) == {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}
    assert found["y(k-1)"] == pytest.approx(0.5, abs=0.01)
    assert frols.model_.noise_variance == pytest.approx(1e-4, rel=0.2)
    assert len(frols.path_) == frols.criterion_.size == 10 and frols.err_.size == 3
    assert 0.99 < frols.err_.sum() < 1.0


def test_blocks_and_whole_agree(monkeypatch):
    whole = Frols(degree=2).fit(bilinear())
    monkeypatch.setattr(regression, "_BLOCK", 37)
    np.testing.assert_allclose(Frols(degree=2).fit(bilinear()).model_.theta, whole.model_.theta, rtol=1e-13)


def test_forward_selection_against_explicit_projections_on_ill_conditioned_candidates():
    rng = np.random.default_rng(4)
    n, base = 300, rng.normal(size=300)
    rows = np.array([base + 10.0**-power * rng.normal(size=n) for power in (0, 2, 4, 5, 5, 4, 3)])
    target = rows.T @ np.array([1, 2e2, -1e4, 0, 3e5, 0, 0]) + 1e-3 * rng.normal(size=n)
    path = list(forward_selection(rows.copy(), target, 5))
    chosen: list[int] = []
    for step in range(5):
        rest = [j for j in range(len(rows)) if j not in chosen]
        errors = []
        for j in rest:
            q, _ = np.linalg.qr(rows[[*chosen, j]].T)
            errors.append(np.sum((target - q @ (q.T @ target)) ** 2))
        assert path[step].candidate == rest[int(np.argmin(errors))]
        chosen.append(path[step].candidate)
        assert path[step].residual == pytest.approx(min(errors), rel=1e-6)
    assert sum(step.err for step in path) == pytest.approx(1 - path[-1].residual / (target @ target), rel=1e-12)


def test_dependent_candidates_are_not_chosen_twice():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 50))
    path = list(forward_selection(np.array([a, 2 * a, a + b, b]), a + 0.5 * b, 4))
    assert len(path) == 2 and path[-1].residual < 1e-25


@pytest.mark.parametrize("criterion", ["ebic", "bic", "aic"])
def test_noise_free_data_do_not_buy_terms_at_rounding_level(criterion):
    frols = Frols(output_lags=2, input_lags=2, degree=2, max_terms=8, criterion=criterion).fit(bilinear(noise=0.0))
    true = {"y(k-1)": 0.5, "u(k-2)": 0.8, "y(k-1)u(k-1)": -0.3}
    for term, theta in zip(frols.terms_, frols.model_.theta, strict=True):
        assert theta == pytest.approx(true.get(str(term), 0.0), abs=1e-12)


def test_rows_that_are_given_count_as_chosen():
    rng = np.random.default_rng(12)
    given, rows = rng.normal(size=(3, 80)), rng.normal(size=(6, 80))
    rows[0] += given[1]
    target = np.array([1, 2, -1]) @ given + rows[0] + 0.4 * rows[4] + 0.1 * rng.normal(size=80)
    path = list(forward_selection(rows.copy(), target, 2, given=given))
    assert [step.candidate for step in path] == [0, 4]
    left = target - given.T @ np.linalg.lstsq(given.T, target)[0]
    whole = np.vstack([given, rows[[0, 4]]])
    after = np.sum((target - whole.T @ np.linalg.lstsq(whole.T, target)[0]) ** 2)
    assert path[-1].residual == pytest.approx(after, rel=1e-10)
    assert sum(step.err for step in path) == pytest.approx((left @ left - after) / (target @ target), rel=1e-10)


def test_criteria_as_written_in_the_literature():
    rng = np.random.default_rng(8)
    rows, target = rng.normal(size=(9, 40)), rng.normal(size=40)
    path = list(forward_selection(rows.copy(), target, 3))
    n, p, k, s = 40, 9, 3, path[2].residual / 40
    expected = {"aic": n * math.log(s) + 2 * k, "bic": n * math.log(s) + k * math.log(n)}
    for name, value in expected.items():
        assert criterion_values(name, path, target, p)[2] == pytest.approx(value, rel=1e-12)
    # EBIC (Chen and Chen 2008, gamma = 1, for up to p/2 terms), plus a constant
    path = list(forward_selection(rows.copy(), target, 7))
    values = criterion_values("ebic", path, target, p) - criterion_values("bic", path, target, p)
    choices = [2 * math.log((p + 1) * math.comb(p, min(j, p // 2))) for j in range(1, 8)]
    np.testing.assert_allclose(values, choices, rtol=1e-10)


def test_the_extended_criterion_withstands_many_false_candidates():
    """One true term among 164 white candidates, 300 samples, 200 draws.

    The next best candidate lowers n ln s by the largest of 163 chi-square variables of one degree of freedom. BIC takes
    it when that exceeds ln 300 = 5.70: with probability 1 - (1 - 0.0169)^163 = 94 %. The extended criterion asks for
    5.70 + 2 ln(163/2) = 14.5: 1 - (1 - 0.00014)^163 = 2.3 %; 15 of 200 are 5 standard deviations above that.
    """
    rng = np.random.default_rng(11)
    false = dict.fromkeys(("ebic", "bic"), 0)
    for _ in range(200):
        rows = rng.normal(size=(164, 300))
        target = rows[3] + rng.normal(size=300)
        path = list(forward_selection(rows, target, 3))
        for name in false:
            false[name] += int(np.argmin(criterion_values(name, path, target, 164))) > 0
    assert false["ebic"] <= 15
    assert false["bic"] >= 170  # 188 expected, 3.4 the standard deviation


def test_free_run_error_chooses_over_the_held_out_samples():
    recording = bilinear(500, seed=3, noise=0.05)
    frols = Frols(output_lags=3, input_lags=3, degree=2, max_terms=8, criterion="free_run", held_out=0.4).fit(recording)
    training, held_out = recording.section(0, 300), recording.section(300, 500)
    # The same by hand: each length of the path fitted to the beginning and run free over the end, from its sample 3 on.
    for k in range(1, 9):
        first = Frols(output_lags=3, input_lags=3, degree=2, max_terms=k, criterion="none").fit(training)
        assert first.terms_ == frols.path_[:k]
        run = first.model_.simulate(held_out.section(3 - first.model_.table.max_lag, 200))
        assert frols.criterion_[k - 1] == pytest.approx(run.rms_error**2, rel=1e-9)
    assert len(frols.terms_) == int(np.argmin(frols.criterion_)) + 1
    assert frols.model_.provenance["samples"] == str(500 - 3)  # the parameters are of all samples


def test_free_run_error_of_one_of_several_outputs_takes_the_others_as_measured():
    rng = np.random.default_rng(13)
    n = 300
    u, y = rng.uniform(-1, 1, n), np.zeros((2, n))
    for k in range(1, n):
        y[0, k] = 0.5 * y[0, k - 1] + 0.3 * y[1, k - 1] + u[k - 1]
        y[1, k] = -0.4 * y[1, k - 1] + 0.5 * y[0, k - 1] * u[k - 1] + 0.1 * rng.normal()
    frols = Frols(output_lags=1, input_lags=1, max_terms=4, criterion="free_run").fit(Recording.from_arrays(u, y, 1.0))
    first, second = frols.equations_
    assert {str(term) for term in first.path_[:3]} == {"y1(k-1)", "y2(k-1)", "u(k-1)"}
    # The first equation holds exactly, so that its run does too, though the second output is noisy.
    assert first.criterion_[2] < 1e-20 < second.criterion_.min()


def test_another_estimator_takes_the_chosen_terms():
    recording = bilinear()
    plain, ridge = Frols().fit(recording), Frols(estimator=Ridge(penalty=1.0)).fit(recording)
    assert plain.terms_ == ridge.terms_
    assert np.abs(ridge.model_.theta).sum() < 0.9 * np.abs(plain.model_.theta).sum()
    assert "Ridge(penalty=1.0)" in ridge.model_.provenance["identifier"]


def test_an_interrupted_free_run_keeps_the_models_that_were_run():
    stop = StopAt(lambda doing: doing == "free run with 4 terms")
    frols = Frols(criterion="free_run", max_terms=8, degree=3).fit(bilinear(), progress=stop)
    assert not frols.status_.ok and np.isfinite(frols.criterion_).sum() == 4 and len(frols.path_) == 8
    assert len(frols.terms_) == 1 + int(np.argmin(frols.criterion_[:4])) and np.all(
        np.diff([share for share, _ in stop.told]) > 0
    )

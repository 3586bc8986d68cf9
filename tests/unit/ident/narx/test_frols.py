"""Frols: the choice, its arithmetic, and scikit-learn's contract."""

import numpy as np
import pytest

from deatwin.ident.narx import Frols
from deatwin.ident.narx.frols import forward_selection, least_squares
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Experiment, Recording


def bilinear(n=400, seed=0, noise=0.01, start=0.0, units=(1.0, 1.0)):
    """y(k) = 0.5 y(k-1) + 0.8 u(k-2) - 0.3 y(k-1)u(k-1) + e(k), in other units."""
    rng = np.random.default_rng(seed)
    u, e, y = rng.uniform(-1, 1, n), noise * rng.normal(size=n), np.zeros(n)
    for k in range(2, n):
        y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] - 0.3 * y[k - 1] * u[k - 1] + e[k]
    return Recording.from_arrays(u * units[0], y * units[1], 0.1, start=start)


def test_finds_terms_parameters_and_noise():
    frols = Frols(output_lags=3, input_lags=3, degree=2, max_terms=10)
    assert frols.fit(bilinear()) is frols
    found = dict(zip(map(str, frols.terms_), frols.model_.theta, strict=True))
    assert set(found) == {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}
    assert found["y(k-1)"] == pytest.approx(0.5, abs=0.01)
    assert frols.model_.noise_variance == pytest.approx(1e-4, rel=0.2)
    assert len(frols.path_) == frols.criterion_.size == 10 and frols.err_.size == 3
    assert 0.99 < frols.err_.sum() < 1.0


def test_units_change_nothing_but_the_units():
    plain = Frols(degree=2).fit(bilinear())
    small = Frols(degree=2).fit(bilinear(units=(2.0**11, 2.0**-13)))
    assert plain.terms_ == small.terms_
    np.testing.assert_array_equal(plain.err_, small.err_)
    powers = {"y(k-1)": 0, "u(k-2)": -24, "y(k-1)u(k-1)": -11}
    factors = np.array([2.0 ** powers[str(term)] for term in plain.terms_])
    np.testing.assert_array_equal(small.model_.theta, plain.model_.theta * factors)
    np.testing.assert_array_equal(small.model_.theta_cov, plain.model_.theta_cov * np.outer(factors, factors))


def test_covariance_is_that_of_least_squares():
    recording = bilinear()
    model = Frols(degree=2).fit(recording).model_
    phi = model.table.rows(recording.inputs, recording.outputs, 2, recording.n_samples).T
    theta, residual, *_ = np.linalg.lstsq(phi, recording.outputs[0, 2:])
    np.testing.assert_allclose(model.theta, theta, rtol=1e-10)
    sigma = residual[0] / (phi.shape[0] - phi.shape[1])
    assert model.noise_variance == pytest.approx(sigma, rel=1e-10)
    np.testing.assert_allclose(model.theta_cov, sigma * np.linalg.inv(phi.T @ phi), rtol=1e-8)


def test_each_recording_starts_with_its_own_lags():
    parts = [bilinear(150, seed=1), bilinear(250, seed=2, start=100.0)]
    together = Frols(degree=2).fit(Experiment(recordings=tuple(parts)))
    assert together.model_.provenance["samples"] == str(148 + 248)
    np.testing.assert_array_equal(Frols(degree=2).fit(parts).model_.theta, together.model_.theta)
    rows, targets = [], []
    for part in parts:
        rows.append(together.model_.table.rows(part.inputs, part.outputs, 2, part.n_samples))
        targets.append(part.outputs[0, 2:])
    theta, *_ = np.linalg.lstsq(np.concatenate(rows, axis=1).T, np.concatenate(targets))
    np.testing.assert_allclose(together.model_.theta, theta, rtol=1e-10)


def test_blocks_and_whole_agree(monkeypatch):
    whole = Frols(degree=2).fit(bilinear())
    monkeypatch.setattr("deatwin.ident.narx.regression._BLOCK", 37)
    np.testing.assert_allclose(Frols(degree=2).fit(bilinear()).model_.theta, whole.model_.theta, rtol=1e-13)


def test_forward_selection_against_explicit_projections_on_ill_conditioned_candidates():
    rng = np.random.default_rng(4)
    n, base = 300, rng.normal(size=300)
    rows = np.array([base + 10.0**-power * rng.normal(size=n) for power in (0, 2, 4, 5, 5, 4, 3)])
    target = rows.T @ np.array([1, 2e2, -1e4, 0, 3e5, 0, 0]) + 1e-3 * rng.normal(size=n)
    path = forward_selection(rows.copy(), target, 5)
    chosen: list[int] = []
    for step in range(5):
        rest = [j for j in range(len(rows)) if j not in chosen]
        errors = []
        for j in rest:
            q, _ = np.linalg.qr(rows[[*chosen, j]].T)
            errors.append(np.sum((target - q @ (q.T @ target)) ** 2))
        assert path.chosen[step] == rest[int(np.argmin(errors))]
        chosen.append(path.chosen[step])
        assert path.residual[step] == pytest.approx(min(errors), rel=1e-6)
    assert sum(path.err) == pytest.approx(1 - path.residual[-1] / (target @ target), rel=1e-12)


def test_dependent_candidates_are_not_chosen_twice():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 50))
    path = forward_selection(np.array([a, 2 * a, a + b, b]), a + 0.5 * b, 4)
    assert len(path.chosen) == 2 and path.residual[-1] < 1e-25


def test_least_squares_survives_unequal_columns():
    rng = np.random.default_rng(6)
    rows = rng.normal(size=(3, 100)) * np.array([[1e-12], [1.0], [1e9]])
    theta, cov, noise = least_squares(rows, np.array([1e12, -1.0, 2e-9]) @ rows)
    np.testing.assert_allclose(theta, [1e12, -1.0, 2e-9], rtol=1e-12)
    assert noise < 1e-25 and np.all(np.diag(cov) >= 0)


@pytest.mark.parametrize("criterion", ["bic", "aic", "aicc"])
def test_noise_free_data_do_not_buy_terms_at_rounding_level(criterion):
    frols = Frols(output_lags=2, input_lags=2, degree=2, max_terms=8, criterion=criterion).fit(
        bilinear(noise=0.0)
    )
    true = {"y(k-1)": 0.5, "u(k-2)": 0.8, "y(k-1)u(k-1)": -0.3}
    for term, theta in zip(frols.terms_, frols.model_.theta, strict=True):
        assert theta == pytest.approx(true.get(str(term), 0.0), abs=1e-12)


def test_scikit_learn_contract():
    base = pytest.importorskip("sklearn.base")
    lags = [1, 3]
    frols = Frols(output_lags=lags, criterion="aic")
    assert frols.output_lags is lags
    again = base.clone(frols)
    assert again is not frols and again.get_params() == frols.get_params()
    assert again.set_params(degree=3).degree == 3
    with pytest.raises(ModelError, match='did you mean "degree"'):
        frols.set_params(degre=3)
    assert not [name for name in vars(frols) if name.endswith("_")]
    assert repr(Frols(degree=3)).startswith("Frols(output_lags=2, input_lags=2, degree=3")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"criterion": "bik"}, 'did you mean "bic"'),
        ({"max_terms": 0}, "max_terms"),
        ({"degree": 0}, "degree"),
        ({"max_terms": 500}, "too few"),
        ({"output_lags": 600, "degree": 1}, "samples"),
    ],
)
def test_senseless_arguments_are_refused(arguments, says):
    with pytest.raises(ModelError, match=says):
        Frols(**arguments).fit(bilinear())


def test_data_that_say_nothing_are_refused():
    with pytest.raises(ModelError, match="constantly zero"):
        Frols().fit(Recording.from_arrays(np.ones(50), np.zeros(50), 1.0))
    with pytest.raises(ModelError, match="at least one"):
        Frols().fit([])
    with pytest.raises(ModelError, match="sample time"):
        Frols().fit([bilinear(), Recording.from_arrays(np.ones(50), np.ones(50), 1.0)])


@pytest.mark.parametrize("given", ["recording.csv", None, 3.0])
def test_fit_refuses_what_is_no_recording(given):
    with pytest.raises(ModelError, match="fit takes recordings and experiments"):
        Frols().fit(given)

"""Lasso: its path against the conditions of optimality, its choice, and its arguments."""

from functools import partial

import made_narx
import numpy as np
import pytest
from stopping import StopAt

from deatwin.ident.narx.identifier import FitStatus
from deatwin.ident.narx.lasso import Lasso, lasso_path
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS

bilinear = partial(made_narx.bilinear, noise=0.05)


@pytest.mark.parametrize("centred", [True, False])
def test_every_knot_is_optimal(centred):
    """The conditions of Karush, Kuhn and Tucker: z'r/n = penalty sign(b) where b is not 0, and at most the penalty."""
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(12, 90)) * np.geomspace(1e-3, 1e3, 12)[:, None] + 0.3
    rows[5] = 2.0  # does not vary
    rows[7] = rows[6] * 1e3 + 0.1 * rows[7]  # correlated
    target = 1e3 * rows[0] - rows[6] / 10 + 0.2 * rng.normal(size=90) + 5
    taking_part, penalties, coefficients = lasso_path(rows, target, centred=centred, max_knots=40)
    assert (5 in taking_part) is not centred
    means = rows.mean(axis=1, keepdims=True) if centred else 0.0
    z = rows - means
    z = (z / np.sqrt(np.mean(z**2, axis=1, keepdims=True)).clip(1e-30))[taking_part]
    y = target - target.mean() if centred else target
    y = y / np.sqrt(np.mean(y**2))
    assert np.all(np.diff(penalties) < 0) and np.count_nonzero(coefficients[:, 0]) == 0
    for penalty, b in zip(penalties, coefficients.T, strict=True):
        slopes = z @ (y - b @ z) / y.size
        assert np.all(np.abs(slopes) <= penalty + 1e-9)
        np.testing.assert_allclose(slopes[b != 0], penalty * np.sign(b[b != 0]), atol=1e-9)


def test_the_choice_is_the_least_free_run_error_of_the_refits():
    recording = bilinear(300, seed=4)
    lasso = Lasso(degree=2, max_terms=6, held_out=1 / 3).fit(recording)
    training, held_out = recording.section(0, 200), recording.section(200, 300)
    data = Regression.of(training, output_lags=2, input_lags=2, degree=2)
    path = lasso.path_
    by_hand = []
    for b in path.coefficients.T:
        support = [data.table.terms.index(term) for term, value in zip(path.terms, b, strict=True) if value]
        errors = [np.inf]
        for structure in (support, [0, *support]):
            if 0 < len(structure) <= 6:
                kept = data.only(structure)
                rows, target = kept.matrix()
                theta, *_ = np.linalg.lstsq(rows.T, target)
                model = kept.model(theta, np.zeros((len(theta),) * 2), 0.0, identifier=lasso)
                run = model.simulate(held_out.section(2 - model.table.max_lag, 100))
                errors.append(run.rms_error if run.status.ok else np.inf)
        by_hand.append(min(errors))
    np.testing.assert_allclose(path.errors, by_hand, rtol=1e-8)
    assert path.chosen == int(np.argmin(by_hand))
    held = {term for term, value in zip(path.terms, path.coefficients[:, path.chosen], strict=True) if value}
    assert held <= set(lasso.terms_) <= held | {data.table.terms[0]}


def test_the_constant_is_not_penalised_but_may_be_left_out():
    raised = Lasso(degree=2, max_terms=8).fit(bilinear(level=0.7, seed=5))
    found = dict(zip(map(str, raised.terms_), raised.model_.theta, strict=True))
    assert found["1"] == pytest.approx(0.7, abs=0.1)
    level = Lasso(degree=2, max_terms=8).fit(bilinear(seed=5))
    assert "1" not in map(str, level.terms_)
    assert "1" not in map(
        str, Lasso(rule=lambda term: term.degree > 0, max_terms=8).fit(bilinear(level=0.7, seed=5)).terms_
    )


@pytest.mark.parametrize("name", ["S2", "S6"])
def test_true_terms_are_kept_among_165_candidates(name):
    system = SYSTEMS[name]
    lags = {"output_lags": system.output_lags, "input_lags": system.input_lags, "degree": system.degree}
    kept = 0
    for seed in range(6):
        lasso = Lasso(**lags).fit(system.draw(np.random.default_rng(seed)).recording)
        assert len(lasso.path_.terms) == 164
        kept += set(system.terms) <= set(lasso.terms_)
    assert kept >= 4  # S6 is at the limit of what 500 samples tell


def test_an_interrupt_keeps_the_best_knot():
    lasso = Lasso(degree=2).fit(bilinear(), progress=StopAt(5))
    assert lasso.status_ is FitStatus.INTERRUPTED
    assert np.all(np.isinf(lasso.path_.errors[5:])) and lasso.path_.chosen < 5


def test_the_path_is_drawn():
    lasso = Lasso(degree=2, max_terms=6).fit(bilinear())
    ax = lasso.path_.plot(most=3)
    largest = np.argsort(-np.abs(lasso.path_.coefficients[:, lasso.path_.chosen]))[:3]
    named = [text.get_text() for text in ax.get_legend().get_texts()]
    assert named == [str(lasso.path_.terms[i]) for i in largest]
    assert ax.get_xscale() == "log"

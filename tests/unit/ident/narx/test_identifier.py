"""scikit-learn's contract: tags, scores, nested parameters, clones and searches over recordings."""

import subprocess
import sys

import numpy as np
import pytest

from deatwin.ident.narx import Fixed, Frols, Grow, Narmax, Semp, SvbNarx
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.linear import Arx
from deatwin.ident.testing import example_recordings
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def parts():
    return [part for record in example_recordings(300) for part in (record.section(0, 140), record.section(140, 280))]


def test_the_score_is_the_coefficient_of_determination_of_the_free_run():
    from sklearn import metrics

    data = parts()
    found = Frols(criterion="bic").fit(data[:2])
    runs = [found.model_.simulate(record) for record in data[2:]]
    measured = np.concatenate([run.measured[0, run.first :] for run in runs])
    computed = np.concatenate([run.outputs[0, run.first :] for run in runs])
    assert found.score(data[2:]) == pytest.approx(metrics.r2_score(measured, computed), rel=1e-12)


def test_a_free_run_that_diverges_scores_worse_than_any_other():
    found = Fixed(terms=["y(k-1)", "y(k-1)^2", "u(k-1)"]).fit(example_recordings())
    wild = example_recordings()[0]
    wild = Recording.from_arrays(1e3 * wild.inputs, 1e3 * wild.outputs, wild.sample_time)
    assert found.score(wild) == -np.inf


def test_a_score_needs_a_fit_and_an_output_that_moves():
    record = example_recordings()[0]
    with pytest.raises(ModelError, match="not fitted"):
        Frols().score(record)
    still = Recording.from_arrays(record.inputs, np.ones(record.outputs.shape), record.sample_time)
    with pytest.raises(ModelError, match="constant"):
        Fixed(terms=["y(k-1)", "u(k-1)"]).fit(record).score(still)


def test_arguments_of_an_inner_estimator_are_got_set_and_cloned():
    from sklearn import base

    outer = Narmax(Frols(degree=2))
    assert outer.get_params()["process__degree"] == 2
    assert "process__degree" not in outer.get_params(deep=False)
    copy = base.clone(outer)
    assert copy.set_params(process__degree=3, max_noise_terms=1) is copy
    assert (copy.process.degree, copy.max_noise_terms, outer.process.degree) == (3, 1, 2)
    with pytest.raises(ModelError, match="Frols has no argument 'degre'"):
        copy.set_params(process__degre=3)
    with pytest.raises(ModelError, match="noise_lags__n"):
        copy.set_params(noise_lags__n=3)
    fresh = Frols()
    copy.set_params(process__degree=1, process=fresh)
    assert copy.process is fresh and fresh.degree == 1


@pytest.mark.parametrize(
    ("identifier", "grid", "best"),
    [
        (Frols(criterion="bic"), {"degree": [1, 2]}, {"degree": 2}),
        (Narmax(Frols(criterion="bic")), {"process__degree": [1, 2]}, {"process__degree": 2}),
        (SvbNarx(), {"input_lags": [1, 2], "output_lags": [1]}, {"input_lags": 2, "output_lags": 1}),
        (Arx(na=1, nb=1), {"nk": [1, 2]}, {"nk": 2}),
    ],
)
def test_a_grid_search_over_a_list_of_recordings_finds_the_structure_of_the_data(identifier, grid, best):
    from sklearn import model_selection as selection

    data = parts()
    search = selection.GridSearchCV(identifier, grid, cv=2, error_score="raise").fit(data)
    assert search.best_params_ == best
    assert search.score(data) == search.best_estimator_.score(data)
    scores = selection.cross_val_score(identifier, data, cv=selection.LeaveOneOut())
    assert scores.shape == (4,) and np.all(scores <= 1)


@pytest.mark.parametrize(
    "identifier",
    [
        Frols(),
        Lasso(degree=2),
        SvbNarx(),
        Semp(output_lags=2, input_lags=2, degree=2),
        Fixed(terms=["y(k-1)", "u(k-2)"]),
        Grow(degree=1),
    ],
    ids=lambda one: type(one).__name__,
)
def test_units_change_nothing_but_the_units(identifier):
    """Powers of two change no digit: each parameter is scaled by what its term is."""
    record = example_recordings()[0]
    units = {"u": 2.0**11, "y": 2.0**-13}
    other = Recording.from_arrays(record.inputs * units["u"], record.outputs * units["y"], record.sample_time)
    plain, scaled = (
        identifier.fit(record).model_,
        type(identifier)(**identifier.get_params(deep=False)).fit(other).model_,
    )
    assert scaled.terms == plain.terms
    factors = np.array([units["y"] / np.prod([units[v.kind] for v in term.expanded]) for term in plain.terms])
    np.testing.assert_array_equal(scaled.theta, plain.theta * factors)
    np.testing.assert_array_equal(scaled.theta_cov, plain.theta_cov * np.outer(factors, factors))


def test_importing_the_identifiers_does_not_import_scikit_learn():
    asked = "import sys, deatwin.ident.narx, deatwin.ident.testing; sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", asked], check=False).returncode == 0

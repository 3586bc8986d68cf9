"""Inputs of few levels: relations between powers by algebra, candidates, choices and sentences."""

import numpy as np
import pytest
from scipy.signal import butter, decimate, lfilter

from deatwin.ident.narx import Frols, Lasso, Semp
from deatwin.ident.narx.forward import forward_selection
from deatwin.ident.narx.levels import few_levels, without_repeated_powers
from deatwin.ident.narx.preprocess import FindingKind, inspect_recordings
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, generate_terms
from deatwin.plant.recording import Recording


def steps(levels, n=1500, noise=0.0, seed=0):
    """x(k) = 0.99 x(k-1) + 0.01 u(k-1), u resting at the levels in turn."""
    rng = np.random.default_rng(seed)
    u = np.resize(np.repeat(levels, 150), n).astype(float)
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = 0.99 * x[k - 1] + 0.01 * u[k - 1]
    return Recording.from_arrays(u, x + noise * rng.normal(size=n), 1.0)


def test_levels_are_told_apart_beyond_rounding():
    np.testing.assert_allclose(few_levels(np.array([0.3, 0.1 + 0.2, 0.7]), 3), [0.3, 0.7])
    assert few_levels(np.arange(5.0), 4).size == 0 and few_levels(np.arange(5.0), 5).size == 5
    assert few_levels(np.append(np.zeros(1000), [1, 2, 3]), 3).size == 0
    assert few_levels(np.array([0.0, 1e-300]), 3).size == 2


def held(rng, levels, hold, n=1500):
    return np.repeat(rng.choice(levels, n // hold + 1), hold)[:n].astype(float)


@pytest.mark.parametrize("hold", [1, 3, 15, 60])
@pytest.mark.parametrize("noise", [1e-6, 1e-4, 1e-3, 5e-3])
def test_noise_on_the_readback_makes_no_levels(hold, noise):
    """Two levels are two, three are three, in all of 10 recordings of each; with a degree of 2, three are not few."""
    for seed in range(10):
        rng = np.random.default_rng([seed, hold])
        scatter = 2.0 * noise * rng.normal(size=1500)
        np.testing.assert_allclose(few_levels(held(rng, (1.0, 3.0), hold) + scatter, 3), [1.0, 3.0], atol=2 * noise)
        three = held(rng, (-1.0, 0.0, 1.0), hold) + scatter
        assert few_levels(three, 3).size == 3 and few_levels(three, 2).size == 0


def test_edges_that_a_filter_smears_are_no_levels():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        for noise in (0.0, 1e-3):
            smeared = decimate(held(rng, (0.0, 1.0), 30, 6000) + noise * rng.normal(size=6000), 4, zero_phase=True)
            np.testing.assert_allclose(few_levels(smeared, 3), [0.0, 1.0], atol=0.02)
            assert few_levels(lfilter(*butter(2, 0.3), held(rng, (0.0, 1.0), 60)), 3).size == 2


@pytest.mark.parametrize(
    "signal",
    [
        lambda rng, t: rng.uniform(-1, 1, t.size),
        lambda rng, t: rng.normal(size=t.size),
        lambda rng, t: 5.0 + 1e-4 * rng.normal(size=t.size),
        lambda rng, t: np.repeat(rng.uniform(-1, 1, 75), 20),
        lambda rng, t: np.sin(t / 100),
        lambda rng, t: np.abs(t / 50 % 2 - 1),
        lambda rng, t: np.r_[np.zeros(50), 100 + rng.uniform(-1, 1, t.size - 50)],  # the rig is started first
        lambda rng, t: held(rng, (1.0, 3.0), 300) + 0.02 * np.sin(t / 3),  # two operating points, gains at each
        lambda rng, t: held(rng, (1.0, 3.0), 300) + 0.02 * np.repeat(rng.uniform(-1, 1, 300), 5),
        lambda rng, t: np.where(t % 100 < 20, np.repeat(rng.uniform(0.5, 1, 15), 100), 0.0),  # pulses of many heights
        lambda rng, t: np.where(t % 300 < 10, 0.0, held(rng, (-1.0, 1.0), 15)) + 1e-3 * rng.normal(size=t.size),
    ],
)
def test_commands_of_many_levels_have_many(signal):
    for seed in range(10):
        values = signal(np.random.default_rng(seed), np.arange(1500))
        assert few_levels(values, 2).size == few_levels(values, 1).size == 0


@pytest.mark.parametrize("levels", [(0.0, 1.0), (-1.0, 1.0), (0.2, 0.7), (-1.0, 0.0, 1.0), (0.0, 1.0, 3.0)])
def test_no_candidate_is_lost_that_the_others_do_not_make_up(levels):
    """The candidates that are left span what all of them span: their rank is that of all, and they are fewer."""
    rng = np.random.default_rng(1)
    u, y = rng.choice(levels, size=400), rng.normal(size=400)
    recording = Recording.from_arrays(u, y, 1.0)
    terms = generate_terms(1, 2, 3)
    left = without_repeated_powers(terms, [recording])
    assert len(left) < len(terms)
    data = Regression.on(recording, type(Regression.of(recording, output_lags=1, input_lags=2, degree=1).table)(terms))
    rows = dict(zip(terms, data.matrix()[0], strict=True))
    kept = np.array([rows[term] for term in left])
    assert np.linalg.matrix_rank(kept) == len(left) == np.linalg.matrix_rank(np.array(list(rows.values())))
    most = len(levels) - 1
    assert all(power <= most for term in left for variable, power in term.factors if variable.kind == "u")


def test_a_power_stays_where_no_lower_one_is_a_candidate():
    recording = steps((0.0, 1.0))
    squares = (Term.parse("y(k-1)"), Term.parse("u(k-1)^2"))
    assert without_repeated_powers(squares, [recording]) == squares
    minus = (Term.parse("1"), Term.parse("u(k-1)^2"))
    assert without_repeated_powers(minus, [steps((-1.0, 1.0))]) == minus[:1]
    several = [steps((0.0, 1.0)), steps((0.0, 2.0))]  # three levels together
    assert Term.parse("u(k-1)^2") in without_repeated_powers(generate_terms(1, 1, 2), several)


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize("identifier", [Frols(), Semp(), Lasso()], ids=lambda one: type(one).__name__)
def test_of_equal_terms_the_one_of_lowest_degree_is_chosen(identifier, noise):
    model = identifier.fit(steps((0.0, 1.0), noise=noise)).model_
    assert all(power == 1 for term in model.terms for variable, power in term.factors if variable.kind == "u")
    if not noise and not isinstance(identifier, Lasso):
        assert {str(term) for term in model.terms} == {"y(k-1)", "u(k-1)"}


def test_of_equal_candidates_the_first_is_chosen_whatever_rounding_says():
    rng = np.random.default_rng(2)
    p, q = rng.normal(size=(2, 500))
    for factor in (0.3, 0.7, 3.0, 1e3):
        rows = np.array([p, factor * p, q, factor * q])
        chosen = [step.candidate for step in forward_selection(rows.copy(), 2 * q + p, 4)]
        assert chosen == [2, 0]


def test_the_findings_name_inputs_of_few_levels():
    (found,) = [f for f in inspect_recordings(steps((0.0, 1.0))) if f.kind is FindingKind.FEW_LEVELS]
    assert found.count == 2 and found.size == 1.0 and "takes only 2 levels, which show no curvature" in found.text
    together = inspect_recordings([steps((0.0, 1.0)), steps((0.5, 2.0)), steps((3.0, 4.0))])
    assert FindingKind.FEW_LEVELS not in {f.kind for f in together}  # six levels in all
    three = steps((0.0, 1.0, 3.0))
    kinds = {degree: {f.kind for f in inspect_recordings(three, degree=degree)} for degree in (2, 3)}
    assert FindingKind.FEW_LEVELS in kinds[3] and FindingKind.FEW_LEVELS not in kinds[2]

"""Structure selection on the published benchmark systems.

Systems S2, S3, S4 and S6 as tabled in arXiv:2109.09917, with 500 samples, lags 4, degree 3 (165
candidates); E1 of W. R. Jacobs' thesis, section 6.5.1, with 1000 samples, noise variance 0.004, degree 4 (495
candidates). S6 is used in its original form, with 0.25 u(k-1) and -0.2 y(k-2)u(k-1). Seeds are fixed; draws
that diverge (about one in six on E1) are replaced.

Demanded here of the plain variational algorithm: every true term is kept in every run, and the structure is
exact in at least 75 % of the runs on S2 to S4 and in at least half on E1: one false term can raise the lower
bound. Where the structure is exact, the 95 % intervals of the parameters cover the truth in 90 to 99 % of the
cases.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import t as student

from deatwin.ident.narx import Frols, NarxModel, SvbNarx, Term
from deatwin.plant.recording import Recording

RUNS = 30


@dataclass(frozen=True)
class System:
    terms: dict[str, float]
    draw: Callable[[np.random.Generator, int], np.ndarray]
    noise: float
    samples: int = 500
    degree: int = 3


def uniform(rng, n):
    return rng.uniform(-1, 1, n)


MAO_BILLINGS = {"y(k-1)^3": 0.2, "y(k-1)u(k-1)": 0.7, "u(k-2)^2": 0.6, "y(k-2)u(k-2)^2": -0.7, "y(k-2)": -0.5}
SYSTEMS = {
    "S2": System(
        {"y(k-1)": 0.8, "u(k-1)": 0.4, "u(k-1)^2": 0.4, "u(k-1)^3": 0.4}, lambda rng, n: rng.normal(0, 0.3, n), 0.01
    ),
    "S3": System(MAO_BILLINGS, uniform, 0.01),
    "S4": System({"y(k-1)u(k-1)": 0.7, "y(k-2)": -0.5, "u(k-2)^2": 0.6, "y(k-2)u(k-2)^2": -0.7}, uniform, 0.04),
    "S6": System({"y(k-2)": 0.75, "u(k-1)": 0.25, "y(k-2)u(k-1)": -0.2}, lambda rng, n: rng.normal(0, 0.25, n), 0.02),
    "E1": System(MAO_BILLINGS, uniform, 0.004**0.5, samples=1000, degree=4),
}


def draw(name: str, seed: int) -> Recording:
    """Simulate a system with noise inside; a draw that diverges is replaced."""
    system, rng = SYSTEMS[name], np.random.default_rng(seed)
    # The noise enters as a second input with the coefficient 1.
    terms = {text.replace("u", "u1"): value for text, value in system.terms.items()} | {"u2(k)": 1.0}
    model = NarxModel.from_terms(terms, sample_time=1.0)
    while True:
        u, e = system.draw(rng, system.samples), rng.normal(0, system.noise, system.samples)
        run = model.simulate(Recording.from_arrays([u, e], np.zeros(u.size), 1.0))
        if run.status.ok:
            return Recording.from_arrays(u, run.outputs, 1.0)


def true_terms(name: str) -> dict[Term, float]:
    return {Term.parse(text): value for text, value in SYSTEMS[name].terms.items()}


def candidates(name: str) -> dict[str, int]:
    return {"output_lags": 4, "input_lags": 4, "degree": SYSTEMS[name].degree}


@pytest.fixture(scope="module", params=["S2", "S3", "S4"])
def svb_runs(request):
    return request.param, [
        SvbNarx(**candidates(request.param), clean_up="none").fit(draw(request.param, seed)) for seed in range(RUNS)
    ]


def test_svb_keeps_every_true_term_and_is_mostly_exact(svb_runs):
    name, runs = svb_runs
    truth = set(true_terms(name))
    assert all(truth <= set(run.terms_) for run in runs)
    assert sum(truth == set(run.terms_) for run in runs) >= 0.75 * RUNS


def test_svb_intervals_cover_the_truth(svb_runs):
    name, runs = svb_runs
    truth = true_terms(name)
    hits = []
    for model in (run.model_ for run in runs if set(run.terms_) == set(truth)):
        scale = np.sqrt(np.diag(model.theta_cov) * (model.theta_dof - 2) / model.theta_dof)
        errors = model.theta - [truth[term] for term in model.terms]
        hits += list(np.abs(errors) < student.ppf(0.975, model.theta_dof) * scale)
    assert 0.90 <= np.mean(hits) <= 0.99


def test_svb_noise_variance(svb_runs):
    name, runs = svb_runs
    # b0 = 1e-4 adds 4e-7 in scaled units, a few per cent of the least noise; a sample scatters by sqrt(2 /
    # 500)
    assert np.median([run.model_.noise_variance for run in runs]) == pytest.approx(SYSTEMS[name].noise ** 2, rel=0.1)


def test_svb_on_the_thesis_example():
    truth = set(true_terms("E1"))
    runs = [SvbNarx(**candidates("E1"), clean_up="none").fit(draw("E1", seed)) for seed in range(4)]
    assert len(runs[0].path_[0].terms) == 495
    assert all(truth <= set(run.terms_) for run in runs)
    assert sum(truth == set(run.terms_) for run in runs) >= 2


@pytest.mark.parametrize("name", ["S2", "S6"])
def test_frols_finds_the_true_terms_first_where_the_literature_says_so(name):
    """Published: FROLS is right on S2 and S6, the number of terms being known. Demanded: 90 % of runs on S2.

    S6 is at the limit of what 500 samples tell (published rates of randomised methods are 66 to 100 %); its
    two linear terms must come first in every run.
    """
    truth = true_terms(name)
    paths = [
        Frols(**candidates(name), max_terms=len(truth), criterion="none").fit(draw(name, seed)).path_
        for seed in range(RUNS)
    ]
    if name == "S2":
        assert sum(set(path) == set(truth) for path in paths) >= 0.9 * RUNS
    else:
        assert all({str(term) for term in path[:2]} == {"y(k-2)", "u(k-1)"} for path in paths)

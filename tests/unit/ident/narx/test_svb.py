"""SvbNarx: the posterior, the bound, the pruning."""

import math

import numpy as np
import pytest
from made_narx import bilinear
from scipy import integrate
from scipy.special import gammaln
from stopping import StopAt, interrupted

from deatwin.ident.narx import SvbNarx, svb
from deatwin.ident.narx.bayes import Priors, Statistics, fit_relevance, posterior
from deatwin.ident.narx.identifier import FitStatus
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def statistics(phi, y):
    return Statistics(gram=phi.T @ phi, moment=phi.T @ y, power=float(y @ y), n_samples=y.size)


def problem(seed, n=60, m=8, noise=0.3):
    rng = np.random.default_rng(seed)
    phi = rng.normal(size=(n, m)) * 10 ** rng.uniform(-1, 1, m)
    theta = np.where(rng.uniform(size=m) < 0.5, rng.normal(size=m), 0.0)
    return phi, phi @ theta + noise * rng.normal(size=n)


def test_with_relevances_held_the_posterior_is_the_closed_form():
    """Normal-gamma conjugacy by the inverse of the marginal covariance: another route than the code's."""
    phi, y = problem(0)
    alpha = np.random.default_rng(1).uniform(0.1, 10, 8)
    priors = Priors(a0=0.7, b0=0.4)
    q = posterior(statistics(phi, y), alpha, priors)
    marginal = np.eye(y.size) + phi @ np.diag(1 / alpha) @ phi.T
    gain = np.diag(1 / alpha) @ phi.T @ np.linalg.inv(marginal)
    np.testing.assert_allclose(q.mean, gain @ y, rtol=1e-10)
    v = np.diag(1 / alpha) - gain @ phi @ np.diag(1 / alpha)
    np.testing.assert_allclose(q.root.T @ q.root, v, rtol=1e-10, atol=1e-10 * np.abs(v).max())
    np.testing.assert_allclose(q.spread, np.diag(v), rtol=1e-10)
    assert q.a == 0.7 + y.size / 2
    assert q.b == pytest.approx(0.4 + 0.5 * y @ np.linalg.solve(marginal, y), rel=1e-10)
    assert q.log_det == pytest.approx(np.linalg.slogdet(v)[1], rel=1e-10)
    np.testing.assert_allclose(q.covariance, v * q.b / (q.a - 1), rtol=1e-9, atol=1e-10)


def test_the_bound_lies_just_below_the_evidence():
    """One term: ln p(y) by numerical integration over its relevance."""
    rng = np.random.default_rng(2)
    phi = rng.normal(size=(40, 1))
    y = 0.8 * phi[:, 0] + 0.2 * rng.normal(size=40)
    priors = Priors(a0=1.0, b0=0.5, c0=1.5, d0=0.8)
    data = statistics(phi, y)

    def density(log_alpha):
        alpha = math.exp(log_alpha)
        q = posterior(data, np.array([alpha]), priors)
        given = (
            -20 * math.log(2 * math.pi)
            + 0.5 * (log_alpha + q.log_det)
            + priors.a0 * math.log(priors.b0)
            - gammaln(priors.a0)
            + gammaln(q.a)
            - q.a * math.log(q.b)
        )
        prior = priors.c0 * math.log(priors.d0) - gammaln(priors.c0) + priors.c0 * log_alpha - priors.d0 * alpha
        return math.exp(given + prior)

    evidence = math.log(integrate.quad(density, -25, 8, limit=400)[0])
    fit = fit_relevance(data, priors, np.array([1.0]), tolerance=0.0, max_iterations=500)
    assert evidence - 0.5 < fit.bounds[-1] < evidence


def test_pruning_goes_down_to_one_term_and_the_largest_bound_is_chosen():
    svb = SvbNarx(output_lags=2, input_lags=2, degree=2, clean_up="none")
    assert svb.fit(bilinear()) is svb
    counts = [len(step.terms) for step in svb.path_]
    assert counts[0] == 15 and counts[-1] == 1 and np.all(np.diff(counts) < 0)
    bounds = [step.lower_bound for step in svb.path_]
    assert svb.lower_bound_ == max(bounds)
    best = svb.path_[int(np.argmax(bounds))]
    assert svb.terms_ == best.terms
    assert {str(term) for term in svb.terms_} == {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}
    for before, after in zip(svb.path_, svb.path_[1:], strict=False):
        kept = {
            term
            for term, value in zip(before.terms, before.relevance, strict=True)
            if value > before.threshold * (1 + 1e-9)
        }
        assert kept <= set(after.terms) < set(before.terms)


def test_each_step_starts_afresh():
    """A step of the path is what the same terms give on their own."""
    svb = SvbNarx(output_lags=2, input_lags=2, degree=2).fit(bilinear())
    step = svb.path_[len(svb.path_) // 2]
    alone = SvbNarx(output_lags=2, input_lags=2, degree=2, rule=lambda term: term in step.terms).fit(bilinear())
    assert alone.path_[0].terms == step.terms
    assert alone.path_[0].bounds == pytest.approx(step.bounds, rel=1e-12)


def test_the_clean_up_can_be_left_out():
    """How often either finds exactly the true terms is in tests/validation/test_hit_rates.py."""
    for seed in range(3):
        recording = bilinear(seed=seed)
        plain = SvbNarx(output_lags=4, input_lags=4, degree=3, clean_up="none").fit(recording)
        clean = SvbNarx(output_lags=4, input_lags=4, degree=3).fit(recording)
        assert plain.status_ is clean.status_ is FitStatus.DONE
        assert [step.terms for step in clean.path_] == [step.terms for step in plain.path_]
        assert {str(t) for t in plain.terms_} >= {str(t) for t in clean.terms_} == {"y(k-1)", "u(k-2)", "y(k-1)u(k-1)"}


def test_candidates_that_are_zero_take_no_part():
    rng = np.random.default_rng(6)
    rest = Recording.from_arrays(np.zeros(200), rng.normal(size=200), 0.1)
    svb = SvbNarx().fit(rest)
    assert len(svb.path_[0].terms) == 6 and not any("u" in str(term) for term in svb.path_[0].terms)
    with pytest.raises(ModelError, match="zero"):
        SvbNarx(rule=lambda term: "u" in str(term)).fit(rest)


def test_an_interrupt_keeps_the_best_so_far():
    whole = SvbNarx().fit(bilinear())
    part = SvbNarx().fit(bilinear(), progress=StopAt(4))
    assert part.status_ is FitStatus.INTERRUPTED and whole.status_ is FitStatus.DONE
    assert [step.terms for step in part.path_] == [step.terms for step in whole.path_[:4]]
    assert part.lower_bound_ == max(step.lower_bound for step in whole.path_[:4])

    cleaning = SvbNarx()
    cleaning.fit(bilinear(), progress=StopAt(len(whole.path_) + 1))
    assert cleaning.status_ is FitStatus.INTERRUPTED
    assert set(cleaning.terms_) in [set(step.terms) for step in whole.path_]  # where the clean-up began


def test_an_interrupt_before_anything_is_found_goes_on(monkeypatch):
    monkeypatch.setattr(svb, "fit_relevance", interrupted)
    with pytest.raises(KeyboardInterrupt):
        SvbNarx().fit(bilinear())


def test_pictures_mark_the_choice():
    from deatwin.ident.narx.svb import draw_relevance_paths

    svb = SvbNarx(clean_up="none").fit(bilinear())
    line, mark = svb.plot().get_lines()
    np.testing.assert_array_equal(line.get_ydata(), [step.lower_bound for step in svb.path_])
    assert mark.get_ydata() == svb.lower_bound_ == max(line.get_ydata())
    first = svb.path_[0]
    kept, pruned, *_ = first.plot().get_lines()
    assert set(kept.get_xdata()) == set(svb.path_[1].indices)
    assert set(kept.get_xdata()) | set(pruned.get_xdata()) == set(range(15))
    labels = [line.get_label() for line in draw_relevance_paths(svb.path_).get_lines()]
    assert {str(term) for term in svb.terms_} <= set(labels)

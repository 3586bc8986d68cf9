"""Structures by their exact evidence: against integration, least squares and all subsets."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.special import comb

from deatwin.ident.narx.bayes import Statistics
from deatwin.ident.narx.evidence import climb, log_evidence, log_odds


def statistics(phi, y):
    return Statistics(gram=phi.T @ phi, moment=phi.T @ y, power=float(y @ y), n_samples=y.size)


def problem(seed, n=40, m=8, noise=0.5):
    """Return regressors of which 0, 3 and 5 count, 3 in the neighbourhood of 4."""
    rng = np.random.default_rng(seed)
    phi = rng.normal(size=(n, m)) * 10 ** rng.uniform(-2, 2, m)
    phi[:, 4] = phi[:, 3] + 0.3 * np.std(phi[:, 3]) * rng.normal(size=n)
    y = (phi[:, [0, 3, 5]] / np.std(phi[:, [0, 3, 5]], axis=0)).sum(axis=1) + noise * rng.normal(size=n)
    return phi, y


def share_by_lstsq(phi, y, chosen):
    left = y - phi[:, chosen] @ np.linalg.lstsq(phi[:, chosen], y)[0]
    return float(left @ left / (y @ y))


def odds_by_lstsq(phi, y, chosen):
    """The same by the definition: unit information; numbers of terms, and all of one number, equally probable."""
    n, m, k = y.size, phi.shape[1], len(chosen)
    prior = -math.log(comb(m, min(k, m // 2)))
    return -0.5 * k * math.log(1 + n) - 0.5 * n * math.log(share_by_lstsq(phi, y, chosen)) + prior


def test_the_evidence_is_the_integral_over_parameters_and_noise():
    """Normal laws of y given the noise, by scipy, and the noise precision by quadrature."""
    phi, y = problem(0, n=6)
    phi = phi[:, :2]
    fitted = phi @ np.linalg.lstsq(phi, y)[0]
    projection = phi @ np.linalg.solve(phi.T @ phi, phi.T)

    def integral(mean, spread):
        def density(log_tau):  # d tau / tau = d ln tau
            return math.exp(stats.multivariate_normal.logpdf(y, mean, spread * math.exp(-log_tau)))

        return integrate.quad(density, -20, 20, points=[0], limit=200)[0]

    ratio = integral(fitted, np.eye(6) + 6 * projection) / integral(np.zeros(6), np.eye(6))
    share = share_by_lstsq(phi, y, [0, 1])
    assert float(log_evidence(share, 2, 6)) == pytest.approx(math.log(ratio), rel=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_odds_and_moves_agree_with_all_subsets(seed):
    phi, y = problem(seed)
    m = phi.shape[1]
    data = statistics(phi, y)
    subsets = [frozenset(c) for k in range(1, m + 1) for c in combinations(range(m), k)]
    odds = {subset: odds_by_lstsq(phi, y, sorted(subset)) for subset in subsets}
    for subset in subsets:
        assert log_odds(data, np.array(sorted(subset))) == pytest.approx(odds[subset], abs=1e-6)

    def neighbours(subset):
        return [
            other
            for other in subsets
            if len(subset ^ other) == 1 or (len(other) == len(subset) and len(subset ^ other) == 2)
        ]

    for start in ([1], [4, 6], list(range(m))):
        moves = list(climb(data, np.array(start)))
        for before, after in pairwise(moves):
            was, now = frozenset(before.chosen), frozenset(after.chosen)
            assert now == max(neighbours(was), key=odds.__getitem__)
            assert after.log_odds == pytest.approx(odds[now], abs=1e-6)
            assert was != now and max(len(was - now), len(now - was)) == 1
        last = frozenset(moves[-1].chosen)
        assert odds[last] >= max(map(odds.__getitem__, neighbours(last)))
        assert odds[last] == max(odds.values())  # no worse local maximum in these problems


def test_terms_that_say_the_same_are_never_chosen_together():
    phi, y = problem(1)
    phi = np.column_stack([phi, phi[:, 3], phi[:, 0] - 2 * phi[:, 5]])
    data = statistics(phi, y)
    assert log_odds(data, np.array([3, 8])) == -np.inf
    assert log_odds(data, np.array([0, 5, 9])) == -np.inf
    assert len(list(climb(data, np.array([3, 8])))) == 1
    chosen = set(list(climb(data, np.array([1, 2])))[-1].chosen)
    assert not {3, 8} <= chosen and not {0, 5, 9} <= chosen and len(chosen) == 3


def test_an_exact_fit_buys_no_further_terms():
    phi, y = problem(2, noise=0.0)
    moves = list(climb(statistics(phi, y), np.arange(8)))
    assert set(moves[-1].chosen) == {0, 3, 5}


def test_no_term_and_as_many_as_samples_are_no_structures():
    phi, y = problem(3, n=6)
    data = statistics(phi, y)
    assert log_odds(data, np.array([], dtype=int)) == -np.inf
    assert log_odds(data, np.arange(6)) == -np.inf

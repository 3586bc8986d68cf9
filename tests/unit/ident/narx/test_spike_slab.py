"""The spike-and-slab sampler of structures against closed forms and enumeration."""

from itertools import combinations

import numpy as np
from made_regressions import regression

from deatwin.ident.narx.bayes import Statistics
from deatwin.ident.narx.spike_slab import SpikeSlab, sample_structures


def test_evidence_is_that_of_a_gaussian_process() -> None:
    # With tau integrated out y is Student-t with scale (b0 / a0)(I + Phi Phi' / slab): SciPy has its density.
    from scipy.stats import multivariate_t

    rows, target = regression(2)
    posterior = spike_slab(rows, target)
    a0, b0 = posterior.priors.a0, posterior.priors.b0

    def log_density(terms: list[int]) -> float:
        spread = np.eye(60) + rows[terms].T @ (rows[terms] / posterior.slab[terms, None])
        return float(multivariate_t.logpdf(target, shape=b0 / a0 * spread, df=2 * a0))

    same_prior = [[0, 2], [1, 5], [3, 4]]  # sets of one size are as likely as each other before the data
    expected = np.diff([log_density(terms) for terms in same_prior])
    found = np.diff([posterior.log_evidence(frozenset(terms)) for terms in same_prior])
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_sampler_agrees_with_enumeration() -> None:
    # 256 sets; 20,000 flips of which about every tenth is independent leave an error of 0.01 at most, three allowed.
    rows, target = regression(0)
    posterior = spike_slab(rows, target)
    sets = [frozenset(chosen) for m in range(9) for chosen in combinations(range(8), m)]
    logs = np.array([posterior.log_evidence(terms) for terms in sets])
    weights = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    expected = [sum(w for w, terms in zip(weights, sets, strict=True) if j in terms) for j in range(8)]
    rng = np.random.default_rng(5)
    found = sample_structures(posterior, rng, flips=20_000, burn_in=200, start=frozenset({1, 3, 4, 6, 7}))
    np.testing.assert_allclose(found.inclusion, expected, atol=0.03)
    assert found.median == {0, 2}
    # Means over structures: that of a set is (Phi'Phi + slab)^-1 Phi'y, here through the inverse.
    mean = np.zeros(8)
    for weight, terms in zip(weights, sets, strict=True):
        chosen = sorted(terms)
        inverse = np.linalg.inv(rows[chosen] @ rows[chosen].T + np.diag(posterior.slab[chosen]))
        mean[chosen] += weight * inverse @ rows[chosen] @ target
    drawn = found.parameters(posterior, 20_000, rng)
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.02)


def spike_slab(rows: np.ndarray, target: np.ndarray) -> SpikeSlab:
    data = Statistics(gram=rows @ rows.T, moment=rows @ target, power=float(target @ target), n_samples=target.size)
    return SpikeSlab(data=data)

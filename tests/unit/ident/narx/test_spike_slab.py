"""The spike-and-slab sampler of structures against closed forms and enumeration."""

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest
from made_regressions import regression
from scipy.stats import multivariate_t

from deatwin.ident.narx.bayes import Statistics
from deatwin.ident.narx.spike_slab import SpikeSlab, full_margin, near_margin, sample_structures


def log_evidence(posterior: SpikeSlab, rows: np.ndarray, target: np.ndarray, terms: list[int]) -> float:
    """With tau integrated out, y is Student-t with scale (b0 / a0)(I + Phi Phi' / slab); all sizes are as likely."""
    a0, b0 = posterior.priors.a0, posterior.priors.b0
    spread = np.eye(target.size) + rows[terms].T @ (rows[terms] / posterior.slab[terms, None])
    density = float(multivariate_t.logpdf(target, shape=b0 / a0 * spread, df=2 * a0))
    return density - math.log(math.comb(len(rows), len(terms)))


def test_a_flip_gains_what_the_evidence_does() -> None:
    rows, target = regression(2)
    posterior = spike_slab(rows, target)
    for terms in ([], [0, 2], list(range(8))):
        own = log_evidence(posterior, rows, target, terms)
        flipped = [sorted({*terms} ^ {flip}) for flip in range(8)]
        expected = [log_evidence(posterior, rows, target, other) - own for other in flipped]
        np.testing.assert_allclose(posterior.flip_gains(frozenset(terms)), expected, rtol=1e-7, atol=1e-7)


def test_the_sampler_agrees_with_enumeration() -> None:
    # 256 sets; 20,000 flips of which about every tenth is independent leave an error of 0.01 at most, three allowed.
    rows, target = regression(0)
    posterior = spike_slab(rows, target)
    sets = [frozenset(chosen) for m in range(9) for chosen in combinations(range(8), m)]
    logs = np.array([log_evidence(posterior, rows, target, sorted(terms)) for terms in sets])
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


def test_t_values_of_all_candidates() -> None:
    rows, target = regression(1)
    design = rows.T
    theta, (squares,), _, _ = np.linalg.lstsq(design, target, rcond=None)
    t = np.abs(theta) / np.sqrt(squares / (60 - 8) * np.diag(np.linalg.inv(design.T @ design)))
    margin = full_margin(rows, target, np.array([0, 2, 5]))
    assert margin.true == pytest.approx(t[[0, 2, 5]].min())
    assert margin.false == pytest.approx(t[[1, 3, 4, 6, 7]].max())


@pytest.mark.parametrize("seed", range(6))
def test_the_truth_among_its_neighbours(seed: int) -> None:
    # The reference fits every neighbour by least squares.
    rows, target = regression(seed)
    true, false = [0, 2, 5], [1, 3, 4, 6, 7]

    def squares(terms: Sequence[int]) -> float:
        theta = np.linalg.lstsq(rows[list(terms)].T, target, rcond=None)[0]
        return float(np.sum((target - theta @ rows[list(terms)]) ** 2))

    own = squares(true)
    dropped = min((squares([t for t in true if t != out]) - own) / (own / 57) for out in true)
    added = max((own - squares([*true, extra])) / (squares([*true, extra]) / 56) for extra in false)
    swapped = min(squares([*(t for t in true if t != out), extra]) for out in true for extra in false)
    margin = near_margin(rows, target, np.array(true))
    assert margin.true == pytest.approx(np.sqrt(dropped))
    assert margin.false == (pytest.approx(np.sqrt(added)) if swapped >= own else np.inf)

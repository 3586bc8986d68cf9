"""The filter's whitening against a dense covariance."""

import numpy as np
import pytest

from deatwin.ident.mismatch.likelihood.model import Process
from deatwin.ident.mismatch.likelihood.whitening import Filter, grams, whitened

FAST = Process(weights=(0.5, 0.5), times=(0.1, 1.0))
SLOW = Process(weights=(0.5, 0.5, 0.01, 0.01), times=(0.1, 1.0, 10.0, 100.0))


def clock() -> tuple[np.ndarray, np.ndarray]:
    """Three recordings: one with gaps of many and of a broken number of samples, a jittered one, and a single sample."""
    rng = np.random.default_rng(1)
    gaps = np.cumsum(np.concatenate([np.full(40, 0.02), [0.4], np.full(25, 0.02), [0.033], np.full(800, 0.02)]))
    jittered = 40.0 + np.cumsum(0.02 + 0.002 * rng.uniform(-1.0, 1.0, 60))
    times = [gaps, jittered, np.array([60.0])]
    return np.concatenate(times), np.concatenate([np.full(t.size, k) for k, t in enumerate(times)])


def dense(process: Process, ratio: float, times: np.ndarray, records: np.ndarray) -> np.ndarray:
    """Covariance of unit noise and the process, by its definition."""
    lags, together = np.abs(times[:, None] - times), records[:, None] == records
    cov = np.eye(times.size)
    for weight, constant in zip(process.weights, process.times, strict=True):
        cov += ratio**2 * weight * np.exp(-lags / constant) * together
    return cov


@pytest.mark.parametrize("process", [FAST, SLOW, Process(weights=(1.0,), times=(0.3,))])
def test_products_and_determinant_are_those_of_the_dense_covariance(process):
    times, records = clock()
    rows, ratios = np.random.default_rng(2).standard_normal((4, times.size)), np.array([0.03, 0.4, 5.0])
    products, logs = grams(process, ratios, (times, records), rows)
    for k, ratio in enumerate(ratios):
        cov = dense(process, ratio, times, records)
        np.testing.assert_allclose(products[k], rows @ np.linalg.solve(cov, rows.T), atol=1e-8)
        assert logs[k] == pytest.approx(np.linalg.slogdet(cov)[1], abs=1e-8)
        row = whitened(process, ratio, (times, records), rows)
        np.testing.assert_allclose(row @ row.T, products[k], atol=1e-10)


def test_missing_samples_need_one_stationary_covariance_for_each_length_of_gap(monkeypatch):
    solved: list[float] = []
    settled = Filter.settled

    def counted(of: Filter, step: float) -> np.ndarray:
        solved.append(step)
        return settled(of, step)

    monkeypatch.setattr(Filter, "settled", counted)
    rng = np.random.default_rng(4)
    kept = np.flatnonzero(rng.random(400) > 0.2)
    times, records = np.tile(50_000.0 + 0.02 * kept, 2), np.repeat([0, 1], kept.size)
    rows = rng.standard_normal((2, times.size))
    products, logs = grams(FAST, np.array([0.4]), (times, records), rows)
    cov = dense(FAST, 0.4, times, records)
    np.testing.assert_allclose(products[0], rows @ np.linalg.solve(cov, rows.T), atol=1e-7)
    assert logs[0] == pytest.approx(np.linalg.slogdet(cov)[1], abs=1e-7)
    assert len(solved) == np.unique(np.diff(kept)).size

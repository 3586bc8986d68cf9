"""Evidence of linear readings, against multivariate normals and quadrature."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from processes import drawn
from scipy.integrate import trapezoid
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from deatwin.ident.mismatch.likelihood.laplace import log_above
from deatwin.ident.mismatch.likelihood.model import LogNormal, Prior, Process, Reading
from deatwin.ident.mismatch.likelihood.scales import _integral, evidence, weighed
from deatwin.plant.errors import DataError

PROCESS = Process(weights=(0.6, 0.4), times=(0.1, 1.0))


def rows(seed: int, n: int = 40, m: int = 3) -> Reading:
    """Two recordings of a reading, of which the second one has a gap; noise of 2, a process of 0.5."""
    rng = np.random.default_rng(seed)
    times = np.concatenate([0.02 * np.arange(n // 2), 3.0 + 0.02 * np.arange(n - n // 2)])
    times[-5:] += 0.2
    return Reading(
        times=times,
        records=(np.arange(n) >= n // 2).astype(int),
        residual=2.0 * rng.standard_normal(n),
        columns=rng.standard_normal((n, m)),
        process=PROCESS,
        kappa=LogNormal(median=0.5),
        sigma=LogNormal(median=2.0),
    )


def covariance(reading: Reading, kappa: float, sigma: float) -> np.ndarray:
    """Of process and noise, by definition."""
    lags = np.abs(reading.times[:, None] - reading.times)
    pairs = zip(PROCESS.weights, PROCESS.times, strict=True)
    process = sum(w * np.exp(-lags / tau) for w, tau in pairs)
    together = reading.records[:, None] == reading.records
    return kappa**2 * process * together + sigma**2 * np.eye(reading.times.size)


def log_normal(reading: Reading, prior: Prior, kappa: float, sigma: float) -> float:
    """Of the residual where the coordinates lie about what was fitted as their prior says."""
    cov = covariance(reading, kappa, sigma) + reading.columns @ reading.columns.T
    return float(multivariate_normal.logpdf(reading.residual, -reading.columns @ prior.fitted, cov))


def log_prior(scale: LogNormal, log_value: np.ndarray) -> np.ndarray:
    z = (log_value - np.log(scale.median)) / scale.spread
    return -0.5 * z**2 - np.log(scale.spread * np.sqrt(2.0 * np.pi))


def test_evidence_is_that_of_a_multivariate_normal():
    for seed in range(5):
        reading, prior = rows(seed), Prior.of((2, np.array([0.7, -1.2])), (1, None))
        found = evidence([reading], prior)
        assert found.log == pytest.approx(log_normal(reading, prior, 0.5, 2.0), abs=1e-8)
        weight = np.linalg.inv(covariance(reading, 0.5, 2.0))
        cov = np.linalg.inv(reading.columns.T @ weight @ reading.columns + np.eye(3))
        mean = prior.fitted + cov @ (reading.columns.T @ weight @ reading.residual - prior.fitted)
        np.testing.assert_allclose(found.mean, mean, atol=1e-9)
        np.testing.assert_allclose(found.cov, cov, atol=1e-9)


def test_several_readings_share_their_coordinates():
    one, other = rows(6), replace(rows(7, n=30), kappa=LogNormal(median=1.5), sigma=LogNormal(median=0.4))
    prior = Prior.of((3, np.array([0.2, 0.0, 1.0])))
    columns = np.vstack([one.columns, other.columns])
    cov = columns @ columns.T
    cov[:40, :40] += covariance(one, 0.5, 2.0)
    cov[40:, 40:] += covariance(other, 1.5, 0.4)
    residual = np.concatenate([one.residual, other.residual])
    exact = multivariate_normal.logpdf(residual, -columns @ prior.fitted, cov)
    assert evidence([one, other], prior).log == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize(("kappa", "sigma"), [(0.7, 0.1), (0.7, 0.0), (0.0, 0.3), (1.5, 0.5)])
def test_unknown_scales_are_summed_over(kappa, sigma):
    reading = replace(rows(8), kappa=LogNormal(median=0.5, spread=kappa), sigma=LogNormal(median=2.0, spread=sigma))
    prior = Prior.of((3, None))
    kappas = np.log(0.5) + kappa * np.linspace(-6.0, 6.0, 61 if kappa else 1)
    sigmas = np.log(2.0) + sigma * np.linspace(-6.0, 6.0, 61 if sigma else 1)
    logs = np.array([[log_normal(reading, prior, np.exp(k), np.exp(s)) for s in sigmas] for k in kappas])
    peak = logs.max()
    dense = np.exp(logs - peak)
    if sigma:
        dense = trapezoid(dense * np.exp(log_prior(reading.sigma, sigmas)), sigmas, axis=1)[:, None]
    if kappa:
        dense = trapezoid(dense[:, 0] * np.exp(log_prior(reading.kappa, kappas)), kappas)
    assert evidence([reading], prior).log == pytest.approx(float(np.log(np.squeeze(dense)) + peak), abs=2e-3)


@pytest.mark.parametrize("loud", [2.0, 300.0])
def test_an_error_far_from_its_prior_is_found(loud):
    """Twice and three hundred times as loud as expected: its own sample says how loud, to about a tenth."""
    rng = np.random.default_rng(9)
    n = 2000
    reading = Reading(
        times=0.02 * np.arange(n),
        records=np.zeros(n),
        residual=0.5 * loud * drawn(PROCESS, n, 0.02, rng) + 2.0 * rng.standard_normal(n),
        columns=rng.standard_normal((n, 2)),
        process=PROCESS,
        kappa=LogNormal(median=0.5, spread=0.7),
        sigma=LogNormal(median=2.0, spread=0.05),
    )
    found = evidence([reading], Prior.of((2, None)))
    assert found.kappas[0] == pytest.approx(0.5 * loud, rel=0.3)
    assert found.sigmas[0] == pytest.approx(2.0, rel=0.05)
    # The peak is as high and as narrow as a fine sum over κ says, at each κ the noise summed.
    by_hand = []
    for log_kappa in np.log(found.kappas[0]) + np.linspace(-0.6, 0.6, 41):
        known = replace(reading, kappa=LogNormal(median=float(np.exp(log_kappa))))
        by_hand.append(evidence([known], Prior.of((2, None))).log + log_prior(reading.kappa, log_kappa))
    assert found.log == pytest.approx(float(logsumexp(by_hand) + np.log(0.03)), abs=0.02)


def test_the_sum_over_ratios_holds_wherever_the_peak_lies():
    """Forty sizes of the error, so that the ratios that are tried fall in all ways beside each other."""
    reading = replace(rows(20, n=60), kappa=LogNormal(median=0.5, spread=0.7))
    prior, fine = Prior.of((3, None)), np.linspace(-4.0, 8.0, 121)
    for loud in np.geomspace(0.2, 400.0, 40):
        one = replace(reading, residual=loud * reading.residual)
        known = [fit.log_evidence(np.log([2.0]))[0] for fit in weighed(one, prior, fine)]
        dense = np.array(known) + log_prior(one.kappa, fine + np.log(2.0))
        assert evidence([one], prior).log == pytest.approx(float(logsumexp(dense) + np.log(0.1)), abs=0.02)


def test_laplace_over_several_scales_is_near_their_sum():
    """With 400 samples a scale's logarithm is nearly normal: of two readings without a common column both are exact."""
    readings = [
        replace(rows(seed, n=400), kappa=LogNormal(median=0.5, spread=0.3), sigma=LogNormal(median=2.0, spread=0.1))
        for seed in (10, 11)
    ]
    apart = [
        replace(r, columns=np.column_stack([r.columns * (j == 0), r.columns * (j == 1)]))
        for j, r in enumerate(readings)
    ]
    alone = sum(evidence([r], Prior.of((3, None))).log for r in readings)
    assert evidence(apart, Prior.of((6, None))).log == pytest.approx(alone, abs=0.05)


def amplitude_by_quadrature(reading: Reading, kappa: float, sigma: float) -> float:
    """Log of the integral over an amplitude with half a normal as its prior."""
    amplitudes = np.linspace(0.0, 9.0, 40_001)
    weight = np.linalg.inv(covariance(reading, kappa, sigma))
    left = reading.residual[:, None] - reading.columns * amplitudes
    logs = -0.5 * (left * (weight @ left)).sum(axis=0) + np.log(2.0) - 0.5 * amplitudes**2
    constant = 0.5 * (np.linalg.slogdet(weight)[1] - (left.shape[0] + 1) * np.log(2.0 * np.pi))
    return float(np.log(trapezoid(np.exp(logs - logs.max()), amplitudes)) + logs.max() + constant)


@pytest.mark.parametrize("true", [-2.0, 0.0, 1.5])
def test_an_amplitude_that_cannot_be_negative_against_quadrature(true):
    reading = rows(12, m=1)
    reading = replace(reading, residual=reading.residual + true * reading.columns[:, 0])
    prior = Prior.of((1, None), one_sided=[0])
    assert evidence([reading], prior).log == pytest.approx(amplitude_by_quadrature(reading, 0.5, 2.0), abs=1e-5)


def test_two_amplitudes_that_imitate_each_other_against_quadrature():
    """Columns that are alike to 0.8: the second cut is taken for normal, which costs a tenth of a nat."""
    for seed in range(13, 18):
        reading = rows(seed, m=2)
        first = reading.columns[:, 0]
        reading = replace(reading, columns=np.column_stack([first, 0.8 * first + 0.6 * reading.columns[:, 1]]))
        weight = np.linalg.inv(covariance(reading, 0.5, 2.0))
        precision = reading.columns.T @ weight @ reading.columns + np.eye(2)
        mean = np.linalg.solve(precision, reading.columns.T @ weight @ reading.residual)
        grid = np.linspace(0.0, 9.0, 901)
        points = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1)
        inside = multivariate_normal.pdf(points, mean, np.linalg.inv(precision))
        share = trapezoid(trapezoid(inside, grid), grid)
        free, limited = Prior.of((2, None)), Prior.of((2, None), one_sided=[0, 1])
        gained = evidence([reading], limited).log - evidence([reading], free).log
        assert gained == pytest.approx(float(np.log(4.0 * share)), abs=0.1)


@pytest.mark.parametrize("alike", [0.0, 0.9, 0.999999, 1.0])
@pytest.mark.parametrize("edge", [-1e1, -1e3, -1e5, -1e7, -1e9])
def test_amplitudes_far_below_zero_are_as_unlikely_as_where_both_are_zero(alike, edge):
    """Two deviates with one correlation r lie at 0 at the earliest: exp(-edge² / (1 + r)), but for powers of the edge.

    Readings without noise have such edges.
    """
    found = log_above(np.full((1, 2), edge), np.array([[[1.0, alike], [alike, 1.0]]]), np.zeros(2))[0]
    assert found == pytest.approx(-(edge**2) / (1.0 + alike), abs=4.0 * np.log(-edge), rel=1e-12)


def test_readings_that_cannot_be_weighed_are_refused():
    reading = rows(19)
    with pytest.raises(DataError, match="column for each coordinate"):
        evidence([reading], Prior.of((4, None)))
    with pytest.raises(DataError, match="not all finite"):
        replace(reading, residual=np.full(40, np.nan))
    with pytest.raises(DataError, match="same length"):
        replace(reading, records=np.zeros(3))
    with pytest.raises(DataError, match="must rise"):
        replace(reading, times=np.zeros(40))
    with pytest.raises(DataError, match="positive"):
        LogNormal(median=0.0)
    with pytest.raises(DataError, match="2 weights for 1"):
        Process(weights=(0.5, 0.5), times=(1.0,))


def test_a_coordinate_of_which_nothing_was_known_leaves_the_others_exact():
    """Ten thousand times wider, its prior is ten thousand times lower wherever the reading may put it."""
    reading, prior = rows(10, n=60, m=8), Prior.of((8, None))
    logs = []
    for width in (1e4, 1e8):
        columns = reading.columns * np.where(np.arange(8) == 4, width, 1.0)
        logs.append(evidence([replace(reading, columns=columns)], prior).log + np.log(width))
    assert logs[0] == pytest.approx(logs[1], abs=1e-6)


class Curve:
    """A log density whose form is given, in the place of a reading's."""

    def __init__(self, log_density: Callable[[float], float]) -> None:
        self._log_density = log_density
        self._known: dict[float, float] = {}

    def extend(self, places: np.ndarray) -> None:
        self._known |= {float(at): float(self._log_density(float(at))) for at in places}

    @property
    def at(self) -> np.ndarray:
        return np.array(sorted(self._known))

    @property
    def values(self) -> np.ndarray:
        return np.array([self._known[at] for at in sorted(self._known)])


@pytest.mark.parametrize("width", [1.0, 0.1, 0.01, 1e-4])
def test_a_peak_of_any_width_has_its_area(width):
    for centre in np.random.default_rng(1).uniform(-3.0, 3.0, 10):
        found = _integral(Curve(lambda x, c=centre: -(((x - c) / width) ** 2) / 2.0), 0.0, 1.0)
        assert found == pytest.approx(np.log(width * np.sqrt(2.0 * np.pi)), abs=1e-3)


def test_a_peak_that_is_no_parabola_is_found_and_rounding_ends():
    """Two exponentials that meet in a point: no parabola tells how wide they are. Of 60 such none fails."""
    for centre in np.random.default_rng(1).uniform(-3.0, 3.0, 60):
        found = _integral(Curve(lambda x, c=centre: -abs(x - c) / 1e-4), 0.0, 1.0)
        assert found == pytest.approx(np.log(2e-4), abs=10.0)  # a corner between two places is cut off
    rng = np.random.default_rng(2)
    assert np.isfinite(_integral(Curve(lambda x: 1e4 * rng.standard_normal()), 0.0, 1.0))

"""Responses of systems that vary: maps from smoothed parameters cover the truth, and frozen responses err as they say.

The systems are simulated with parameters that are known at every sample.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from made_narx import trajectory_of
from scipy.stats import binom, chi2, norm

from deatwin.ident.frequency.varying.along_time import tv_gfrf, tv_nofrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.recursive import ThetaSmoother
from deatwin.plant.recording import Recording

# ---- coverage: random walks as the smoother assumes them

TERMS = ("y(k-1)", "u(k-1)", "y(k-1)u(k-1)", "1")
START = np.array([0.5, 1.0, 0.15, 0.3])
STEP = np.array([0.002, 0.01, 0.003, 0.01])  # standard deviation of each parameter's step
NOISE = 0.1
LEVEL = 0.5  # operating input; the equilibrium wanders with all parameters, and with it H_1 through the third
N = 400
W = np.array([0.1, 0.5, 1.5, 3.0])
TONES = 0.5 * np.cos(2 * np.pi * np.outer([3, 4], np.arange(40)) / 40).sum(axis=0)  # squared: lines 0, 1, 6, 7, 8
MAPS = {
    "H_1": partial(tv_gfrf, order=1, omega=W),
    "H_2": partial(tv_gfrf, order=2, omega=np.stack([W, W], axis=-1)),
    "G_2": partial(tv_nofrf, excitation=TONES, order=2),
}


def draw(rng):
    """One record of a system whose parameters walk, and the walks."""
    theta = START[:, None] + np.cumsum(STEP[:, None] * rng.normal(size=(4, N)), axis=1)
    u, e, y = LEVEL + rng.uniform(-1, 1, N), NOISE * rng.normal(size=N), np.full(N, 0.8)
    for k in range(1, N):
        y[k] = theta[:, k] @ (y[k - 1], u[k - 1], y[k - 1] * u[k - 1], 1.0) + e[k]
    return Recording.from_arrays(u, y, 1.0), theta


def known():
    """A smoother that is told the variances."""
    return ThetaSmoother(terms=TERMS, noise_variance=NOISE**2, drift_variance=STEP**2)


def estimated():
    """A smoother that finds them."""
    return ThetaSmoother(terms=TERMS, variances="posterior")


def covered(rng, smoother, times, level):
    """Whether the regions of one realisation hold the truth, (n_times, n) each; NaN where they promise nothing."""
    recording, theta = draw(rng)
    found = smoother.fit(recording).trajectory_
    assert [str(term) for term in found.terms] == [*TERMS]
    true = replace(found, theta=theta[:, 1:], theta_cov=np.zeros_like(found.theta_cov))
    inside = {}
    for name, along in MAPS.items():
        estimate, truth = (along(one, timepts=times, operating_input=LEVEL) for one in (found, true))
        band = estimate.band(level)
        held = (band.low <= truth.gain) & (truth.gain <= band.high)
        inside[f"{name} gain"] = np.where(band.linear_law, held, np.nan)
        off = (estimate.values - truth.values)[:, -4:]  # without G_2 at 0 Hz, which is real: its ellipse is a line
        parts = np.stack([off.real, off.imag], axis=-1)[..., None]
        distance = (parts.swapaxes(-1, -2) @ np.linalg.solve(estimate.covariance[:, -4:], parts))[..., 0, 0]
        inside[f"{name} ellipse"] = np.where(band.linear_law[:, -4:], distance <= chi2.ppf(level, 2), np.nan)
    half = norm.ppf(0.5 + level / 2) * estimate.equilibrium_std
    inside["equilibrium"] = (np.abs(estimate.equilibria - truth.equilibria) <= half).astype(float)[:, None]
    return inside


def test_maps_cover_the_truth():
    # One time and one frequency of each of 100 realisations, so that the binomial law holds: at 50 % fewer than 35 or
    # more than 65 of 100 (or of the fewer ones whose gain follows the linear law) are inside in 0.2 % of cases. Bands
    # twice too wide would hold 82, ellipses 94, and half as wide 26 and 16.
    rng = np.random.default_rng(10)
    counts = {}
    for _ in range(100):
        inside = covered(rng, known(), [float(rng.integers(5, N - 5))], 0.5)
        point = rng.integers(20)
        for name, values in inside.items():
            counts.setdefault(name, []).append(values[0, point % values.shape[1]])
    for name, values in counts.items():
        told = np.array(values)[np.isfinite(values)]
        assert told.size >= 75, name
        assert binom.ppf(0.001, told.size, 0.5) <= told.sum() <= binom.ppf(0.999, told.size, 0.5), name


@pytest.mark.study
@pytest.mark.parametrize("smoother", [known, estimated])
def test_maps_cover_the_truth_at_all_times_and_frequencies(smoother):
    # 200 realisations, 20 times and 4 or 5 frequencies of each, where the linear law holds (`Band.linear_law`). Times
    # are correlated; the standard errors are those over realisations. Found, in %:
    #                 H_1 gain   ellipse    H_2 gain   ellipse    G_2 gain   ellipse    equilibrium
    # known         94.4 ± 0.3 94.4 ± 0.4 95.5 ± 0.5 94.3 ± 0.5 95.6 ± 0.5 92.8 ± 0.5 95.3 ± 0.3
    # estimated     94.4 ± 0.4 93.8 ± 0.5 95.2 ± 0.5 93.6 ± 0.6 95.2 ± 0.6 92.2 ± 0.6 95.1 ± 0.4
    # The law holds for H_1 everywhere, for H_2 and G_2 at 93 % of the points (estimated: 87 and 88 %). Counted at all
    # points the ellipses of H_2 and G_2 hold 94.1 and 92.8 (estimated: 92.7 and 91.5).
    # So the ellipses of G_2 are too small, by more than chance: with estimated variances they hold 92.2 % where the
    # linear law holds, which the bound below just lets pass, and 91.5 % at all points, which it would not.
    times = np.linspace(5, N - 5, 20).round()
    found = [covered(np.random.default_rng(1000 + seed), smoother(), times, 0.95) for seed in range(200)]
    for name in found[0]:
        assert 0.92 <= np.mean([np.nanmean(one[name]) for one in found]) <= 0.98, name


# ---- the error of frozen responses

T = 0.1
MOVING = {
    "y(k-1)": 1.1,
    "y(k-2)": -0.4,
    "u(k-1)": 0.3,
    "u(k-2)": 0.1,
    "u(k-1)^2": 0.1,
    "y(k-1)u(k-2)": 0.05,
    "y(k-1)^2": 0.05,
    "y(k-1)y(k-2)": -0.1,
    "1": 0.1,
}


def varying_system(rate):
    """All parameters swing by 10 %, each in its own phase, once in 40 s / rate; the operating input swings too."""
    model = NarxModel.from_terms(MOVING, sample_time=T)
    n = round(400 / rate)
    phase = 2 * np.pi * np.arange(n) / n
    theta = model.theta[:, None] * (1 + 0.1 * np.sin(phase + np.arange(len(MOVING))[:, None]))
    trajectory = trajectory_of(model, T * np.arange(n), theta)
    return trajectory, 0.5 + 0.1 * np.cos(phase)


def demodulated(trajectory, level, order, w):
    """H_n(w, ..., w) at each sample as the system that varies has it, from simulations with small tones.

    Tones of opposite signs part odd orders from even ones; tones a quarter of the order's period apart part the real
    from the imaginary, and those of half of it leave H_2(w, -w) out. What is left is of relative order amplitude^2.
    """
    angle = w * trajectory.timepts
    turn = np.exp(-1j * order * angle)

    def run(amplitude, phase):
        u = level + amplitude * np.cos(angle + phase)
        return trajectory.simulate(Recording.from_arrays(u, np.zeros_like(u), T)).outputs[0]

    if order == 1:
        a = 1e-4
        real, imaginary = ((run(a, phase) - run(-a, phase)) / (2 * a) for phase in (0, -np.pi / 2))
        return (real + 1j * imaginary) * turn
    a = 3e-3
    even = [(run(a, phase) + run(-a, phase)) / (2 * a**2) for phase in np.pi / 4 * np.array([0, 2, -1, 1])]
    return (even[0] - even[1] + 1j * (even[2] - even[3])) * turn


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("w", [0.3, 3.0])
def test_a_frozen_response_errs_as_it_says(order, w):
    # The estimate is of first order in the rate: halving it halves the error, and quarters what the estimate leaves.
    # Second order terms are some per cent of the first at the fastest rate, so that exponents are found to 0.15.
    error, left, told = [], [], []
    rates = (1.0, 0.5, 0.25)
    for rate in rates:
        trajectory, level = varying_system(rate)
        chosen = np.arange(trajectory.timepts.size // 2, trajectory.timepts.size - 5, round(5 / rate))
        omega = [w] if order == 1 else [[w, w]]
        frozen = tv_gfrf(trajectory, order, omega, timepts=trajectory.timepts[chosen], operating_input=level[chosen])
        off = demodulated(trajectory, level, order, w)[chosen] - frozen.values[:, 0]
        rest = off - frozen.frozen_correction[:, 0]
        error.append(np.sqrt(np.mean(np.abs(off) ** 2)))
        told.append(np.sqrt(np.mean(frozen.frozen_error**2)))
        left.append(np.sqrt(np.mean(np.abs(rest[1:-1]) ** 2)))  # at the ends the rate is one-sided
    power = np.polyfit(np.log(rates), np.log([error, told, left]).T, 1)[0]
    np.testing.assert_allclose(power, [1, 1, 2], atol=0.15)
    np.testing.assert_allclose(told, error, rtol=0.1)
    assert left[-1] < 0.05 * error[-1]

"""Models of a residual on one whose dynamics are known."""

import numpy as np

from deatwin.ident.discrepancy import Track, gaussian_process, narx, sparse_dynamics


def residual_dynamics(count: int = 4000, cut: int = 3000) -> Track:
    """A residual that obeys e' = -0.5 e + 0.3 x^2, along a second-order response x to random holds."""
    rng = np.random.default_rng(5)
    drive = np.repeat(rng.uniform(0.2, 2.0, count // 50), 50)
    reading, rate, residual = np.zeros(count), np.zeros(count), np.zeros(count)
    for k in range(count - 1):
        rate[k + 1] = rate[k] + 0.02 * (25 * (drive[k] - reading[k]) - 3 * rate[k])
        reading[k + 1] = reading[k] + 0.02 * rate[k + 1]
        residual[k + 1] = residual[k] + 0.02 * (-0.5 * residual[k] + 0.3 * reading[k] ** 2)
    noisy = residual + 0.005 * rng.standard_normal(count)
    return Track(residual=noisy, reading=reading, rate=rate, drive=drive, cut=cut, sample_time=0.02, size=1.0)


def test_baselines_learn_a_residual_with_known_dynamics() -> None:
    track = residual_dynamics()
    judged = track.judged.residual
    found = {learn: learn(track) for learn in (sparse_dynamics, narx, gaussian_process)}
    left = {learn: float(np.std(judged - correction.predicted)) for learn, correction in found.items()}
    # Both kinds of dynamics hold the true ones: little more than the noise of 0.005 may be left. A Gaussian process of
    # a few hundred lagged samples only comes near: it must take out three quarters of the variance.
    assert left[sparse_dynamics] < 1.5 * 0.005
    assert left[narx] < 1.5 * 0.005
    assert left[gaussian_process] < 0.5 * float(np.std(judged))
    assert found[sparse_dynamics].term in ("e", "x^2")  # the only two that the rate of the residual has

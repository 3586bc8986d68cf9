"""The covariance of parameters of least free-run error whose error is correlated in time.

``sigma^2 (S'S)^-1``, with the free run's sensitivities S, holds for white errors, which free runs seldom have. Here it
is ``(S'S)^-1 S'RS (S'S)^-1``, R being that of the autoregressive process that fits the errors best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.narx.covariance import gram_inverse_root
from deatwin.ident.narx.joined import Joined
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.refine import tangent
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording


def with_correlated_error(model: NarxModel, recordings: Sequence[Recording]) -> NarxModel:
    """Return a model of least free-run error on recordings, with the covariance of correlated errors."""
    from scipy.linalg import matmul_toeplitz

    slopes, errors = tangent(model, joined := Joined.of(model, recordings))
    first = model.table.max_lag
    correlation = autocovariance(joined.apart(errors, first))
    root = gram_inverse_root(slopes)
    middle = np.zeros((root.shape[1],) * 2)
    for part in joined.apart(slopes, first):
        directions = part @ root  # orthonormal over all recordings
        middle += directions.T @ matmul_toeplitz(correlation[: len(part)], directions, check_finite=False)
    spread = 0.5 * errors.size / max(errors.size - model.theta.size, 1) * (middle + middle.T)
    return replace(model, theta_cov=root @ spread @ root.T)


def autocovariance(errors: Sequence[Array]) -> Array:
    """Autocovariance, (longest,), of the autoregressive process (Yule, Walker) that Akaike's criterion prefers."""
    from scipy.linalg import solve_toeplitz
    from scipy.signal import lfilter

    longest, n = max(e.size for e in errors), sum(e.size for e in errors)
    most = min(int(10 * np.log10(n)), longest // 4)  # as in `ar` of R and most texts
    sample = np.array([sum(float(e[lag:] @ e[: e.size - lag]) for e in errors) for lag in range(most + 1)]) / n
    found = np.zeros(longest)
    found[0] = sample[0]
    if sample[0] == 0.0:
        return found
    best, chosen = 0.0, np.empty(0)
    for order in range(1, most + 1):
        coefficients = solve_toeplitz(sample[:order], sample[1 : order + 1])
        left = 1.0 - float(coefficients @ sample[1 : order + 1]) / sample[0]
        if left <= 0.0:
            break
        if (criterion := n * np.log(left) + 2 * order) < best:
            best, chosen = criterion, coefficients
    order = chosen.size
    if order == 0:
        return found
    found[: order + 1] = sample[: order + 1]
    # Beyond these lags g(k) = sum_i a_i g(k-i): a filter without input that starts from them.
    whole = np.concatenate([[1.0], -chosen])
    state = np.array([chosen[i:] @ sample[order:i:-1][: order - i] for i in range(order)])
    found[order + 1 :] = lfilter([1.0], whole, np.zeros(longest - order - 1), zi=state)[0]
    return found

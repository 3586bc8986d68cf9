"""Training ranges, trajectories and recordings of NARX models with the numbers that a test is about."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx import NarxModel, OperatingRange, ThetaTrajectory
from deatwin.plant.recording import Recording


def trained_on(inputs: tuple[float, float], outputs: tuple[float, float], **centres: float) -> OperatingRange:
    """Training data from the first to the second number, centred in the middle unless told otherwise."""
    middle = {"input_centre": sum(inputs) / 2, "output_centre": sum(outputs) / 2} | centres
    ends = {"input_min": inputs[0], "input_max": inputs[1], "output_min": outputs[0], "output_max": outputs[1]}
    return OperatingRange(**{name: np.array([value]) for name, value in (ends | middle).items()})


def trajectory_of(model: NarxModel, timepts: ArrayLike, theta: ArrayLike, **given: Any) -> ThetaTrajectory:
    """Parameters over time, known exactly unless told otherwise."""
    count, size = np.size(timepts), model.theta.size
    plain = {"theta_cov": np.zeros((count, size, size)), "drift_variance": np.zeros(size)}
    return ThetaTrajectory(model=model, timepts=timepts, theta=theta, **{**plain, **given})


def bilinear(
    n: int = 400,
    seed: int = 0,
    noise: float = 0.02,
    level: float = 0.0,
    start: float = 0.0,
    units: tuple[float, float] = (1.0, 1.0),
) -> Recording:
    """A recording of y(k) = level + 0.5 y(k-1) + 0.8 u(k-2) - 0.3 y(k-1)u(k-1) + e(k), in other units."""
    rng = np.random.default_rng(seed)
    u, e, y = rng.uniform(-1, 1, n), noise * rng.normal(size=n), np.zeros(n)
    for k in range(2, n):
        y[k] = level + 0.5 * y[k - 1] + 0.8 * u[k - 2] - 0.3 * y[k - 1] * u[k - 1] + e[k]
    return Recording.from_arrays(u * units[0], y * units[1], 0.1, start=start)

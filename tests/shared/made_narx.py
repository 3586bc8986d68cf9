"""Training ranges and trajectories of NARX models with the numbers that a test is about."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx import NarxModel, OperatingRange, ThetaTrajectory


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

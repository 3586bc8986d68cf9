"""Training ranges, trajectories and recordings of NARX models with the numbers that a test is about."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx import NarxModel, OperatingRange, ThetaTrajectory
from deatwin.ident.narx.linear import LinearModel
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


def full_narx(**given: Any) -> NarxModel:
    """A model with all that a NARX model can have but origins, which may be `given`."""
    root = np.random.default_rng(3).normal(size=(6, 6)) * 1e-2
    return NarxModel.from_terms(
        {"y(k-1)": 0.5, "y(k-2)": -0.2, "u(k-1)": 0.3, "u(k)^2": 0.1, "y(k-1)^2u(k-2)": -0.05, "1": 0.02},
        sample_time=0.1,
        theta_cov=root @ root.T,
        noise_variance=1e-3,
        theta_dof=200.5,
        input_names=("command",),
        output_names=("displacement",),
        input_units=("V",),
        output_units=("m",),
        operating=OperatingRange(
            input_min=[-1], input_max=[1], input_centre=[0.1], output_min=[-0.9], output_max=[0.8], output_centre=[0.03]
        ),
        provenance={"file": "a.csv"},
        **given,
    )


def full_linear() -> LinearModel:
    """Two inputs, every polynomial, delays 1 and 0."""
    root = np.random.default_rng(3).normal(size=(11, 11)) * 1e-2
    return LinearModel(
        a=[1, -0.4],
        b=([0, 1.0, 0.5], [0.3]),
        c=[1, 0.3, 0.1],
        d=[1, -0.7],
        f=([1, -1.2, 0.5], [1, 0.6]),
        offset=0.25,
        theta_cov=root @ root.T,
        noise_variance=0.04,
        sample_time=0.1,
        input_names=("command", "temperature"),
        output_names=("displacement",),
        input_units=("V", "K"),
        output_units=("m",),
        provenance={"file": "a.csv"},
    )

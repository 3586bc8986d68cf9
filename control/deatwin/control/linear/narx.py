"""A NARX model about an operating point, as the linear model that a controller is designed on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.ident.frequency import equilibrium, linear_part
from deatwin.ident.frequency.linear import LinearPart, operating_input_of
from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError

__all__ = ["linearise", "linearise_posterior"]

Array = NDArray[np.float64]
Progress = Callable[[float], None]

_SIGN_LEVEL = 1.96
"""A static gain within this many standard deviations of zero has no certain sign (95 %, normal law)."""


def linearise(model: NarxModel, operating_input: float | None = None) -> LinearModel:
    """Linearise a model of one input and one output about its equilibrium at a constant input.

    Parameters
    ----------
    model : NarxModel
        In the rows of its recording: where a row's reading is taken is not its business (see
        `LinearModel.in_loop`).
    operating_input : float, optional
        Constant input in its unit; the centre of the training data by default.

    Returns
    -------
    LinearModel
        Its status says whether there is an equilibrium, and whether it is sound.

    Raises
    ------
    ModelError
        If the model has several inputs or the operating input is not finite.
    """
    if len(model.input_names) != 1:
        raise ModelError(f"the model has {len(model.input_names)} inputs; a controller is designed for one")
    point = float(operating_input_of(model, operating_input)[0])
    try:
        rest = equilibrium(model, point)
        part = linear_part(model, point, rest.output)
    except ModelError as error:
        return _without_equilibrium(model, point, str(error))
    linear = _of_part(model, part, point, rest.output)
    if not rest.is_stable:
        detail = f"largest pole {abs(linear.poles).max():.4g}"
        return replace(linear, status=LinearStatus.UNSTABLE, detail=detail)
    gain, deviation = linear.static_gain, linear.static_gain_deviation
    if gain == 0.0 or abs(gain) < _SIGN_LEVEL * deviation:
        detail = f"{gain:.3g} with a standard deviation of {deviation:.3g}"
        return replace(linear, status=LinearStatus.NO_GAIN, detail=detail)
    return linear


def linearise_posterior(
    model: NarxModel,
    operating_input: float | None,
    rng: np.random.Generator,
    count: int,
    progress: Progress | None = None,
) -> tuple[LinearModel, ...]:
    """Linearise samples of a model's posterior, each about its own equilibrium.

    Parameters
    ----------
    model : NarxModel
        With the covariance of its parameters (normal, or Student-t where ``theta_dof`` is finite).
    operating_input : float or None
        As for `linearise`.
    rng : numpy.random.Generator
        Source of the samples.
    count : int
        Number of samples.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    tuple of LinearModel
        Some may lack an equilibrium; their status says so.
    """
    samples = []
    for number, theta in enumerate(_draw(model, rng, count)):
        # The spread is in the samples themselves.
        sample = replace(model, theta=theta, theta_cov=np.zeros_like(model.theta_cov))
        samples.append(linearise(sample, operating_input))
        if progress is not None:
            progress((number + 1) / count)
    return tuple(samples)


def _draw(model: NarxModel, rng: np.random.Generator, count: int) -> Array:
    """Samples of the parameters, shape (count, n_terms)."""
    deviations = np.sqrt(np.diag(model.theta_cov))
    units = np.where(deviations > 0.0, deviations, 1.0)  # parameters differ by many orders of magnitude
    values, vectors = np.linalg.eigh(model.theta_cov / np.outer(units, units))
    spread = rng.standard_normal((count, units.size)) * np.sqrt(values.clip(min=0.0)) @ vectors.T * units
    if np.isfinite(model.theta_dof):
        spread *= np.sqrt((model.theta_dof - 2.0) / rng.chisquare(model.theta_dof, count))[:, None]
    return np.asarray(model.theta + spread, dtype=np.float64)


def _of_part(model: NarxModel, part: LinearPart, operating_input: float, output: float) -> LinearModel:
    n_b, n_a = int(part.input_lags.max(initial=0)) + 1, int(part.output_lags.max(initial=0))
    numerator, denominator = np.zeros(n_b), np.concatenate([[1.0], np.zeros(n_a)])
    slopes = np.zeros((n_b + n_a, model.theta.size))
    numerator[part.input_lags] = part.b
    slopes[part.input_lags] = part.b_theta
    denominator[part.output_lags] = -part.a
    slopes[n_b + part.output_lags - 1] = -part.a_theta
    return LinearModel(
        numerator=numerator, denominator=denominator, covariance=slopes @ model.theta_cov @ slopes.T,
        operating_output=output, **_signals(model, operating_input),
    )  # fmt: skip


def _without_equilibrium(model: NarxModel, operating_input: float, detail: str) -> LinearModel:
    return LinearModel(
        numerator=np.zeros(1), denominator=np.ones(1), covariance=np.zeros((1, 1)), operating_output=None,
        status=LinearStatus.NO_EQUILIBRIUM, detail=detail, **_signals(model, operating_input),
    )  # fmt: skip


def _signals(model: NarxModel, operating_input: float) -> dict[str, Any]:
    return {
        "sample_time": model.sample_time, "operating_input": operating_input,
        "input_name": model.input_names[0], "output_name": model.output_names[0],
        "input_unit": model.input_units[0], "output_unit": model.output_units[0],
    }  # fmt: skip

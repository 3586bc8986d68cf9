"""Evaluate a model and its frequency responses at other parameters, such as posterior draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.narx.covariance import covariance_root
from deatwin.ident.narx.linear import LinearModel
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.plant.errors import ModelError

Array = NDArray[np.float64]

_MOST_BYTES = 1 << 31
JOINT = "the covariance of all parts; take fewer frequencies (at_points)"
"""Array, and remedy, that the error of `require_memory` names for a joint covariance."""

Model = NarxModel | LinearModel  # Models with parameters, their covariance, and a frequency response

Quantity = Callable[[Any], FrequencyResponse]
"""Function that computes a frequency response of a model, such as ``partial(gfrf, order=2, omega=omega)``."""


def with_theta(model: Model, theta: Array) -> Model:
    """Return a model with other parameters. Shapes: `theta` (n_theta,)."""
    if isinstance(model, NarxModel):
        return replace(model, theta=theta)
    p = model.orders.split(theta)
    return replace(model, a=p.a, b=p.b, c=p.c, d=p.d, f=p.f, offset=p.offset)


def dof_of(model: Model) -> float:
    """Return the degrees of freedom of the law of a model's parameters; infinite for a normal law."""
    return model.theta_dof if isinstance(model, NarxModel) else math.inf


def draw_theta(model: Model, rng: np.random.Generator, n_draws: int) -> Array:
    """Draw parameters from a model's posterior, which is normal or Student-t. Shapes: returns (n_draws, n_theta)."""
    if isinstance(model, NarxModel):
        return ThetaPosterior(model=model).sample(rng, n_draws).theta
    normal = rng.standard_normal((n_draws, model.theta.size))
    return np.asarray(model.theta + normal @ covariance_root(model.theta_cov).T)


def response_of(model: Model, quantity: Quantity, level: float) -> FrequencyResponse:
    """Return a quantity of a model after a check."""
    probability(level)
    if not callable(quantity):
        raise ModelError(f"quantity = {quantity!r}; it must be a function of a model, as partial(frf, omega=omega)")
    response = quantity(model)
    if not isinstance(response, FrequencyResponse):
        raise ModelError(
            f"the quantity returned a {type(response).__name__}; it must return a FrequencyResponse, as "
            "partial(gfrf, order=2, omega=omega) does, or partial(frf, omega=omega) of a linear model"
        )
    return response


def require_memory(count: int, what: str) -> None:
    """Raise ModelError if an array would be too large."""
    if 8 * count > _MOST_BYTES:
        raise ModelError(f"{8 * count / 2**30:.3g} GiB, more than {_MOST_BYTES >> 30} GiB, are needed for {what}")


def evaluate(model: Model, quantity: Quantity, response: FrequencyResponse, thetas: Array) -> Evaluated:
    """Compute a quantity at many parameter vectors, all at once if possible. Shapes: `thetas` (n_draws, n_theta)."""
    if response.evaluate is not None:
        many = response.evaluate(thetas)
        if many.values.shape != (len(thetas), response.values.size):
            raise ModelError(
                f"{response.label} has {response.values.size} points, but at {len(thetas)} parameters its values have "
                f"the shape {many.values.shape}; take some of its points with at_points"
            )
        return many
    values = np.full((len(thetas), response.values.size), np.nan + 0j)
    exists, stable = np.zeros(len(thetas), dtype=bool), np.zeros(len(thetas), dtype=bool)
    for i, theta in enumerate(thetas):
        try:
            found = quantity(with_theta(model, theta))
        except ModelError:  # the quantity exists for the model itself, so these parameters are the reason
            continue
        if found.values.shape == response.values.shape:
            values[i], exists[i], stable[i] = found.values, True, found.status.ok
    return Evaluated(values=values, exists=exists, stable=stable)

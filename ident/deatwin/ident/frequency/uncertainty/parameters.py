"""Evaluate a model and its frequency responses at other parameters, such as posterior draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from deatwin.ident.arguments import probability
from deatwin.ident.frequency.many import Evaluated
from deatwin.ident.frequency.response import FrequencyResponse
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.posterior import ThetaPosterior
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError

Quantity = Callable[[Any], FrequencyResponse]
"""Function that computes a frequency response of a model, such as ``partial(gfrf, order=2, omega=omega)``."""


def draw_theta(model: NarxModel, rng: np.random.Generator, n_draws: int) -> Array:
    """Draw parameters from a model's posterior, which is normal or Student-t. Shapes: returns (n_draws, n_theta)."""
    return ThetaPosterior(model=model).sample(rng, n_draws).theta


def response_of(model: NarxModel, quantity: Quantity, level: float) -> FrequencyResponse:
    """Return a quantity of a model after a check."""
    probability(level)
    if not callable(quantity):
        raise ModelError(
            f"quantity = {quantity!r}; it must be a function of a model, as partial(gfrf, order=1, omega=omega)"
        )
    response = quantity(model)
    if not isinstance(response, FrequencyResponse):
        raise ModelError(
            f"the quantity returned a {type(response).__name__}; it must return a FrequencyResponse, as "
            "partial(gfrf, order=2, omega=omega) does"
        )
    return response


def evaluate(model: NarxModel, quantity: Quantity, response: FrequencyResponse, thetas: Array) -> Evaluated:
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
            found = quantity(replace(model, theta=theta))
        except ModelError:  # the quantity exists for the model itself, so these parameters are the reason
            continue
        if found.values.shape == response.values.shape:
            values[i], exists[i], stable[i] = found.values, True, found.status.ok
    return Evaluated(values=values, exists=exists, stable=stable)

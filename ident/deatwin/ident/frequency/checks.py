"""Check arguments of the functions in `deatwin.ident.frequency`: models and orders of responses."""

from __future__ import annotations

from typing import Any

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.identifier import Identifier
from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError


def narx_model(model: Any) -> NarxModel:
    """Return a model, after a check that it is a NarxModel."""
    if not isinstance(model, NarxModel):
        instead = (
            "its model_ may be" if isinstance(model, Identifier) else "to_narx() makes one of an ARX or ARMAX model"
        )
        raise ModelError(f"a {type(model).__name__} is not a NarxModel; {instead}")
    return model


def polynomial_model(model: Any) -> NarxModel:
    """Return a NarxModel, after a check that its terms are polynomial; other functions have infinitely many orders."""
    if narx_model(model).table.functions:
        raise ModelError(
            f"frequency analysis needs a polynomial model, but this model contains {model.table.functions[0]}: identify it without "
            "functions, or compute its response with best_linear_approximation from a simulation with a multisine"
        )
    checked: NarxModel = model
    return checked


def whole_order(order: Any, highest: int | None = None) -> int:
    """Return the order of a response, after a check."""
    return whole_number(order, "order", 1, highest)

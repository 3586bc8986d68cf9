"""Check arguments of the functions in `deatwin.ident.frequency`: models and orders of responses."""

from __future__ import annotations

from typing import Any

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.plant.errors import ModelError


def polynomial_model(model: Any) -> NarxModel:
    """Return a NarxModel, after a check that its terms are polynomial; other functions have infinitely many orders."""
    checked = require_model(model)
    if checked.table.functions:
        raise ModelError(
            f"frequency analysis needs a polynomial model, but this model contains {checked.table.functions[0]}: identify it without "
            "functions, or compute its response with best_linear_approximation from a simulation with a multisine"
        )
    return checked


def whole_order(order: Any, highest: int | None = None) -> int:
    """Return the order of a response, after a check."""
    return whole_number(order, "order", 1, highest)

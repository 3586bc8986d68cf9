"""Choose origins for the signals of a regression, so that neither offsets nor units change the result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import TermTable

Array = NDArray[np.float64]


def about_data(data: Regression) -> Regression:
    """Return a regression about origins chosen from the data: the mean of a signal if it exceeds its swing, else
    zero.

    About a zero that is nearer, powers lose at most a bit or two per factor; about a distant one, as with kelvin,
    regressors would be nearly constant. Neither choice depends on the unit. A signal with a function of it keeps its
    zero, to which the function refers.
    """
    kept = {(v.kind, v.index) for v in data.table.functions}
    return replace(
        data,
        input_origin=_origins(
            [record.inputs for record in data.recordings], [row for kind, row in kept if kind == "u"]
        ),
        output_origin=_origins(
            [record.outputs for record in data.recordings], [row for kind, row in kept if kind == "y"]
        ),
    )


def about_rest(data: list[Regression], model: NarxModel) -> list[Regression]:
    """Return the regressors of all outputs about the model's equilibrium with its inputs at their origins."""
    moved = (model.output_origin.any() or model.input_origin.any()) and not model.table.functions
    if len(data) != model.n_outputs or not moved or not any(term.degree == 0 for term in model.terms):
        return data
    swings = np.ptp(np.concatenate([record.outputs for record in data[0].recordings], axis=1), axis=1)
    quiet = [m for m, term in enumerate(model.terms) if all(v.kind == "y" for v, _ in term.factors)]
    rest = _rest(
        TermTable(tuple(model.terms[m] for m in quiet)), model.theta[quiet], [model.equations[m] for m in quiet], swings
    )
    return data if rest is None else [replace(one, output_origin=model.output_origin + rest) for one in data]


def _rest(table: TermTable, theta: Array, equations: list[int], swings: Array) -> Array | None:
    """Return outputs with y = f(y) near zero, shape (n_outputs,); None if there are none."""
    from scipy.optimize import root

    def imbalance(y: Array) -> Array:
        values = np.array([(y * swings)[variable.index] for variable in table.variables])
        return np.bincount(equations, weights=theta * table.at(values), minlength=y.size) / swings - y

    found = root(imbalance, np.zeros(swings.size))
    return found.x * swings if found.success and np.all(np.abs(found.x) <= 1.0) else None


def _origins(signals: list[Array], kept: list[int]) -> Array:
    joined = np.concatenate(signals, axis=1)
    swing = np.ptp(joined, axis=1)
    mean = np.where(swing > 0, joined.mean(axis=1), joined[:, 0])  # a constant is its own mean, to the last bit
    mean[kept] = 0.0
    return np.where(np.abs(mean) <= swing, 0.0, mean)

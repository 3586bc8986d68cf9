"""From where a regression counts its signals, so that neither offsets nor units change what is identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyroots
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression

__all__ = ["about_data", "about_rest"]

Array = NDArray[np.float64]


def about_data(data: Regression) -> Regression:
    """Return a regression about origins that its data give: zero where they reach about that far, else the mean.

    A signal whose mean is no further from zero than its own swing, largest less smallest value, has zero among or
    beside its values: terms mean what they say of the signal itself, and a power loses no more than a bit or two for
    each factor. Any other signal, as one in kelvin, counts from a zero that has no part in the experiment: its
    regressors would all be nearly constant, and what a prior does to them would depend on that zero. About the mean it
    does not. Neither choice depends on the unit.

    Parameters
    ----------
    data : Regression
        About any origins.
    """
    return replace(
        data,
        input_origin=_origins([record.inputs for record in data.recordings]),
        output_origin=_origins([record.outputs for record in data.recordings]),
    )


def about_rest(data: Regression, model: NarxModel) -> Regression:
    """Return a regression about the output at which a model rests while its inputs are at their origins.

    A constant term is then not needed: where the zero of a signal has no part in the experiment, the constant says no
    more than how far from the rest the origin was put.

    Parameters
    ----------
    data : Regression
        To which the model was fitted.
    model : NarxModel
        About the same origins.

    Returns
    -------
    Regression
        The given one itself where all signals count from their own zeros, the model has no constant or no rest within
        the swing of the data, or there are several outputs.
    """
    origin = model.output_origin
    moved = origin.any() or model.input_origin.any()
    if origin.size > 1 or not moved or not any(term.degree == 0 for term in model.terms):
        return data
    swing = float(np.ptp(np.concatenate([record.outputs[0] for record in data.recordings])))
    quiet = [m for m, term in enumerate(model.terms) if all(v.kind == "y" for v, _ in term.factors)]
    degrees = [model.terms[m].degree for m in quiet]
    coefficients = np.bincount(degrees, weights=model.theta[quiet], minlength=2)
    coefficients[1] -= 1.0
    # Counted in swings: no coefficient is large for its unit alone.
    roots = polyroots(coefficients * swing ** np.arange(coefficients.size) / swing)
    rests = roots.real[(np.abs(roots.imag) < 1e-9) & (np.abs(roots) <= 1.0)]
    if rests.size == 0:
        return data
    return replace(data, output_origin=origin + swing * rests[np.argmin(np.abs(rests))])


def _origins(signals: list[Array]) -> Array:
    joined = np.concatenate(signals, axis=1)
    swing = np.ptp(joined, axis=1)
    mean = np.where(swing > 0, joined.mean(axis=1), joined[:, 0])  # a constant is its own mean, to the last bit
    return np.where(np.abs(mean) <= swing, 0.0, mean)

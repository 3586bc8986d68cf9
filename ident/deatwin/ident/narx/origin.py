"""From where a regression counts its signals, so that neither offsets nor units change what is identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.polynomial import polyroots
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression

Array = NDArray[np.float64]


def about_data(data: Regression) -> Regression:
    """Return a regression about origins that its data give: zero where they reach about that far, else the mean."""
    return replace(
        data,
        input_origin=_origins([record.inputs for record in data.recordings]),
        output_origin=_origins([record.outputs for record in data.recordings]),
    )


def about_rest(data: Regression, model: NarxModel) -> Regression:
    """Return a regression about the output at which a model rests while its inputs are at their origins."""
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

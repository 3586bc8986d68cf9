"""The file of a linear model: JSON of the schema "deatwin/linear/1"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.datasets import Variables

if TYPE_CHECKING:
    from deatwin.ident.narx.linear.model import LinearModel

Array = NDArray[np.float64]
SCHEMA = "deatwin/linear/1"


def to_document(model: LinearModel) -> dict[str, Any]:
    """Return a model as plain data."""

    def signals(names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, str]]:
        return [{"name": name, "unit": unit} for name, unit in zip(names, units, strict=True)]

    return {
        "schema": SCHEMA,
        "sample_time_s": float(model.sample_time),
        "inputs": signals(model.input_names, model.input_units),
        "outputs": signals(model.output_names, model.output_units),
        "a": model.a.tolist(),
        "b": [b.tolist() for b in model.b],
        "c": model.c.tolist(),
        "d": model.d.tolist(),
        "f": [f.tolist() for f in model.f],
        "offset": float(model.offset),
        "theta_cov": model.theta_cov.tolist(),
        "noise_variance": float(model.noise_variance),
        "provenance": dict(model.provenance),
    }


def fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the model that `to_document` wrote."""
    sides = {"input": document["inputs"], "output": document["outputs"]}
    labels = {
        f"{side}_{key}s": tuple(str(signal[key]) for signal in signals)
        for side, signals in sides.items()
        for key in ("name", "unit")
    }
    return {
        **{name: document[name] for name in ("a", "c", "d", "theta_cov")},
        **{name: tuple(document[name]) for name in ("b", "f")},
        "offset": float(document["offset"]),
        "noise_variance": float(document["noise_variance"]),
        "sample_time": float(document["sample_time_s"]),
        "provenance": {str(key): str(value) for key, value in document["provenance"].items()},
        **labels,
    }


def length(model: LinearModel) -> int:
    """Coefficients of the longest polynomial."""
    return max(p.size for p in (model.a, model.c, model.d, *model.b, *model.f))


def by_power(model: LinearModel) -> Variables:
    """All polynomials over the same powers."""

    def whole(polynomial: Array) -> Array:
        return np.pad(polynomial, (0, length(model) - polynomial.size))

    return {
        **{name: ("power", whole(getattr(model, name))) for name in ("a", "c", "d")},
        **{name: (("input", "power"), np.array([whole(p) for p in getattr(model, name)])) for name in ("b", "f")},
    }

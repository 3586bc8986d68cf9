"""The file of a nonlinear state space: JSON of the schema "deatwin/nonlinear-states/1"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.narx.document import signals_of

if TYPE_CHECKING:
    from deatwin.ident.nss.model import NonlinearStateSpace

SCHEMA = "deatwin/nonlinear-states/1"
WEIGHTS = ("directions", "transition", "output")


def weights_of(held: Any) -> dict[str, Any]:
    """Return the weights of a system or a model, and which of them are free, by name."""
    return {name: getattr(held, name) for name in (*WEIGHTS, *(f"free_{name}" for name in WEIGHTS))}


def to_document(model: NonlinearStateSpace) -> dict[str, Any]:
    """Return a model as plain data."""

    def signals(side: str) -> list[dict[str, Any]]:
        columns = (getattr(model, f"{side}_{key}") for key in ("names", "units", "origin", "scale"))
        keys = ("name", "unit", "origin", "scale")
        return [
            {key: value if isinstance(value, str) else float(value) for key, value in zip(keys, row, strict=True)}
            for row in zip(*columns, strict=True)
        ]

    return {
        "schema": SCHEMA,
        "sample_time_s": float(model.sample_time),
        "inputs": signals("input"),
        "outputs": signals("output"),
        "terms": list(model.terms),
        **{name: getattr(model, name).tolist() for name in WEIGHTS},
        **{f"free_{name}": getattr(model, f"free_{name}").tolist() for name in WEIGHTS},
        "theta_cov": model.theta_cov.tolist(),
        "noise_variance": model.noise_variance.tolist(),
        "provenance": dict(model.provenance),
    }


def fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the model that `to_document` wrote."""
    sides = {"input": document["inputs"], "output": document["outputs"]}
    return {
        **signals_of(document),
        **{
            f"{side}_{key}": np.array([signal[key] for signal in signals], dtype=np.float64)
            for side, signals in sides.items()
            for key in ("origin", "scale")
        },
        "terms": tuple(str(term) for term in document["terms"]),
        **{name: document[name] for name in WEIGHTS},
        **{f"free_{name}": document[f"free_{name}"] for name in WEIGHTS},
        "theta_cov": document["theta_cov"],
        "noise_variance": document["noise_variance"],
    }

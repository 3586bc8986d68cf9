"""The file of a linear model: JSON of the schema "deatwin/linear/1"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SCHEMA = "deatwin/linear/1"


def fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the model from a document."""
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

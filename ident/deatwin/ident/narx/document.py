"""The file of a NARX model: JSON of the schema "deatwin/narx/1"."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.arguments import read_only
from deatwin.ident.narx.operating import OperatingRange
from deatwin.ident.narx.terms import Term
from deatwin.ident.narx.values import signals_of

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel


SCHEMA = "deatwin/narx/1"


def to_document(model: NarxModel) -> dict[str, Any]:
    """Return a model as plain data."""

    def signals(side: str, names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, Any]]:
        ranges = {
            key: [None] * len(names) if model.operating is None else getattr(model.operating, f"{side}_{key}").tolist()
            for key in ("min", "max", "centre")
        }
        origins = getattr(model, f"{side}_origin")
        return [
            {"name": name, "unit": unit}
            | ({"origin": float(origin)} if origin else {})
            | {key: values[i] for key, values in ranges.items()}
            for i, (name, unit, origin) in enumerate(zip(names, units, origins, strict=True))
        ]

    return {
        "schema": SCHEMA,
        "sample_time_s": float(model.sample_time),
        "inputs": signals("input", model.input_names, model.input_units),
        "outputs": signals("output", model.output_names, model.output_units),
        "terms": [
            {"term": str(term), "theta": float(value)} | ({"output": row} if row else {})
            for term, value, row in zip(model.terms, model.theta, model.equations, strict=True)
        ],
        "theta_cov": model.theta_cov.tolist(),
        "theta_dof": float(model.theta_dof) if math.isfinite(model.theta_dof) else None,
        "noise_variance": np.asarray(model.noise_variance).tolist(),
        "provenance": dict(model.provenance),
    }


def fields_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of the model that `to_document` wrote."""
    sides = {"input": document["inputs"], "output": document["outputs"]}
    ranges = {
        f"{side}_{key}": [signal[key] for signal in signals]
        for side, signals in sides.items()
        for key in ("min", "max", "centre")
    }
    known = all(value is not None for values in ranges.values() for value in values)
    dof, noise = document["theta_dof"], document["noise_variance"]
    return {
        "terms": tuple(Term.parse(item["term"]) for item in document["terms"]),
        "theta": read_only([item["theta"] for item in document["terms"]]),
        "theta_cov": read_only(document["theta_cov"]),
        "theta_dof": math.inf if dof is None else float(dof),
        "noise_variance": read_only(noise) if isinstance(noise, list) else float(noise),
        "equations": tuple(int(item.get("output", 0)) for item in document["terms"]),
        "operating": OperatingRange(**{key: read_only(values) for key, values in ranges.items()}) if known else None,
        **signals_of(document),
        **{
            f"{side}_origin": read_only([signal.get("origin", 0.0) for signal in signals])
            for side, signals in sides.items()
        },
    }

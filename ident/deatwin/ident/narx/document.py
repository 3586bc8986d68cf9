"""Check the fields of a NARX model, and write them to a file: JSON of the schema "deatwin/narx/1"."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.arguments import read_only, real_numbers
from deatwin.ident.narx.covariance import covariance_of
from deatwin.ident.narx.terms import Term
from deatwin.plant.arrays import Array, texts
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel


def set_signals(model: Any) -> None:
    """Make names, units and provenance of a frozen model read-only; ModelError unless they are texts that agree."""
    for side in ("input", "output"):
        names, units = texts(getattr(model, f"{side}_names")), texts(getattr(model, f"{side}_units"))
        if not all(isinstance(text, str) for text in (*names, *units)):
            raise ModelError(f"the names and units of {side}s must be texts; got {names} and {units}")
        if len(names) != len(units):
            raise ModelError(
                f"{len(names)} {side}(s) are named, {', '.join(names)}, but {len(units)} unit(s) are given"
            )
        if len(set(names)) < len(names):
            raise ModelError(f"two {side}s of the model have the same name; got {', '.join(names)}")
        object.__setattr__(model, f"{side}_names", names)
        object.__setattr__(model, f"{side}_units", units)
    told = model.provenance
    if not isinstance(told, Mapping) or not all(isinstance(text, str) for pair in told.items() for text in pair):
        raise ModelError(f"provenance must be a mapping of texts to texts; got {told!r}")
    object.__setattr__(model, "provenance", MappingProxyType(dict(told)))


def signals_of(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the names and units of a model's signals, its sample time and its provenance, from its document."""
    sides = {"input": document["inputs"], "output": document["outputs"]}
    return {
        **{
            f"{side}_{key}s": tuple(str(signal[key]) for signal in signals)
            for side, signals in sides.items()
            for key in ("name", "unit")
        },
        "sample_time": float(document["sample_time_s"]),
        "provenance": {str(key): str(value) for key, value in document["provenance"].items()},
    }


def set_covariance(model: Any, size: int) -> None:
    """Check the covariance of a frozen model's parameters and make it read-only; an empty one becomes zero."""
    cov = real_numbers(model.theta_cov, "theta_cov")
    cov = cov if cov.size else np.zeros((size, size))
    if cov.shape != (size, size) or not np.all(np.isfinite(cov)):
        raise ModelError(f"theta_cov must be finite and of shape ({size}, {size}); got {cov.shape}")
    object.__setattr__(model, "theta_cov", covariance_of(cov, [f"theta[{i}]" for i in range(size)]))


def require_terms(model: NarxModel) -> None:
    """Raise ModelError unless terms, equations and signals of a model agree."""
    n = len(model.terms)
    if len(model.equations) != n or not set(model.equations) <= set(range(model.n_outputs)):
        raise ModelError(f"{n} terms need the row of an output each, 0 to {model.n_outputs - 1}; got {model.equations}")
    if n == 0 or len(set(zip(model.equations, model.terms, strict=True))) != n:
        raise ModelError(
            "a NARX model needs at least one term, and each only once; "
            f"got {', '.join(map(str, model.terms)) or 'none'}"
        )
    for kind, signals, names in (
        ("u", "inputs", model.input_names),
        ("y", "outputs", model.output_names),
        ("e", "outputs", model.output_names),
    ):
        if model.table.channels(kind) > len(names):
            raise ModelError(f"the terms use {model.table.channels(kind)} {signals}, but {len(names)} are named")


def require_values(model: NarxModel) -> None:
    """Raise ModelError unless shapes and numbers of a model are valid; its covariance is not checked."""
    n = len(model.terms)
    if model.theta.shape != (n,) or model.theta_cov.shape != (n, n):
        raise ModelError(
            f"{n} terms need theta of shape ({n},) and theta_cov of shape ({n}, {n}); "
            f"got {model.theta.shape} and {model.theta_cov.shape}"
        )
    if not (np.all(np.isfinite(model.theta)) and np.all(np.isfinite(model.theta_cov))):
        raise ModelError("theta and theta_cov must be finite")
    wanted = () if model.n_outputs == 1 else (model.n_outputs,)
    if np.shape(model.noise_variance) != wanted:
        raise ModelError(
            f"noise_variance has the shape {np.shape(model.noise_variance)}; "
            f"a model of {model.n_outputs} output(s) needs {wanted}"
        )
    for side in ("input", "output"):
        origin, names = getattr(model, f"{side}_origin"), getattr(model, f"{side}_names")
        if origin.shape != (len(names),) or not np.all(np.isfinite(origin)):
            raise ModelError(f"{side}_origin must be {len(names)} finite number(s); got {origin.tolist()}")
    noise = np.asarray(model.noise_variance)
    if not 0 < model.sample_time < math.inf or not np.all((noise >= 0) & (noise < math.inf)) or not model.theta_dof > 2:
        raise ModelError(
            f"sample_time = {model.sample_time} must be positive and finite, noise_variance = {model.noise_variance} "
            f"finite and not negative and theta_dof = {model.theta_dof} above 2"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingRange(Rebuilt):
    """Range of the signals in a model's training data.

    Parameters
    ----------
    input_min, input_max : ndarray, shape (n_inputs,)
        Smallest and largest value of each input, in its unit.
    input_centre : ndarray, shape (n_inputs,)
        Mean of each input, in its unit; 0 if the model's signals are deviations from an operating point.
    output_min, output_max : ndarray, shape (n_outputs,)
        Smallest and largest value of each output, in its unit.
    output_centre : ndarray, shape (n_outputs,)
        Mean of each output, in its unit; 0 if the model's signals are deviations from an operating point.
    """

    input_min: Array
    input_max: Array
    input_centre: Array
    output_min: Array
    output_max: Array
    output_centre: Array

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, np.atleast_1d(real_numbers(getattr(self, item.name), item.name)))

    def shifted(self, operating_input: Array, operating_output: Array) -> OperatingRange:
        """Return the range of the deviations from `operating_input` (n_inputs,) and `operating_output` (1,)."""
        return OperatingRange(
            input_min=self.input_min - operating_input,
            input_max=self.input_max - operating_input,
            input_centre=np.zeros_like(self.input_centre),
            output_min=self.output_min - operating_output,
            output_max=self.output_max - operating_output,
            output_centre=np.zeros_like(self.output_centre),
        )


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

"""Check that the terms and numbers of a NARX model are valid."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.ident.arguments import real_numbers
from deatwin.ident.narx.covariance import covariance_of
from deatwin.plant.arrays import texts
from deatwin.plant.errors import ModelError

if TYPE_CHECKING:
    from deatwin.ident.narx.model import NarxModel


def set_signals(model: Any) -> None:
    """Make names and units of a frozen model tuples and its provenance read-only; ModelError unless they are texts and
    each signal has one name of its own and one unit."""
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

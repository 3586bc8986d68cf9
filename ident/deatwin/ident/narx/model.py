"""The polynomial NARX model: terms, parameters and their covariance; prediction, free run, and its file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.narx.operating import Array, OperatingRange, read_only
from deatwin.ident.narx.response import NarxResponse, ResponseStatus, free_run
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.plant.documents import read_document, write_document
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

SCHEMA = "deatwin/narx/1"

# A free run has diverged when it leaves this many times the outputs of the training data; a model without
# training data has no scale of its own, so that only what cannot be meant is called divergence.
_DIVERGED_TRAINED = 1e3
_DIVERGED_UNTRAINED = 1e9


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxModel:
    """A polynomial NARX model, y(k) = sum_m theta_m term_m(k) + e(k), of one output.

    Parameters
    ----------
    terms : tuple of Term
        The terms; each prints as in the literature.
    theta : ndarray, shape (n_terms,)
        Parameters in SI units (those of the signals).
    theta_cov : ndarray, shape (n_terms, n_terms)
        Covariance of the parameters.
    theta_dof : float
        Degrees of freedom of a Student-t posterior with that covariance: the squared scale of the t
        distribution is ``theta_cov * (theta_dof - 2) / theta_dof``. Infinite for a normal law.
    noise_variance : float
        Variance of e(k), square of the output's unit.
    sample_time : float
        Sampling interval in s.
    input_names, output_names, input_units, output_units : tuple of str
        Names and units of the signals.
    operating : OperatingRange or None
        Ranges of the training data, None when unknown.
    provenance : mapping of str to str
        Where the model comes from.

    Raises
    ------
    ModelError
        If shapes, terms or values do not fit together.
    """

    terms: tuple[Term, ...]
    theta: Array
    theta_cov: Array
    noise_variance: float
    sample_time: float
    theta_dof: float = math.inf
    input_names: tuple[str, ...] = ("input",)
    output_names: tuple[str, ...] = ("output",)
    input_units: tuple[str, ...] = ("",)
    output_units: tuple[str, ...] = ("",)
    operating: OperatingRange | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("theta", "theta_cov"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        n = len(self.terms)
        if n == 0 or len(set(self.terms)) != n:
            raise ModelError(
                "a NARX model needs at least one term, and each only once; "
                f"got {', '.join(map(str, self.terms)) or 'none'}"
            )
        if self.theta.shape != (n,) or self.theta_cov.shape != (n, n):
            raise ModelError(
                f"{n} terms need theta of shape ({n},) and theta_cov of shape ({n}, {n}); "
                f"got {self.theta.shape} and {self.theta_cov.shape}"
            )
        if not (np.all(np.isfinite(self.theta)) and np.all(np.isfinite(self.theta_cov))):
            raise ModelError("theta and theta_cov must be finite")
        if not self.sample_time > 0 or not self.noise_variance >= 0 or not self.theta_dof > 2:
            raise ModelError(
                f"sample_time = {self.sample_time} must be positive, noise_variance = "
                f"{self.noise_variance} not negative and theta_dof = {self.theta_dof} above 2"
            )
        if len(self.output_names) != 1 or self.table.channels("y") > 1:
            raise ModelError("a NarxModel has one output in this version")
        if self.table.channels("u") > len(self.input_names):
            raise ModelError(
                f"the terms use {self.table.channels('u')} inputs, but {len(self.input_names)} are named"
            )

    @classmethod
    def from_terms(
        cls,
        terms: Mapping[str, float],
        *,
        sample_time: float,
        theta_cov: ArrayLike | None = None,
        noise_variance: float = 0.0,
        **details: Any,
    ) -> Self:
        """Make a model from written terms.

        Parameters
        ----------
        terms : mapping of str to float
            Parameter of each term, as ``{"y(k-1)": 0.6, "u(k-1)^2": 0.3}``.
        sample_time : float
            Sampling interval in s.
        theta_cov : array_like, shape (n_terms, n_terms), optional
            Covariance of the parameters; zero when not given.
        noise_variance : float
            Variance of e(k), square of the output's unit.
        **details
            Other fields of the class: names, units, operating, provenance, theta_dof.

        Raises
        ------
        ModelError
            If a term cannot be read.
        """
        parsed = tuple(Term.parse(text) for text in terms)
        inputs = max(TermTable(parsed).channels("u"), 1)
        if inputs > 1:
            details.setdefault("input_names", tuple(f"input{i}" for i in range(1, inputs + 1)))
            details.setdefault("input_units", ("",) * inputs)
        cov = np.zeros((len(parsed), len(parsed))) if theta_cov is None else theta_cov
        return cls(
            terms=parsed,
            theta=read_only(list(terms.values())),
            theta_cov=read_only(cov),
            noise_variance=noise_variance,
            sample_time=sample_time,
            **details,
        )

    @cached_property
    def table(self) -> TermTable:
        """The terms prepared for evaluation."""
        return TermTable(self.terms)

    def __str__(self) -> str:
        right = " + ".join(f"{value:.6g} {term}" for value, term in zip(self.theta, self.terms, strict=True))
        return f"y(k) = {right} + e(k)".replace("+ -", "- ")

    def predict(self, recording: Recording) -> NarxResponse:
        """Predict each sample one step ahead from the measured past.

        Parameters
        ----------
        recording : Recording
            Measured inputs and outputs, in the model's units.

        Returns
        -------
        NarxResponse
            With ``.outputs`` of shape (1, n); the first lags are the measured ones.

        Raises
        ------
        ModelError
            If the recording does not suit the model.
        """
        first = self._check(recording)
        outputs = np.array(recording.outputs, dtype=np.float64)
        outputs[0, first:] = self.theta @ self.table.rows(
            recording.inputs, recording.outputs, first, recording.n_samples
        )
        return self._response(recording, outputs, first)

    def simulate(self, recording: Recording) -> NarxResponse:
        """Run free: only the first measured lags and the inputs of the recording are used.

        Parameters
        ----------
        recording : Recording
            Inputs, and outputs of which the first ``table.max_lag`` samples start the run, in the model's
            units.

        Returns
        -------
        NarxResponse
            With ``.outputs`` of shape (1, n). If the run diverges, ``.status`` says so, ``.failed_at_s``
            when, and the outputs from there on hold the last value.

        Raises
        ------
        ModelError
            If the recording does not suit the model.
        """
        first = self._check(recording)
        outputs, failed = free_run(
            self.table, self.theta, recording.inputs, recording.outputs[0], self._divergence_limit(recording)
        )
        if failed is None:
            return self._response(recording, outputs[None], first)
        return self._response(
            recording, outputs[None], first, ResponseStatus.DIVERGED, float(recording.timepts[failed])
        )

    def save(self, path: str | Path) -> None:
        """Write the model as JSON ("deatwin/narx/1"), beside the target first and then renamed.

        Parameters
        ----------
        path : str or Path
            File to write.
        """
        write_document(path, _to_json(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a model that `save` wrote.

        Parameters
        ----------
        path : str or Path
            File to read.

        Raises
        ------
        ModelError
            If the file is missing, not JSON, of another schema, or malformed.
        """
        return read_document(path, SCHEMA, lambda document: cls(**_from_json(document)))

    def _check(self, recording: Recording) -> int:
        """Return the first sample that can be computed, after checking that the recording suits."""
        if not math.isclose(recording.sample_time, self.sample_time, rel_tol=1e-6):
            raise ModelError(
                f"the recording has a sample time of {recording.sample_time:g} s, "
                f"the model of {self.sample_time:g} s"
            )
        if recording.inputs.shape[0] != len(self.input_names) or recording.outputs.shape[0] != 1:
            raise ModelError(
                f"the recording has {recording.inputs.shape[0]} inputs and "
                f"{recording.outputs.shape[0]} outputs, the model {len(self.input_names)} and 1"
            )
        if recording.n_samples <= self.table.max_lag:
            raise ModelError(
                f"the recording has {recording.n_samples} samples; "
                f"the model needs at least {self.table.max_lag + 1}"
            )
        return self.table.max_lag

    def _divergence_limit(self, recording: Recording) -> float:
        if self.operating is None:
            return _DIVERGED_UNTRAINED * max(1.0, float(np.abs(recording.outputs).max()))
        seen = np.abs([self.operating.output_min, self.operating.output_max])
        return _DIVERGED_TRAINED * max(float(seen.max()), float(np.abs(recording.outputs).max()))

    def _response(
        self,
        recording: Recording,
        outputs: Array,
        first: int,
        status: ResponseStatus = ResponseStatus.OK,
        failed_at_s: float | None = None,
    ) -> NarxResponse:
        outputs.setflags(write=False)
        return NarxResponse(
            outputs=outputs,
            measured=recording.outputs,
            timepts=recording.timepts,
            first=first,
            status=status,
            failed_at_s=failed_at_s,
            unit=self.output_units[0],
        )


def _to_json(model: NarxModel) -> dict[str, Any]:
    def signals(side: str, names: tuple[str, ...], units: tuple[str, ...]) -> list[dict[str, Any]]:
        ranges = {
            key: [None] * len(names)
            if model.operating is None
            else getattr(model.operating, f"{side}_{key}").tolist()
            for key in ("min", "max", "centre")
        }
        return [
            {"name": name, "unit": unit} | {key: values[i] for key, values in ranges.items()}
            for i, (name, unit) in enumerate(zip(names, units, strict=True))
        ]

    return {
        "schema": SCHEMA,
        "sample_time_s": float(model.sample_time),
        "inputs": signals("input", model.input_names, model.input_units),
        "outputs": signals("output", model.output_names, model.output_units),
        "terms": [
            {"term": str(term), "theta": float(value)}
            for term, value in zip(model.terms, model.theta, strict=True)
        ],
        "theta_cov": model.theta_cov.tolist(),
        "theta_dof": float(model.theta_dof) if math.isfinite(model.theta_dof) else None,
        "noise_variance": float(model.noise_variance),
        "provenance": dict(model.provenance),
    }


def _from_json(document: Mapping[str, Any]) -> dict[str, Any]:
    sides = {"input": document["inputs"], "output": document["outputs"]}
    ranges = {
        f"{side}_{key}": [signal[key] for signal in signals]
        for side, signals in sides.items()
        for key in ("min", "max", "centre")
    }
    known = all(value is not None for values in ranges.values() for value in values)
    dof = document["theta_dof"]
    names = {
        f"{side}_{key}s": tuple(str(signal[key]) for signal in signals)
        for side, signals in sides.items()
        for key in ("name", "unit")
    }
    return {
        "terms": tuple(Term.parse(item["term"]) for item in document["terms"]),
        "theta": read_only([item["theta"] for item in document["terms"]]),
        "theta_cov": read_only(document["theta_cov"]),
        "theta_dof": math.inf if dof is None else float(dof),
        "noise_variance": float(document["noise_variance"]),
        "sample_time": float(document["sample_time_s"]),
        "operating": OperatingRange(**{key: read_only(values) for key, values in ranges.items()})
        if known
        else None,
        "provenance": {str(key): str(value) for key, value in document["provenance"].items()},
        **names,
    }

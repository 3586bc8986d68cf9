"""What all NARX estimators share: the regression on recordings, its scaling, and scikit-learn's contract."""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.operating import OperatingRange
from deatwin.ident.narx.terms import Lags, TermTable, generate_terms
from deatwin.plant.errors import ModelError, nearest
from deatwin.plant.recording import Experiment, Recording

Array = NDArray[np.float64]
Recordings = Recording | Experiment | Iterable[Recording | Experiment]

_BLOCK = 4096  # samples evaluated at once: a block of 1000 terms is 32 MB


class NarxIdentifier(ABC):
    """An estimator of NARX models under scikit-learn's contract.

    Arguments are stored untouched under their names, what is learned ends in ``_``, and ``fit`` returns the
    estimator.
    """

    model_: NarxModel

    @abstractmethod
    def fit(self, recordings: Recordings) -> Self:
        """Learn ``model_`` from recordings.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data of one sample time; each recording starts with its own lags.
        """

    @classmethod
    def _names(cls) -> list[str]:
        return [name for name in inspect.signature(cls.__init__).parameters if name != "self"]

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the arguments by name.

        Parameters
        ----------
        deep : bool
            Part of scikit-learn's contract; without effect, for no argument is an estimator.

        Returns
        -------
        dict
        """
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self, **params: Any) -> Self:
        """Set arguments by name.

        Parameters
        ----------
        **params
            New values.

        Raises
        ------
        ModelError
            If a name is not an argument.
        """
        for name in params:
            if name not in self._names():
                raise ModelError(
                    f"{type(self).__name__} has no argument {name!r}{nearest(name, self._names())}"
                )
        for name, value in params.items():
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        arguments = ", ".join(f"{name}={value!r}" for name, value in self.get_params().items())
        return f"{type(self).__name__}({arguments})"


@dataclass(frozen=True, eq=False)
class Regression:
    """The regression y = Phi theta + e of candidate terms on recordings, in scaled signals.

    Each signal is divided by the power of two just above its largest magnitude: no regressor exceeds 1,
    whatever the units, and the way back to physical units is exact in binary arithmetic.

    Parameters
    ----------
    table : TermTable
        Candidate terms.
    recordings : tuple of Recording
        Training data.
    first : int
        The sample at which each recording starts to be fitted, so that all its lags are its own.
    """

    table: TermTable
    recordings: tuple[Recording, ...]
    first: int

    @classmethod
    def of(cls, recordings: Recordings, *, output_lags: Lags, input_lags: Lags, degree: int) -> Regression:
        """Set up all candidates of given lags and degree.

        Parameters
        ----------
        recordings : Recording, Experiment, or several
            Training data.
        output_lags, input_lags : int or sequence of int
            Lags in samples, a number n for 1..n.
        degree : int
            Largest degree.

        Raises
        ------
        ModelError
            If the recordings do not fit together or are too short.
        """
        chosen = flatten(recordings)
        times = [record.sample_time for record in chosen]
        channels = {(record.inputs.shape[0], record.outputs.shape[0]) for record in chosen}
        if len(channels) != 1 or not math.isclose(min(times), max(times), rel_tol=1e-6):
            raise ModelError("the recordings must have the same inputs, outputs and sample time")
        if chosen[0].outputs.shape[0] != 1:
            raise ModelError(
                f"the recordings have {chosen[0].outputs.shape[0]} outputs; "
                "NARX estimators identify one output in this version"
            )
        table = TermTable(generate_terms(output_lags, input_lags, degree, n_inputs=chosen[0].inputs.shape[0]))
        if not any(np.any(record.outputs) for record in chosen):
            raise ModelError("the output is constantly zero: there is nothing to identify")
        for number, record in enumerate(chosen, start=1):
            if record.n_samples <= table.max_lag:
                raise ModelError(
                    f"recording {number} has {record.n_samples} samples; "
                    f"lags up to {table.max_lag} need at least {table.max_lag + 1}"
                )
        return cls(table, chosen, table.max_lag)

    def only(self, indices: Iterable[int]) -> Regression:
        """Return the regression on some of the terms, over the same samples.

        Parameters
        ----------
        indices : iterable of int
            Their positions in ``table.terms``, in the order wanted.
        """
        return Regression(TermTable(tuple(self.table.terms[i] for i in indices)), self.recordings, self.first)

    @property
    def n_samples(self) -> int:
        """Number of rows of the regression."""
        return sum(record.n_samples - self.first for record in self.recordings)

    @cached_property
    def input_scales(self) -> Array:
        """Divisors of the inputs, shape (n_inputs,), in their units."""
        return _scales([record.inputs for record in self.recordings])

    @cached_property
    def output_scale(self) -> float:
        """Divisor of the output, in its unit."""
        return float(_scales([record.outputs for record in self.recordings])[0])

    @cached_property
    def term_scales(self) -> Array:
        """Physical size of a parameter of 1 for each term, shape (n_terms,)."""
        values = np.array(
            [self.output_scale if v.kind == "y" else self.input_scales[v.index] for v in self.table.variables]
        )
        return self.output_scale / self.table.at(values)

    def blocks(self) -> Iterator[tuple[Array, Array]]:
        """Yield regressors and outputs block by block.

        Yields
        ------
        rows : ndarray, shape (n_terms, n)
            Scaled regressors of up to 4096 samples, transposed.
        target : ndarray, shape (n,)
            Scaled outputs of these samples.
        """
        for record in self.recordings:
            inputs = record.inputs / self.input_scales[:, None]
            outputs = record.outputs / self.output_scale
            for start in range(self.first, record.n_samples, _BLOCK):
                stop = min(start + _BLOCK, record.n_samples)
                yield self.table.rows(inputs, outputs, start, stop), outputs[0, start:stop]

    def matrix(self) -> tuple[Array, Array]:
        """Return scaled regressors, transposed to (n_terms, n_samples), and outputs, shape (n_samples,)."""
        rows = np.empty((len(self.table.terms), self.n_samples))
        target = np.empty(self.n_samples)
        filled = 0
        for block, outputs in self.blocks():
            stop = filled + outputs.size
            rows[:, filled:stop], target[filled:stop] = block, outputs
            filled = stop
        return rows, target

    def gram(self) -> tuple[Array, Array, float]:
        """Return Phi'Phi, (n_terms, n_terms), Phi'y, (n_terms,), and y'y of the scaled signals, by blocks."""
        n = len(self.table.terms)
        gram, moment, power = np.zeros((n, n)), np.zeros(n), 0.0
        for rows, target in self.blocks():
            gram += rows @ rows.T
            moment += rows @ target
            power += float(target @ target)
        return gram, moment, power

    def model(
        self,
        theta: Array,
        theta_cov: Array,
        noise_variance: float,
        *,
        identifier: NarxIdentifier,
        theta_dof: float = math.inf,
    ) -> NarxModel:
        """Return the model of all terms of this regression, in physical units.

        Parameters
        ----------
        theta : ndarray, shape (n_terms,)
            Scaled parameters.
        theta_cov : ndarray, shape (n_terms, n_terms)
            Scaled covariance.
        noise_variance : float
            Scaled noise variance.
        identifier : NarxIdentifier
            The estimator, for the provenance.
        theta_dof : float
            Degrees of freedom of a Student-t posterior.

        Returns
        -------
        NarxModel
        """
        scale = self.term_scales
        record = self.recordings[0]
        files = [r.provenance["file"] for r in self.recordings if "file" in r.provenance]
        return NarxModel(
            terms=self.table.terms,
            theta=theta * scale,
            theta_cov=theta_cov * np.outer(scale, scale),
            theta_dof=theta_dof,
            noise_variance=noise_variance * self.output_scale**2,
            sample_time=record.sample_time,
            input_names=record.input_names,
            output_names=record.output_names,
            input_units=record.input_units,
            output_units=record.output_units,
            operating=_operating_range(self.recordings),
            provenance={
                "identifier": repr(identifier),
                "samples": str(self.n_samples),
                "recordings": ", ".join(files) or str(len(self.recordings)),
            },
        )


def flatten(recordings: Recordings) -> tuple[Recording, ...]:
    """Return the recordings of whatever was given.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Training data.

    Raises
    ------
    ModelError
        If there is none.
    """
    if isinstance(recordings, Recording):
        return (recordings,)
    if isinstance(recordings, Experiment):
        return tuple(recordings.recordings)
    if isinstance(recordings, str | bytes) or not isinstance(recordings, Iterable):
        raise ModelError(f"fit takes recordings and experiments, not a {type(recordings).__name__}")
    chosen = tuple(record for item in recordings for record in flatten(item))
    if not chosen:
        raise ModelError("no recording was given; fit needs at least one")
    return chosen


def _scales(signals: list[Array]) -> Array:
    largest = np.max([np.abs(signal).max(axis=1) for signal in signals], axis=0)
    return np.where(largest > 0, np.ldexp(1.0, np.frexp(largest)[1]), 1.0)


def _operating_range(recordings: tuple[Recording, ...]) -> OperatingRange:
    inputs = np.concatenate([record.inputs for record in recordings], axis=1)
    outputs = np.concatenate([record.outputs for record in recordings], axis=1)
    return OperatingRange(
        input_min=inputs.min(axis=1),
        input_max=inputs.max(axis=1),
        input_centre=inputs.mean(axis=1),
        output_min=outputs.min(axis=1),
        output_max=outputs.max(axis=1),
        output_centre=outputs.mean(axis=1),
    )

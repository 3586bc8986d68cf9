"""The polynomial NARMAX model: terms, parameters and their covariance; prediction and free run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from deatwin.ident.arguments import read_only, real_number, real_numbers, whole_number
from deatwin.ident.narx.covariance import covariance_of
from deatwin.ident.narx.document import (
    SCHEMA,
    OperatingRange,
    fields_of,
    require_terms,
    require_values,
    set_signals,
    to_document,
)
from deatwin.ident.narx.drive import Drive, require_suits
from deatwin.ident.narx.free_run import free_run, innovations, require_steps, steps_ahead
from deatwin.ident.narx.response import NarxResponse, ResponseStatus, divergence_limit, response_over
from deatwin.ident.narx.terms import Term, TermTable
from deatwin.ident.narx.written import by_equation, name_signals, origins, shown_units, written
from deatwin.plant.arguments import each, instance
from deatwin.plant.arrays import Array, texts
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, document, squared, variable
from deatwin.plant.documents import Saved
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def _variance_unit(model: NarxModel) -> str:
    units = {squared(unit) for unit in model.output_units}
    return units.pop() if len(units) == 1 else ""


@dataclass(frozen=True, kw_only=True, eq=False)
class NarxModel(Described, Saved, schema=SCHEMA, document=to_document, fields=fields_of):
    """Polynomial NARX model, y(k) = sum_m theta_m term_m(k) + e(k), with one or several outputs.

    In the terms, y and u are the signals minus their origins. The arguments and results of all methods are the signals
    themselves.

    Terms may contain the noise e(k-l) of earlier samples (NARMAX). With several outputs, each term belongs to the
    equation of one output, and the equations are simulated together.

    Parameters
    ----------
    terms : tuple of Term
        Terms of all equations; a term is printed like ``y(k-1)u(k-2)^2``.
    theta : ndarray, shape (n_terms,)
        Parameters, in the units that follow from those of the signals.
    theta_cov : ndarray, shape (n_terms, n_terms)
        Covariance of the parameters.
    theta_dof : float
        Degrees of freedom of the parameters' posterior, if that is a Student-t distribution with the covariance
        `theta_cov`. Infinite for a normal distribution. With several outputs, the smallest of their values.
    noise_variance : float, or ndarray of shape (n_outputs,) with several outputs
        Variance of e(k), square of the output's unit.
    sample_time : float
        Sample time, s.
    equations : tuple of int
        For each term, the index of the output whose equation contains the term. Needed only with several outputs.
    input_names, output_names, input_units, output_units : tuple of str
        Names and units of the signals.
    input_origin, output_origin : ndarray, shapes (n_inputs,) and (n_outputs,)
        Origins, which are subtracted from the inputs and outputs, in their units. By default zeros.
    operating : OperatingRange or None
        Ranges of the training data; None if unknown.
    provenance : mapping of str to str
        Notes on the origin of the model, such as the identifier and the recordings.

    Raises
    ------
    ModelError
        If shapes, terms or values are inconsistent, or `theta_cov` is not symmetric positive semidefinite.

    Examples
    --------
    >>> model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)^2": 2.0}, sample_time=0.1)
    >>> model.simulate([1.0, 1.0, 1.0], initial=[0.0]).outputs
    array([[0., 2., 3.]])
    """

    terms: tuple[Term, ...]
    theta: Array
    theta_cov: Array
    noise_variance: float | Array
    sample_time: float
    theta_dof: float = math.inf
    equations: tuple[int, ...] = ()
    input_names: tuple[str, ...] = ("input",)
    output_names: tuple[str, ...] = ("output",)
    input_units: tuple[str, ...] = ("",)
    output_units: tuple[str, ...] = ("",)
    input_origin: Array = field(default_factory=lambda: np.empty(0))
    output_origin: Array = field(default_factory=lambda: np.empty(0))
    operating: OperatingRange | None = None
    provenance: Mapping[str, str] = field(default_factory=dict)

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "term": coordinate("term", of=lambda model: [str(term) for term in model.terms]),
        "other_term": coordinate("other_term", of=lambda model: [str(term) for term in model.terms]),
        "theta": variable("term"),
        "theta_cov": variable("term", "other_term"),
        "equations": variable("term", name="equation", of=lambda model: list(model.equations)),
        "noise_variance": variable("output", of=lambda model: np.atleast_1d(model.noise_variance), unit=_variance_unit),
        "output": coordinate("output", of=lambda model: list(model.output_names)),
        "sample_time": attribute(),
        "theta_dof": attribute(),
        "input_units": attribute(of=lambda model: list(model.input_units)),
        "input_names": attribute(of=lambda model: list(model.input_names)),
        "output_units": attribute(of=lambda model: list(model.output_units)),
        "document": document(to_document),
    }

    def __post_init__(self) -> None:
        each(instance(Term))(self.terms, "terms")
        set_signals(self)
        for name, names in (("input_origin", self.input_names), ("output_origin", self.output_names)):
            given = real_numbers(getattr(self, name), name)
            object.__setattr__(self, name, given if given.size else read_only(np.zeros(len(names))))
        for name in ("theta", "theta_cov"):
            object.__setattr__(self, name, real_numbers(getattr(self, name), name))
        each(partial(whole_number, least=0))(self.equations, "equations")
        for name in ("sample_time", "theta_dof"):
            real_number(getattr(self, name), name)
        if self.operating is not None:
            instance(OperatingRange)(self.operating, "operating")
        real_numbers(self.noise_variance, "noise_variance")
        if self.n_outputs == 1 and set(self.equations) <= {0}:  # also after terms were replaced
            object.__setattr__(self, "equations", (0,) * len(self.terms))
        if self.n_outputs > 1:
            object.__setattr__(self, "noise_variance", read_only(self.noise_variance))
        require_terms(self)
        require_values(self)
        object.__setattr__(self, "theta_cov", covariance_of(self.theta_cov, self.terms))

    @classmethod
    def from_terms(
        cls,
        terms: Mapping[str, float] | Mapping[str, Mapping[str, float]],
        *,
        sample_time: float,
        theta_cov: ArrayLike | None = None,
        noise_variance: ArrayLike = 0.0,
        **details: Any,
    ) -> Self:
        """Make a model from written terms.

        Parameters
        ----------
        terms : mapping of str to float, or of str to such mappings
            Parameter of each term, as ``{"y(k-1)": 0.6, "u(k-1)^2": 0.3}``. If there are several outputs, give one
            mapping for each output: ``{"y1": {"y1(k-1)": 0.6}, "y2": {"y1(k-1)": 0.2, "u(k-1)": 1.0}}``. Terms may also contain signal
            names that are given in `details`.
        sample_time : float
            Sample time, s.
        theta_cov : array_like, shape (n_terms, n_terms), optional
            Covariance of the parameters; zero if omitted.
        noise_variance : float or array_like of shape (n_outputs,)
            Variance of e(k), square of the output's unit. A single number applies to all outputs.
        **details
            Other fields of `NarxModel`, such as ``input_names`` or ``operating``.

        Raises
        ------
        ModelError
            If a term cannot be read, or for the reasons given for `NarxModel`.
        """
        names = {f"{side}_names": texts(details.get(f"{side}_names", ())) for side in ("input", "output")}
        written = by_equation(terms, names["output_names"])
        parsed = tuple(Term.parse(text, **names) for _, text, _ in written)
        outputs = max(row for row, _, _ in written) + 1
        name_signals(details, "input", TermTable(parsed).channels("u"))
        name_signals(details, "output", outputs)
        cov = np.zeros((len(parsed), len(parsed))) if theta_cov is None else theta_cov
        noise = np.asarray(noise_variance, dtype=np.float64)
        return cls(
            terms=parsed,
            theta=read_only([value for _, _, value in written]),
            theta_cov=read_only(cov),
            noise_variance=np.broadcast_to(noise, outputs) if outputs > 1 else float(noise),
            sample_time=sample_time,
            equations=tuple(row for row, _, _ in written),
            **details,
        )

    @classmethod
    def joined(cls, models: Sequence[NarxModel]) -> NarxModel:
        """Combine single-output `models`, one for each output in the order of the outputs, into one model.

        All have the same names of inputs and outputs, and terms only in their own equation; ModelError otherwise.
        Parameters of different equations are uncorrelated.
        """
        first = models[0]
        if any(set(model.equations) != {row} for row, model in enumerate(models)) or (len(models) != first.n_outputs):
            raise ModelError("joined takes one model for each output, in the order of the outputs")
        noise = np.array([np.atleast_1d(model.noise_variance)[row] for row, model in enumerate(models)])
        return replace(
            first,
            terms=tuple(term for model in models for term in model.terms),
            equations=tuple(row for model in models for row in model.equations),
            theta=np.concatenate([model.theta for model in models]),
            theta_cov=block_diag(*(model.theta_cov for model in models)),
            theta_dof=min(model.theta_dof for model in models),
            noise_variance=noise if len(models) > 1 else float(noise[0]),
        )

    @cached_property
    def table(self) -> TermTable:
        """Terms prepared for evaluation."""
        return TermTable(self.terms)

    @property
    def n_outputs(self) -> int:
        """Number of outputs."""
        return len(self.output_names)

    @cached_property
    def deterministic(self) -> NarxModel:
        """Model without its noise terms, as used in a free run; ModelError if it has only noise terms."""
        kept = [m for m, term in enumerate(self.terms) if all(v.kind != "e" for v, _ in term.factors)]
        if len(kept) == len(self.terms):
            return self
        return replace(
            self,
            terms=tuple(self.terms[m] for m in kept),
            equations=tuple(self.equations[m] for m in kept),
            theta=self.theta[kept],
            theta_cov=self.theta_cov[np.ix_(kept, kept)],
        )

    def require_one_output(self, purpose: str) -> None:
        """Raise ModelError, which names the `purpose`, unless the model has one output and no noise terms."""
        if self.n_outputs > 1:
            raise ModelError(f"{purpose} takes a model of one output; this one has {self.n_outputs}")
        if self.table.channels("e"):
            raise ModelError(f"{purpose} takes a model without noise terms; give its `deterministic` part")

    def __str__(self) -> str:
        shown = shown_units(self)
        text = written(self.terms, self.theta * shown.factors, self.equations, self.input_names, self.output_names)
        return text + origins(self) + (f"\n({shown.legend})" if shown.legend else "")

    def about_origin(self, inputs: Array, outputs: Array) -> tuple[Array, Array]:
        """Return `inputs` (n_inputs, n) and `outputs` (n_outputs, n) minus their origins."""
        return inputs - self.input_origin[:, None], outputs - self.output_origin[:, None]

    def divergence_limit(self, outputs: Array) -> float:
        """Return the distance from ``output_origin`` beyond which a free run has diverged, in the outputs' units.

        It is a multiple of the largest distance that the training data or `outputs`, shape (n_outputs, n), have from
        the origin.
        """
        return divergence_limit(self.operating, outputs, self.output_origin)

    def predict(self, recording: Recording, *, steps: int = 1) -> NarxResponse:
        """Predict each output sample from the outputs that were measured at least `steps` samples before it.

        Parameters
        ----------
        recording : Recording
            Measured inputs and outputs, in the model's units.
        steps : int
            Number of samples ahead. The ``steps - 1`` outputs before the predicted one are predictions themselves. All
            inputs are the measured ones.

        Returns
        -------
        NarxResponse
            Response with ``.outputs`` of shape (n_outputs, n). The samples before ``.first``, which is the largest lag
            plus ``steps - 1``, are measured values. In noise terms, e is the one-step prediction error. At the first
            samples, which have no prediction, and after the last measured output that is used, e is 0. ``.status``
            tells whether predictions several steps ahead diverge.

        Raises
        ------
        ModelError
            If the recording does not suit the model, or is too short for `steps`.
        """
        first = self._check(recording)
        require_steps(steps, first, recording.n_samples)
        if steps > 1:
            return self._predict_further(recording, steps)
        signals = self.about_origin(recording.inputs, recording.outputs)
        outputs = recording.outputs - innovations(self.table, self.theta, *signals, self.equations)
        return response_over(recording, outputs, first, self.output_units)

    def _predict_further(self, recording: Recording, steps: int) -> NarxResponse:
        """Predict more than one step ahead."""
        found, failed = steps_ahead(
            self.table,
            self.theta,
            *self.about_origin(recording.inputs, recording.outputs),
            steps,
            self.divergence_limit(recording.outputs),
            self.equations,
        )
        first = self.table.max_lag + steps - 1
        outputs = np.concatenate([recording.outputs[:, :first], found + self.output_origin[:, None]], axis=1)
        if not failed.any():
            return response_over(recording, outputs, first, self.output_units)
        when = float(recording.timepts[first + int(np.argmax(failed))])
        return response_over(recording, outputs, first, self.output_units, ResponseStatus.SOME_DIVERGED, when)

    def simulate(self, recording: Recording | ArrayLike, *, initial: ArrayLike | None = None) -> NarxResponse:
        """Simulate the outputs from the inputs and from initial outputs, without noise (free run).

        The initial outputs are `initial` if given, else the first ``table.max_lag`` outputs of a recording, else
        ``output_origin``.

        Parameters
        ----------
        recording : Recording, or array_like of shape (n,) or (n_inputs, n)
            Inputs in the model's units.
        initial : array_like, shape (m,) or (n_outputs, m), optional
            Outputs at the first m samples, the newest last, where m is at least the largest output lag. If m is below
            ``table.max_lag``, they are the outputs at the last m samples before the first computed one. NaN after the
            last known output is ignored.

        Returns
        -------
        NarxResponse
            Response with ``.outputs`` of shape (n_outputs, n), which are computed from ``.first`` on. ``.measured`` is
            NaN for unknown outputs. If the run diverges, ``.status`` is ``DIVERGED``, ``.failed_at_s`` is the time, and
            the outputs keep their last value from then on.

        Raises
        ------
        ModelError
            If shapes are inconsistent, there are too few initial outputs, or the recording does not suit the model.
        """
        drive = self._drive(recording, initial)
        start = drive.first - self.table.max_lag
        run, failed = free_run(
            self.table,
            self.theta,
            *self.about_origin(drive.inputs[:, start:], drive.outputs[:, start:]),
            self.divergence_limit(drive.outputs),
            self.equations,
        )
        outputs = np.concatenate([drive.outputs[:, :start], run + self.output_origin[:, None]], axis=1)
        outputs[:, : drive.first] = drive.outputs[:, : drive.first]  # exact to the last bit
        if failed is None:
            return response_over(drive, outputs, drive.first, self.output_units)
        when = float(drive.timepts[start + failed])
        return response_over(drive, outputs, drive.first, self.output_units, ResponseStatus.DIVERGED, when)

    def _drive(self, given: Recording | ArrayLike, initial: ArrayLike | None) -> Drive:
        """Return inputs and initial outputs of a free run, after a check."""
        first = self.table.max_lag
        if isinstance(given, Recording):
            alone = initial is not None or not given.output_names
            self._check(given, with_outputs=not alone)
            if not alone:
                return Drive.recorded(given, first)
        if initial is None:
            initial = np.repeat(self.output_origin[:, None], first, axis=1)
        return Drive.of(
            given,
            initial,
            input_names=self.input_names,
            n_outputs=self.n_outputs,
            sample_time=self.sample_time,
            first=first,
            fewest=max((v.reach for v in self.table.variables if v.kind == "y"), default=0),
        )

    def _check(self, recording: Recording, with_outputs: bool = True) -> int:
        """Return the first sample that can be computed, after checking that the recording suits."""
        require_suits(recording, self, with_outputs=with_outputs, fewest=self.table.max_lag + 1)
        return self.table.max_lag


def require_model(model: object) -> NarxModel:
    """Return the model; raise ModelError for anything but a NarxModel, such as the identifier that holds one."""
    if isinstance(model, NarxModel):
        return model
    instead = {"fit": "; its model_ may be", "to_narx": "; to_narx() makes one of an ARX or ARMAX model"}
    said = next((text for name, text in instead.items() if hasattr(type(model), name)), "")
    raise ModelError(f"a {type(model).__name__} is not a NarxModel{said}")

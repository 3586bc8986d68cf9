"""Results of the finished steps of a diagnosis, kept if the later ones do not run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.located import LocationSummary
from deatwin.ident.mismatch.model_error import differences, with_model_error
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.quality import DataQuality, faults_of
from deatwin.ident.mismatch.refit.base import Base
from deatwin.ident.mismatch.refit.fitted import fitted_parameters
from deatwin.ident.mismatch.result import (
    AdviceSummary,
    DetectionSummary,
    Fault,
    FormSummary,
    FreeFormSummary,
    VerificationSummary,
)
from deatwin.ident.mismatch.verdict import FittedParameter
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.records import Json, finite, plain


@dataclass(frozen=True, kw_only=True)
class GateSummary:
    """State of the recordings."""

    soundness: str
    findings: tuple[str, ...]
    notes: tuple[str, ...]
    faults: tuple[Fault, ...]


@dataclass(frozen=True, kw_only=True)
class FittedPlant:
    """Fitted parameters, their values, and the residuals."""

    effects: tuple[str, ...]
    form: Mapping[str, Json]  # Interpretation of the rig file where it differs from the file or the file is silent
    fitted: float  # Rms residual, like `unseen`, in the unit that a diagnosis reports
    unseen: float | None  # None until it was judged on held-out data
    parameters: Mapping[str, FittedParameter]


@dataclass(frozen=True, kw_only=True)
class BaseSummary(FittedPlant):
    """The calibrated base plant, and its alternative forms."""

    noise: float
    model_error: float
    rivals: tuple[FormSummary, ...]


StepResult = (
    GateSummary
    | FittedPlant
    | DetectionSummary
    | LocationSummary
    | VerificationSummary
    | AdviceSummary
    | FreeFormSummary
)
_Summary = TypeVar("_Summary", bound=StepResult, covariant=True)


class _Found(Protocol[_Summary]):
    """Result of a step."""

    @property
    def summary(self) -> _Summary: ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """Finished step of a diagnosis. Its result is preliminary: later steps may overrule it.

    Parameters
    ----------
    name : str
        ``gate`` (check of the recordings), ``base`` (calibration), ``detect``, ``locate``, ``fit`` (of one candidate),
        ``verify``, ``advise`` or ``discover``.
    result : GateSummary, FittedPlant, DetectionSummary, LocationSummary, VerificationSummary, AdviceSummary or \
FreeFormSummary
        Result of the step, with amplitudes in the unit of `Diagnosis.output`.
    subject : str
        Effects and rig variant of the candidate, if the step is ``fit``; else empty. A later step with the same name
        and subject replaces this one.
    model : CalibratedPlant or None
        Calibrated base plant, if the step is ``base``; else None.
    """

    name: str
    result: StepResult
    subject: str = ""
    model: CalibratedPlant | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the step as stored in its file; numbers that no fit determines are None."""
        found: dict[str, Any] = finite(plain(self.result))
        return found


def quality_step(checked: DataQuality) -> Step:
    """Return the state of the recordings."""
    result = GateSummary(
        soundness=checked.soundness.name.lower(),
        findings=tuple(checked.findings),
        notes=tuple(checked.notes),
        faults=faults_of(checked),
    )
    return Step(name="gate", result=result)


def base_step(problem: DiagnosisProblem, base: Base) -> Step:
    """Return the calibrated base plant; what it leaves of the held-out part is its model error."""
    chosen, size = base.chosen, _size(problem)
    fit = chosen.calibration
    result = BaseSummary(
        **vars(_fit(problem, fit, chosen.unseen)),
        noise=base.noise / size,
        model_error=fit.plant.rig.model_error / size,
        rivals=variants_tried(problem, base)[1:],
    )
    model = CalibratedPlant(
        plant=with_model_error(fit.plant, problem.stated_error),
        noise=base.noise,
        model_error=chosen.unseen_test.size,
        names=fit.names,
        covariance=fit.covariance,
        provenance={"step": "base"},
    )
    return Step(name="base", result=result, model=model)


def variants_tried(problem: DiagnosisProblem, base: Base) -> tuple[FormSummary, ...]:
    """Return how each form of the base plant interprets the rig file, the chosen one first, and what error remains."""
    return tuple(_remainder(problem, form) for form in (base.chosen, *base.alternatives))


def fit_step(problem: DiagnosisProblem, fit: Calibration, unseen: np.ndarray | None) -> Step:
    """Return a fit with further effects; `unseen`, (n,), are its held-out residuals, SI, or None if not yet judged."""
    result = _fit(problem, fit, unseen)
    form = [f"{name} = {value!r}" for name, value in result.form.items()]
    return Step(name="fit", subject=", ".join(["+".join(result.effects), *form]), result=result)


def found_step(name: str, found: _Found[StepResult] | None) -> Step | None:
    """Return what a step found, as ``diagnosis.json`` would hold it; None if it had nothing to find."""
    return None if found is None else Step(name=name, result=found.summary)


def _fit(problem: DiagnosisProblem, fit: Calibration, unseen: np.ndarray | None) -> FittedPlant:
    size = _size(problem)
    with np.errstate(invalid="ignore", over="ignore"):  # intervals of an unfinished fit may be infinite
        parameters = fitted_parameters(problem.nominal, fit)
    return FittedPlant(
        effects=tuple(name for name in fit.plant.effect_names if name not in problem.nominal.effect_names),
        form=_form(problem, fit),
        fitted=fit.rms / size,
        unseen=None if unseen is None else root_mean_square(unseen) / size,
        parameters=parameters,
    )


def _remainder(problem: DiagnosisProblem, form: Candidate) -> FormSummary:
    size = _size(problem)
    return FormSummary(
        form=_form(problem, form.calibration), fitted=form.fitted_test.rms / size, unseen=form.unseen_test.rms / size
    )


def _form(problem: DiagnosisProblem, fit: Calibration) -> dict[str, Any]:
    """Return the interpretation of the rig file where it differs from the file, or the file is silent."""
    return differences([problem.nominal.rig, fit.plant.rig])[1]


def _size(problem: DiagnosisProblem) -> float:
    return amplitude_unit(problem.nominal.rig.output_unit)[1]

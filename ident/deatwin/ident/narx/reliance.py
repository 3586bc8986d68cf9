"""How reliable a model is: its residual tests, the gain error of its free run, and the bands that its recordings excited."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from deatwin.ident.arguments import probability
from deatwin.ident.narx.drive import require_suits
from deatwin.ident.narx.excited import Excitation, excitation, number_of
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.ident.narx.residual import DIVERGED, DivergedError, free_run_residual
from deatwin.ident.narx.validate import Validation, ValidationStatus, validate
from deatwin.plant.checks import require_samples
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

STATUS_KEY, FAILED_KEY, BIAS_KEY = "residual_tests", "residual_tests_failed", "free_run_gain_error"
SCARCITY_KEY, FIT_KEY = "samples_per_parameter", "free_run_fit_percent"  # Keys of a model's provenance
_UNTESTED = "untested"
# Training samples for each effective parameter: with fewer, by Akaike's final prediction error (n + p)/(n - p), the
# expected squared error on new data is more than half as large again as on the training data.
_ENOUGH = 5.0


@dataclass(frozen=True, kw_only=True)
class Reliance:
    """Assessment of a model with one output on held-out data.

    Parameters
    ----------
    status : ValidationStatus or None
        Joint result of the residual tests; None if the held-out data were too short for them.
    failed : tuple of str
        Names of the residual tests that failed, such as ``ue``; see `Validation.test`.
    gain_error : float or None
        Slope of the measured output over the free run, minus 1; positive if the measured output varies more. None if
        unknown.
    gain_error_half_width : float or None
        Half width of the 95 % interval of ``gain_error``; None if unknown.
    samples_per_parameter : float or None
        Number of training samples per effective parameter of the model; None if unknown. A term that was chosen among
        many candidates counts as more than one parameter.
    fit : float or None
        Fit of the free run to the held-out data in percent: 100 for a perfect model, 0 for a constant at the mean of
        the data. None if unknown.
    """

    status: ValidationStatus | None
    failed: tuple[str, ...] = ()
    gain_error: float | None = None
    gain_error_half_width: float | None = None
    samples_per_parameter: float | None = None
    fit: float | None = None

    @classmethod
    def of(cls, model: NarxModel, validation: Validation | None) -> Self:
        """Return the assessment of a `model` with one output; `validation` is None for too few held-out data."""
        share = samples_per_parameter(model)
        if validation is None:
            return cls(status=None, samples_per_parameter=share)
        fit = float(validation.free_run.percent[0])
        return cls(
            status=validation.status,
            failed=tuple(dict.fromkeys(test.name for test in validation.failed)),
            gain_error=validation.gain_error,
            gain_error_half_width=validation.gain_error_half_width,
            samples_per_parameter=share,
            fit=fit if math.isfinite(fit) and validation.unstable is None else None,
        )

    @property
    def biased(self) -> bool:
        """True if the 95 % interval of the gain error excludes zero."""
        if self.gain_error is None or self.gain_error_half_width is None:
            return False
        return abs(self.gain_error) > self.gain_error_half_width

    @property
    def caveats(self) -> tuple[str, ...]:
        """Reasons not to rely on the model, each as a sentence without its full stop."""
        found = []
        if self.status is None:
            found.append(
                "the held-out data were too short for the residual tests, so only the training data support the model"
            )
        elif self.status is ValidationStatus.DIVERGED:
            found.append("the model's free run diverged on held-out data")
        elif self.status is ValidationStatus.UNSTABLE:
            found.append("the model is unstable, so its free run on held-out data means nothing")
        elif not self.status.ok:
            count = len(self.failed)
            tests = (
                f"{_COUNTED.get(count, count)} residual test{'s' if count > 1 else ''}" if count else "residual tests"
            )
            names = f" ({', '.join(self.failed)}, where e is the residual and u the input)" if count else ""
            found.append(
                f"the model failed {tests} on held-out data{names}: its residual {_MEANING[self.status]}, and the uncertainty "
                "of its parameters does not include this error"
            )
        if self.biased and self.gain_error is not None and self.gain_error_half_width is not None:
            way = "larger" if self.gain_error > 0 else "smaller"
            half_width = f"{100 * self.gain_error_half_width:.2g}"
            decimals = len(half_width.partition(".")[2])
            found.append(
                f"the model is biased: on held-out data, the measured gain is {100 * abs(self.gain_error):.{decimals}f} ± "
                f"{half_width} % (95 % interval) {way} than the gain of the model's free run"
            )
        return (*found, *self.remarks)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Caveats besides the residual tests and the gain error: a useless free run, and too few training samples."""
        useless = (
            "the model predicts nothing: on held-out data, its free run is no better than the mean of the readings"
            if self.fit is not None and self.fit <= 0.0
            else ""
        )
        return tuple(said for said in (useless, self.scarcity) if said)

    @property
    def scarcity(self) -> str:
        """Warning that there were too few training samples, without a final full stop; otherwise empty."""
        if self.samples_per_parameter is None or self.samples_per_parameter >= _ENOUGH:
            return ""
        return (
            f"the model was fitted to only {self.samples_per_parameter:.2g} samples per effective parameter (the choice among "
            f"candidates counts as parameters), but {_ENOUGH:g} are needed: terms may be present by chance, and "
            f"intervals are too narrow; record longer, or choose a lower degree"
        )

    @property
    def provenance(self) -> dict[str, str]:
        """The assessment as entries for the provenance of a `NarxModel`."""
        kept = {STATUS_KEY: _UNTESTED if self.status is None else self.status.name.lower()}
        if self.failed:
            kept[FAILED_KEY] = "; ".join(self.failed)
        if self.gain_error is not None and self.gain_error_half_width is not None:
            kept[BIAS_KEY] = f"{self.gain_error:.6g} +- {self.gain_error_half_width:.6g}"
        if self.samples_per_parameter is not None:
            kept[SCARCITY_KEY] = f"{self.samples_per_parameter:.6g}"
        if self.fit is not None:
            kept[FIT_KEY] = f"{self.fit:.6g}"
        return kept

    @classmethod
    def of_provenance(cls, provenance: Mapping[str, str]) -> Self | None:
        """Read the assessment from a model's `provenance`; None if there is none, ModelError if it is invalid."""
        if (written := provenance.get(STATUS_KEY)) is None:
            return None
        try:
            status = None if written == _UNTESTED else ValidationStatus[written.upper()]
        except KeyError:
            known = ", ".join([*(status.name.lower() for status in ValidationStatus), _UNTESTED])
            raise ModelError(
                f"the model's provenance has {STATUS_KEY} = {written!r}: it must be one of {known}"
            ) from None
        failed = tuple(name for name in provenance.get(FAILED_KEY, "").split("; ") if name)
        error, width = _numbers(provenance.get(BIAS_KEY))
        return cls(
            status=status,
            failed=failed,
            gain_error=error,
            gain_error_half_width=width,
            samples_per_parameter=number_of(provenance, SCARCITY_KEY),
            fit=number_of(provenance, FIT_KEY),
        )


_COUNTED = {1: "one", 2: "two", 3: "three", 4: "four", 5: "five"}
_MEANING = {
    ValidationStatus.STRUCTURE: "still depends on the input",
    ValidationStatus.NOISE: "is predictable from its own past",
}


def assess_reliance(model: NarxModel, recordings: Sequence[Recording]) -> Reliance:
    """Assess on held-out recordings whether a model can be relied on.

    Parameters
    ----------
    model : NarxModel
        Model with one output.
    recordings : sequence of Recording
        Recordings that were not used for the fit.

    Returns
    -------
    Reliance
        Assessment; the status is None if the recordings are too short for the residual tests.

    Raises
    ------
    ModelError
        If a recording does not suit the model.
    """
    require_model(model)
    for record in flatten(recordings):
        require_suits(record, model, with_outputs=True, fewest=0)
    try:
        return Reliance.of(model, validate(model, recordings))
    except ModelError:
        return Reliance.of(model, None)


def samples_per_parameter(model: NarxModel) -> float | None:
    """Return training samples per effective parameter, None if unknown. One of the best k of M terms may count as 2
    ln(M/k) parameters, because it was chosen (Foster, George, Ann. Statist. 22 (1994) 1947-1975,
    doi:10.1214/aos/1176325766)."""
    samples, candidates = (number_of(model.provenance, key) for key in ("samples", "candidates"))
    if samples is None or not model.terms:
        return None
    terms = len(model.terms)
    candidates = max(candidates or 0.0, terms)
    return samples / (terms * max(1.0, 2.0 * math.log(candidates / terms)))


def _numbers(written: str | None) -> tuple[float | None, float | None]:
    if written is None:
        return None, None
    try:
        error, width = (float(part) for part in written.split(" +- "))
    except ValueError:
        error, width = math.nan, math.nan
    if not (math.isfinite(error) and math.isfinite(width) and width >= 0.0):
        raise ModelError(f'the model\'s provenance has {BIAS_KEY} = {written!r}: it must be like "0.1 +- 0.02"')
    return error, width


HELD_OUT = 0.3  # Share at the end of each recording that is not fitted but judges the model
_FEWEST = 500  # Samples of a held-out part: fewer show too little of a slow residual to give its size and memory


def hold_out(recordings: Recordings, share: float = HELD_OUT) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Split each recording into a beginning to which a model is fitted, and an end on which the model is tested.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings of at least 10 samples each.
    share : float
        Share of each recording that is held out, between 0 and 1.

    Returns
    -------
    training, held_out : tuple of Recording
        Beginnings and ends of the recordings, in the order given.

    Raises
    ------
    ModelError
        If a recording has fewer than 10 samples, or `share` is not between 0 and 1.
    """
    probability(share, "share")
    whole = flatten(recordings)
    for record in whole:
        require_samples([record], 10, "identification with a held-out part")
    cuts = [min(max(round(record.n_samples * (1.0 - share)), 1), record.n_samples - 1) for record in whole]
    pairs = [
        (record.section(0, cut), record.section(cut, record.n_samples)) for record, cut in zip(whole, cuts, strict=True)
    ]
    return tuple(first for first, _ in pairs), tuple(last for _, last in pairs)


def assessed(
    model: NarxModel, recordings: Recordings, held_out: Recordings, *, reliance: Reliance | None = None
) -> NarxModel:
    """Return a copy of a model with an assessment of its reliability, as `deatwin identify` saves it.

    The assessment contains the frequency bands that the input excited, and the rms and correlation time of the free-run
    residual. For held-out data, it contains the results of the residual tests and the gain error. The gain error is the
    slope of a regression of the free-run residual on the simulated output. All of these are stored as entries of
    ``provenance``, which the commands `frequency` and `check` read.

    Parameters
    ----------
    model : NarxModel
        Fitted model with one output.
    recordings : Recording, Experiment, or several
        All recordings of the plant, including their held-out parts.
    held_out : Recording, Experiment, or several
        The parts to which the model was not fitted; see `hold_out`.
    reliance : Reliance, optional
        Results of the tests on the held-out parts; computed if omitted.

    Returns
    -------
    NarxModel
        Copy of the model with the assessment added to its provenance. The excited bands are missing if the first input
        of every recording is constant, a ramp, or shorter than 64 samples.
    """
    require_model(model)
    whole, unseen = flatten(recordings), flatten(held_out)
    excited, _ = band_excited(whole)
    told = (assess_reliance(model, unseen) if reliance is None else reliance).provenance
    left = _largest_residual(model, [part for part in unseen if part.n_samples >= _FEWEST] or whole)
    return replace(model, provenance={**model.provenance, **excited, **left, **told})


def band_excited(recordings: Sequence[Recording]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the bands that the inputs excited, as a model stores them, or the reasons why there are none."""
    found, faults = [], []
    for record in recordings:
        if np.ptp(record.inputs[0]) > 0:
            try:
                found.append(excitation(record))
            except DataError as error:
                faults.append(f"{error}; the model does not state up to which frequency it is reliable")
    return (Excitation.joined(found).provenance, ()) if found else ({}, tuple(faults))


def _largest_residual(model: NarxModel, judged: Sequence[Recording]) -> dict[str, str]:
    """Return the free-run residual as a model stores it; if a free run diverges, that fact."""
    try:
        found = [free_run_residual(model, record) for record in judged]
    except DivergedError:
        return dict(DIVERGED)
    except ModelError:
        return {}
    return max(found, key=lambda residual: residual.rms).provenance

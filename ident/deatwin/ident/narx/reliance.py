"""How far a model may be relied upon: what its residual tests said, and the gain error of its free run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.validate import ValidationStatus, validate
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

STATUS_KEY, FAILED_KEY, BIAS_KEY = "residual_tests", "residual_tests_failed", "free_run_gain_error"
"""Keys of a model's provenance."""
_TWO_SIDED = 1.96  # quantile of the normal law for intervals of 95 %


@dataclass(frozen=True, kw_only=True)
class Reliance:
    """Assessment of a model with one output on held-out data.

    Parameters
    ----------
    status : ValidationStatus
        Joint result of the residual tests.
    failed : tuple of str
        Names of the tests that failed, such as ``ue``.
    gain_error : float or None
        Relative error of the free run's gain, positive if the recorded output swings more; None if unknown.
    gain_error_half_width : float or None
        Half width of the 95 % interval of the gain error; None if unknown.
    """

    status: ValidationStatus
    failed: tuple[str, ...] = ()
    gain_error: float | None = None
    gain_error_half_width: float | None = None

    @property
    def biased(self) -> bool:
        """True if the 95 % interval of the gain error excludes zero."""
        if self.gain_error is None or self.gain_error_half_width is None:
            return False
        return abs(self.gain_error) > self.gain_error_half_width

    @property
    def caveats(self) -> tuple[str, ...]:
        """Reasons not to rely on the model, one sentence each without a full stop."""
        found = []
        if self.status is ValidationStatus.DIVERGED:
            found.append("the model's free run diverged on held-out data")
        elif self.status is ValidationStatus.UNSTABLE:
            found.append("the model is unstable, so that its free run on held-out data says nothing")
        elif not self.status.ok:
            tests = f" ({', '.join(self.failed)})" if self.failed else ""
            found.append(
                f"the model failed its residual tests on held-out data{tests}: {_MEANING[self.status]}, and bands that "
                "come from the model alone do not cover it"
            )
        if self.biased and self.gain_error is not None and self.gain_error_half_width is not None:
            way = "more" if self.gain_error > 0 else "less"
            found.append(
                f"the model is biased: on held-out data the output swings {100 * abs(self.gain_error):.2g} ± "
                f"{100 * self.gain_error_half_width:.2g} % {way} than the model's free run"
            )
        return tuple(found)

    @property
    def provenance(self) -> dict[str, str]:
        """Entries for the provenance of a `NarxModel`."""
        kept = {STATUS_KEY: self.status.name.lower()}
        if self.failed:
            kept[FAILED_KEY] = "; ".join(self.failed)
        if self.gain_error is not None and self.gain_error_half_width is not None:
            kept[BIAS_KEY] = f"{self.gain_error:.6g} +- {self.gain_error_half_width:.6g}"
        return kept

    @classmethod
    def of_provenance(cls, provenance: Mapping[str, str]) -> Self | None:
        """Read the assessment from a model's provenance; None if there is none.

        Parameters
        ----------
        provenance : mapping of str to str
            Provenance of the model.

        Returns
        -------
        Reliance or None

        Raises
        ------
        ModelError
            If the entries cannot be read.
        """
        if (written := provenance.get(STATUS_KEY)) is None:
            return None
        try:
            status = ValidationStatus[written.upper()]
        except KeyError:
            known = ", ".join(status.name.lower() for status in ValidationStatus)
            raise ModelError(
                f"the model's provenance has {STATUS_KEY} = {written!r}: it must be one of {known}"
            ) from None
        failed = tuple(name for name in provenance.get(FAILED_KEY, "").split("; ") if name)
        error, width = _numbers(provenance.get(BIAS_KEY))
        return cls(status=status, failed=failed, gain_error=error, gain_error_half_width=width)


_MEANING = {
    ValidationStatus.STRUCTURE: "the residual depends on the input",
    ValidationStatus.NOISE: "the residual is predictable from its own past",
}


def assess_reliance(model: NarxModel, recordings: Sequence[Recording]) -> Reliance | None:
    """Assess a model on held-out recordings.

    Parameters
    ----------
    model : NarxModel
        Model with one output.
    recordings : sequence of Recording
        Recordings that were not used for the fit.

    Returns
    -------
    Reliance or None
        Assessment; None if the recordings are too short for the tests.

    Notes
    -----
    The gain error is the slope b of the regression ``y - y_s = a + b y_s`` on the free run y_s. Its variance allows for
    errors correlated in time: the autocovariance of the products of error and regressor is summed up to the first pair
    of lags with a negative sum (C. J. Geyer, Statistical Science 7 (1992) 473-483).
    """
    try:
        found = validate(model, recordings)
    except ModelError:
        return None
    names = tuple(dict.fromkeys(test.name for test in found.failed))
    if found.diverged or found.status is ValidationStatus.UNSTABLE or model.n_outputs != 1:
        return Reliance(status=found.status, failed=names)
    error, width = _gain_error([model.simulate(recording).outputs[0] for recording in recordings], recordings)
    return Reliance(status=found.status, failed=names, gain_error=error, gain_error_half_width=width)


def _gain_error(runs: Sequence[Array], recordings: Sequence[Recording]) -> tuple[float | None, float | None]:
    """The slope of the free-run error over the free run, and half of its 95 % interval."""
    swings = [run - run.mean() for run in runs]
    power = sum(float(swing @ swing) for swing in swings)
    scale = sum(float(np.sum(recording.outputs[0] ** 2)) for recording in recordings)
    if power <= np.finfo(np.float64).eps * scale:  # the model does not move: it has no gain
        return None, None
    errors = [recording.outputs[0] - run for recording, run in zip(recordings, runs, strict=True)]
    slope = sum(float(swing @ error) for swing, error in zip(swings, errors, strict=True)) / power
    products = [swing * (error - error.mean() - slope * swing) for swing, error in zip(swings, errors, strict=True)]
    variance = sum(_variance_of_sum(product) for product in products) / power**2
    return slope, _TWO_SIDED * math.sqrt(variance)


def _variance_of_sum(values: Array) -> float:
    """Variance of the sum of a correlated series about zero."""
    size = 1 << (2 * values.size - 1).bit_length()
    sums = np.fft.irfft(np.abs(np.fft.rfft(values, size)) ** 2, size)[: values.size]
    pairs = sums[: sums.size // 2 * 2].reshape(-1, 2).sum(axis=1)
    first_negative = int(np.argmax(np.append(pairs <= 0.0, True)))
    return max(2.0 * float(pairs[:first_negative].sum()) - float(sums[0]), float(sums[0]))


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

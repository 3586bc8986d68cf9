"""How far a model may be relied upon: what its residual tests said, and the gain error of its free run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.validate import Validation, ValidationStatus, validate
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

STATUS_KEY, FAILED_KEY, BIAS_KEY = "residual_tests", "residual_tests_failed", "free_run_gain_error"
"""Keys of a model's provenance."""


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

    @classmethod
    def of(cls, validation: Validation) -> Self:
        """Return the assessment that a validation contains.

        Parameters
        ----------
        validation : Validation
            Validation of the model on held-out recordings.
        """
        return cls(
            status=validation.status,
            failed=tuple(dict.fromkeys(test.name for test in validation.failed)),
            gain_error=validation.gain_error,
            gain_error_half_width=validation.gain_error_half_width,
        )

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

    """
    try:
        return Reliance.of(validate(model, recordings))
    except ModelError:
        return None


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

"""The verdict of a diagnosis and its causes, with their parameters in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from deatwin.ident.mismatch.thresholds import NEGLIGIBLE
from deatwin.plant.prefixes import prefixed
from deatwin.plant.records import OPTIONAL


class Verdict(Enum):
    """Conclusion of a diagnosis.

    ``NONE``: the recordings show no missing physics. ``PARAMETERS``: only parameters were wrong. ``NAMED``: one
    explanation was found. ``AMBIGUOUS``: several explanations remain possible. ``PARTLY``: the effects that were found
    explain only a part of the mismatch. ``UNKNOWN``: no effect of the catalogue explains the mismatch. ``DISTURBANCE``:
    the mismatch does not come from the plant. ``DATA_FAULT``: the recordings are faulty. ``NOT_TESTABLE``: the
    recordings could not show a mismatch.
    """

    NONE = "none"
    PARAMETERS = "parameters"
    NAMED = "named"
    AMBIGUOUS = "ambiguous"
    PARTLY = "partly"
    UNKNOWN = "unknown"
    DISTURBANCE = "disturbance"
    DATA_FAULT = "data_fault"
    NOT_TESTABLE = "not_testable"

    @property
    def advice(self) -> str:
        """Advice on what to do next."""
        return _ADVICE[self]

    @property
    def has_causes(self) -> bool:
        """True if the diagnosis reports effects as causes."""
        return self in (Verdict.NAMED, Verdict.AMBIGUOUS, Verdict.PARTLY)


_ADVICE: Mapping[Verdict, str] = {
    Verdict.NONE: (
        "use the calibrated model for inputs within the recorded range and frequencies; the report lists how large "
        "each effect could be and still remain undetected"
    ),
    Verdict.PARAMETERS: "use the calibrated model for inputs within the recorded range and frequencies",
    Verdict.NAMED: "use the amended model, model.json, with `deatwin simulate` or `deatwin check`",
    Verdict.AMBIGUOUS: "record a longer or richer input, and diagnose all recordings together",
    Verdict.PARTLY: "use the amended model, model.json, with care, because it still lacks something",
    Verdict.UNKNOWN: "check the readings for a fault at the times of the mismatch; if there is none, add the effect that you suspect",
    Verdict.DISTURBANCE: "find the source of the disturbance in the set-up; changing the model will not help",
    Verdict.DATA_FAULT: "repeat the recording, or delete its faulty rows and use `--allow-gaps`",
    Verdict.NOT_TESTABLE: "record a larger input, or one with more frequencies; `deatwin plan` says what an input would show",
}


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A parameter in a unit with a prefix, for a reader."""

    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Parameter with its 95 % interval.

    Parameters
    ----------
    value, low, high : float
        Estimate, and lower and upper end of its 95 % interval, SI.
    unit : str
        SI unit.
    """

    value: float
    low: float
    high: float
    unit: str

    @property
    def shown(self) -> Shown:
        """Return the same estimate and interval in a unit with a prefix, such as mm.

        The estimate decides the prefix. If the interval contains zero and is much larger than the estimate, the interval
        decides it, and an estimate below a thousandth of its width is shown as 0.
        """
        largest = max(self.high, -self.low)
        about_zero = self.low <= 0.0 <= self.high
        value = 0.0 if about_zero and abs(self.value) < NEGLIGIBLE * (self.high - self.low) else self.value
        size, unit = prefixed(largest if about_zero and 10.0 * abs(value) < largest else value, self.unit)
        return Shown(value=value / size, low=self.low / size, high=self.high / size, unit=unit)


@dataclass(frozen=True, kw_only=True)
class FittedParameter(Interval):
    """Parameter of the calibrated plant, with its 95 % interval.

    Parameters
    ----------
    value, low, high : float
        Estimate, and lower and upper end of its 95 % interval, SI.
    unit : str
        SI unit.
    nominal : float or None
        Value before the calibration, SI.
    at_bound : bool
        True if the estimate lies on a bound of its range.
    undetermined : bool
        True if the recordings do not determine the parameter: its interval is then the whole allowed range.
    """

    nominal: float | None = None
    at_bound: bool = False
    undetermined: bool = False


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Effect that explains a part of the mismatch, with its parameters and probability.

    Parameters
    ----------
    effect, family : str
        Canonical names of the effect and of its family.
    probability : float
        Probability that this effect is present, at most 0.95: the remaining 5 % are reserved for causes that were not
        tried.
    share_explained : float
        Share of the mismatch's power that the effect explains, from 0 to 1.
    parameters : mapping of str to Interval
        Parameters of the effect.
    place : str or None
        Place of the plant at which the effect acts. None if the effect has only one place, or if the recordings do not
        decide between several places.
    places : tuple of str or None
        Places at which the effect may act, if the recordings do not decide between them. The first one is used in
        `Diagnosis.model`.
    """

    effect: str
    family: str
    probability: float
    share_explained: float
    parameters: Mapping[str, Interval]
    place: str | None = field(default=None, metadata=OPTIONAL)
    places: tuple[str, ...] | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Explanation that the recordings do not rule out, with its probability.

    Parameters
    ----------
    effects : tuple of str
        Canonical names of its effects; empty for the plant without effects.
    probability : float
        Probability that these effects and no others are present, at most 0.95: the remaining 5 % are reserved for
        causes that were not tried.
    """

    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True, kw_only=True)
class CandidateSummary:
    """Summary of a candidate that was tried.

    Parameters
    ----------
    effects : tuple of str
        Names of its effects; empty for the base plant.
    fitted, unseen : float
        Rms residuals on fitted and on held-out data, SI.
    d2 : float or None
        Squared distance d² from the best explanation (`Distance`); None if it was not computed.
    """

    effects: tuple[str, ...]
    fitted: float
    unseen: float
    d2: float | None = None

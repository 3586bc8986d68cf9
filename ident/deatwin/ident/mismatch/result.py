"""Content of a diagnosis file: amplitudes in the unit that ``output`` names, parameters in SI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter

from deatwin.ident.mismatch.advise.offer import PricedReading
from deatwin.plant.datasets import variable
from deatwin.plant.prefixes import with_unit
from deatwin.plant.records import OPTIONAL, Json, key
from deatwin.plant.words import spaced


@dataclass(frozen=True, kw_only=True)
class Output:
    """Name of the reading, and the unit of its amplitudes."""

    name: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Rms residuals on one part of the data, without and with the effects found."""

    before: float
    after: float | None


LEAST_TOLD = 0.01
"""Smallest probability of an explanation that a sentence mentions; a smaller one would be shown as 0 %."""


@dataclass(frozen=True, kw_only=True)
class ReadingSummary:
    """Residuals of one of several readings, and the probabilities of explanations with and without this reading.

    Parameters
    ----------
    reading, unit : str
        Name of the signal, and its SI unit.
    noise : float
        Standard deviation of the reading's noise, in `unit`.
    fitted, unseen : Errors
        Rms residuals on fitted and on held-out data, without and with the effects found, in `unit`.
    with_it, without_it : mapping of str to float, or None
        Probabilities of the explanations, computed from all readings and from all readings except this one. None if
        there are fewer than two explanations.
    """

    reading: str
    unit: str
    noise: float
    fitted: Errors
    unseen: Errors
    with_it: Mapping[str, float] | None
    without_it: Mapping[str, float] | None

    @property
    def sentence(self) -> str:
        """Residuals of this reading and its influence on the explanation, in words."""
        before, after = with_unit(self.unseen.before, self.unit), self.unseen.after
        left = f"is {before} rms"
        if after is not None:
            left += f" without and {with_unit(after, self.unit)} rms with the explanation"
        said = f"{self.name}: the error on held-out data {left} (sensor noise: {with_unit(self.noise, self.unit)} rms)"
        if self.with_it is None or self.without_it is None:
            return said
        whole, without = _likely(self.with_it), _likely(self.without_it)
        if whole == without:
            return f"{said}; without this reading, the explanation would be the same: {whole}"
        return f"{said}; the likeliest explanation is {whole} with this reading, and {without} without it"

    @property
    def name(self) -> str:
        """Name of the signal for use in a sentence."""
        return spaced(self.reading)


def _likely(probabilities: Mapping[str, float]) -> str:
    """Write the explanations with a probability of at least 1 %, the likeliest first."""
    worth = {spaced(names): share for names, share in probabilities.items() if share >= LEAST_TOLD}
    return " or ".join(f"{names} ({100 * share:.0f} %)" for names, share in worth.items())


# Detection


@dataclass(frozen=True, kw_only=True)
class Statistic:
    """One group of statistics of the residual, with its p-value."""

    name: str
    value: float  # Largest of the group: a ratio of mean squares, a distance of periodograms, or a correlation
    where: str = ""  # Part of the data, frequency, or regressor at which it is found
    score: float | None = field(default=None, metadata=OPTIONAL)  # Standardised by its distribution under chance
    p_value: float  # Of this group alone


@dataclass(frozen=True, kw_only=True)
class Repeatability:
    """Similarity of the residual between repeats of a command."""

    correlation: float  # Of the residual with its repeat, each less its mean over the stretch
    # Covariance with the repeat over variance beyond noise: 1 if all that the plant lacks is repeatable, 0 if nothing
    # is; low and high are two standard deviations off
    share: float
    low: float
    high: float
    # Largest share that any deterministic model can explain: what the variance about the repeatable part leaves
    explainable: float


@dataclass(frozen=True, kw_only=True)
class OriginSummary:
    """Evidence that a residual belongs to the plant or to a disturbance."""

    by: str  # repeats, prediction, or nothing if neither was possible
    share: float  # Repeatable or predictable share of the rest; low and high are two standard deviations off
    low: float
    high: float
    left: float  # Rms of the rest: the residual without noise and without patterns that the plant's physics may cause
    conclusion: str  # plant, disturbance or undecided

    @classmethod
    def none(cls, left: float) -> OriginSummary:
        """Return undecided evidence; `left` is the rms of the residual beyond the noise."""
        return cls(by="nothing", share=0.0, low=0.0, high=1.0, left=left, conclusion="undecided")


@dataclass(frozen=True, kw_only=True)
class DetectionSummary:
    """Summary of the test for missing physics, and of the smallest detectable effects.

    Amplitudes are in the unit of `Diagnosis.output`.

    Parameters
    ----------
    p_value : float or None
        p-value of all statistics together, for the hypothesis that nothing is missing.
    excess : float or None
        Rms residual beyond the sensor noise: the larger of the values on fitted and on held-out data.
    practical : float or None
        Smallest `excess` that counts as missing physics.
    taken_up : bool or None
        True if a fit of the plant to all data, fitted and held-out, leaves no mismatch.
    moved : float or None
        Rms response of the simulated readings to the changes of the command.
    smallest_detectable : mapping of str to float or None
        For each effect, the rms change of the readings at which it is detected with a probability of 90 %. None if a
        refit of the parameters absorbs the effect completely.
    statistics : tuple of Statistic or None
        One result for each group of statistics of the residual: variance ratio, cumulative periodogram, correlation
        with the command, and correlation of the squared residual with the command.
    noise_source : str or None
        Source of the noise estimate.
    repeatability : Repeatability or None
        Similarity of the residual between repeats of a command; None if no command is repeated.
    origin : OriginSummary or None
        Evidence on whether the residual comes from the plant or from a disturbance.
    """

    p_value: float | None
    excess: float | None
    practical: float | None = field(default=None, metadata=OPTIONAL)
    taken_up: bool | None = field(default=None, metadata=OPTIONAL)
    moved: float | None = field(default=None, metadata=OPTIONAL)
    smallest_detectable: Mapping[str, float | None]
    statistics: tuple[Statistic, ...] | None = field(default=None, metadata=OPTIONAL)
    noise_source: str | None = field(default=None, metadata=OPTIONAL)
    repeatability: Repeatability | None = None
    origin: OriginSummary | None = None


# Verification


@dataclass(frozen=True, kw_only=True)
class Ablation:
    """Result of removing one effect and refitting the rest."""

    effect: str
    fitted: float = field(metadata=variable(unit=attrgetter("output_unit"), about="rms residual without the effect"))
    unseen: float = field(metadata=variable(unit=attrgetter("output_unit"), about="rms residual without the effect"))
    gain_low: float = field(
        metadata=variable(unit=attrgetter("output_unit"), about="lower 95 % bound of what the effect takes away")
    )
    share: float = field(metadata=variable(about="share of the mismatch's energy that returns"))  # from 0 to 1
    # True if the error certainly grows over all data, and on held-out data by more than the model error
    counts: bool = False

    @property
    def returns(self) -> bool:
        """Return whether the error certainly returns without the effect, also on held-out data."""
        # An effect that acts at a few steps occurs in too few blocks of held-out data to be certain from these alone.
        return self.gain_low > 0.0 or self.counts


@dataclass(frozen=True, kw_only=True)
class PlaceboSummary:
    """Gain of a placebo effect, relative to the effect itself."""

    effect: str
    kind: str = field(metadata=key("sham"))  # How it differs from the effect
    share: float | None
    expected: float | None  # Share that it would gain if the effect were the truth
    rejected: bool | None  # True if it explains less than the effect, as it should; None if it was skipped
    skipped: str  # Reason why it shows nothing; empty if it was judged


@dataclass(frozen=True, kw_only=True)
class TransferSummary:
    """Residuals without and with the effects found on one part of the held-out data."""

    part: str
    before: float | None  # Rms residuals
    after: float | None
    gain_low: float  # One-sided 95 % bound of the fall of the rms residual, like `gain_high`
    gain_high: float
    worse: bool  # True if the error certainly grows there, to more than noise and model error


@dataclass(frozen=True, kw_only=True)
class ConstancySummary:
    """Change of the strength of one effect over the fitted data."""

    effect: str
    own: float  # Share of the change's power that nothing else in the plant can cause
    change: float | None  # Relative to the fitted strength; None if it cannot be determined
    deviation: float | None
    mends: bool = False  # True if the explanation leaves too much, and the change would remove most of that
    holds: bool


@dataclass(frozen=True, kw_only=True)
class VerificationSummary:
    """Summary of the tests that `verify` applies to the best explanation.

    Parameters
    ----------
    holds : bool
        True if all tests are passed.
    failures : tuple of str
        Descriptions of the failed tests, as clauses.
    gain_low : float
        Lower 95 % bound of the decrease of the rms residual on held-out data, in the unit of `Diagnosis.output`.
    counts : bool or None
        True if the explanation is accepted even if `gain_low` is not positive. The mean square residual must then
        decrease significantly over all data. On held-out data, it must decrease by more than the square of the model
        error, and its excess over the noise variance must at least be halved.
    ablation : tuple of Ablation
        For each effect, the result when this effect is removed and all other parameters are refitted.
    shams : tuple of PlaceboSummary
        Results with placebo effects, one for each kind of placebo and each effect.
    transfer : tuple of TransferSummary
        Residuals without and with the explanation on parts of the held-out data: on each recording, if there are
        several, and on blocks with small, medium and large commands.
    constancy : tuple of ConstancySummary or None
        For each effect that is not an event, the change of its strength from the beginning to the end of the fitted
        data, in a fit that lets the strength vary.
    """

    holds: bool
    failures: tuple[str, ...]
    gain_low: float
    counts: bool | None = field(default=None, metadata=OPTIONAL)
    ablation: tuple[Ablation, ...]
    shams: tuple[PlaceboSummary, ...]
    transfer: tuple[TransferSummary, ...]
    constancy: tuple[ConstancySummary, ...] | None = field(default=None, metadata=OPTIONAL)


# Advice, free form, fit, faults and rig variants


@dataclass(frozen=True, kw_only=True)
class AdviceSummary:
    """Summary of the advice on the next experiment.

    Parameters
    ----------
    file : str or None
        Name of the file with the advised input; None if no input can distinguish the explanations.
    seconds : float or None
        Length of the input, s; None if there is no input.
    confusion_before, confusion_after : float or None
        Probability that the nearest wrong explanation fits better than the true one, before and after the experiment,
        averaged over the explanations. `confusion_after` is None if there is no input.
    waveform : str or None
        Description of the input; None if there is no input.
    added_mass_g : float or None
        Mass to add to the load before the experiment, g; None if none is needed.
    measure : str or None
        Signal to measure in addition, if the input alone cannot distinguish all explanations.
    undecided : tuple of str or None
        Explanations that the input cannot distinguish from at least one other explanation.
    log_odds : float or None
        Expected natural logarithm of the odds of the true explanation over the nearest other explanation, after an
        experiment with the best waveform and no additional reading.
    readings : tuple of PricedReading
        Additional readings that the rig could have, the most informative first.
    """

    file: str | None
    seconds: float | None
    confusion_before: float | None = field(default=None, metadata=OPTIONAL)
    confusion_after: float | None = None
    waveform: str | None = None
    added_mass_g: float | None = None
    measure: str | None = None
    undecided: tuple[str, ...] | None = field(default=None, metadata=OPTIONAL)
    log_odds: float | None = field(default=None, metadata=OPTIONAL)
    readings: tuple[PricedReading, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ShapeSummary:
    """A parameter of the shape of a term, SI."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class TermSummary:
    """One term of a free form, SI."""

    term: str  # In words
    coefficient: float
    unit: str
    shape: ShapeSummary | None = None
    inclusion: float  # Share of the resampled records that chose it


@dataclass(frozen=True, kw_only=True)
class FreeFormSummary:
    """Summary of a free form: a force that is estimated from the data and has no physical name.

    Parameters
    ----------
    place : str
        Place of the plant at which the force acts.
    signal : str or None
        Signal of the plant to which the force is added.
    terms : tuple of TermSummary
        Terms of the force, in SI units, the one with the largest contribution first.
    before, after : float
        Rms error on held-out data, without and with the free form, in the unit of `Diagnosis.output`.
    gain_low : float or None
        Lower 95 % bound of the decrease of the error from `before` to `after`, in the same unit.
    """

    place: str
    signal: str | None = field(default=None, metadata=OPTIONAL)
    terms: tuple[TermSummary, ...]
    before: float
    after: float
    gain_low: float | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class UnseenErrors(Errors):
    """Errors on the held-out data, with the lower 95 % bound of their decrease."""

    gain_low: float | None


@dataclass(frozen=True, kw_only=True)
class FitSummary:
    """Rms residuals of the first reading, without and with the effects found, in the unit of `Diagnosis.output`.

    Parameters
    ----------
    fitted : Errors
        Rms residuals on fitted data.
    unseen : UnseenErrors
        Rms residuals on held-out data, with the lower 95 % bound of their decrease. This bound is computed from all
        readings together.
    """

    fitted: Errors
    unseen: UnseenErrors


@dataclass(frozen=True, kw_only=True)
class IndistinguishablePair:
    """Two explanations that the recordings cannot distinguish."""

    effects: tuple[str, ...]
    d2: float  # Squared distance in units of the noise


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One kind of fault in a recording."""

    experiment: int  # Counted from 1
    recording: int  # Counted from 1
    file: str  # Name of the file, or times of the recording
    fault: str
    samples: int  # Number of faulty samples
    from_s: float
    to_s: float


@dataclass(frozen=True, kw_only=True)
class FormSummary:
    """An interpretation of the rig file, and the error that remains with it without any effect."""

    form: Mapping[str, Json]  # Fields that are interpreted otherwise than in the file, or about which it is silent
    fitted: float | None  # Rms residuals
    unseen: float | None

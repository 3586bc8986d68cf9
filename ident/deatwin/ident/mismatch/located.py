"""Summary of the location of a mismatch; amplitudes in the reported unit."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter

from deatwin.plant.datasets import variable
from deatwin.plant.prefixes import time_span
from deatwin.plant.records import OPTIONAL, key
from deatwin.plant.words import spaced


@dataclass(frozen=True, kw_only=True)
class Window:
    """A stretch of time."""

    from_s: float = field(metadata=variable(unit="s"))
    to_s: float = field(metadata=variable(unit="s"))
    score: float = field(metadata=variable(about="share of the mismatch's energy"))
    # 0 if it is not significant
    slope: float = field(default=0.0, metadata=variable(about="growth of the residual, SI per s"))


@dataclass(frozen=True, kw_only=True)
class Band:
    """A band of frequencies in which the spectrum exceeds the noise."""

    from_Hz: float = field(metadata=variable(unit="Hz"))
    to_Hz: float = field(metadata=variable(unit="Hz"))
    excess_dB: float = field(metadata=variable(unit="dB", about="mean power over that of the sensor's noise"))

    @property
    def power(self) -> float:
        """Power in the band, in proportion to the noise's density."""
        return float((self.to_Hz - self.from_Hz) * 10.0 ** (self.excess_dB / 10.0))


@dataclass(frozen=True, kw_only=True)
class LineGroup:
    """A group of lines of the residual's spectrum."""

    kind: str  # excited, odd or even (not excited), or varying: the part that changes from period to period, all lines
    # Rms of the residual on these lines without its varying part; of the last group, of that part
    rms: float = field(metadata=variable(about="what the residual holds there, SI"))
    p_value: float  # Of the hypothesis of no residual there; of the last group, of no more than white sensor noise
    lines: int = field(metadata=variable(about="how many"))


@dataclass(frozen=True, kw_only=True)
class LinesSummary:
    """The residual under a periodic input, by groups of lines."""

    period_s: float  # Period of the input
    periods: int  # Number of periods compared
    groups: tuple[LineGroup, ...]


@dataclass(frozen=True, kw_only=True)
class Region:
    """A range of an operating signal in which the residual's mean is not zero."""

    signal: str
    low: float = field(metadata=key("from"))  # Like `high`, in the signal's unit
    high: float = field(metadata=key("to"))
    mean_residual: float = field(metadata=variable(unit=attrgetter("unit")))


@dataclass(frozen=True, kw_only=True)
class PlaceSummary:
    """Share of the mismatch that the best effect at a place explains or, if none was tried, its signals predict."""

    place: str
    score: float  # Share of the mismatch, 0 to 1
    effect: str | None = field(default=None, metadata=OPTIONAL)  # Name of that effect; None if none was tried
    signal: str | None = field(default=None, metadata=OPTIONAL)
    # Gain by a wandering quantity at this place
    log_likelihood_gain: float | None = field(default=None, metadata=OPTIONAL)
    p_value: float | None = field(default=None, metadata=OPTIONAL)  # Of that gain
    # Share of the mismatch that the signals there predict on data to which this was not fitted, 0 to 1
    explained: float | None = field(default=None, metadata=OPTIONAL)
    among_best: bool | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True, kw_only=True)
class ResponseDifference:
    """An order and a band in which the recorded response differs from that of the plant."""

    order: int  # n of H_n
    from_Hz: float
    to_Hz: float
    p_value: float  # Of a difference no larger than the model error causes, corrected for the number of tests
    size: float  # Difference of the means over the band, divided by the plant's gain there


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Mismatch that remains with the effects found (`Diagnosis.causes`), and its location.

    Parameters
    ----------
    rms : float
        Rms residual of the plant with the effects found, beyond the sensor noise, over all data, in the unit of
        `Diagnosis.output`.
    mismatch : float
        The same quantity for the plant without these effects.
    share : float
        Ratio (rms / mismatch)², at most 1.
    fitted, unseen : float
        As `rms`, on fitted and on held-out data.
    time : Window or None
        Interval of time with the largest share of the remaining mismatch. None if the remaining mismatch extends over
        nearly the whole time.
    frequency : Band or None
        Frequency band in which the remaining mismatch has the most power; None if no band exceeds the noise.
    region : Region or None
        Range of an operating signal, such as the command or the reading, in which the mean of the remaining residual is
        largest. None if there is no such range.
    place : str or None
        Part of the plant whose signals predict the remaining mismatch best; None if no part predicts it.
    """

    rms: float
    mismatch: float
    share: float
    fitted: float
    unseen: float
    time: Window | None = None
    frequency: Band | None = None
    region: Region | None = None
    place: str | None = None


@dataclass(frozen=True, kw_only=True)
class ReadingLocation:
    """Location of the mismatch in a further reading, SI."""

    reading: str
    time: tuple[Window, ...]
    frequency: tuple[Band, ...]
    region: tuple[Region, ...]

    @property
    def sentence(self) -> str:
        """Return, in words, where most of the mismatch lies."""
        if not self.time and not self.frequency:
            return f"{spaced(self.reading)}: there is no mismatch beyond sensor noise"
        window = max(self.time, key=lambda one: one.score, default=None)
        band = max(self.frequency, key=lambda one: one.excess_dB, default=None)
        when = "" if window is None else f"from {time_span(window.from_s, window.to_s)}"
        where = "" if band is None else f"from {band.from_Hz:.3g} to {band.to_Hz:.3g} Hz"
        return f"{spaced(self.reading)}: the mismatch is largest {' and '.join(filter(None, (when, where)))}"


@dataclass(frozen=True, kw_only=True)
class LocationSummary:
    """Summary of the location of the mismatch. All fields except `readings` describe the first reading.

    Parameters
    ----------
    time : tuple of Window
        Intervals of time with a mismatch.
    period_s : float or None
        Period with which the mismatch repeats, s; None if the mismatch does not repeat.
    frequency : tuple of Band
        Frequency bands with a mismatch.
    lines : LinesSummary or None
        Residual under a periodic input: at the excited spectral lines, at the other odd and even lines, and its part
        that varies between periods. None if no recording is periodic.
    region : tuple of Region
        Ranges of operating signals, such as the command or the reading, in which the mean residual is not zero.
    place : tuple of PlaceSummary
        Parts of the plant at which effects or signals explain the mismatch, the best first.
    response : tuple of ResponseDifference, or None
        Orders and frequency bands in which the recorded frequency response differs from that of the plant; None if this
        could not be tested.
    readings : tuple of ReadingLocation or None
        Location in each reading other than the first; None if there is only one reading.
    """

    time: tuple[Window, ...]
    period_s: float | None = None
    frequency: tuple[Band, ...]
    lines: LinesSummary | None = None
    region: tuple[Region, ...]
    place: tuple[PlaceSummary, ...]
    response: tuple[ResponseDifference, ...] | None = None
    readings: tuple[ReadingLocation, ...] | None = field(default=None, metadata=OPTIONAL)

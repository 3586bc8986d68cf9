"""Compute mean and gain of a record in sliding windows, to find drift before any model is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.arguments import probability, real_number
from deatwin.plant.amplitudes import axis_label
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, attribute, coordinate, variable
from deatwin.plant.drawing import Axes, panels_or_new
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording, way_to_record

_BATCHES = 10  # batches per window: their scatter shows how many independent samples serial correlation leaves
_LEAST = 4  # least samples per batch
_UNCORRELATED = -0.2  # expected of ten independent observations about a straight line: -(sum of P[i, i+1]) / 8
_CORRELATED = 0.2  # correlation of neighbours above which more distant batches are correlated too
_MOST = 0.9  # largest correlation that is used, so that a band stays finite
_SAMPLES = 1 << 20  # samples in the batches that are processed together
_ROUNDING = 16 * np.finfo(float).eps  # share of a mean below which a deviation is rounding
_CHANCE = 0.01  # p-value below which a change counts as drift


class SlidingStatus(Enum):
    """Conclusion about drift of a recording, drawn from sliding windows.

    The value of each member is a message for the user.
    """

    STEADY = "neither mean nor gain changes by more than chance: constant parameters may suffice"
    DRIFTING = "mean or gain changes along the record: constant parameters do not suffice, so let them vary with time"
    SHORT = (
        "neighbouring tenths of a window are correlated, so the bands are too narrow and the changes may be "
        "due to chance: use longer windows"
    )
    STILL = "the input or the output is constant in nearly all windows, so it is unknown whether the gain changes"
    FEW = "the record contains a single window, which cannot show a change: use shorter windows"

    @property
    def ok(self) -> bool:
        """True if the windows can distinguish drift from random variation."""
        return self in (SlidingStatus.STEADY, SlidingStatus.DRIFTING)


@dataclass(frozen=True, kw_only=True, eq=False)
class SlidingStatistics(Described):
    """Mean and gain of a recording in sliding windows.

    Parameters
    ----------
    timepts : ndarray, shape (n_windows,)
        Middle of each window on the experiment's clock, s.
    window_s : float
        Length of a window, s.
    level : float
        Coverage probability of the bands in each window.
    mean, mean_low, mean_high : ndarray, shape (n_windows,)
        Mean of the output, and lower and upper end of its confidence band, in the output's unit.
    gain, gain_low, gain_high : ndarray, shape (n_windows,)
        Standard deviation of the output divided by that of the input, without the bias of a short window, and lower and
        upper end of its confidence band, in output units per input unit. NaN if the input or the output is constant.
    p_mean, p_gain : float
        p-values of the tests for drift of the mean and of the gain between windows that do not overlap. NaN with fewer
        than two such windows.
    mean_correlation, gain_correlation : float
        Correlation of the mean, and of the logarithm of the gain, between neighbouring tenths of a window. It widens
        the bands; it is near 0 if the windows are long enough.
    status : SlidingStatus
        Conclusion about drift.
    output_name, output_unit, input_unit : str
        Name of the output, and units of output and input, for the labels of plots; empty if unknown.
    """

    timepts: Array = field(metadata=coordinate("time", name="time", unit="s"))
    window_s: float = field(metadata=attribute())
    level: float = field(metadata=attribute())
    mean: Array = field(metadata=variable("time", unit=attrgetter("output_unit")))
    mean_low: Array = field(metadata=variable("time", unit=attrgetter("output_unit")))
    mean_high: Array = field(metadata=variable("time", unit=attrgetter("output_unit")))
    gain: Array = field(metadata=variable("time", unit=attrgetter("gain_unit")))
    gain_low: Array = field(metadata=variable("time", unit=attrgetter("gain_unit")))
    gain_high: Array = field(metadata=variable("time", unit=attrgetter("gain_unit")))
    p_mean: float = field(metadata=attribute())
    p_gain: float = field(metadata=attribute())
    mean_correlation: float
    gain_correlation: float
    status: SlidingStatus = field(metadata=attribute())
    output_name: str = "output"
    output_unit: str = ""
    input_unit: str = ""

    @property
    def gain_unit(self) -> str:
        """Unit of the gain; empty if the unit of either signal is empty."""
        return f"{self.output_unit}/{self.input_unit}" if self.output_unit and self.input_unit else ""

    def plot(self, axes: Sequence[Axes] | None = None) -> list[Axes]:
        """Draw mean and gain over time with their bands, on two `axes` or new ones; ModelError if fewer are given."""
        panels = panels_or_new(axes, 2, height=2.2, sharex=True)
        drawn = (
            (f"mean {self.output_name}", self.output_unit, self.mean, self.mean_low, self.mean_high, self.p_mean),
            ("gain", self.gain_unit, self.gain, self.gain_low, self.gain_high, self.p_gain),
        )
        for ax, (name, unit, values, low, high, p) in zip(panels, drawn, strict=True):
            (line,) = ax.plot(self.timepts, values, label=f"windows of {self.window_s:.4g} s")
            band = f"{100 * self.level:.4g} % band"
            ax.fill_between(self.timepts, low, high, color=line.get_color(), alpha=0.25, linewidth=0, label=band)
            ax.set_ylabel(axis_label(name, unit))
            ax.set_title(f"chance without drift: {p:.2g}", loc="right", fontsize="small")
        panels[0].legend(fontsize="small")
        panels[-1].set_xlabel("time (s)")
        return panels


def sliding_mean_and_gain(
    recording: Recording, window_s: float, *, step_s: float | None = None, level: float = 0.95
) -> SlidingStatistics:
    """Compute mean and gain of a recording in sliding windows, with confidence bands.

    The gain is the standard deviation of the output divided by that of the input. Noise and drift within a window
    increase the gain.

    Each window is divided into ten batches. The scatter of the batch means gives the standard error of the mean. A
    jackknife over the batches gives the standard error of the logarithm of the gain, and removes the bias that this
    logarithm has in a short window, which changes the gain by up to a few per cent. The bands use the t distribution
    with nine degrees of freedom. A correlation r between neighbouring batches, estimated from all windows, widens the
    bands by the factor sqrt((1 + r) / (1 - r)). An analysis of variance tests whether windows that do not overlap
    differ by more than random variation.

    Parameters
    ----------
    recording : Recording
        Recording of one input and one output.
    window_s : float
        Length of a window, s, rounded to a multiple of ten samples. A tenth of it should be longer than the memory of
        the system.
    step_s : float, optional
        Distance between successive windows, s; a quarter of the window by default.
    level : float
        Coverage probability of the bands in each window, between 0 and 1.

    Raises
    ------
    DataError
        If the recording does not have exactly one input and one output, the window has fewer than 40 samples or is
        longer than the recording, or the step is shorter than the sample time.
    ModelError
        If `window_s` or `step_s` is not a number, or `level` is not between 0 and 1.

    References
    ----------
    Schmeiser, "Batch size effects in the analysis of simulation output", Operations Research 30 (1982) 556-568.
    Miller, "The jackknife - a review", Biometrika 61 (1974) 1-15.
    """
    from scipy.stats import t

    if not isinstance(recording, Recording):
        raise DataError(f"a {type(recording).__name__} is not a recording: {way_to_record(recording)}")
    if recording.inputs.shape[0] != 1 or recording.outputs.shape[0] != 1:
        raise DataError(
            f"the recording has {recording.inputs.shape[0]} inputs and {recording.outputs.shape[0]} outputs; mean and "
            "gain are those of one input and one output"
        )
    level = probability(level)
    starts, length, apart = _windows(recording, window_s, step_s)
    mean, gain = _batches(recording, starts, length)
    half = float(t.ppf(0.5 + level / 2, _BATCHES - 1)) / np.sqrt(_BATCHES)
    middle, log_gain = mean.mean(axis=1), gain.mean(axis=1)
    correlations = _correlation(mean[::apart]), _correlation(gain[::apart])
    wider = [np.sqrt((1 + r) / (1 - r)) for r in correlations]
    far, wide = half * wider[0] * mean.std(axis=1, ddof=1), half * wider[1] * gain.std(axis=1, ddof=1)
    p_mean, p_gain = _chance(mean[::apart], wider[0]), _chance(gain[::apart], wider[1])
    return SlidingStatistics(
        timepts=recording.timepts[0] + (starts + (length - 1) / 2) * recording.sample_time,
        window_s=length * recording.sample_time,
        level=level,
        mean=middle,
        mean_low=middle - far,
        mean_high=middle + far,
        gain=np.exp(log_gain),
        gain_low=np.exp(log_gain - wide),
        gain_high=np.exp(log_gain + wide),
        p_mean=p_mean,
        p_gain=p_gain,
        mean_correlation=correlations[0],
        gain_correlation=correlations[1],
        status=_status(p_mean, p_gain, max(correlations), len(mean[::apart])),
        output_name=recording.output_names[0],
        output_unit=recording.output_units[0],
        input_unit=recording.input_units[0],
    )


def _windows(recording: Recording, window_s: float, step_s: float | None) -> tuple[NDArray[np.intp], int, int]:
    """Return the first samples of the windows, their length, and the step between windows that do not overlap."""
    sample_time, n = recording.sample_time, recording.n_samples
    window = real_number(window_s, "window_s")
    length = _BATCHES * round(window / sample_time / _BATCHES) if np.isfinite(window) else 0
    if not _BATCHES * _LEAST <= length <= n:
        raise DataError(
            f"window_s = {window_s}; it must lie between {_BATCHES * _LEAST * sample_time:g} s ({_BATCHES} batches of "
            f"{_LEAST} samples) and the record's {n * sample_time:g} s"
        )
    wanted = length // 4 if step_s is None else real_number(step_s, "step_s") / sample_time
    step = round(wanted) if np.isfinite(wanted) else 0
    if step < 1:
        raise DataError(f"step_s = {step_s}; it must be at least the sample time, {sample_time:g} s")
    return np.arange(0, n - length + 1, step), length, -(-length // step)


def _batches(recording: Recording, starts: NDArray[np.intp], length: int) -> tuple[Array, Array]:
    """Return batch means of the output and pseudo-values of the logarithmic gain, (n_windows, batches) each."""
    size = length // _BATCHES
    firsts, place = np.unique(starts[:, None] + size * np.arange(_BATCHES), return_inverse=True)
    place = place.reshape(len(starts), _BATCHES)  # overlapping windows share batches
    y, u = (_moments(signal[0], firsts, size)[:, place] for signal in (recording.outputs, recording.inputs))
    gain = 0.5 * (_log_variance(*y) - _log_variance(*u))
    return y[0], np.where(np.isfinite(gain), gain, np.nan)


def _moments(signal: Array, firsts: NDArray[np.intp], size: int) -> Array:
    """Return mean and variance of batches, shape (2, n_batches), computed in blocks to save memory."""
    batches, some = np.lib.stride_tricks.sliding_window_view(signal, size), max(1, _SAMPLES // size)
    parts = (batches[firsts[first : first + some]] for first in range(0, firsts.size, some))
    return np.concatenate([np.stack([part.mean(axis=1), part.var(axis=1)]) for part in parts], axis=1)


def _log_variance(mean: Array, variance: Array) -> Array:
    """Return jackknife pseudo-values of the logarithm of the variance, shape (n_windows, batches)."""
    # With l_i the logarithm without batch i, the pseudo-value is B l - (B - 1) l_i.
    off, others = mean - mean.mean(axis=1, keepdims=True), _BATCHES - 1
    squares = variance + off**2
    without = (squares.sum(axis=1, keepdims=True) - squares) / others - (off / others) ** 2
    rounding = (_ROUNDING * np.abs(mean).max(axis=1, keepdims=True)) ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.log(np.where(without > rounding, without, 0.0))
        return np.asarray(_BATCHES * np.log(squares.mean(axis=1, keepdims=True)) - others * left)


def _correlation(groups: Array) -> float:
    """Return the correlation of neighbouring observations about a straight line, over all groups; at least 0."""
    line = np.arange(_BATCHES) - (_BATCHES - 1) / 2
    known = groups[np.isfinite(groups).all(axis=1)]
    left = known - known.mean(axis=1, keepdims=True)
    left = left - np.outer(left @ line, line) / (line @ line)
    squares = float(np.sum(left**2))
    if not squares > 0:
        return 0.0
    return min(max(float(np.sum(left[:, 1:] * left[:, :-1])) / squares - _UNCORRELATED, 0.0), _MOST)


def _chance(groups: Array, wider: float) -> float:
    """Return the probability of group means that differ this much by chance, if each is ``wider`` than its scatter."""
    from scipy.stats import f

    known = groups[np.isfinite(groups).all(axis=1)]
    if len(known) < 2:
        return float("nan")
    within = float(known.var(axis=1, ddof=1).mean()) * wider**2
    between = _BATCHES * float(known.mean(axis=1).var(ddof=1))
    if within == 0:
        return float(between == 0)
    return float(f.sf(between / within, len(known) - 1, known.size - len(known)))


def _status(p_mean: float, p_gain: float, correlation: float, n_windows: int) -> SlidingStatus:
    if n_windows < 2:
        return SlidingStatus.FEW
    if correlation > max(_CORRELATED, 3.0 / np.sqrt(n_windows * _BATCHES)):  # large enough to matter, and not by chance
        return SlidingStatus.SHORT
    if np.nanmin([p_mean, p_gain, 1.0]) < _CHANCE:
        return SlidingStatus.DRIFTING
    return SlidingStatus.STILL if np.isnan(p_gain) else SlidingStatus.STEADY

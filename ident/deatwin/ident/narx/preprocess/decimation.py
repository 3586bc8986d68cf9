"""The sampling time for a NARX model, and decimation to it.

The first minimum of the output's linear or nonlinear correlation should lie at 10 to 20 samples (Billings and Aguirre,
Int. J. Bifurcation Chaos 5 (1995) 1541-1556, doi:10.1142/S0218127495001158). It is the scale of the strongest part; a
lightly damped mode or a fast time constant that moves the output less must keep its samples too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import ClassVar

import numpy as np

from deatwin.ident.arguments import whole_number
from deatwin.ident.narx.regression import Recordings, flatten, require_alike
from deatwin.ident.narx.response import lagged_products
from deatwin.plant.arguments import taking
from deatwin.plant.arrays import Array
from deatwin.plant.datasets import Described, Metadata, attribute, coordinate, status_of, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import DataError

_WANTED = (10, 20)  # wanted number of samples to the first minimum
_KEPT = 10  # Least samples in a period of the output's fastest part (Ljung, System Identification, 1999, section 13.7)
_SLIGHT = 1e-4  # Share of the output's variance that may be lost: less than a model leaves unexplained
# Standard deviations of white noise that the power above a frequency must exceed to be the plant's: 3 times 1.4, because
# the window makes neighbouring lines similar, plus 3.8, because the quietest quarter of 16 bands lies below their mean.

_SURE = 8.0


class SamplingStatus(Enum):
    """Assessment of the sampling time. The value of each member is a message for the user."""

    KEEP = "the sampling time is suitable: the first minimum lies at 10 to 20 samples"
    DECIMATE = "sampled faster than a NARX model needs: decimate by the factor"
    TOO_SLOW = "sampled slowly: the first minimum lies before 10 samples; below 5, dynamics are lost: sample faster"
    FAST_PART = "the sampling time is suitable: after decimation, the fastest part of the output would have fewer than 10 samples per period"
    NO_MINIMUM = (
        "the correlation functions reach neither a minimum nor zero at the lags that the record can show: "
        "give more lags or a longer record, or choose the factor by hand"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplingChoice(Described):
    """Correlation functions of the output and the decimation factor chosen from them.

    Parameters
    ----------
    linear : ndarray, shape (n_lags + 1,)
        Autocorrelation of y', the output minus its mean, at the lags 0, 1, ...; dimensionless.
    nonlinear : ndarray, shape (n_lags + 1,)
        Autocorrelation of the square y'^2, whose mean is subtracted first, at the same lags; dimensionless.
    linear_band, nonlinear_band : float
        Half width of the 95 % band about zero for each function (Bartlett's formula at large lags).
    sample_time : float
        Sample time of the recordings in s.
    highest : float
        Highest frequency of the output, in Hz. Above this frequency, the output has less than 1e-4 of its variance, or
        no more power than white noise at the level of the quietest quarter of the spectrum.
    linear_minimum, nonlinear_minimum : int or None
        Lag of the first minimum of each function, in samples; None if there is none. If neither function has a minimum,
        ``linear_minimum`` is the first lag at which the linear function lies within its band.
    factor : int
        Decimation factor: keep every ``factor``-th sample; 1 keeps all.
    status : SamplingStatus
        Assessment of the sampling time.
    """

    linear: Array = field(metadata=variable("lag", about="correlation of the output with itself"))
    nonlinear: Array = field(metadata=variable("lag", about="correlation of the squared output with itself"))
    linear_band: float = field(metadata=attribute())
    nonlinear_band: float = field(metadata=attribute())
    sample_time: float = field(metadata=attribute())
    highest: float = field(metadata=attribute())
    linear_minimum: int | None = field(metadata=attribute())
    nonlinear_minimum: int | None = field(metadata=attribute())
    factor: int = field(metadata=attribute())
    status: SamplingStatus = field(metadata=status_of())

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "lag": coordinate("lag", of=lambda choice: np.arange(choice.linear.size), unit="samples"),
        "lag_time": coordinate("lag", of=lambda choice: np.arange(choice.linear.size) * choice.sample_time, unit="s"),
    }

    @property
    def first_minimum(self) -> int | None:
        """Lag of the earlier of the two first minima, in samples; None if there is none."""
        return min((m for m in (self.linear_minimum, self.nonlinear_minimum) if m is not None), default=None)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw both correlation functions with their first minima, on `ax` or new axes."""
        axes = axes_or_new(ax)
        lags = self.sample_time * np.arange(self.linear.size)
        for values, band, minimum, label in (
            (self.linear, self.linear_band, self.linear_minimum, "linear, $y'$"),
            (self.nonlinear, self.nonlinear_band, self.nonlinear_minimum, "nonlinear, $(y'^2)'$"),
        ):
            (line,) = axes.plot(lags, values, label=label)
            axes.axhspan(-band, band, color=line.get_color(), alpha=0.12, linewidth=0)
            if minimum is not None:
                axes.plot(lags[minimum], values[minimum], "o", color=line.get_color())
        axes.set(xlabel="lag (s)", ylabel="correlation")
        axes.set_title(f"decimate by {self.factor}" if self.factor > 1 else "keep all samples", fontsize="medium")
        axes.legend()
        return axes


@taking(n_lags=partial(whole_number, least=0))
def choose_sampling(recordings: Recordings, *, n_lags: int | None = None) -> SamplingChoice:
    """Choose a decimation factor from two autocorrelations of the output.

    The linear autocorrelation is that of the output, and the nonlinear one is that of the square of the output's
    deviation from its mean. The earlier of their first minima should lie at a lag of 10 to 20 samples. If it lies
    later, the decimation factor is chosen so that the minimum moves to a lag near 15 samples. The factor is reduced if
    a period of the output's highest frequency would otherwise have fewer than 10 samples.

    A minimum counts only if the autocorrelation then rises by more than the half width of its 95 % band. If neither
    autocorrelation has such a minimum, as for a first-order plant or a short recording, the first lag at which the
    linear autocorrelation lies within its 95 % band about zero is used instead.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Recordings with one output and a common sample time.
    n_lags : int, optional
        Largest lag in samples; defaults to a quarter of the longest recording.

    Raises
    ------
    DataError
        If there are several outputs, the output or its square is constant, or `n_lags` is below 2 or not below the
        length of the longest recording.
    ModelError
        If the recordings differ in signals, units or sample time.
    """
    chosen = flatten(recordings)
    longest = max(record.n_samples for record in chosen)
    lags = longest // 4 if n_lags is None else n_lags
    if not 2 <= lags < longest:
        raise DataError(f"n_lags = {lags}; it must be at least 2 and less than the {longest} samples of a recording")
    if any(record.outputs.shape[0] != 1 for record in chosen):
        raise DataError("the sampling time is chosen by one output; give recordings of one output")
    require_alike(chosen)
    outputs = [record.outputs[0] for record in chosen]
    mean = float(np.concatenate(outputs).mean())
    linear = _correlation([y - mean for y in outputs], lags)
    power = float(np.mean(np.concatenate(outputs) ** 2)) - mean**2
    nonlinear = _correlation([(y - mean) ** 2 - power for y in outputs], lags)
    n = sum(y.size for y in outputs)
    bands = [1.96 * float(np.sqrt((1.0 + 2.0 * (values[1:] @ values[1:])) / n)) for values in (linear, nonlinear)]
    minima = _first_minimum(linear, bands[0]), _first_minimum(nonlinear, bands[1])
    if minima == (None, None):
        minima = next((lag for lag, value in enumerate(linear) if value <= bands[0]), None), None
    highest = max(_highest(y - mean) for y in outputs if np.ptp(y) > 0.0)
    factor, status = _factor(min((m for m in minima if m is not None), default=None), highest)
    return SamplingChoice(
        linear=linear,
        nonlinear=nonlinear,
        linear_band=bands[0],
        nonlinear_band=bands[1],
        sample_time=chosen[0].sample_time,
        highest=highest / chosen[0].sample_time,
        linear_minimum=minima[0],
        nonlinear_minimum=minima[1],
        factor=factor,
        status=status,
    )


def _factor(minimum: int | None, highest: float) -> tuple[int, SamplingStatus]:
    """Return factor and status from the first minimum, in samples, and the output's highest frequency."""
    low, high = _WANTED
    if minimum is None:
        return 1, SamplingStatus.NO_MINIMUM
    if minimum < low:
        return 1, SamplingStatus.TOO_SLOW
    if minimum <= high:
        return 1, SamplingStatus.KEEP
    factor = min(max(2, round(2 * minimum / (low + high))), int(1.0 / (_KEPT * highest)))
    return (factor, SamplingStatus.DECIMATE) if factor > 1 else (1, SamplingStatus.FAST_PART)


def _highest(y: Array) -> float:
    """Return the frequency, cycles per sample, above which a signal has negligible power; at most 0.5."""
    power = np.abs(np.fft.rfft((y - y.mean()) * np.hanning(y.size)))[1:] ** 2
    parts = np.array_split(power, min(16, power.size))
    floor = float(np.quantile([part.mean() for part in parts], 0.25))
    beyond = np.cumsum((power - floor)[::-1])[::-1]
    least = np.maximum(_SLIGHT * power.sum(), _SURE * floor * np.sqrt(np.arange(power.size, 0, -1)))
    return float((np.flatnonzero(beyond > least)[-1:] + 1).sum() or power.size) / y.size


def _correlation(signals: list[Array], lags: int) -> Array:
    """Return the correlation function at the lags 0 to ``lags``, over all records."""
    products = np.zeros(lags + 1)
    for x in signals:
        own = lagged_products(x)[: lags + 1]
        products[: own.size] += own
    if not products[0] > 0.0:
        raise DataError("the output, or its square, is constant: its correlation says nothing")
    return products / products[0]


def _first_minimum(values: Array, band: float) -> int | None:
    """Return the lag of the first minimum that a rise by more than the band follows; None without one."""
    lowest = 0
    for lag, value in enumerate(values):
        if value < values[lowest]:
            lowest = lag
        elif value > values[lowest] + band:
            return lowest
    return None

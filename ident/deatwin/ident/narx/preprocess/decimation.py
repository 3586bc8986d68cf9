"""The sampling time for a NARX model, and decimation to it.

Sampled too fast, neighbouring regressors are all but the same and the regression is ill-conditioned; sampled
too slowly, dynamics are lost. The first minimum of the linear and of the nonlinear correlation function of the
output gives the scale (Billings and Aguirre, Int. J. Bifurcation Chaos 5 (1995) 1541-1556,
doi:10.1142/S0218127495001158): the smaller of the two should lie at 10 to 20 samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.operating import read_only
from deatwin.ident.narx.preprocess.datasets import sampling_dataset
from deatwin.ident.narx.regression import Recordings, flatten
from deatwin.plant.drawing import axes_or_new
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["SamplingChoice", "SamplingStatus", "choose_sampling", "decimate", "removed_share"]

Array = NDArray[np.float64]
_WANTED = (10, 20)  # samples to the first minimum
_PASSED, _STOPPED, _ATTENUATION_DB = 0.8, 1.2, 60.0  # of the filter, edges relative to the new Nyquist frequency


class SamplingStatus(Enum):
    """Whether the sampling time suits; the value is the advice."""

    KEEP = "the sampling time suits: the first minimum lies at 20 samples or fewer, and at 10 or more"
    DECIMATE = "sampled faster than a NARX model needs: decimate by the factor"
    TOO_SLOW = "sampled slowly: the first minimum lies before 10 samples; below 5, dynamics are lost: sample faster"
    NO_MINIMUM = (
        "a correlation function falls without a minimum over the lags that the record can tell: "
        "give more lags or a longer record, or choose the factor by hand"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class SamplingChoice:
    """Correlation functions of the output and the decimation that they ask for.

    Parameters
    ----------
    linear : ndarray, shape (n_lags + 1,)
        Correlation of y', the output less its mean, with itself at the lags 0, 1, ...; dimensionless.
    nonlinear : ndarray, shape (n_lags + 1,)
        That of the square of y', less its own mean.
    linear_band, nonlinear_band : float
        By how much chance lets each function differ from zero, 95 % (Bartlett's formula at large lags).
    sample_time : float
        Of the recordings, s.
    linear_minimum, nonlinear_minimum : int or None
        Lags of their first minima in samples, None where there is none.
    factor : int
        Every so many samples are to be kept; 1 to keep all.
    status : SamplingStatus
        Whether the sampling time suits.
    """

    linear: Array
    nonlinear: Array
    linear_band: float
    nonlinear_band: float
    sample_time: float
    linear_minimum: int | None
    nonlinear_minimum: int | None
    factor: int
    status: SamplingStatus

    @property
    def first_minimum(self) -> int | None:
        """The smaller of the two lags in samples, tau_m."""
        return min((m for m in (self.linear_minimum, self.nonlinear_minimum) if m is not None), default=None)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw both correlation functions with their first minima.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; new axes otherwise.

        Returns
        -------
        matplotlib Axes
        """
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
        axes.set_xlabel("lag (s)")
        axes.set_ylabel("correlation")
        axes.set_title(f"decimate by {self.factor}" if self.factor > 1 else "keep all samples", fontsize="medium")
        axes.legend()
        return axes

    def to_xarray(self) -> Any:
        """Return both correlation functions as an `xarray.Dataset` over the lag."""
        return sampling_dataset(self)


def choose_sampling(recordings: Recordings, *, n_lags: int | None = None) -> SamplingChoice:
    """Choose a decimation factor by the linear and the nonlinear correlation function of the output.

    The factor brings the smaller of the two first minima to 15 samples, or as near as it can within 10 to 20. A
    minimum counts if the function rises after it by more than chance lets it.

    Parameters
    ----------
    recordings : Recording, Experiment, or several
        Of one output and one sample time.
    n_lags : int, optional
        Largest lag in samples; a quarter of the longest recording when not given.

    Returns
    -------
    SamplingChoice

    Raises
    ------
    DataError
        If there is not one output, it is constant, or the lags are too many.
    """
    chosen = flatten(recordings)
    longest = max(record.n_samples for record in chosen)
    lags = longest // 4 if n_lags is None else n_lags
    if not 2 <= lags < longest:
        raise DataError(f"n_lags = {lags}; it must be at least 2 and less than the {longest} samples of a recording")
    if any(record.outputs.shape[0] != 1 for record in chosen):
        raise DataError("the sampling time is chosen by one output; give recordings of one output")
    outputs = [record.outputs[0] for record in chosen]
    mean = float(np.concatenate(outputs).mean())
    linear = _correlation([y - mean for y in outputs], lags)
    power = float(np.mean(np.concatenate(outputs) ** 2)) - mean**2
    nonlinear = _correlation([(y - mean) ** 2 - power for y in outputs], lags)
    n = sum(y.size for y in outputs)
    bands = [1.96 * float(np.sqrt((1.0 + 2.0 * (values[1:] @ values[1:])) / n)) for values in (linear, nonlinear)]
    minima = _first_minimum(linear, bands[0]), _first_minimum(nonlinear, bands[1])
    factor, status = _factor(min((m for m in minima if m is not None), default=None))
    return SamplingChoice(
        linear=read_only(linear),
        nonlinear=read_only(nonlinear),
        linear_band=bands[0],
        nonlinear_band=bands[1],
        sample_time=chosen[0].sample_time,
        linear_minimum=minima[0],
        nonlinear_minimum=minima[1],
        factor=factor,
        status=status,
    )


def _factor(minimum: int | None) -> tuple[int, SamplingStatus]:
    low, high = _WANTED
    if minimum is None:
        return 1, SamplingStatus.NO_MINIMUM
    if minimum < low:
        return 1, SamplingStatus.TOO_SLOW
    if minimum <= high:
        return 1, SamplingStatus.KEEP
    return max(2, round(2 * minimum / (low + high))), SamplingStatus.DECIMATE


def _correlation(signals: list[Array], lags: int) -> Array:
    """Correlation function at the lags 0 to ``lags``, over all records."""
    products = np.zeros(lags + 1)
    for x in signals:
        size = 2 ** int(np.ceil(np.log2(2 * x.size)))
        own = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: min(lags + 1, x.size)]
        products[: own.size] += own
    if not products[0] > 0.0:
        raise DataError("the output, or its square, is constant: its correlation says nothing")
    return products / products[0]


def _first_minimum(values: Array, band: float) -> int | None:
    """Lag of the first minimum after which the function rises by more than the band, None if there is none."""
    lowest = 0
    for lag, value in enumerate(values):
        if value < values[lowest]:
            lowest = lag
        elif value > values[lowest] + band:
            return lowest
    return None


def decimate(recording: Recording, factor: int, *, reading: ReadingTime = ReadingTime.END_OF_HOLD) -> Recording:
    """Keep every so many samples, after a low-pass filter without phase on inputs, outputs and extras.

    Filtered alike, inputs and outputs of a linear system still obey it; of a nonlinear one only as far as
    little power is removed (see `removed_share`). A new row holds its input as long as ``factor`` old rows: its
    input is the filtered command at the middle of that time, and its reading is taken at the end (or the start)
    of it, as that of the old rows was. So the model of the new rows has the phase of the held system; its
    gain is that of a held input to the order ``(omega T)^2 / 24``. Samples to which the filter would have to be
    continued beyond the record are left out, about nine new ones at each end; the clock is kept.

    Parameters
    ----------
    recording : Recording
        Evenly sampled.
    factor : int
        Number of old samples for a new one, at least 1.
    reading : ReadingTime
        When, within its row, a reading is taken.

    Returns
    -------
    Recording
        With ``factor`` times the sample time; its provenance tells the factor.

    Raises
    ------
    DataError
        If the factor is not a positive integer, or the recording is shorter than the filter.
    """
    if not isinstance(factor, int | np.integer) or factor < 1:
        raise DataError(f"factor = {factor!r}; it must be an integer of at least 1")
    if factor == 1:
        return recording
    odd, held = _low_pass(factor, 0), _low_pass(factor, (factor - 1) % 2)
    half = odd.size // 2
    rows = np.arange(-(-half // factor) * factor, recording.n_samples - half - factor + 1, factor)
    if rows.size < 2:
        raise DataError(
            f"{recording.n_samples} samples are too few to decimate by {factor}: the filter alone is {odd.size} long"
        )
    last = factor - 1 if reading is ReadingTime.END_OF_HOLD else 0

    def read(signal: Array) -> Array:
        return _filtered(signal, odd, rows + last)

    # The middle of the hold is (factor - 1)/2 old rows after its first one: between two rows if factor is even,
    # which is where a filter of even length has its centre.
    inputs = [_filtered(u, held, rows + (factor - 1) // 2) for u in recording.inputs]
    n = rows.size
    return replace(
        recording,
        inputs=np.reshape(inputs, (len(recording.inputs), n)),
        outputs=np.reshape([read(y) for y in recording.outputs], (len(recording.outputs), n)),
        extras={name: read(values) for name, values in recording.extras.items()},
        sample_time=recording.sample_time * factor,
        start=recording.start + recording.sample_time * int(rows[0]),
        provenance={**recording.provenance, "decimated": f"by {factor}, from {recording.sample_time:g} s"},
    )


def removed_share(recording: Recording, factor: int) -> dict[str, float]:
    """Return the share of the variance of each signal that `decimate` removes, by the signal's name.

    What is removed of the input of a nonlinear system acts on, all the same, on its output.

    Parameters
    ----------
    recording : Recording
        Before decimation.
    factor : int
        Number of old samples for a new one, at least 2.

    Returns
    -------
    dict
        Between 0 and 1; 0 for a constant signal.
    """
    low_pass = _low_pass(factor, 0)
    half = low_pass.size // 2
    rows = np.arange(half, recording.n_samples - half)
    shares = {}
    names = recording.input_names + recording.output_names
    for name, signal in zip(names, (*recording.inputs, *recording.outputs), strict=True):
        total = float(np.var(signal[rows]))
        left = signal[rows] - _filtered(signal, low_pass, rows)
        shares[name] = float(np.var(left)) / total if total > 0.0 else 0.0
    return shares


def _low_pass(factor: int, between: int) -> Array:
    """Symmetric filter of gain 1 at zero frequency; of odd length, or of even length to fall between rows."""
    from scipy.signal import firwin, kaiserord

    taps, beta = kaiserord(_ATTENUATION_DB, (_STOPPED - _PASSED) / factor)
    size = taps + (taps + 1 + between) % 2
    return np.asarray(firwin(size, 1.0 / factor, window=("kaiser", beta)), dtype=np.float64)


def _filtered(signal: Array, low_pass: Array, rows: NDArray[np.intp]) -> Array:
    """The filtered signal at rows, or half a row after them for a filter of even length."""
    from scipy.signal import fftconvolve

    middle = (low_pass.size - 1) // 2
    smooth = fftconvolve(signal, low_pass, mode="valid")
    return np.asarray(smooth[rows - middle], dtype=np.float64)

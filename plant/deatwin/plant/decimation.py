"""Decimate recordings: a zero-phase low-pass filter, then a selection of rows."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arguments import instance, taking
from deatwin.plant.arrays import Array
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime, require_reading_time

_PASSED, _STOPPED, _ATTENUATION_DB = 0.8, 1.2, 60.0  # Edges of the filter, relative to the new Nyquist frequency


@taking(recording=instance(Recording, error=DataError))
def decimate(
    recording: Recording, factor: int, *, reading: ReadingTime = ReadingTime.END_OF_HOLD, means: Collection[str] = ()
) -> Recording:
    """Apply a zero-phase low-pass filter to all signals, then keep every ``factor``-th sample.

    A linear model stays valid, because inputs and outputs pass the same filter. A nonlinear model stays valid only if
    the filter removes little power (see `removed_share`).

    Each new sample covers ``factor`` old samples. The new input is the filtered command in the middle of the new
    sample. The new reading is the filtered reading at the end of the new sample, or at the start for
    ``START_OF_HOLD``. A model of the new samples therefore has the phase of the system with a held input. At the
    angular frequency omega, the relative gain error of the model is at most ``(omega T)^2 / 24``, where T is the new
    sample time.

    About nine new samples at each end are dropped, because the filter would extend beyond the recording. The times of
    the remaining samples do not change.

    Parameters
    ----------
    recording : Recording
        Evenly sampled recording.
    factor : int
        Number of old samples per new sample, at least 1.
    reading : ReadingTime
        Time within a sample at which the reading is taken. With ``MEAN_OVER_HOLD``, no filter is used: each new sample
        of every signal is the mean of ``factor`` old samples. Only old samples at the end that do not fill a new one
        are then dropped.
    means : collection of str
        Names of the outputs and further channels whose samples are means over the time since the previous reading, such
        as the ``current`` of a film. Their new samples are such means, too.

    Returns
    -------
    Recording
        Recording with ``factor`` times the sample time; the provenance states the factor.

    Raises
    ------
    DataError
        If `factor` is not a positive integer, `reading` is not a `ReadingTime`, `means` is text or names no output or
        further channel, the recording is shorter than the filter, or a channel to be filtered has missing values.
    """
    require_reading_time(reading, DataError)
    require_means(means, recording)
    _require_factor(factor, 1)
    if factor == 1:
        return recording
    if reading is ReadingTime.MEAN_OVER_HOLD:
        return _averaged(recording, int(factor))
    odd, held = _low_pass(factor, 0), _low_pass(factor, (factor - 1) % 2)
    half = odd.size // 2
    last = factor - 1 if reading is ReadingTime.END_OF_HOLD else 0
    # A mean over the new sample is the filtered mean in its middle, which for START_OF_HOLD lies before the row.
    early = factor // 2 if last == 0 and means else 0
    rows = np.arange(-(-(half + early) // factor) * factor, recording.n_samples - half - factor + 1, factor)
    _require_samples(recording, factor, rows, odd)
    for name, values in recording.extras.items():
        if np.isnan(values).any():
            raise DataError(
                f'the channel "{name}" has missing values, which no filter bridges: leave it out to resample'
            )

    def read(signal: Array, name: str) -> Array:
        if name in means:
            return _filtered(signal, held, rows - early if early else rows + (factor - 1) // 2)
        return _filtered(signal, odd, rows + last)

    # The middle of a hold is (factor - 1)/2 old rows after its first row. For an even factor that lies between two
    # rows, as does the centre of a filter of even length.
    inputs = [_filtered(u, held, rows + (factor - 1) // 2) for u in recording.inputs]
    n = rows.size
    return replace(
        recording,
        inputs=np.reshape(inputs, (len(recording.inputs), n)),
        outputs=np.reshape(list(map(read, recording.outputs, recording.output_names)), (len(recording.outputs), n)),
        extras={name: read(values, name) for name, values in recording.extras.items()},
        sample_time=recording.sample_time * factor,
        start=recording.start + recording.sample_time * int(rows[0]),
        provenance={**recording.provenance, "decimated": f"by {factor}, from {recording.sample_time:g} s"},
    )


def require_means(means: Collection[str], recording: Recording) -> None:
    """Raise DataError unless the names are a collection of outputs and further channels of a recording."""
    known = (*recording.output_names, *recording.extras)
    if isinstance(means, str) or not isinstance(means, Collection) or any(name not in known for name in means):
        raise DataError(
            f"means = {means!r}; give a list of names of outputs and further channels, which are {', '.join(known)}"
        )


def _require_factor(factor: object, least: int) -> None:
    if not isinstance(factor, int | np.integer) or factor < least:
        raise DataError(f"factor = {factor!r}; it must be an integer of at least {least}")


def _require_samples(recording: Recording, factor: int, rows: NDArray[np.intp], low_pass: Array) -> None:
    """Raise DataError unless two or more filtered rows remain."""
    if rows.size < 2:
        raise DataError(
            f"{recording.n_samples} samples are too few to decimate by {factor}: the filter alone is {low_pass.size} "
            "samples long"
        )


def _averaged(recording: Recording, factor: int) -> Recording:
    """Return the mean of all old rows within each new row."""
    n = recording.n_samples // factor
    if n < 2:
        raise DataError(
            f"{recording.n_samples} samples are too few to decimate by {factor}: a row of the result is the mean of so many, and it needs two"
        )

    def means(signals: Array) -> Array:
        return np.asarray(signals[..., : n * factor].reshape(*signals.shape[:-1], n, factor).mean(axis=-1))

    return replace(
        recording,
        inputs=means(recording.inputs),
        outputs=means(recording.outputs),
        extras={name: means(values) for name, values in recording.extras.items()},
        sample_time=recording.sample_time * factor,
        provenance={**recording.provenance, "decimated": f"means of {factor}, from {recording.sample_time:g} s"},
    )


@taking(recording=instance(Recording, error=DataError))
def removed_share(recording: Recording, factor: int) -> dict[str, float]:
    """Return the share of each signal's variance that `decimate` removes.

    A nonlinear system responds to the removed part of its input, too, but the decimated recording does not show this
    part.

    Parameters
    ----------
    recording : Recording
        Recording before decimation.
    factor : int
        Number of old samples per new sample, at least 2.

    Returns
    -------
    dict
        Removed share of the variance of each signal, by the signal's name; 0 for a constant signal.

    Raises
    ------
    DataError
        If `factor` is not an integer of at least 2, or the recording is shorter than the filter.
    """
    _require_factor(factor, 2)
    low_pass = _low_pass(factor, 0)
    half = low_pass.size // 2
    rows = np.arange(half, recording.n_samples - half)
    _require_samples(recording, factor, rows, low_pass)
    shares = {}
    names = recording.input_names + recording.output_names
    for name, signal in zip(names, (*recording.inputs, *recording.outputs), strict=True):
        total = float(np.var(signal[rows]))
        left = signal[rows] - _filtered(signal, low_pass, rows)
        shares[name] = float(np.var(left)) / total if total > 0.0 else 0.0
    return shares


def low_pass_gain(factor: int, frequencies: Array, reading: ReadingTime) -> Array:
    """Return the gain of the filter, or of the mean, in `decimate`; `frequencies` in cycles per new sample, 0 to 0.5."""
    if factor == 1:
        return np.ones_like(frequencies)
    taps = np.full(factor, 1.0 / factor) if reading is ReadingTime.MEAN_OVER_HOLD else _low_pass(factor, 0)
    lags = np.arange(taps.size) - taps.size // 2
    return np.asarray(np.abs(np.exp(-2j * np.pi * np.outer(frequencies / factor, lags)) @ taps))


def _low_pass(factor: int, between: int) -> Array:
    """Return a symmetric filter with gain 1 at zero frequency; its length is odd, or even if `between` is 1."""
    from scipy.signal import firwin, kaiserord

    taps, beta = kaiserord(_ATTENUATION_DB, (_STOPPED - _PASSED) / factor)
    size = taps + (taps + 1 + between) % 2
    return np.asarray(firwin(size, 1.0 / factor, window=("kaiser", beta)), dtype=np.float64)


def _filtered(signal: Array, low_pass: Array, rows: NDArray[np.intp]) -> Array:
    """Return the filtered signal at rows or, with a filter of even length, half a row after them."""
    from scipy.signal import fftconvolve

    middle = (low_pass.size - 1) // 2
    smooth = fftconvolve(signal, low_pass, mode="valid")
    return np.asarray(smooth[rows - middle], dtype=np.float64)

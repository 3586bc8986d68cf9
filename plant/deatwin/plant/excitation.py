"""Excitation signals: the commands of an experiment, held between samples."""

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError


def band_limited_noise(
    rng: np.random.Generator,
    duration: float,
    sample_time: float,
    mean: float = 2.4,
    variance: float = 0.36,
    band: float = 1.0,
    lower: float = 1.1,
    upper: float = 3.75,
) -> NDArray[np.float64]:
    """Return Gaussian noise from 0 Hz to a band limit about an operating point.

    In this order: white Gaussian noise is filtered (every line of its spectrum above `band`, and that at
    0 Hz, is zero), scaled to `variance` exactly, shifted by `mean`, and limited to `lower` and `upper`. The
    variance is hence that before the limits; clipping takes a little of it and puts a little power above the
    band. The defaults are the thesis' excitation.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of the noise.
    duration : float
        Length, s; rounded to whole samples.
    sample_time : float
        Time between two samples, s.
    mean : float
        Operating point, V.
    variance : float
        Variance before the limits, V².
    band : float
        Band limit, Hz; at most half the sample rate.
    lower, upper : float
        Limits, V.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If the duration is too short for one line in the band, the band lies above half the sample rate, the
        variance is negative, or the limits do not enclose the mean.

    References
    ----------
    W. R. Jacobs, "Identification and Frequency Response Analysis with Application to Soft Smart Actuators",
    University of Sheffield, chapter 2.
    """
    n = _sample_count(duration, sample_time)
    if not 0.0 < band <= 0.5 / sample_time:
        raise DataError(
            f"band {band:g} Hz: it must be above 0 and at most half the sample rate, {0.5 / sample_time:g} Hz"
        )
    if variance < 0.0 or not lower < mean < upper:
        raise DataError(
            f"variance {variance:g}, mean {mean:g}, limits {lower:g} and {upper:g}: need variance >= 0 "
            "and lower < mean < upper"
        )
    frequency = np.fft.rfftfreq(n, sample_time)
    inside = (frequency > 0.0) & (frequency <= band * (1.0 + 1e-12))
    if not inside.any():
        raise DataError(f"duration {duration:g} s: noise up to {band:g} Hz needs at least {1.0 / band:g} s")
    noise = np.fft.irfft(np.where(inside, np.fft.rfft(rng.standard_normal(n)), 0.0), n)
    noise *= np.sqrt(variance) / noise.std()
    return np.clip(mean + noise, lower, upper)


def random_holds(
    rng: np.random.Generator,
    duration: float,
    sample_time: float,
    lower: float,
    upper: float,
    shortest: float = 2.0,
    longest: float = 25.0,
) -> NDArray[np.float64]:
    """Return levels that are held for random times, both uniformly distributed.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of levels and times.
    duration : float
        Length, s; rounded to whole samples. The last hold ends with it and may be shorter than `shortest`.
    sample_time : float
        Time between two samples, s.
    lower, upper : float
        Range of the levels, V.
    shortest, longest : float
        Range of the holds, s; rounded to whole samples, at least one.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If a range is empty or the duration is shorter than a sample.
    """
    n = _sample_count(duration, sample_time)
    if not lower < upper or not 0.0 < shortest <= longest:
        raise DataError(
            f"levels {lower:g} to {upper:g} V, holds {shortest:g} to {longest:g} s: need lower < upper and "
            "0 < shortest <= longest"
        )
    command = np.empty(n)
    first = 0
    while first < n:
        hold = max(1, round(rng.uniform(shortest, longest) / sample_time))
        command[first : first + hold] = rng.uniform(lower, upper)
        first += hold
    return command


def _sample_count(duration: float, sample_time: float) -> int:
    """Return the whole number of samples in a duration."""
    n = round(duration / sample_time) if sample_time > 0.0 else 0
    if n < 1:
        raise DataError(f"duration {duration:g} s, sample time {sample_time:g} s: need at least one sample")
    return n

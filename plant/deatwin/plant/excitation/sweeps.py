"""Sines on a bias whose frequency changes."""

import math

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.errors import DataError
from deatwin.plant.excitation.samples import sample_count, with_numbers


@with_numbers
def linear_chirp(
    duration: float,
    sample_time: float,
    first: float = 5.0,
    last: float = 15.0,
    mean: float = 2.4,
    amplitude: float = 0.3,
) -> NDArray[np.float64]:
    """Return a bias plus a sine whose frequency changes linearly with time.

    The signal starts at the bias and rises first. By default, the frequency ends near the resonance of the diaphragm
    with its ball at 2.4 V. The frequency f of this resonance gives the sag of the diaphragm under the ball, g/(2πf)²
    with the gravity g, even if the sensor's zero is unknown.

    Parameters
    ----------
    duration : float
        Length, s; rounded to whole samples.
    sample_time : float
        Time between two samples, s.
    first, last : float
        Frequencies at the beginning and at the end, Hz; above 0 and at most half the sample rate.
    mean : float
        Bias, V.
    amplitude : float
        Amplitude of the sine, V.

    Returns
    -------
    (n,) array
        Commands, V, between ``mean - amplitude`` and ``mean + amplitude``.

    Raises
    ------
    DataError
        If the duration is shorter than a sample, a frequency is out of range, the amplitude is negative, or mean or
        amplitude is infinite.
    """
    t, end = _times(duration, sample_time, first, last, mean, amplitude)
    cycles = first * t + (last - first) * t**2 / (2.0 * end)
    return mean + amplitude * np.sin(2.0 * np.pi * cycles)


@with_numbers
def logarithmic_chirp(
    duration: float,
    sample_time: float,
    first: float = 0.1,
    last: float = 10.0,
    mean: float = 2.4,
    amplitude: float = 0.3,
) -> NDArray[np.float64]:
    """Return a bias plus a sine whose frequency changes exponentially with time.

    The signal starts at the bias and rises first. The frequency passes through every octave in the same time, so that
    slow and fast dynamics get equal shares of the experiment.

    Parameters
    ----------
    duration : float
        Length, s; rounded to whole samples.
    sample_time : float
        Time between two samples, s.
    first, last : float
        Frequencies at the beginning and at the end, Hz; above 0, at most half the sample rate, and not equal.
    mean : float
        Bias, V.
    amplitude : float
        Amplitude of the sine, V.

    Returns
    -------
    (n,) array
        Commands, V, between ``mean - amplitude`` and ``mean + amplitude``.

    Raises
    ------
    DataError
        If the duration is shorter than a sample, a frequency is out of range, the frequencies are equal, the
        amplitude is negative, or mean or amplitude is infinite.
    """
    t, end = _times(duration, sample_time, first, last, mean, amplitude)
    if first == last:
        raise DataError(f"frequencies {first:g} and {last:g} Hz: a logarithmic chirp needs two that differ")
    growth = math.log(last / first) / end
    cycles = first * np.expm1(growth * t) / growth
    return mean + amplitude * np.sin(2.0 * np.pi * cycles)


def _times(
    duration: float, sample_time: float, first: float, last: float, mean: float, amplitude: float
) -> tuple[NDArray[np.float64], float]:
    """Return the sampled times and the time at which the last frequency is reached."""
    n = sample_count("duration", duration, sample_time)
    highest = 0.5 / sample_time
    if not (0.0 < first <= highest and 0.0 < last <= highest):
        raise DataError(
            f"frequencies {first:g} and {last:g} Hz: they must be above 0 and at most half the sample rate, "
            f"{highest:g} Hz"
        )
    if not (0.0 <= amplitude < np.inf and np.isfinite(mean)):
        raise DataError(
            f"mean {mean:g} V, amplitude {amplitude:g} V: both must be finite, and the amplitude at least 0"
        )
    return np.arange(n, dtype=np.float64) * np.float64(sample_time), n * sample_time

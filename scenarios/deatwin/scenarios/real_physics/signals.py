"""Recorded signals: held inputs and derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["derivatives", "held"]

Array = NDArray[np.float64]


def held(values: Array) -> Array:
    """Held values that act on a plant like a band-limited input of which `values` are the samples.

    A held sample lags by half a sample and is weaker at high frequencies; both are undone below half the rate.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples of the input, which begins and ends at rest.

    Returns
    -------
    ndarray, shape (n,)
        In the same unit; each acts from its own sample to the next.
    """
    frequencies = np.fft.rfftfreq(values.size)
    spectrum = np.fft.rfft(values) * np.exp(1j * np.pi * frequencies) / np.sinc(frequencies)
    return np.fft.irfft(spectrum, values.size)


def derivatives(values: Array, sample_time: float, band: float) -> tuple[Array, Array, Array]:
    """A signal and its first two derivatives by the Fourier transform, up to a frequency.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Begins and ends alike.
    sample_time : float
        s.
    band : float
        Highest frequency that is kept, Hz.

    Returns
    -------
    tuple of ndarray, each of shape (n,)
        In the unit of `values`, then per s and per s².
    """
    frequencies = np.fft.rfftfreq(values.size, sample_time)
    spectrum, omega = np.fft.rfft(values) * (frequencies <= band), 2j * np.pi * frequencies
    first, second, third = (np.fft.irfft(spectrum * omega**order, values.size) for order in range(3))
    return first, second, third

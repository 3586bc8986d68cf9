"""Recorded signals: held inputs and derivatives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def held(values: Array) -> Array:
    """Return held values (n,) that act on a plant like the band-limited input with the samples `values` (n,)."""
    frequencies = np.fft.rfftfreq(values.size)
    spectrum = np.fft.rfft(values) * np.exp(1j * np.pi * frequencies) / np.sinc(frequencies)
    return np.fft.irfft(spectrum, values.size)


def derivatives(values: Array, sample_time: float, band: float) -> tuple[Array, Array, Array]:
    """A signal (n,) and its first two derivatives by the Fourier transform, up to `band`, Hz."""
    frequencies = np.fft.rfftfreq(values.size, sample_time)
    spectrum, omega = np.fft.rfft(values) * (frequencies <= band), 2j * np.pi * frequencies
    first, second, third = (np.fft.irfft(spectrum * omega**order, values.size) for order in range(3))
    return first, second, third

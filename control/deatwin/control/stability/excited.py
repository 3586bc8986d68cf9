"""The band that a recording excited."""

from __future__ import annotations

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording

__all__ = ["BAND_KEY", "excited_band"]

BAND_KEY = "excited_band_Hz"
"""Key of a model's provenance under which the band of its recording is found, Hz."""
_FEWEST = 64
_EXCITED_SHARE = 0.99  # of the input's power lies in the excited band


def excited_band(recording: Recording) -> float:
    """Frequency below which a recording's input has 99 % of its power.

    Parameters
    ----------
    recording : Recording
        Its first input counts, without mean and trend.

    Returns
    -------
    float
        Hz.

    Raises
    ------
    DataError
        If the input is constant, a ramp, or shorter than 64 samples.
    """
    command = recording.inputs[0]
    if not np.ptp(command) > 0.0:
        raise DataError("the input of the recording is constant: it excites nothing")
    if command.size < _FEWEST:
        raise DataError(f"a recording of {command.size} samples says nothing of a spectrum: {_FEWEST} are the least")
    # A trend, and ends that do not meet, would look like power at all frequencies.
    timepts = np.linspace(-1.0, 1.0, command.size)
    trend = np.polynomial.Polynomial.fit(timepts, command, 1)(timepts)
    left = command - trend
    if not np.abs(left).max() > 1e-9 * np.ptp(command):
        raise DataError("the input of the recording is a ramp: it excites nothing but the slowest motion")
    power = np.abs(np.fft.rfft(left * np.hanning(command.size))) ** 2
    line = int(np.searchsorted(np.cumsum(power), _EXCITED_SHARE * power.sum()))
    return line / recording.duration

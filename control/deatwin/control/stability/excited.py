"""The band that a recording excited."""

from __future__ import annotations

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording

__all__ = ["BAND_KEY", "excited_band"]

BAND_KEY = "excited_band_Hz"
"""Key of a model's provenance under which the band of its recording is found, Hz."""
_EXCITED_SHARE = 0.99  # of the input's power lies in the excited band


def excited_band(recording: Recording) -> float:
    """Frequency below which a recording's input has 99 % of its power.

    Parameters
    ----------
    recording : Recording
        Its first input counts, without its mean.

    Returns
    -------
    float
        Hz.

    Raises
    ------
    DataError
        If the input is constant.
    """
    command = recording.inputs[0] - recording.inputs[0].mean()
    if not np.ptp(command) > 0.0:
        raise DataError("the input of the recording is constant: it excites nothing")
    power = np.abs(np.fft.rfft(command)) ** 2
    line = int(np.searchsorted(np.cumsum(power), _EXCITED_SHARE * power.sum()))
    return line / recording.duration

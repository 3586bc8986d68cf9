"""The sensor's noise, as recordings show it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

__all__ = ["noise_floor"]

TOP_OF_SPECTRUM = 0.8
"""Share of the Nyquist frequency above which a residual is taken to be sensor noise."""
SHEET_TOLERANCE = 1.3


def noise_floor(residuals: Sequence[np.ndarray], sample_time: float, sheet: float) -> float:
    """Standard deviation of the sensor's noise: the data sheet's, unless the top of the spectrum says more.

    Parameters
    ----------
    residuals : sequence of ndarray
        Of a calibrated plant, one for each record, SI.
    sample_time : float
        s.
    sheet : float
        What the data sheet says, SI.

    Returns
    -------
    float
        SI. White noise of that strength has the spectrum seen above 80 % of the Nyquist frequency.
    """
    powers, weights = [], []
    for residual in residuals:
        segment = min(256, residual.size)
        frequency, density = welch(residual, 1 / sample_time, nperseg=segment)
        top = density[frequency >= TOP_OF_SPECTRUM * frequency[-1]]
        powers.append(np.median(top) * frequency[-1])
        weights.append(residual.size)
    seen = float(np.sqrt(np.average(powers, weights=weights)))
    return seen if seen > SHEET_TOLERANCE * sheet else sheet

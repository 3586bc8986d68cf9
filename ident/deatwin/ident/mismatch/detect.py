"""Is there a mismatch at all: significant, and larger than what the plant's own equations get wrong?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import welch

from deatwin.ident.mismatch.losses import block_losses, exceeds

__all__ = ["SIGNIFICANCE", "Detection", "detect", "noise_floor"]

SIGNIFICANCE = 0.01
BEYOND_DOUBT = 2.0
"""An excess this many times the model error is a mismatch whatever its scatter."""
TOP_OF_SPECTRUM = 0.8
"""Share of the Nyquist frequency above which a residual is taken to be sensor noise."""
SHEET_TOLERANCE = 1.3


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Whether a residual is more than noise and model error.

    Parameters
    ----------
    rms : float
        Of the residual, SI.
    noise, model_error : float
        Rms of sensor noise and of the plant's own error, SI.
    p_value : float
        Of the hypothesis that noise and model error account for the residual.
    """

    rms: float
    noise: float
    model_error: float
    p_value: float

    @property
    def excess(self) -> float:
        """Rms of what is not sensor noise, SI."""
        return float(np.sqrt(max(self.rms**2 - self.noise**2, 0.0)))

    @property
    def within_floor(self) -> bool:
        """Whether noise and model error account for the residual in size."""
        return self.rms**2 <= self.noise**2 + self.model_error**2

    @property
    def mismatch(self) -> bool:
        """Whether physics is missing: significant beyond noise *and* model error, or too large to doubt.

        A mismatch that comes in bursts scatters so much that no test of its mean is significant.
        """
        return self.p_value < SIGNIFICANCE or self.excess > BEYOND_DOUBT * self.model_error


def detect(residuals: np.ndarray, noise: float, model_error: float) -> Detection:
    """Test a residual against the floor of noise and model error.

    The floor carries the practical size: with many samples any model error is significant against noise alone.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Measured minus simulated, in order, SI.
    noise, model_error : float
        Rms of sensor noise and of the plant's own error, SI.

    Returns
    -------
    Detection
    """
    return Detection(
        rms=float(np.sqrt(np.mean(residuals**2))), noise=noise, model_error=model_error,
        p_value=exceeds(block_losses(residuals), noise**2 + model_error**2),
    )  # fmt: skip


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

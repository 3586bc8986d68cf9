"""Test whether a residual exceeds sensor noise and model error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch.losses import block_losses, exceeds
from deatwin.ident.mismatch.thresholds import PRACTICAL_SHARE, SIGNIFICANCE
from deatwin.plant.arrays import root_mean_square

BEYOND_DOUBT = 2.0
"""Multiple of the practical size above which an excess is a mismatch, however large its scatter."""


@dataclass(frozen=True, kw_only=True)
class Excess:
    """Test whether a residual is larger than noise and model error."""

    rms: float  # of the residual, SI
    noise: float  # rms, SI
    model_error: float  # rms, SI
    p_value: float  # of the hypothesis that noise and model error account for the residual

    @property
    def size(self) -> float:
        """Rms of the residual beyond the sensor noise, SI."""
        return beyond_noise(self.rms**2, self.noise)

    @property
    def practical(self) -> float:
        """Smallest excess that counts, SI."""
        return practical_size(self.noise, self.model_error)

    @property
    def within_error(self) -> bool:
        """Return whether the residual is no larger than noise and model error, with a margin of the noise's power."""
        return self.size <= self.practical

    @property
    def mismatch(self) -> bool:
        """Return whether physics is missing: the excess is significant, or too large to doubt."""
        # A mismatch that comes in bursts varies so much that no test of its mean is significant.
        return self.p_value < SIGNIFICANCE or self.size > BEYOND_DOUBT * self.practical


def beyond_noise(mean_square: float, noise: float) -> float:
    """Return the rms of a residual beyond the sensor noise, from its mean square; SI."""
    return float(np.sqrt(max(mean_square - noise**2, 0.0)))


def practical_size(noise: float, model_error: float) -> float:
    """Return the smallest rms excess that counts, from the rms of noise and of model error; all SI."""
    return max(model_error, float(np.sqrt(PRACTICAL_SHARE)) * noise)


def excess_of(residuals: np.ndarray, noise: float, model_error: float) -> Excess:
    """Test whether a residual, (n,), measured minus simulated in order, exceeds noise and model error; all SI."""
    # With many samples any model error is significant against noise alone, so the practical size counts, too.
    floor = noise**2 + practical_size(noise, model_error) ** 2
    return Excess(
        rms=root_mean_square(residuals),
        noise=noise,
        model_error=model_error,
        p_value=exceeds(block_losses(residuals), floor),
    )

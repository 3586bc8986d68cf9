"""What a sensor adds to a reading: coloured noise and rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    r"""White noise, first-order coloured noise and rounding.

    .. math:: r = \mathrm{round}_q(y + w + c), \qquad c_k = a\,c_{k-1} + \sqrt{1 - a^2}\,n_k
    """

    rms: float
    coloured: float  # Share of the variance of w + c that c has
    pole: float  # a, between 0 and 1
    step: float  # q, m

    @classmethod
    def drawn(cls, rng: np.random.Generator, rms: float) -> Self:
        """Noise of a given size, otherwise at random."""
        step = rms * rng.uniform(0.1, 1.0)
        return cls(rms=rms, coloured=rng.uniform(0.1, 0.5), pole=rng.uniform(0.3, 0.85), step=step)

    def added(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Readings as they are recorded. Shapes: `values` (n,); returns (n,)."""
        from scipy.signal import lfilter

        random = np.sqrt(self.rms**2 - self.step**2 / 12)
        white, pushes = rng.standard_normal((2, values.size))
        start = [self.pole * pushes[0]]  # stationary from the first sample on
        rest, _ = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], pushes[1:], zi=start)
        coloured = np.concatenate([pushes[:1], rest])
        noisy = values + random * (np.sqrt(1 - self.coloured) * white + np.sqrt(self.coloured) * coloured)
        return np.round(noisy / self.step) * self.step

"""What a sensor adds to a reading: coloured noise and rounding."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

__all__ = ["SensorNoise"]


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    r"""White noise, first-order coloured noise and rounding.

    .. math:: r = \mathrm{round}_q(y + w + c), \qquad c_k = a\,c_{k-1} + \sqrt{1 - a^2}\,n_k

    Parameters
    ----------
    rms : float
        Of all that is added, the rounding (:math:`q/\sqrt{12}`) included, m.
    coloured : float
        Share of the variance of w + c that c has.
    pole : float
        a, between 0 and 1.
    step : float
        q, m.
    """

    rms: float
    coloured: float
    pole: float
    step: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, rms: float) -> Self:
        """Noise of a given size, otherwise at random.

        Parameters
        ----------
        rng : numpy.random.Generator
            Source of its colour and rounding.
        rms : float
            m.

        Returns
        -------
        SensorNoise
        """
        step = rms * rng.uniform(0.1, 1.0)
        return cls(rms=rms, coloured=rng.uniform(0.1, 0.5), pole=rng.uniform(0.3, 0.85), step=step)

    def added(self, values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Readings as they are recorded.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Noise-free, m.
        rng : numpy.random.Generator
            Source of the noise.

        Returns
        -------
        ndarray, shape (n,)
            m.
        """
        from scipy.signal import lfilter

        random = np.sqrt(self.rms**2 - self.step**2 / 12)
        white, pushes = rng.standard_normal((2, values.size))
        start = [self.pole * pushes[0]]  # stationary from the first sample on
        rest, _ = lfilter([np.sqrt(1 - self.pole**2)], [1, -self.pole], pushes[1:], zi=start)
        coloured = np.concatenate([pushes[:1], rest])
        noisy = values + random * (np.sqrt(1 - self.coloured) * white + np.sqrt(self.coloured) * coloured)
        return np.round(noisy / self.step) * self.step

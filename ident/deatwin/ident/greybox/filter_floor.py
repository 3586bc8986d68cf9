"""Noise and model error that explain a residual if no physics is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.greybox.filter_linear import Linear


@dataclass(frozen=True, kw_only=True)
class Floor:
    """Noise and model error that explain a residual with nothing opened."""

    noise: float  # Standard deviation of the sensor's white noise, SI
    model_error: float = 0.0  # Rms of the plant's own error in the reading, SI
    memory: float = 1.0  # Correlation time of the model error, s

    @classmethod
    def of(cls, linears: Sequence[Linear], noise: float | None = None) -> Floor:
        """The floor of a plant: a static error moves as the motion does."""
        rig = linears[0].plant.rig
        memory = float(np.median([_correlation_time(linear) for linear in linears]))
        return cls(noise=rig.noise if noise is None else noise, model_error=rig.model_error, memory=memory)


def _correlation_time(linear: Linear) -> float:
    """Correlation time of the states, weighted by their contribution to the reading, s."""
    motion = sum(
        (np.abs(linear.rows[:, k]).mean() * linear.states[name] for k, name in enumerate(linear.state_names)),
        start=np.zeros(linear.residual.size),
    )
    motion = motion - motion.mean()
    if not motion.any():
        return linear.interval
    spectrum = np.abs(np.fft.rfft(motion, 2 * motion.size)) ** 2
    correlation = np.fft.irfft(spectrum)[: motion.size]
    return linear.interval * max(1, int(np.argmax(correlation < correlation[0] / np.e)))

"""Waveforms of the commands, by name."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    random_holds,
    random_phase_multisine,
    with_alternating_polarity,
)

RICH = ("noise", "fast_noise", "noise_and_holds", "multisine", "chirp", "stairs_and_noise", "both_polarities")
"""Each distinguishes mechanisms by itself; holds alone say little of what is fast."""


def commands(
    name: str, rng: np.random.Generator, seconds: float, sample_time: float, lower: float, upper: float
) -> np.ndarray:
    """Draw commands between two voltages, rounded as an output of 16 bit does. Shapes: returns (n,), V."""
    wave: np.ndarray = getattr(_Waves(rng=rng, seconds=seconds, step=sample_time, lower=lower, upper=upper), name)()
    return wave.round(4)


@dataclass(frozen=True, kw_only=True)
class _Waves:
    """Range and length of the commands; each waveform is a method that returns shape (n,), V."""

    rng: np.random.Generator
    seconds: float
    step: float  # s
    lower: float  # V
    upper: float  # V

    def noise(self, band: float = 1.0) -> np.ndarray:
        """The thesis' noise: mean and variance lie in the range as they do there."""
        span = self.upper - self.lower
        return band_limited_noise(
            self.rng,
            self.seconds,
            self.step,
            mean=self.lower + 0.49 * span,
            variance=(0.226 * span) ** 2,
            band=band,
            lower=self.lower,
            upper=self.upper,
        )

    def fast_noise(self) -> np.ndarray:
        return self.noise(band=5.0)

    def holds(self, shortest: float = 2.0, longest: float = 25.0) -> np.ndarray:
        ends = {"lower": self.lower, "upper": self.upper}
        return random_holds(self.rng, self.seconds, self.step, **ends, shortest=shortest, longest=longest)

    def multisine(self) -> np.ndarray:
        """Three periods of a multisine to 5 Hz."""
        period = self.step * round(self.seconds / 3 / self.step)
        lines = np.arange(1, int(5.0 * period))
        wave = random_phase_multisine(
            self.rng,
            period,
            self.step,
            lines,
            rms=0.2 * (self.upper - self.lower),
            mean=(self.lower + self.upper) / 2,
            amplitudes=lines**-0.5,
            periods=3,
            lower=-np.inf,
            upper=np.inf,
        )
        return self._of_length(np.clip(wave, self.lower, self.upper))

    def chirp(self) -> np.ndarray:
        """A quarter of noise, a quarter of a chirp through the ball's resonance, and both again."""
        span, parts = self.upper - self.lower, []
        for _ in range(2):
            parts.append(replace(self, seconds=self.seconds / 4).noise())
            last, middle = self.rng.uniform(12.0, 20.0), self.lower + self.rng.uniform(0.4, 0.6) * span
            sweep = {"first": 2.0, "last": last, "mean": middle, "amplitude": 0.15 * span}
            parts.append(linear_chirp(self.seconds / 4, self.step, **sweep))
        return self._of_length(np.concatenate(parts))

    def noise_and_holds(self) -> np.ndarray:
        half = replace(self, seconds=self.seconds / 2)
        return self._of_length(np.concatenate([half.fast_noise(), half.holds(shortest=1.0, longest=12.0)]))

    def stairs_and_noise(self) -> np.ndarray:
        """A staircase with a little noise on every step."""
        levels = self.rng.permutation(np.linspace(self.lower, self.upper, 8)[1:-1])
        stair = self._of_length(np.repeat(levels, round(self.seconds / 6 / self.step) + 1))
        size = {"mean": 0.0, "variance": (0.1 * (self.upper - self.lower)) ** 2, "band": 3.0}
        wobble = band_limited_noise(self.rng, self.seconds, self.step, **size, lower=-np.inf, upper=np.inf)
        return np.clip(stair + wobble, self.lower, self.upper)

    def both_polarities(self) -> np.ndarray:
        return with_alternating_polarity(self.noise(), self.step, self.rng.uniform(8.0, 15.0))

    def one_level(self) -> np.ndarray:
        """A constant level with a sine of a few hundredths of the range."""
        angle, span = 2 * np.pi * self.rng.uniform(0.3, 0.6) * self._times, self.upper - self.lower
        return self.lower + self.rng.uniform(0.5, 0.8) * span + 0.02 * span * np.sin(angle)

    @property
    def _times(self) -> np.ndarray:
        return self.step * np.arange(round(self.seconds / self.step))

    def _of_length(self, wave: np.ndarray) -> np.ndarray:
        """Cut the wave to its length, or hold its last value."""
        n = round(self.seconds / self.step)
        return np.pad(wave[:n], (0, max(n - wave.size, 0)), mode="edge")

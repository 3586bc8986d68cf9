"""Commands for the cases of the study, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    random_holds,
    random_phase_multisine,
    with_alternating_polarity,
)

Waveform = Callable[[np.random.Generator, float, float, float, float], np.ndarray]


def commands(
    name: str, rng: np.random.Generator, seconds: float, sample_time: float, lower: float, upper: float
) -> np.ndarray:
    """Commands of a kind within a range, as an output of 16 bit gives them. `lower, upper` range, V; returns (n,), V,
    each held for one sample.
    """
    return EXCITATIONS[name](rng, seconds, sample_time, lower, upper).round(4)


def _noise(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """The thesis' noise: mean and variance lie in the range as they do there."""
    mean, deviation = lower + 0.49 * (upper - lower), 0.226 * (upper - lower)
    return band_limited_noise(rng, seconds, step, mean=mean, variance=deviation**2, lower=lower, upper=upper)


def _fast_noise(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    mean, deviation = lower + 0.49 * (upper - lower), 0.226 * (upper - lower)
    return band_limited_noise(rng, seconds, step, mean=mean, variance=deviation**2, band=5.0, lower=lower, upper=upper)


def _holds(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    return random_holds(rng, seconds, step, lower=lower, upper=upper, shortest=2.0, longest=25.0)


def _short_holds(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    return random_holds(rng, seconds, step, lower=lower, upper=upper, shortest=1.0, longest=12.0)


def _multisine(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """Three periods of a multisine to 5 Hz."""
    period = step * round(seconds / 3 / step)
    lines = np.arange(1, int(5.0 * period))
    wave = random_phase_multisine(
        rng,
        period,
        step,
        lines,
        rms=0.2 * (upper - lower),
        mean=(lower + upper) / 2,
        amplitudes=lines**-0.5,
        periods=3,
        lower=-np.inf,
        upper=np.inf,
    )
    return _of_length(np.clip(wave, lower, upper), seconds, step)


def _chirp(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """A quarter noise, a quarter chirp through the ball's resonance, and the same again."""
    parts = [
        wave
        for _ in range(2)
        for wave in (
            _noise(rng, seconds / 4, step, lower, upper),
            linear_chirp(
                seconds / 4,
                step,
                first=2.0,
                last=rng.uniform(12.0, 20.0),
                mean=lower + rng.uniform(0.4, 0.6) * (upper - lower),
                amplitude=0.15 * (upper - lower),
            ),
        )
    ]
    return _of_length(np.concatenate(parts), seconds, step)


def _noise_and_holds(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    halves = [_fast_noise(rng, seconds / 2, step, lower, upper), _short_holds(rng, seconds / 2, step, lower, upper)]
    return _of_length(np.concatenate(halves), seconds, step)


def _stairs_and_noise(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """A staircase whose every stair bears a little noise."""
    stair = np.repeat(rng.permutation(np.linspace(lower, upper, 8)[1:-1]), round(seconds / 6 / step) + 1)
    wobble = band_limited_noise(
        rng, seconds, step, mean=0.0, variance=(0.1 * (upper - lower)) ** 2, band=3.0, lower=-np.inf, upper=np.inf
    )
    return np.clip(_of_length(stair, seconds, step) + wobble, lower, upper)


def _both_polarities(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    return with_alternating_polarity(_noise(rng, seconds, step, lower, upper), step, rng.uniform(8.0, 15.0))


def _slow_sine(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """A single slow sine over half the range."""
    time = step * np.arange(round(seconds / step))
    angle = 2 * np.pi * rng.uniform(0.15, 0.35) * time + rng.uniform(0, 2 * np.pi)
    return (lower + upper) / 2 + 0.25 * (upper - lower) * np.sin(angle)


def _one_level(rng: np.random.Generator, seconds: float, step: float, lower: float, upper: float) -> np.ndarray:
    """One level that is held, with a sine of a few hundredths of the range on it."""
    time = step * np.arange(round(seconds / step))
    angle = 2 * np.pi * rng.uniform(0.3, 0.6) * time
    return lower + rng.uniform(0.5, 0.8) * (upper - lower) + 0.02 * (upper - lower) * np.sin(angle)


def _of_length(wave: np.ndarray, seconds: float, step: float) -> np.ndarray:
    """Exactly so many samples: the last value is held, or the rest cut off."""
    n = round(seconds / step)
    return np.pad(wave[:n], (0, max(n - wave.size, 0)), mode="edge")


EXCITATIONS: Mapping[str, Waveform] = MappingProxyType(
    {
        "noise": _noise,
        "fast_noise": _fast_noise,
        "noise_and_holds": _noise_and_holds,
        "multisine": _multisine,
        "chirp": _chirp,
        "stairs_and_noise": _stairs_and_noise,
        "both_polarities": _both_polarities,
        "slow_sine": _slow_sine,
        "one_level": _one_level,
        "holds": _holds,
    }
)
"""``waveform(rng, seconds, sample_time, lower, upper)`` by name."""
POOR = ("slow_sine", "one_level")
RICH = tuple(name for name in EXCITATIONS if name not in (*POOR, "holds"))
"""Each tells mechanisms apart by itself; holds alone say little of what is fast."""

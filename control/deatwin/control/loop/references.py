"""References for a closed loop: steps with a smooth rise, sines, and several tones at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control.arguments import finite, generator, numbers, positive, taking, whole
from deatwin.control.errors import ControlError
from deatwin.plant.arrays import Array

LEVELS = (0.0, 1.0, 0.0, -1.0, 0.0)  # Levels of the step reference, in amplitudes; the loop closes at the first


@taking(centre=finite, amplitude=finite, plateau=whole(1), rise=whole(0))
def step_reference(centre: float, amplitude: float, plateau: int, rise: int = 0) -> Array:
    """Make a reference that steps from the centre up, back, down and back.

    Parameters
    ----------
    centre, amplitude : float
        Centre, and height of each step, in the output's unit.
    plateau : int
        Number of samples at each level, including the transition to it.
    rise : int
        Number of samples of each transition, along half a cosine; 0 for sharp steps.

    Returns
    -------
    ndarray, shape (5 * plateau,)
        Reference, in the output's unit; the first level is the centre.

    Raises
    ------
    ControlError
        If an argument has the wrong type or is not finite, or if `rise` is not less than `plateau`.

    Examples
    --------
    >>> step_reference(1.0, 0.5, 1).tolist()
    [1.0, 1.5, 1.0, 0.5, 1.0]
    >>> step_reference(0.0, 1.0, 3, rise=1)[2:6].round(6).tolist()
    [0.0, 0.5, 1.0, 1.0]
    """
    if rise >= plateau:
        raise ControlError(f"a rise of {rise} samples must be shorter than its level of {plateau}")
    share = np.ones(plateau)
    share[:rise] = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, rise + 1) / (rise + 1))
    before = (LEVELS[0], *LEVELS[:-1])
    levels = [low + (high - low) * share for low, high in zip(before, LEVELS, strict=True)]
    return np.asarray(centre + amplitude * np.concatenate(levels))


@taking(centre=finite, amplitude=finite, frequency_Hz=positive, sample_time=positive, periods=whole(1))
def sine_reference(centre: float, amplitude: float, frequency_Hz: float, sample_time: float, periods: int) -> Array:
    """Make a sine reference about an operating point.

    Parameters
    ----------
    centre, amplitude : float
        Centre and amplitude, in the output's unit.
    frequency_Hz : float
        Frequency, Hz.
    sample_time : float
        Sampling time, s.
    periods : int
        Number of periods. The length of the reference is rounded to whole samples.

    Returns
    -------
    ndarray, shape (n,)
        Reference, in the output's unit.

    Raises
    ------
    ControlError
        If an argument is invalid, or the frequency is not below half the sampling rate.
    """
    _below_nyquist(frequency_Hz, sample_time)
    count = round(periods / (frequency_Hz * sample_time))
    return np.asarray(centre + amplitude * np.sin(2 * np.pi * frequency_Hz * sample_time * np.arange(count)))


def _below_nyquist(frequency_Hz: float, sample_time: float) -> None:
    """Raise ControlError if samples cannot hold a frequency."""
    if frequency_Hz * sample_time >= 0.5:
        raise ControlError(
            f"a frequency of {frequency_Hz:g} Hz: it must be below half the sampling rate, {0.5 / sample_time:g} Hz"
        )


def _frequencies(value: Any, name: str) -> None:
    """Raise an error unless a value is one frequency or one list of frequencies."""
    numbers(value, name)
    given = np.asarray(value)
    if given.ndim > 1 or given.size == 0 or not np.all(np.isfinite(given) & (given > 0.0)):
        raise ControlError(f"{name} must be a list of one or more positive and finite numbers")


@taking(
    centre=finite, amplitude=finite, frequencies_Hz=_frequencies, sample_time=positive, count=whole(1), rng=generator
)
def tone_reference(
    centre: float, amplitude: float, frequencies_Hz: ArrayLike, sample_time: float, count: int, rng: np.random.Generator
) -> Array:
    """Make a sum of sines of equal amplitude and random phases, which starts smoothly at the centre.

    Parameters
    ----------
    centre : float
        Centre, in the output's unit.
    amplitude : float
        Largest distance from the centre, in the output's unit.
    frequencies_Hz : array_like, shape (m,)
        Frequencies of the sines, Hz.
    sample_time : float
        Sampling time, s.
    count : int
        Number of samples.
    rng : numpy.random.Generator
        Random generator for the phases.

    Returns
    -------
    ndarray, shape (count,)
        Reference, in the output's unit. The amplitude grows from zero over the first period of the slowest sine.

    Raises
    ------
    ControlError
        If an argument is invalid, or a frequency is not below half the sampling rate.
    """
    frequencies = np.atleast_1d(np.asarray(frequencies_Hz, dtype=np.float64))
    _below_nyquist(frequencies.max(), sample_time)
    timepts = sample_time * np.arange(count)
    phases = rng.uniform(0.0, 2 * np.pi, frequencies.size)
    tones = np.sin(2 * np.pi * np.outer(frequencies, timepts) + phases[:, None]).sum(axis=0)
    tones *= amplitude / np.abs(tones).max()
    grown = np.clip(timepts * frequencies.min(), 0.0, 1.0)
    return np.asarray(centre + tones * (0.5 - 0.5 * np.cos(np.pi * grown)))

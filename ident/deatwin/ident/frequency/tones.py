"""Measure the first-order frequency response of a plant in simulation, by tones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

PERIODS = 3  # Periods of the lowest tone; the first ones let the plant settle


def tone_response(
    plant: Plant, frequency_Hz: Sequence[float], size: float, operating_input: float
) -> NDArray[np.complex128]:
    """Measure the response (n_frequencies,) to tones of both signs, so that even orders cancel."""
    step = plant.rig.sample_time
    n = round(1 / frequency_Hz[0] / step)
    lines = np.round(np.array(frequency_Hz) * n * step).astype(int)
    phases = np.arange(lines.size)[:, None] ** 2  # keeps the peaks of the tones apart
    period = np.cos(2 * np.pi * np.outer(lines, np.arange(n)) / n + phases).sum(axis=0)
    period *= size / np.abs(period).max()

    def answer(sign: int) -> NDArray[np.complex128]:
        commands = operating_input + np.tile(sign * period, PERIODS)
        record = Recording.from_arrays(commands, np.zeros_like(commands), step)
        run = plant.simulate(Experiment(recordings=(record,))).require().outputs[-1][0, -n:]
        return np.asarray(np.fft.rfft(run)[lines])

    return np.asarray((answer(1) - answer(-1)) / 2 / np.fft.rfft(period)[lines])

"""The frequency response of a film that is known, beside those of models identified from its recording.

The fleet is simulated, so that an actuator can be asked what no experiment tells: how its film answers to a small
command without hysteresis, and how hysteresis changes that with the size of the command.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, gfrf
from deatwin.ident.narx.fleet.alike import OPERATING_INPUT, Alike, Fleet, fit
from deatwin.ident.narx.fleet.records import FILM, STEADY, as_variant
from deatwin.ident.narx.refine import refine
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FREQUENCIES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Of the tones, Hz."""
SMALL, LARGE = 0.02, 0.3
"""Largest deviation from the operating input, V."""
PERIODS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Anchor:
    """First-order responses of one actuator at the operating input."""

    name: str
    frequency_Hz: Array  # shape (n,): Of the tones
    film: Complex  # shape (n,): Of the bare film for small commands, m/V
    small: Complex  # shape (n,): With hysteresis, for small and for large commands, m/V
    large: Complex
    least_squares: FrequencyResponse
    refined: FrequencyResponse
    recorded: FrequencyResponse  # H_1 of the actuator's model

    def error(self, response: FrequencyResponse) -> float:
        """Largest error of a gain against that of the bare film, relative."""
        gain = np.abs(self.film)
        return float(np.abs(response.gain / gain - 1).max())


def anchor(alike: Alike, fleet: Fleet, frequency_Hz: tuple[float, ...] = FREQUENCIES) -> Anchor:
    """Ask an actuator for its own response."""
    film, gripped = (as_variant(alike.prepared.actuator, variant).plant for variant in (FILM, STEADY))
    record, omega = alike.whole(FILM), 2 * np.pi * np.array(frequency_Hz)
    found = fit(fleet.structure, record)
    models = {"least_squares": found, "refined": refine(found, record), "recorded": alike.model}
    return Anchor(
        name=alike.name,
        frequency_Hz=np.array(frequency_Hz),
        film=_response(film, frequency_Hz, SMALL),
        small=_response(gripped, frequency_Hz, SMALL),
        large=_response(gripped, frequency_Hz, LARGE),
        **{name: gfrf(model, 1, omega, operating_input=OPERATING_INPUT) for name, model in models.items()},
    )


def _response(plant: Plant, frequency_Hz: tuple[float, ...], size: float) -> Complex:
    """By tones of either sign, so that even orders cancel; the first periods let the film settle."""
    step = plant.rig.sample_time
    n = round(1 / frequency_Hz[0] / step)
    lines = np.round(np.array(frequency_Hz) * n * step).astype(int)
    phases = np.arange(lines.size)[:, None] ** 2  # so that the tones do not meet
    period = np.cos(2 * np.pi * np.outer(lines, np.arange(n)) / n + phases).sum(axis=0)
    period *= size / np.abs(period).max()
    spectra = [np.fft.rfft(_last(plant, sign * period))[lines] for sign in (1, -1)]
    return np.asarray((spectra[0] - spectra[1]) / 2 / np.fft.rfft(period)[lines])


def _last(plant: Plant, period: Array) -> Array:
    """The last period of displacement."""
    commands = OPERATING_INPUT + np.tile(period, PERIODS)
    record = Recording.from_arrays(commands, np.zeros_like(commands), plant.rig.sample_time)
    return plant.simulate(Experiment(recordings=(record,))).require().outputs[-1][0, -period.size :]

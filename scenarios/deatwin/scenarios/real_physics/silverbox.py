"""The Silverbox: a circuit that oscillates like a mass on a hardening spring, taken as a linear oscillator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.sizes import Sizes
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.rigs.base import ReadingTime, Rig, StartProcedure

__all__ = ["RATE", "LinearOscillator", "held"]

RATE = 1e7 / 2**14
"""Hz."""


@dataclass(frozen=True, kw_only=True)
class LinearOscillator(Rig):
    """A mass between a spring and a damper, in volts: what the circuit is without its cubic term."""

    sample_time: float = 1 / RATE
    noise: float = 0.0
    reading: ReadingTime = ReadingTime.START_OF_HOLD

    kind: ClassVar[str] = "silverbox"
    input_name: ClassVar[str] = "input"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "output"
    output_unit: ClassVar[str] = "V"
    model_share: ClassVar[float] = 0.02
    sizes: ClassVar[Sizes] = Sizes(
        motion=0.1, force=2e4, period=1 / 70, command=0.1, motion_unit="V", force_unit="V/s2", body="mass"
    )

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="gain", value=1e5, unit="1/s2", lower=1e3, upper=1e7, scale=log),
            Parameter(name="damping", value=50.0, unit="1/s", lower=1.0, upper=1e4, scale=log),
            Parameter(name="stiffness", value=2e5, unit="1/s2", lower=1e4, upper=1e7, scale=log),
            Parameter(name="zero", value=0.0, unit="V", lower=-0.1, upper=0.1),
        )

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=0.1))
        velocity = build.watch("velocity", build.state("velocity", scale=40.0))
        force = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        drive = build.parameter("gain") * build.place(Place.DRIVE, "command", build.command)
        build.rate(position, velocity)
        build.rate(velocity, drive - build.parameter("stiffness") * position + force)
        return build.place(Place.SENSOR, "reading", position + build.parameter("zero"))


def held(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Held values that act on a plant like a band-limited input of which `values` are the samples.

    A held sample lags by half a sample and is weaker at high frequencies; both are undone below half the rate.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Samples of the input, which begins and ends at rest.

    Returns
    -------
    ndarray, shape (n,)
        In the same unit; each acts from its own sample to the next.
    """
    frequencies = np.fft.rfftfreq(values.size)
    spectrum = np.fft.rfft(values) * np.exp(1j * np.pi * frequencies) / np.sinc(frequencies)
    return np.fft.irfft(spectrum, values.size)

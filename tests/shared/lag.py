"""A first-order lag, and what it and its means read in closed form under held commands."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from made_rigs import Bare

from deatwin.plant import Builder, Parameter, Place, ReadingTime, Sizes

GAIN, TIME, HOLD = 2.0, 0.08, 0.05


@dataclass(frozen=True, kw_only=True)
class Lag(Bare):
    """A tank with an outlet."""

    sample_time: float = HOLD
    noise: float = 1e-3
    reading: ReadingTime = ReadingTime.MEAN_OVER_HOLD
    kind: ClassVar[str] = "lag"
    output_name: ClassVar[str] = "level"
    output_unit: ClassVar[str] = "1"
    sizes: ClassVar[Sizes] = Sizes(motion=1.0, force=1.0, period=0.3, command=1.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=GAIN, unit="1", lower=0.1, upper=10.0),
            Parameter(name="time", value=TIME, unit="s", lower=1e-3, upper=10.0),
        )

    def write(self, build: Builder) -> Any:
        level = build.watch("displacement", build.state("level", scale=1.0))
        command = build.place(Place.DRIVE, "command", build.command)
        build.rate(level, build.parameter("gain") * command - level, mass=build.parameter("time"))
        return build.place(Place.SENSOR, "reading", level)


def level(
    times: np.ndarray, command: np.ndarray, gain: float, time: float, hold: float
) -> tuple[np.ndarray, np.ndarray]:
    """The exact level at any times, and its rate, under commands each held for `hold` from rest at 0 on."""
    starts = [0.0]
    for end in gain * command:
        starts.append(end + (starts[-1] - end) * np.exp(-hold / time))
    sample = np.ceil(times / hold - 1e-9).astype(int) - 1  # a level at the end of a sample belongs to it
    inside = np.clip(sample, 0, command.size - 1)
    away = (np.array(starts)[inside] - gain * command[inside]) * np.exp(-(times - hold * inside) / time)
    moving = sample >= 0
    return np.where(moving, gain * command[inside] + away, 0.0), np.where(moving, -away / time, 0.0)


def mean(command: np.ndarray, gain: float, time: float, hold: float = HOLD) -> np.ndarray:
    """The exact means, and that of an exponential in each of them."""
    level, found = 0.0, []
    for end in gain * command:
        away = (level - end) * np.exp(-hold / time)
        found.append(end + (level - end - away) * time / hold)
        level = end + away
    return np.array(found)

"""A bare chain of drive and sensor, so that an effect there can be compared with a closed form."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare
from runs import simulation

from deatwin.plant import Effect, Parameter, Plant
from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.film import Film, FilmPoint


@dataclass(frozen=True, kw_only=True)
class Chain(Bare):
    """All nodes of drive and sensor; a film of one point whose capacitance swells with the squared command.

    The swelling s follows ``0.1 s * ds/dt = (u / 3 V)² - s``; the capacitance is ``(1 + s)`` nF; the reading is
    0.1 mm a volt of command.
    """

    kind: ClassVar[str] = "chain"
    follows_at_once: ClassVar[bool] = True
    signals: ClassVar[tuple[str, ...]] = ("amplifier_voltage", "film_voltage", "field_voltage")
    volume: ClassVar[float] = 4e-8
    thickness: ClassVar[float] = 0.5e-3
    stretches: ClassVar[tuple[float, float]] = (3.5, 4.0)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=800.0, unit="V/V", lower=1.0, upper=1e4),
            Parameter(name="thickness", value=self.thickness, unit="m", lower=1e-6, upper=1.0, known=True),
        )

    def write(self, build: Builder) -> Any:
        swelling = build.state("swelling", scale=1.0)
        build.rate(swelling, (build.command / 3) ** 2 - swelling, mass=0.1)
        build.watch("capacitance", 1e-9 * (1 + swelling))
        point = FilmPoint(volume=self.volume, stretches=self.stretches, radius=0.5)
        film = Film(points=[point], elastic=0.0, relaxed=lambda xi: [(xi, xi)], prestretches=(1.0, 1.0))
        build.share("film", film)
        command = build.watch("acting_command", build.place(Place.DRIVE, "command", build.command))
        voltage = build.parameter("gain") * command
        for name in self.signals:
            voltage = build.watch(name, build.place(Place.DRIVE, name, voltage))
        build.watch("squared_voltage", build.place(Place.DRIVE, "squared_voltage", voltage**2))
        return build.place(Place.SENSOR, "reading", 1e-4 * command)


@pytest.fixture
def chain(uncompiled: None) -> Callable[..., dict[str, np.ndarray]]:
    """``chain(commands, *effects, sample_time=0.02)``: signals and the reading at the end of each sample."""

    def run(commands: np.ndarray, *effects: Effect, sample_time: float = 0.02) -> dict[str, np.ndarray]:
        run_of = simulation(Plant(rig=Chain(sample_time=sample_time), effects=effects), commands)
        return {**run_of.watched[0], "reading": run_of.outputs[0][0]}

    return run

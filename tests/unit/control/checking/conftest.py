"""Rigs of a user, so small that everything about them is known: lags, a plate that is pulled in, one that breaks."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from deatwin.plant import Parameter, Plant, Rig, StartProcedure
from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class Lags(Rig):
    """Lags of one time constant in series behind a gain that may grow with the command."""

    sample_time: float = 0.02
    noise: float = 1e-3
    count: int = 1
    time: float = 0.01
    slope: float = 2.0
    cubic: float = 0.0

    kind: ClassVar[str] = "lags"
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "mm"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="slope", value=self.slope, unit="mm/V", lower=1e-6, upper=100.0),)

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        grown = 1 + build.constant("cubic", self.cubic) * build.command**2
        before = build.parameter("slope") * build.command * grown
        for number in range(self.count):
            position = build.state(f"position_{number}", scale=self.slope)
            build.rate(position, before - position, mass=self.time)
            before = position
        return before


@dataclass(frozen=True, kw_only=True)
class Gap(Rig):
    """A voltage pulls a plate on a spring into a gap: u² = x (1 - x)² at rest, pull-in at x = 1/3 and 0.385 V."""

    sample_time: float = 0.02
    noise: float = 1e-3

    kind: ClassVar[str] = "check_gap"
    input_name: ClassVar[str] = "voltage"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "mm"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="stiffness", value=1.0, unit="1", lower=0.1, upper=10.0),)

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        pull = build.command**2 / (1 - position) ** 2 - build.parameter("stiffness") * position
        build.rate(position, pull, mass=0.02)
        return position


@dataclass(frozen=True, kw_only=True)
class Brittle(Gap):
    """The position 1 - sqrt(1 - u) with a lag: beyond 1 V there is none."""

    kind: ClassVar[str] = "brittle"

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        wanted = build.parameter("stiffness") * (1 - (1 - build.command) ** 0.5)
        build.rate(position, wanted - position, mass=0.02)
        return position


@pytest.fixture(scope="module")
def uncompiled() -> Iterator[None]:
    """So small a plant runs as fast as it compiles."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("deatwin.plant.simulate.compile_functions", lambda functions, **_: dict(functions))
        yield


@pytest.fixture(scope="module")
def lags(uncompiled: None) -> Callable[..., Plant]:
    return lambda **details: Plant(rig=Lags(**details))


@pytest.fixture(scope="module")
def gap(uncompiled: None) -> Plant:
    return Plant(rig=Gap())


@pytest.fixture(scope="module")
def brittle(uncompiled: None) -> Plant:
    return Plant(rig=Brittle())

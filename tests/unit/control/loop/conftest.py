"""A user's rig whose answer is known in closed form."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from deatwin.plant import Parameter, Plant, Rig
from deatwin.plant.builder import Builder


@dataclass(frozen=True, kw_only=True)
class Curve(Rig):
    """The position 2 u + c u³, at once, or with a lag; a voltage beyond what the solver knows is none here."""

    sample_time: float = 0.02
    noise: float = 1e-3
    cubic: float = 0.0
    lag: float = 0.0

    kind: ClassVar[str] = "curve"
    input_name: ClassVar[str] = "command"
    input_unit: ClassVar[str] = "V"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "mm"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="slope", value=2.0, unit="mm/V", lower=0.1, upper=10.0),)

    def write(self, build: Builder) -> Any:
        wanted = build.parameter("slope") * build.command + build.constant("cubic", self.cubic) * build.command**3
        if self.lag == 0.0:
            return wanted
        position = build.state("position", scale=1.0)
        build.rate(position, wanted - position, mass=self.lag)
        return position


@dataclass(frozen=True, kw_only=True)
class Late(Curve):
    """A curve with a lag behind a command that comes two samples late and grows while it is held, from half of it."""

    kind: ClassVar[str] = "late"

    def write(self, build: Builder) -> Any:
        late = build.past_commands(2)[2] * (0.5 + (build.time - build.sample_start) / self.sample_time)
        wanted = build.parameter("slope") * late + build.constant("cubic", self.cubic) * late**3
        position = build.state("position", scale=1.0)
        build.rate(position, wanted - position, mass=self.lag)
        return position


@pytest.fixture
def curve(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Plant]:
    # So small a plant runs as fast as it compiles.
    monkeypatch.setattr("deatwin.plant.simulate.compile_functions", lambda functions, **_: dict(functions))
    return lambda **details: Plant(rig=Curve(**details))


@pytest.fixture
def late(curve: Callable[..., Plant]) -> Plant:
    """A plant that asks for past commands and for the time at which a sample began; not compiled either."""
    return Plant(rig=Late(cubic=0.4, lag=0.1))

"""Rigs of a user, so small that everything about them is known: lags, a plate that is pulled in, one that breaks.

Of one lag there is an exact model as well, and a check on it that is as short as can be.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import jsonschema
import numpy as np
import pytest
from made_narx import trained_on
from made_rigs import Bare, Gap

from deatwin.control import Check, LinearController, check, lambda_tuning, linearise
from deatwin.ident.narx import NarxModel, Residual
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.excited import BAND_KEY
from deatwin.plant import Parameter, Plant
from deatwin.plant.builder import Builder

SCHEMA = json.loads((files("deatwin.control") / "schemas" / "check.schema.json").read_text(encoding="utf-8"))
H, LAG, SLOPE = 0.02, 0.01, 2.0
POLE = np.exp(-H / LAG)
FAST = 0.06
"""Closed-loop time, s: so short that the check is."""


@dataclass(frozen=True, kw_only=True)
class Lags(Bare):
    """Lags of one time constant in series behind a gain that may grow with the command."""

    noise: float = 1e-3
    count: int = 1
    time: float = 0.01
    slope: float = 2.0
    cubic: float = 0.0

    kind: ClassVar[str] = "lags"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "mm"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="slope", value=self.slope, unit="mm/V", lower=1e-6, upper=100.0),)

    def write(self, build: Builder) -> Any:
        grown = 1 + build.constant("cubic", self.cubic) * build.command**2
        before = build.parameter("slope") * build.command * grown
        for number in range(self.count):
            position = build.state(f"position_{number}", scale=self.slope)
            build.rate(position, before - position, mass=self.time)
            before = position
        return before


@dataclass(frozen=True, kw_only=True)
class Brittle(Gap):
    """The position 1 - sqrt(1 - u) with a lag: beyond 1 V there is none."""

    kind: ClassVar[str] = "brittle"

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        wanted = build.parameter("stiffness") * (1 - (1 - build.command) ** 0.5)
        build.rate(position, wanted - position, mass=0.02)
        return position


@pytest.fixture(scope="session")
def lags() -> Callable[..., Plant]:
    return lambda **details: Plant(rig=Lags(**details))


@pytest.fixture(scope="session")
def gap() -> Plant:
    return Plant(rig=Gap(damping=0.02))


@pytest.fixture(scope="session")
def brittle() -> Plant:
    return Plant(rig=Brittle())


@pytest.fixture(scope="session")
def rig(lags: Callable[..., Plant]) -> Plant:
    return lags(time=LAG, slope=SLOPE)


@pytest.fixture(scope="session")
def trained() -> OperatingRange:
    return trained_on((-1.0, 1.0), (-2.0, 2.0))


@pytest.fixture(scope="session")
def known() -> dict[str, str]:
    """What an identification tells of the excited band and of the residual."""
    return {BAND_KEY: "5.0", **Residual(rms=2e-3, correlation_time=0.2).provenance}


@pytest.fixture(scope="session")
def exact(trained: OperatingRange, known: dict[str, str]) -> Callable[..., NarxModel]:
    """The rig's rows: y(k) = p y(k-1) + g (1 - p) u(k)."""

    def model(gain: float = SLOPE, spread: float = 1e-3, **details: Any) -> NarxModel:
        given = {"operating": trained, "provenance": known, "input_units": ("V",), "output_units": ("mm",)} | details
        return NarxModel.from_terms(
            {"y(k-1)": POLE, "u(k)": gain * (1 - POLE)}, sample_time=H, theta_cov=spread**2 * np.eye(2), **given
        )

    return model


@pytest.fixture(scope="session")
def checked() -> Callable[..., Check]:
    """``checked(model, plant, seed=3, samples=60, ...)``: the check, by default of the shortest closed loop."""

    def found(model: NarxModel, plant: Plant, seed: int = 3, samples: int = 60, **details: Any) -> Check:
        given = details if details.keys() & {"controller", "design"} else {"closed_loop_time": FAST} | details
        return check(model, plant, rng=np.random.default_rng(seed), samples=samples, **given)

    return found


@pytest.fixture(scope="session")
def passed(checked: Callable[..., Check], exact: Callable[..., NarxModel], rig: Plant) -> Check:
    return checked(exact(), rig)


@pytest.fixture(scope="session")
def fast(exact: Callable[..., NarxModel], rig: Plant) -> LinearController:
    """A sound controller of the shortest check."""
    return lambda_tuning(linearise(exact()).in_loop(rig.rig.reading), command_limits=(-1.0, 1.0), closed_loop_time=FAST)


@pytest.fixture(scope="session")
def subjects() -> Callable[[Check], set[str]]:
    return lambda found: {finding.subject for finding in found.findings}


@pytest.fixture(scope="session")
def document_of() -> Callable[[Check, Path], dict[str, Any]]:
    """What `save` writes, strictly JSON: no NaN, no infinity, in numbers or in words."""

    def saved(found: Check, path: Path) -> dict[str, Any]:
        found.save(path / "check.json")
        text = (path / "check.json").read_text(encoding="utf-8")

        def refuse(name: str) -> None:
            raise AssertionError(name)

        document: dict[str, Any] = json.loads(text, parse_constant=refuse)
        written = json.dumps([document["reason"], document["sentence"], document["findings"]]).lower()
        assert " nan" not in written
        assert " inf " not in written
        jsonschema.validate(document, SCHEMA)
        return document

    return saved

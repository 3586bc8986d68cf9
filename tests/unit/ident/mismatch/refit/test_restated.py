"""An oscillator in closed form whose mass is not the one that the rig states."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare
from scipy.signal import cont2discrete, dlsim

from deatwin.ident.mismatch import Verdict, check_quality, diagnose, prepare
from deatwin.ident.mismatch.model_error import differences
from deatwin.ident.mismatch.refit.restated import restated, stated_numbers
from deatwin.plant import Builder, Effect, Family, Parameter, Place, Plant, Recording, Rig
from deatwin.plant.effects.base import ranged

WIDTH, NUMBER, NOISE = 0.01, 1800, 2e-6
MASS, STIFFNESS, DAMPING, PUSH = 0.010, 40.0, 0.05, 1e-3


@dataclass(frozen=True, kw_only=True)
class Weighed(Bare):
    """A mass on a spring that a command pulls; the experimenter weighed the mass and knows the pull."""

    sample_time: float = WIDTH
    noise: float = NOISE
    mass: float = MASS
    push: float = PUSH
    unused: float = 7.0
    kind: ClassVar[str] = "weighed mass"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="stiffness", value=STIFFNESS, unit="N/m", lower=1.0, upper=1e3),
            Parameter(name="damping", value=DAMPING, unit="N s/m", lower=1e-3, upper=1.0),
            Parameter(name="mass", value=self.mass, unit="kg", lower=1e-4, upper=1.0, known=True),
            Parameter(name="push", value=self.push, unit="N/V", lower=1e-5, upper=1.0, known=True),
        )

    def write(self, build: Builder) -> Any:
        x, v = build.state("x", scale=1e-3), build.state("v", scale=0.1)
        pull = build.parameter("push") * build.place(Place.DRIVE, "command", build.command)
        build.rate(x, v)
        spring = build.parameter("stiffness") * x
        build.rate(v, pull - build.parameter("damping") * v - spring, mass=build.parameter("mass"))
        return build.place(Place.SENSOR, "reading", x)


def recorded(mass: float, cubic: float = 0.0) -> Recording:
    """Exact response of an oscillator of this mass to held commands, with noise; the sensor may have a cubic error."""
    rng = np.random.default_rng(5)
    command = np.repeat(rng.uniform(-20.0, 20.0, NUMBER // 6), 6)
    rates = np.array([[0, 1], [-STIFFNESS / mass, -DAMPING / mass]])
    discrete = cont2discrete((rates, np.array([[0], [PUSH / mass]]), np.array([[1, 0]]), np.zeros((1, 1))), WIDTH)
    _, motion, _ = dlsim(discrete, np.append(command, 0.0))
    read = motion[1:, 0] + cubic * motion[1:, 0] ** 3
    return Recording.from_arrays(command, read + NOISE * rng.standard_normal(NUMBER), WIDTH)


@dataclass(frozen=True, kw_only=True)
class Limited(Weighed):
    """The experimenter's code refuses masses above a limit."""

    heaviest: ClassVar[float]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass > self.heaviest:
            raise ValueError("too heavy for this spring")


@dataclass(frozen=True, kw_only=True)
class Described(Weighed):
    """Fields that are no stated numbers, and one number without a decimal point."""

    turns: int = 12
    length: float = 3
    is_new: bool = True
    farthest: float = np.inf
    derived: float = field(init=False, default=2.0)


def test_the_numbers_are_those_that_a_rig_adds():
    stated = {"mass": MASS, "push": PUSH, "unused": 7.0}
    assert stated_numbers(Weighed()) == stated
    assert stated_numbers(Described()) == {**stated, "length": 3.0}


def found(recording: Recording, rig: Rig | None = None) -> list[dict[str, float]]:
    plant = Plant(rig=rig or Weighed())
    problem, base = prepare(plant, check_quality(plant, recording), ())
    variants = [variant.calibration.plant.rig for variant in restated(problem, base.chosen)]
    return [differences([problem.nominal.rig, rig])[1] for rig in variants]


def test_a_wrong_mass_is_found_and_a_wrong_pull_is_the_same():
    """12.5 g instead of 10, or 0.8 of the pull on 10 g: the standard errors are far below a per cent at this noise."""
    mass, push = pytest.approx(0.0125, rel=2e-3), pytest.approx(0.8 * PUSH, rel=2e-3)
    assert sorted(found(recorded(0.0125)), key=list) == [{"mass": mass}, {"push": push}]


@pytest.mark.parametrize(
    ("heaviest", "mass", "is_found"),
    [
        (0.0127, 0.0125, True),  # the first step passes the limit, by far
        (MASS, 0.008, True),  # the stated mass is the heaviest one
        (0.0115, 0.0125, False),
    ],
)
def test_a_mass_at_or_beyond_a_limit_of_the_rig(heaviest, mass, is_found, monkeypatch):
    monkeypatch.setattr(Limited, "heaviest", heaviest, raising=False)
    masses = [change["mass"] for change in found(recorded(mass), Limited()) if "mass" in change]
    assert masses == ([pytest.approx(mass, rel=2e-3)] if is_found else [])


def test_a_cubic_error_of_the_sensor_is_no_wrong_number():
    """A tenth at the largest reading, 1 mm."""
    assert found(recorded(MASS, cubic=0.1 / 1e-3**2)) == []


def test_a_number_that_is_stated_wrongly_is_no_missing_physics():
    told = diagnose(Plant(rig=Weighed()), recorded(0.0125), effects=())
    assert told.verdict is Verdict.PARAMETERS
    (name,) = told.forms[0].form
    assert f"fit a rig with {name} = " in told.sentence
    (other,) = {"mass", "push"} - {name}
    assert any(warning.startswith(f"a rig with {other} = ") for warning in told.warnings)


@dataclass(frozen=True, kw_only=True)
class Weaker(Effect):
    """The command acts in part."""

    loss: float = field(default=0.1, metadata=ranged("1", 0.0, 0.9))
    name: ClassVar[str] = "weaker"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "command"
    strength: ClassVar[str] = "loss"
    wording: ClassVar[str] = "The command loses {loss}"

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal * (1 - self.own("loss", build))


@dataclass(frozen=True, kw_only=True)
class Sprung(Weighed):
    """The spring is known to have more than 32 N/m."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        spring, *others = super().parameters
        return (replace(spring, lower=32.002), *others)


def test_an_effect_that_contradicts_the_rig_gives_way_to_a_number_that_does_not():
    """40 N/m and 12.5 g move as 32 N/m and 10 g do, if a fifth of the command or of the pull is lost."""
    told = diagnose(Plant(rig=Sprung()), recorded(0.0125), effects=[Weaker()])
    assert told.verdict is Verdict.PARAMETERS
    assert told.forms[0].form == {"mass": pytest.approx(0.0125, rel=2e-3)}
    assert told.model.plant.parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=2e-3)
    assert told.verification is None  # that of the effect
    assert any(warning.startswith("a rig with push = ") for warning in told.warnings)

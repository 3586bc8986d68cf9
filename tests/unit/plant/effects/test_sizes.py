"""Effects at other sizes: a change of units changes no physics."""

import pickle
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, ClassVar

import numpy as np
import pytest
import runs
from made_rigs import Bare

from deatwin.plant import (
    CoulombFriction,
    Creep,
    CubicStiffness,
    Effect,
    Family,
    Hysteresis,
    Parameter,
    Plant,
    catalogue,
    effect_named,
)
from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.sizes import Sizes

DIAPHRAGM = Sizes()
MOTION, FORCE, TIME, COMMAND = 250.0, 3e4, 0.2, 40.0
"""Of a plant beside the diaphragm's: lengths, forces, times and commands are so many times larger."""
LARGE = Sizes(
    motion=MOTION * DIAPHRAGM.motion,
    force=FORCE * DIAPHRAGM.force,
    period=TIME * DIAPHRAGM.period,
    command=COMMAND * DIAPHRAGM.command,
    motion_unit="V",
    force_unit="V/s2",
    command_unit="A",
    body="mass",
)


@dataclass(frozen=True, kw_only=True)
class Mass(Bare):
    """A mass between spring and damper, in units that are `length`, `push`, `duration` and `order` times smaller."""

    noise: float = 0.0
    length: float = 1.0
    push: float = 1.0
    duration: float = 1.0
    order: float = 1.0

    kind: ClassVar[str] = "mass of any size"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        speed = self.length / self.duration
        return (
            Parameter(name="mass", value=3e-3 * self.push * self.duration / speed, unit="kg", lower=0, upper=1e9),
            Parameter(name="damping", value=0.05 * self.push / speed, unit="N s/m", lower=0.0, upper=1e9),
            Parameter(name="stiffness", value=30.0 * self.push / self.length, unit="N/m", lower=0.0, upper=1e9),
            Parameter(name="gain", value=6e-3 * self.push / self.order, unit="N/V", lower=0.0, upper=1e9),
        )

    def write(self, build: Builder) -> Any:
        position = build.watch("displacement", build.state("position", scale=1e-3 * self.length))
        velocity = build.watch("velocity", build.state("velocity", scale=0.05 * self.length / self.duration))
        command = build.place(Place.DRIVE, "command", build.command)
        force = build.place(Place.BALL, "force", -build.parameter("damping") * velocity)
        build.rate(position, velocity)
        build.rate(
            velocity,
            build.parameter("gain") * command - build.parameter("stiffness") * position + force,
            mass=build.parameter("mass"),
        )
        return build.place(Place.SENSOR, "reading", position)


pytestmark = pytest.mark.usefixtures("uncompiled")


def readings(rig: Mass, commands: np.ndarray, *effects: Effect) -> np.ndarray:
    return runs.readings(Plant(rig=rig, effects=effects), commands)


ON_A_MASS = [e for e in Mass().effects() if Plant(rig=Mass()).accepts(e)]


@pytest.mark.parametrize("effect", ON_A_MASS, ids=lambda e: e.name)
def test_a_change_of_units_changes_no_reading(effect: Effect) -> None:
    # Whatever the law: the readings of the same system in other units are those readings, times the unit of length.
    commands = 2.0 + 1.5 * np.sin(0.4 * np.arange(120)) * np.sin(0.06 * np.arange(120))
    large = Mass(sample_time=0.02 * TIME, length=MOTION, push=FORCE, duration=TIME, order=COMMAND)
    here = readings(Mass(), commands, effect)
    there = readings(large, COMMAND * commands, LARGE.of(effect))
    # The equations of a sample are solved to 1e-10 of the scale; kinks of friction lose some digits.
    assert np.abs(there / MOTION - here).max() < 1e-6 * np.abs(here).max()
    if effect.name not in ("sensor_jump", "sensor_saturation", "end_stop", "resonance"):  # at these sizes unseen
        assert np.abs(here - readings(Mass(), commands)).max() > 1e-4 * np.abs(here).max()


def test_the_catalogue_of_a_mass_is_not_empty() -> None:
    names = {e.name for e in ON_A_MASS}
    assert {"cubic_stiffness", "coulomb_friction", "hysteresis", "delay", "sensor_lag"} <= names
    assert {"relaxation", "dead_zone", "backlash"} <= names


def test_units_and_words_are_those_of_the_plant() -> None:
    (cubic,) = LARGE.of(CubicStiffness()).describe()
    friction, distance, _ = LARGE.of(Hysteresis()).describe()
    assert (cubic.unit, friction.unit, distance.unit) == ("1/(V2 s2)", "V/s2", "V")
    assert distance.value == pytest.approx(MOTION * 30e-6)
    assert distance.upper == pytest.approx(MOTION * 1e-3)
    units = {p.name: p.unit for p in LARGE.of(effect_named("periodic_disturbance")).describe()}
    assert (units["frequency"], units["phase"]) == ("Hz", "rad")
    assert LARGE.of(CoulombFriction()).wording.startswith("The mass ")


def test_a_sensor_may_read_something_else_than_the_motion() -> None:
    sizes = replace(LARGE, reading=20.0, reading_unit="N")
    jump = next(e for e in catalogue() if e.name == "sensor_jump")
    change, _ = sizes.of(jump).describe()
    assert change.unit == "N"
    assert change.value == pytest.approx(20e-6 * 20.0 / DIAPHRAGM.motion)


@pytest.mark.parametrize("effect", [Creep(), LARGE.of(CubicStiffness())], ids=["of a film", "enlarged already"])
def test_what_has_no_size_of_the_diaphragm_stays_as_it_is(effect: Effect) -> None:
    assert LARGE.of(effect) is effect


@pytest.mark.parametrize("effect", ON_A_MASS, ids=lambda e: e.name)
def test_worker_processes_get_the_same_effect(effect: Effect) -> None:
    large = LARGE.of(effect)
    again = pickle.loads(pickle.dumps(large))
    assert again == large
    assert type(again) is type(large)
    assert again.describe() == large.describe()


def test_starts_are_looked_for_in_the_time_of_the_plant() -> None:
    # A line at 1.7 Hz, 0.8 V, in a record of the plant's own clock.
    timepts = 0.05 * np.arange(2000)
    tone = next(e for e in catalogue() if e.name == "periodic_disturbance")
    found = LARGE.of(tone).starts(timepts, 0.8 * np.cos(2 * np.pi * 1.7 * timepts))
    assert any(abs(e.frequency - 1.7) < 1e-3 for e in found)


@pytest.mark.parametrize("period", [300.0, 6e-4], ids=["bath", "piezo"])
@pytest.mark.parametrize(
    ("name", "shape", "value"),
    [("sensor_drift", "time", 9e3), ("sensor_jump", "at", 2e4), ("periodic_disturbance", "frequency", 1 / 7200)],
)
def test_surroundings_do_not_follow_the_period_of_a_rig(name: str, shape: str, value: float, period: float) -> None:
    # A sensor warms up in hours, and a thermostat cycles in two, beside a slow bath as well as beside a piezo stage.
    effect = effect_named(name)
    usual, here = effect.described(shape), Sizes(period=period).of(replace(effect, **{shape: value})).described(shape)
    assert here.lower <= usual.lower < usual.upper <= here.upper
    assert replace(Sizes(period=period).of(effect), **{shape: value}).described(shape).value == value


def test_a_drift_starts_at_times_that_its_recording_shows() -> None:
    timepts = 30.0 * np.arange(3000)
    times = [e.time for e in Sizes(period=300.0).of(effect_named("sensor_drift")).starts(timepts, np.zeros(3000))]
    assert min(times) < 0.1 * np.ptp(timepts) < np.ptp(timepts) < max(times) < 10 * np.ptp(timepts)


def test_a_jump_is_looked_for_at_the_clock_of_a_fast_rig() -> None:
    # Half an hour after the first of several short recordings, three million periods of 0.6 ms.
    timepts = 1800.0 + 2e-4 * np.arange(1000)
    found = Sizes(period=6e-4).of(effect_named("sensor_jump")).starts(timepts, 1e-5 * (np.arange(1000) >= 400))
    assert found[0].at == pytest.approx(1800.0 + 2e-4 * 399.5)
    assert found[0].change == pytest.approx(1e-5)


def test_a_rig_offers_the_catalogue_at_its_sizes() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Circuit(Mass):
        sizes: ClassVar[Sizes] = LARGE

    names = [e.name for e in Circuit().effects()]
    assert names == sorted({*(e.name for e in catalogue()), "relaxation", "dead_zone", "backlash"})
    assert CubicStiffness() in Mass().effects()
    assert LARGE.of(CubicStiffness()) in Circuit().effects()


class Tank(Enum):
    """A place that no film actuator has."""

    BRIM = "brim"


@dataclass(frozen=True, kw_only=True)
class Spill(Effect):
    """A share of the force is lost there."""

    share: float = 0.5

    name: ClassVar[str] = "spill"
    family: ClassVar[Family] = Family.ENVIRONMENT
    place: ClassVar[Tank] = Tank.BRIM
    signal: ClassVar[str] = "gain"
    strength: ClassVar[str] = "share"
    wording: ClassVar[str] = "A share of {share} is spilt"

    def describe(self) -> tuple[Parameter, ...]:
        return (Parameter(name="share", value=self.share, unit="1", lower=0.0, upper=1.0),)

    def rewrite(self, signal: Any, build: Builder) -> Any:
        return signal * (1 - self.own("share", build))


def test_a_rig_may_have_places_of_its_own() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Leaky(Mass):
        kind: ClassVar[str] = "leaky"

        def write(self, build: Builder) -> Any:
            return build.place(Tank.BRIM, "gain", Mass.write(self, build))

    commands = np.sin(0.1 * np.arange(50))
    whole, half = readings(Leaky(), commands), readings(Leaky(), commands, Spill())
    assert half == pytest.approx(whole / 2)
    assert not Plant(rig=Mass()).accepts(Spill())

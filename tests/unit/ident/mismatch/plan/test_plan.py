"""Plans of a first-order lag between a command and a reading, whose effects are known in closed form."""

import json
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare

from deatwin.ident.mismatch import ExperimentPlan, plan_experiment
from deatwin.plant import (
    DataError,
    DeadZone,
    Delay,
    Experiment,
    ModelError,
    Parameter,
    Plant,
    Reading,
    Recording,
    SensorCurvature,
    SensorLag,
    Sizes,
)
from deatwin.plant.builder import Builder
from deatwin.plant.effects.base import Place
from deatwin.plant.files import read_commands

STEP = 0.02
EFFECTS = (Delay(), SensorLag(), SensorCurvature())


@dataclass(frozen=True, kw_only=True)
class Amplifier(Bare):
    """A first-order lag between command and reading."""

    kind: ClassVar[str] = "amplifier"
    model_share: ClassVar[float] = 1e-3

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=1e-4, unit="m/V", lower=1e-6, upper=1e-2),
            Parameter(name="time", value=0.1, unit="s", lower=0.0, upper=1.0),
        )

    def write(self, build: Builder) -> Any:
        position = build.share("position", build.state("position", scale=1e-4))
        command = build.place(Place.DRIVE, "command", build.command)
        build.rate(position, build.parameter("gain") * command - position, mass=build.parameter("time"))
        return build.place(Place.SENSOR, "reading", position)


def commands(values: np.ndarray) -> Recording:
    silent = np.zeros((0, values.size))
    return Recording.from_arrays(values, silent, STEP, input_names=("command",), input_units=("V",))


def steps(n: int = 600) -> Recording:
    return commands(np.repeat(np.random.default_rng(3).uniform(0.0, 5.0, n // 60), 60))


def row(plan: ExperimentPlan, name: str):
    return next(one for one in plan.effects if one.effect == name)


@pytest.fixture(scope="module")
def plan():
    return plan_experiment(Plant(rig=Amplifier()), steps(), effects=EFFECTS)


def test_steps_show_what_a_constant_cannot(plan):
    held = plan_experiment(Plant(rig=Amplifier()), commands(np.zeros(600)), effects=EFFECTS)
    assert all(one.visible for one in plan.effects)
    assert row(held, "delay").smallest is None and row(held, "sensor_lag").smallest is None
    assert "not detected at any strength" in row(held, "delay").sentence


def test_the_change_is_what_a_simulation_with_the_effect_gives(plan):
    plant, record = Plant(rig=Amplifier()), plan.recording
    with_delay = plant.with_effects(Delay()).simulate(Experiment(recordings=(record,))).outputs[0][0]
    assert row(plan, "delay").change == pytest.approx(1e6 * np.sqrt(np.mean((with_delay - record.outputs[0]) ** 2)))


def test_more_noise_needs_more(plan):
    noisy = plan_experiment(Plant(rig=Amplifier(noise=2e-5)), steps(), effects=EFFECTS)
    assert all(row(noisy, one.effect).smallest > one.smallest for one in plan.effects)


def test_given_effects_have_the_units_and_sizes_of_the_rig():
    @dataclass(frozen=True, kw_only=True)
    class Coil(Amplifier):
        kind: ClassVar[str] = "coil"
        input_unit: ClassVar[str] = "A"
        sizes: ClassVar[Sizes] = Sizes(command=3.0, command_unit="A", motion=1e-4, period=0.1)

    given = Recording.from_arrays(steps().inputs, np.zeros((0, 600)), STEP, input_names="current", input_units="A")
    (found,) = plan_experiment(Plant(rig=Coil()), given, effects=[DeadZone(width=0.1)]).effects
    assert found.unit == "A"
    assert found.typical == Coil.sizes.of(DeadZone(width=0.1)).width


def test_a_slow_input_does_not_tell_a_delay_from_a_lag():
    slow = commands(2.5 - 2.5 * np.cos(2 * np.pi * np.arange(1500) * STEP / 15.0))
    found = plan_experiment(Plant(rig=Amplifier(noise=2e-6)), slow, effects=(Delay(), SensorLag(time=0.03)))
    fast = plan_experiment(Plant(rig=Amplifier(noise=2e-6)), steps(1500), effects=(Delay(), SensorLag(time=0.03)))
    assert not row(fast, "delay").alike and not row(fast, "sensor_lag").alike
    assert all(one.alike or not one.visible for one in found.effects)


@dataclass(frozen=True, kw_only=True)
class Watched(Amplifier):
    """The same with a place for a second sensor, before the delay of the first one."""

    kind: ClassVar[str] = "watched_amplifier"
    offers: ClassVar[dict[str, str]] = {"inside": "m"}

    def write(self, build: Builder) -> Any:
        reading = super().write(build)
        build.watch("inside", build.signal("position"))
        return reading


def test_a_second_sensor_tells_what_the_input_leaves():
    slow = commands(2.5 - 2.5 * np.cos(2 * np.pi * np.arange(1500) * STEP / 4.0))
    effects = (Delay(), SensorLag(time=0.03))
    found = plan_experiment(Plant(rig=Watched(noise=1e-6)), slow, effects=effects)
    (sensor,) = found.readings
    # The command is late in both readings, the first sensor's lag only in its own.
    assert (sensor.reading, sensor.tells, sensor.left) == ("inside", (("delay", "sensor_lag"),), 1)
    assert sensor.noise == pytest.approx(1e-3 * 5e-4, rel=0.01)  # of a gain of 100 µm/V, to 5 V
    assert "the inside measured with a noise of 497 nm rms" in found.sentence
    assert found.to_dict()["readings"][0]["tells"] == [["delay", "sensor_lag"]]
    had = Watched(noise=1e-6, further=(Reading(name="inside", unit="m", noise=sensor.noise),))
    bought = plan_experiment(Plant(rig=had), slow, effects=effects)
    assert not bought.readings
    assert not row(bought, "delay").alike and not row(bought, "sensor_lag").alike


def test_an_input_is_advised_within_the_range(tmp_path):
    rig = Amplifier(command_range=(0.0, 4.0))
    plan = plan_experiment(Plant(rig=rig), effects=(Delay(), SensorCurvature()), seconds=8.0)
    assert plan.waveform in plan.tried and plan.tried[plan.waveform] == min(plan.tried.values())
    assert plan.recording.inputs.min() >= 0.0 and plan.recording.inputs.max() <= 4.0
    plan.save_input(tmp_path / "next_input.csv")
    np.testing.assert_allclose(read_commands(tmp_path / "next_input.csv").inputs, plan.recording.inputs)
    again = plan_experiment(Plant(rig=rig), effects=(Delay(), SensorCurvature()), seconds=8.0)
    assert json.dumps(plan.to_dict()) == json.dumps(again.to_dict())


def test_what_cannot_be_planned_is_said():
    plant = Plant(rig=Amplifier())
    with pytest.raises(DataError, match=r"no range of its command, .*command_max_V"):
        plan_experiment(plant)
    with pytest.raises(DataError, match="commands must be a Recording, whose readings are ignored, not a ndarray"):
        plan_experiment(plant, np.zeros(200))
    with pytest.raises(ModelError, match="a plan needs a Plant, not a Amplifier"):
        plan_experiment(plant.rig, steps())
    with pytest.raises(DataError, match="either an input or a length"):
        plan_experiment(plant, steps(), seconds=3.0)
    with pytest.raises(DataError, match="none of the effects can be added"):
        plan_experiment(plant, steps(), effects=())
    with pytest.raises(DataError, match="no sensor noise"):
        plan_experiment(Plant(rig=Amplifier(noise=0.0)), commands(np.zeros(200)), effects=EFFECTS)
    for seconds in (1.0, 1e9):
        with pytest.raises(DataError, match="must be 2 to 2000 s"):
            plan_experiment(plant.with_rig(replace(plant.rig, command_range=(0.0, 1.0))), seconds=seconds)


def test_the_plot_has_a_mark_for_each_effect_that_is_found(plan):
    axes = plan.plot()
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        one.effect.replace("_", " ") for one in plan.effects
    ][::-1]
    assert axes.get_xlabel() == "change of the reading, rms (µm)"

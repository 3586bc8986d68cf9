"""A model that was written elsewhere runs, with its derivatives, as the same equations in deatwin do."""

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from foreign_models import (
    FOREIGN,
    SIZES,
    commands,
    experiment,
    heavy_motor_crashes,
    heavy_motor_hangs,
    heavy_motor_raises,
    motor,
    plants,
)

from deatwin.ident.greybox.fit import calibrate
from deatwin.plant import (
    AmplifierSaturation,
    Backlash,
    CubicStiffness,
    DeadZone,
    Delay,
    Effect,
    ParameterSet,
    PeriodicDisturbance,
    Plant,
    Reading,
    ReadingTime,
    RigError,
    SensorCurvature,
    SensorDrift,
    SensorLag,
    SimulationError,
)
from deatwin.plant.export.model_exchange import export_model_exchange
from deatwin.plant.foreign import ForeignRig, ParameterDrift
from deatwin.plant.simulate import Run


def run(plant: Plant, held: np.ndarray) -> Run:
    timeline = plant.timeline(experiment(held))
    return plant.runner.run_with_sensitivities(
        timeline.commands,
        start=timeline.start,
        sample_time=timeline.sample_time,
        rest_command=0.0,
        values=plant.free_values,
    )


def test_rows_that_are_means_are_those_of_straight_readings() -> None:
    _, foreign = plants()
    ended = foreign.simulate(experiment(commands())).require().outputs[0][0]
    averaged = replace(foreign, rig=replace(foreign.rig, reading=ReadingTime.MEAN_OVER_HOLD))
    found = averaged.simulate(experiment(commands())).require().outputs[0][0]
    np.testing.assert_allclose(found[1:], (ended[1:] + ended[:-1]) / 2, rtol=1e-9, atol=1e-12 * np.abs(ended).max())


@pytest.mark.parametrize(
    "effect",
    [
        None,
        SIZES.of(DeadZone(width=0.2)),
        SIZES.of(Backlash(width=0.2)),
        SIZES.of(AmplifierSaturation(limit=1000.0)),
        SIZES.of(SensorCurvature()),
        SIZES.of(SensorDrift()),
        SIZES.of(PeriodicDisturbance()),
    ],
    ids=lambda e: getattr(e, "name", "none"),
)
def test_readings_and_derivatives_are_those_of_the_same_equations(effect: Effect | None) -> None:
    native, foreign = (run(plant, commands()) for plant in plants(*([] if effect is None else [effect])))
    scale = np.ptp(native.outputs)
    # The collocation's error for a lag of nine samples is 1e-14 of the motion. The central difference in ln(value) is
    # wrong by (1e-3)²/6 of the third derivative, and a corner that it steps over by more.
    np.testing.assert_allclose(foreign.outputs[1:], native.outputs[1:], rtol=0, atol=1e-9 * scale)
    assert native.sensitivities is not None and foreign.sensitivities is not None
    wrong = np.abs(foreign.sensitivities - native.sensitivities)[1:].max(axis=0)
    assert (wrong <= 2e-3 * np.abs(native.sensitivities).max(axis=0) + 1e-12).all()


def test_a_command_that_moves_within_a_sample_acts_by_its_mean() -> None:
    # 3.4 samples late: the voltage jumps within a sample. The motor forgets in 8.7 samples, so what the mean loses
    # is of second order: (1/8.7)²/8 of what a jump of 3 V moves it in a sample.
    native, foreign = (run(plant, commands()) for plant in plants(SIZES.of(Delay(time=0.034))))
    np.testing.assert_allclose(foreign.outputs[1:], native.outputs[1:], rtol=0, atol=2e-3 * np.ptp(native.outputs))


def test_a_sensor_that_lags_starts_at_the_first_reading() -> None:
    _, plant = plants(SensorLag(time=0.05))
    steady = plant.with_rig(ForeignRig(**{**vars(FOREIGN), "model": lambda p, u, t: 3.0 + 0 * t}))
    np.testing.assert_allclose(steady.simulate(experiment(commands())).outputs[0], 3.0)


def test_a_parameter_drifts_by_its_course() -> None:
    _, plant = plants(ParameterDrift(parameter="constant", relative_change=0.5, time=20.0), varying=("constant",))
    found = plant.simulate(experiment(commands())).outputs[0][0]
    elapsed = 0.01 * np.arange(1, 401)
    course = 0.048 * (1 + 0.5 * (1 - np.exp(-elapsed / 20.0)))
    values = {p.name: p.value for p in FOREIGN.parameters} | {"constant": course}
    np.testing.assert_allclose(found, motor(values, {"voltage": commands()}, elapsed), rtol=1e-9)


def test_only_what_varies_can_drift() -> None:
    _, plant = plants()
    assert not plant.accepts(ParameterDrift(parameter="constant"))
    assert not plant.accepts(CubicStiffness())  # of a force that the model does not show


def test_a_fit_finds_the_parameters_of_the_same_equations() -> None:
    native, foreign = plants()
    made = native.with_values({"inertia": 1.2e-4, "drag": 2e-5}).record(
        experiment(commands()), np.random.default_rng(3)
    )
    one, other = (calibrate(plant, made) for plant in (native, foreign))
    for name in one.names:
        assert other.plant.parameters[name].value == pytest.approx(one.plant.parameters[name].value, rel=1e-5)
        assert other.interval(name) == pytest.approx(one.interval(name), rel=1e-4)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (heavy_motor_raises, "it raised FloatingPointError: left its range"),
        (heavy_motor_crashes, "its process crashed"),
        (lambda p, u, t: t[1:], r"it returned readings of shape \(399,\) for times of shape \(400,\)"),
        (
            lambda p, u, t: t + 0j,
            "it raised DataError: its readings must be an array of real numbers, with rows of the same length",
        ),
        (lambda p, u, t: np.ma.masked_less(t, 1.0), "its reading at 0 s is not a finite number"),
        (lambda p, u, t: np.where(t > 1.0, np.nan, t), "its reading at 1.01 s is not a finite number"),
    ],
)
def test_a_model_that_fails_is_one_line(model: object, said: str) -> None:
    _, plant = plants(model=model)
    with pytest.raises(SimulationError, match=f"gave no readings: {said}$"):
        plant.with_values({"inertia": 2e-4}).simulate(experiment(commands())).require()


def test_a_model_that_never_ends_is_ended() -> None:
    _, plant = plants(model=heavy_motor_hangs, longest=1.0)
    with pytest.raises(SimulationError, match="it took too long"):
        plant.with_values({"inertia": 2e-4}).simulate(experiment(commands())).require()
    assert plant.simulate(experiment(commands())).status.ok


def test_a_crash_costs_one_candidate() -> None:
    native, foreign = plants(model=heavy_motor_crashes)
    made = native.with_values({"inertia": 1.2e-4}).record(experiment(commands()), np.random.default_rng(3))
    # Starts spread over the range of the inertia; those above 1.3e-4 kg m2 fail.
    assert calibrate(foreign, made).plant.parameters["inertia"].value == pytest.approx(1.2e-4, rel=0.01)


def test_a_model_that_no_other_process_finds_runs_here(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("of_this_process_alone")
    exec("def motor(parameters, inputs, time):\n    return 0 * time + parameters['drag']", vars(module))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    _, plant = plants(model=module.motor)
    assert run(plant, commands()).outputs == pytest.approx(1e-5)


def test_what_needs_equations_says_so(tmp_path) -> None:
    _, plant = plants()
    with pytest.raises(RigError, match="the equations of a foreign model are unknown"):
        export_model_exchange(plant, tmp_path / "motor.fmu")


def test_further_readings_are_refused() -> None:
    with pytest.raises(RigError, match="a foreign model gives one reading"):
        plants(further=(Reading(name="current", noise=1e-9),))


def test_a_plant_is_saved_by_the_name_of_its_model() -> None:
    _, plant = plants(ParameterDrift(parameter="drag"), SIZES.of(SensorDrift()), varying=("drag",))
    again = Plant.from_dict(plant.to_dict())
    assert again.rig == plant.rig and again.effect_names == ("drift_of_drag", "sensor_drift")
    assert ParameterSet(again.parameters.values()).array() == pytest.approx(plant.parameters.array())
    unknown = plant.to_dict() | {"rig": {**plant.to_dict()["rig"], "model": "nowhere:motor"}}
    with pytest.raises(RigError, match="import nowhere first"):
        Plant.from_dict(unknown)


def test_a_foreign_rig_needs_its_sizes() -> None:
    with pytest.raises(RigError, match=r"sizes is None; give the typical sizes"):
        ForeignRig(**{**vars(FOREIGN), "sizes": None})


@pytest.mark.parametrize(
    "channels",
    [("temperature",), ("temperature", 20.0), (("temperature", "warm"),), ((3, 20.0),), 3, (("heat", np.nan),)],
)
def test_a_channel_is_a_name_and_a_number(channels) -> None:
    with pytest.raises(RigError, match=r'is not a channel; give a name and a number, as \("temperature", 20.0\)'):
        ForeignRig(**{**vars(FOREIGN), "channels": channels})


def test_one_parameter_that_varies_may_be_given_alone() -> None:
    assert ForeignRig(**{**vars(FOREIGN), "varying": "drag"}).varying == ("drag",)

"""Calibration on several readings against weighted least squares of a closed form."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_rigs import Tank
from scipy.optimize import least_squares

from deatwin.ident.greybox import calibrate
from deatwin.ident.greybox.parts import free_run_residuals, parts_of
from deatwin.ident.greybox.problem import Problem
from deatwin.plant import DataError, Experiment, Plant, Reading, Recording
from deatwin.plant.simulate import Simulator

STEP, COUNT = 0.1, 300


TANK = Tank(noise=0.05, drain=0.8, area=1.5, further=(Reading(name="outflow", unit="m/s", noise=0.01),))


def levels(drain: float, area: float, commands: np.ndarray) -> np.ndarray:
    """Exact under held commands."""
    decay, found = np.exp(-drain * STEP), [0.0]
    for command in commands:
        found.append(decay * found[-1] + (1 - decay) * command / (area * drain))
    return np.array(found[1:])


@pytest.fixture
def recording() -> Recording:
    rng = np.random.default_rng(5)
    commands = rng.uniform(0.0, 2.0, COUNT // 20).repeat(20)
    level = levels(0.5, 1.0, commands)
    flow = 0.5 * level + 0.01 * rng.standard_normal(COUNT)
    flow[40:90] = np.nan
    return Recording.from_arrays(
        commands,
        level + 0.05 * rng.standard_normal(COUNT),
        STEP,
        input_names=["pump"],
        input_units=["V"],
        output_names=["level"],
        output_units=["m"],
        extras={"outflow": flow},
        extra_units={"outflow": "m/s"},
    )


def test_each_reading_counts_by_its_noise_and_where_it_was_measured(recording: Recording) -> None:
    measured, flow = recording.outputs[0], recording.extras["outflow"]
    seen = np.isfinite(flow)

    def residuals(values: np.ndarray) -> np.ndarray:
        level = levels(*values, recording.inputs[0])
        return np.concatenate([(measured - level) / 0.05, (flow - values[0] * level)[seen] / 0.01])

    expected = least_squares(residuals, [0.8, 1.5], xtol=1e-12, ftol=1e-12)
    fit = calibrate(Plant(rig=TANK), recording, tolerance=1e-10)
    found = [fit.plant.parameters[name].value for name in ("drain", "area")]
    assert found == pytest.approx(expected.x, rel=1e-5)
    assert fit.residuals == pytest.approx(0.05 * expected.fun, abs=1e-6)
    assert fit.rms == pytest.approx(0.05, rel=0.1)  # each reading is in units of the first one's noise; 0.03 deviates


def test_a_recording_without_the_reading_is_fitted_by_the_first_one(recording: Recording) -> None:
    bare = Recording.from_arrays(
        recording.inputs, recording.outputs, STEP, input_names=["pump"], output_names=["level"]
    )
    both, one = (calibrate(Plant(rig=rig), bare, starts=1) for rig in (TANK, replace(TANK, further=())))
    assert both.residuals == pytest.approx(one.residuals)


def test_a_reading_in_another_unit_is_refused(recording: Recording) -> None:
    wrong = Recording.from_arrays(
        recording.inputs, recording.outputs, STEP, extras=recording.extras, extra_units={"outflow": "V"}
    )
    with pytest.raises(DataError, match='the reading "outflow" is in V, but the model needs it in m/s'):
        calibrate(Plant(rig=TANK), wrong)


@pytest.mark.parametrize("names", [("outflow", "level"), ("depth", "level"), ("outflow", "depth")])
def test_rows_in_another_order_than_the_readings_are_refused(recording: Recording, names: tuple[str, str]) -> None:
    # In one unit, the flow would count as the level.
    tank = replace(TANK, further=(Reading(name="outflow", unit="m", noise=0.01),))
    both = np.stack([0.5 * recording.outputs[0], recording.outputs[0]])
    swapped = replace(recording, outputs=both, output_names=names, output_units=("m", "m"), extras={}, extra_units={})
    with pytest.raises(DataError, match=f'its first output is "{names[0]}", but the first reading .* is "level"'):
        calibrate(Plant(rig=tank), swapped)


def test_simulated_recordings_of_all_readings_give_the_plant_back(recording: Recording) -> None:
    truth = Plant(rig=TANK, values={"drain": 0.5, "area": 1.0})
    made = truth.record(Experiment(recordings=(recording,)), np.random.default_rng(2))
    fit = calibrate(Plant(rig=TANK), made)
    assert fit.residuals.size == 2 * COUNT
    low, high = fit.interval("drain", 4.0)
    assert low < 0.5 < high


def test_readings_that_end_apart_share_a_simulation(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    flow = recording.extras["outflow"].copy()
    flow[-50:] = np.nan
    parts = parts_of(replace(recording, extras={"outflow": flow}), TANK)
    plant, ran = Plant(rig=TANK), []

    def noted(name: str) -> Callable[..., Any]:
        run = getattr(Simulator, name)
        return lambda *args, **given: (ran.append(name), run(*args, **given))[1]

    for name in ("run", "run_with_sensitivities"):
        monkeypatch.setattr(Simulator, name, noted(name))
    problem = Problem(plant=plant, parts=parts, names=("drain", "area"))
    residuals, _ = problem.evaluate(problem.start())
    assert residuals == pytest.approx(free_run_residuals(plant, parts), abs=1e-9)
    assert [part.size for part in parts] == [COUNT, COUNT - 100]
    assert ran == ["run_with_sensitivities", "run"]

"""FMUs, run by fmpy."""

import shutil
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.export import narx_source
from deatwin.plant import Coupon, Creep, Delay, Effect, Experiment, Plant, Reading, Recording
from deatwin.plant.effects import effect_named
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.sensor_jump import SensorJump
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.export import archive
from deatwin.plant.export.cosimulation import export_cosimulation
from deatwin.plant.export.model_exchange import export_model_exchange
from deatwin.plant.export.plant_step import plant_source
from deatwin.plant.fleet import thesis_plant
from deatwin.plant.rigs.planar import Planar

pytestmark = pytest.mark.extras

SHEET = Plant(rig=Planar(sample_time=0.02))


def fmpy() -> Any:
    return pytest.importorskip("fmpy", reason="FMUs are run by fmpy: pip install fmpy")


def commands(count: int, low: float, high: float) -> NDArray[np.float64]:
    return np.repeat(np.random.default_rng(0).uniform(low, high, count // 10), 10)


def simulated(plant: Plant, held: NDArray[np.float64], finer: int = 1) -> NDArray[np.float64]:
    """Readings at the start and after each sample, (n + 1,)."""
    step = plant.rig.sample_time / finer
    run = plant.simulator.run(
        np.repeat(held, finer),
        start=0.0,
        sample_time=step,
        rest_command=plant.rig.start.rest_command,
        values=plant.free_values,
    )
    assert run.status.ok
    return run.outputs[::finer]


def played(fmu: Path, step: float, **signals: NDArray[np.float64]) -> Any:
    """What fmpy records at the start and after each sample; solver's tolerance 1e-9."""
    n = len(next(iter(signals.values())))
    given = np.zeros(n + 1, dtype=[("time", float), *((name, float) for name in signals)])
    given["time"] = step * np.arange(n + 1)
    for name, values in signals.items():
        given[name] = np.append(values, values[-1])
    return fmpy().simulate_fmu(
        str(fmu), stop_time=n * step, output_interval=step, input=given, relative_tolerance=1e-9, record_events=False
    )


@contextmanager
def opened(fmu: Path, start: float = 0.0) -> Iterator[tuple[Any, dict[str, int]]]:
    """An instance that is initialised, and its value references."""
    from fmpy import extract, read_model_description
    from fmpy.fmi3 import FMU3Model

    described, folder = read_model_description(str(fmu)), extract(str(fmu))
    instance = FMU3Model(
        guid=described.guid,
        unzipDirectory=folder,
        modelIdentifier=described.modelExchange.modelIdentifier,
        instanceName="tried",
    )
    try:
        instance.instantiate()
        instance.enterInitializationMode(startTime=start)
        instance.exitInitializationMode()
        yield instance, {v.name: v.valueReference for v in described.modelVariables}
    finally:
        instance.freeInstance()
        shutil.rmtree(folder)


def problems(fmu: Path) -> list[str]:
    from fmpy.validation import validate_fmu

    return list(validate_fmu(str(fmu)))


@pytest.fixture(scope="module")
def thesis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A diaphragm, which has algebraic coordinates, with hysteresis."""
    fmpy()
    return export_model_exchange(thesis_plant(), tmp_path_factory.mktemp("fmu") / "thesis.fmu", name="thesis")


def test_a_diaphragm_with_hysteresis_moves_in_an_fmu_as_here(thesis: Path) -> None:
    plant, held = thesis_plant(), commands(100, 0.0, 3.2)
    assert problems(thesis) == []
    found = played(thesis, plant.rig.sample_time, command=held)
    # A step over a kink of the hysteresis costs the simulation micrometres at 20 ms; at an eighth of that, 0.05 um.
    assert found["displacement"] == pytest.approx(simulated(plant, held, finer=8), abs=5e-8)
    assert np.ptp(found["displacement"]) > 3e-4
    # Where a sample ends and the next begins, fmpy records what follows at once after the change of the command.
    assert found["signal.film_voltage"][:-1] == pytest.approx(plant.rig.gain * held, rel=1e-12)


@pytest.mark.parametrize("effects", [(), (ElectrodeRC(time=0.0),)], ids=["no effect", "a time constant of zero"])
def test_a_smooth_plant_agrees_to_the_tolerance_of_the_integrator(effects: tuple[Effect, ...], tmp_path: Path) -> None:
    fmpy()
    fmu = export_model_exchange(SHEET.with_effects(*effects), tmp_path / "sheet.fmu", name="sheet")
    held = commands(60, 0.0, 3.0)
    expected = simulated(SHEET, held, finer=4)
    # 1e-9 a step in units of the states' sizes; at whole samples the collocation's own error is 2e-6 of the travel.
    assert played(fmu, 0.02, command=held)["displacement"] == pytest.approx(expected, abs=1e-7 * np.ptp(expected))


def test_further_readings_are_outputs_unless_they_are_means_over_a_sample(tmp_path: Path) -> None:
    fmpy()
    seen = (Reading(name="current", noise=5e-9), Reading(name="capacitance", noise=1e-12))
    plant = SHEET.with_rig(replace(SHEET.rig, further=seen))
    fmu = export_model_exchange(plant, tmp_path / "seen.fmu")
    assert problems(fmu) == []
    with zipfile.ZipFile(fmu) as archive:
        said = archive.read("modelDescription.xml").decode()
    assert "without current: an FMU for model exchange has no samples" in said and 'name="current"' not in said
    held = commands(60, 0.0, 3.0)
    one = Recording.from_arrays(held, np.zeros((0, 60)), 0.02)
    expected = plant.simulate(Experiment(recordings=(one,))).require().outputs[0][2]
    found = played(fmu, 0.02, command=held)["capacitance"][1:]
    # At whole samples the collocation's own error is 2e-6 of the travel.
    assert found == pytest.approx(expected, abs=1e-5 * np.ptp(expected))


def test_what_depends_on_time_alone_is_followed(tmp_path: Path) -> None:
    fmpy()
    plant = SHEET.with_effects(SensorJump(change=1e-3, at=0.11))
    fmu = export_model_exchange(plant, tmp_path / "jump.fmu")
    found = played(fmu, 0.02, command=np.zeros(10))["displacement"]
    assert found == pytest.approx(simulated(plant, np.zeros(10)), abs=1e-12)
    with opened(fmu, start=0.2) as (instance, references):
        reading = [references["displacement"]]
        late = instance.getFloat64(reading)[0]
        instance.enterContinuousTimeMode()
        instance.setTime(0.0)
        assert late - instance.getFloat64(reading)[0] == pytest.approx(1e-3, rel=1e-6)


def test_derivatives_through_the_algebraic_coordinates_are_right(thesis: Path) -> None:
    with opened(thesis) as (instance, references):
        state, rate = references["state.deflection"], references["der(state.velocity)"]
        slope = instance.getDirectionalDerivative([rate], [state], [1.0])[0]
        instance.enterContinuousTimeMode()
        states = sorted(value for name, value in references.items() if name.startswith("state."))
        at_rest = np.array(instance.getFloat64(states))
        step, rates = 1e-4, []
        for sign in (1.0, -1.0):
            moved = at_rest + sign * step * (np.array(states) == state)
            instance.setContinuousStates((c_double * moved.size)(*moved), moved.size)
            rates.append(instance.getFloat64([rate])[0])
    # Of second order; the force's third derivative is of the size of its first, in units of a millimetre.
    assert slope == pytest.approx((rates[0] - rates[1]) / (2 * step), rel=1e-6)


def test_a_solver_may_ask_for_the_event_indicators_although_there_are_none(thesis: Path) -> None:
    # FMI 3.0 knows no error in this; fmpy raises one for any status but OK, and its Euler solver always asks.
    with opened(thesis) as (instance, _):
        instance.enterContinuousTimeMode()
        instance.getEventIndicators((c_double * 0)(), 0)


def test_a_measured_channel_is_an_input(tmp_path: Path) -> None:
    plant = SHEET.with_effects(effect_named("thermal_stiffness"))
    fmpy()
    fmu = export_model_exchange(plant, tmp_path / "warm.fmu")
    names = [v.name for v in fmpy().read_model_description(str(fmu)).modelVariables if v.causality == "input"]
    assert names == ["command", "temperature"]


def test_pull_in_is_an_error_of_the_fmu(tmp_path: Path) -> None:
    fmpy()
    fmu = export_model_exchange(SHEET, tmp_path / "sheet.fmu")
    with pytest.raises(Exception, match="corrector convergence test failed"):
        played(fmu, 0.02, command=np.full(50, 30.0))


def test_an_effect_with_a_memory_of_commands_is_refused_by_name(tmp_path: Path) -> None:
    plant = SHEET.with_effects(Creep(), Delay(time=0.03))
    with pytest.raises(ModelError, match=r"^delay: needs the commands of earlier samples.*fmu-cs"):
        export_model_exchange(plant, tmp_path / "late.fmu")
    assert not (tmp_path / "late.fmu").exists()


def test_a_plant_with_a_dead_time_steps_in_an_fmu_as_here(tmp_path: Path) -> None:
    fmpy()
    plant = SHEET.with_effects(Delay(time=0.03))
    fmu = export_cosimulation(plant_source(plant, name="late"), tmp_path / "late.fmu")
    assert problems(fmu) == []
    held = commands(60, 0.0, 3.0)
    expected = simulated(plant, held)
    found = played(fmu, 0.02, command=held)
    assert found["displacement"] == pytest.approx(expected, abs=1e-9 * np.ptp(expected))


def test_a_narx_model_steps_in_an_fmu_as_it_simulates(tmp_path: Path) -> None:
    fmpy()
    model = NarxModel.from_terms(
        {"y(k-1)": 0.8, "u(k)": 0.2, "u(k-1)^2": 0.1}, sample_time=0.1, input_units=("V",), output_units=("mm",)
    )
    fmu = export_cosimulation(narx_source(model), tmp_path / "narx.fmu")
    assert problems(fmu) == []
    u, y = commands(50, -1.0, 1.0), [0.0]
    for k, value in enumerate(u):  # by hand; before the first sample all is zero
        y.append(0.8 * y[-1] + 0.2 * value + 0.1 * (u[k - 1] ** 2 if k else 0.0))
    found = played(fmu, 0.1, input=u)
    assert found["output"] == pytest.approx(np.array(y), abs=1e-14)


def test_what_is_no_source_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ModelError, match=r"source must be a SampledSource, as plant_source\(plant\) returns it; got a Plant"
    ):
        export_cosimulation(SHEET, tmp_path / "sheet.fmu")


def test_a_step_between_two_samples_is_refused(tmp_path: Path) -> None:
    fmu = export_cosimulation(_model(), tmp_path / "narx.fmu") if fmpy() else Path()
    with pytest.raises(Exception, match="fmi3DoStep"):
        played(fmu, 0.15, input=np.ones(3))
    assert played(fmu, 0.2, input=np.ones(3))["output"] == pytest.approx([0.0, 1.5, 1.875, 1.96875])  # two a step


def test_a_plant_without_states_has_an_fmu_too(tmp_path: Path) -> None:
    fmpy()
    strip = Plant(rig=Coupon(sample_time=0.1))
    fmu = export_cosimulation(plant_source(strip, name="strip"), tmp_path / "strip.fmu")
    held = commands(20, 1.0, 2.0)
    assert played(fmu, 0.1, stretch=held)["force"] == pytest.approx(simulated(strip, held), rel=1e-9)


def test_what_an_fmu_needs_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "narx.fmu"
    with monkeypatch.context() as patched:
        patched.setattr(archive, "find_spec", lambda name: None)
        with pytest.raises(ModelError, match=r'install them with pip install "fmpy'):
            export_cosimulation(_model(), target)
    fmpy()
    with pytest.raises(DataError, match="cannot be written: No such file or directory"):
        export_cosimulation(_model(), tmp_path / "nowhere" / "narx.fmu")
    monkeypatch.setenv("DEATWIN_COMPILER", "")
    with pytest.raises(ModelError, match="needs a C compiler, and none was found"):
        export_cosimulation(_model(), target)
    assert list(tmp_path.iterdir()) == []


def _model() -> Any:
    return narx_source(NarxModel.from_terms({"y(k-1)": 0.5, "u(k)": 1.0}, sample_time=0.1))

"""FMUs of other tools and of deatwin itself, wrapped as plants."""

from dataclasses import replace
from pathlib import Path

import fmi2
import numpy as np
import pytest
from foreign_models import PARAMETERS, commands, experiment, motor

from deatwin.ident.greybox.fit import calibrate
from deatwin.plant import Delay, ParameterSet, Plant, ReadingTime, RigError, SimulationError, load_plant
from deatwin.plant.export.cosimulation import export_cosimulation
from deatwin.plant.export.model_exchange import export_model_exchange
from deatwin.plant.export.plant_step import plant_source
from deatwin.plant.foreign import FmuModel, ParameterDrift
from deatwin.plant.rigs.planar import Planar

pytestmark = pytest.mark.extras

pytest.importorskip("fmpy", reason="FMUs are run by fmpy: pip install fmpy")

FILE = """
[model]
file = "motor.fmu"
{kind}
[input]
name = "voltage"
size = 3000.0
[output]
name = "speed"
size = 3000.0
noise = 3.0
[time]
sample_rate_Hz = 100
period_s = 0.1
[parameters.inertia]
lower = 1e-6
upper = 1e-2
unit = "kg m2"
logarithmic = true
[parameters.drag]
lower = 1e-7
upper = 1e-2
logarithmic = true
[parameters.constant]
upper = 0.5
known = true
varying = true
"""
KINDS = {"co-simulation": 1e-9, "model exchange": 1e-6}
"""Kinds of FMU, and what they leave of the motion: the co-simulation is exact, the solver's tolerance is 1e-8 a step."""
VALUES = {p.name: p.value for p in PARAMETERS}
ROWS = 0.01 * np.arange(400)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from deatwin.plant.integrator.compiled import compiler

    found = compiler()
    if found is None:
        pytest.skip("there is no C compiler here")
    made = tmp_path_factory.mktemp("fmu")
    fmi2.build(made / "motor.fmu", found)
    (made / "motor.toml").write_text(FILE.format(kind=""))
    return made


def plant(folder: Path, kind: str = "co-simulation", **changed: object) -> Plant:
    given = load_plant(folder / "motor.fmu").plant
    return given.with_rig(replace(given.rig, model=replace(given.rig.model, kind=kind, **changed)))


def read(plant: Plant) -> np.ndarray:
    return plant.simulate(experiment(commands())).require().outputs[0][0]


@pytest.mark.parametrize("kind", KINDS)
def test_an_fmu_of_version_2_moves_as_its_equations(folder: Path, kind: str) -> None:
    expected = motor(VALUES, {"voltage": commands()}, ROWS)
    assert read(plant(folder, kind)) == pytest.approx(expected, abs=KINDS[kind] * np.ptp(expected))


@pytest.mark.parametrize("kind", KINDS)
def test_a_reading_at_the_start_of_a_row_is_that_at_the_end_of_the_row_before(folder: Path, kind: str) -> None:
    ends = read(plant(folder, kind))
    starts = plant(folder, kind, reading=ReadingTime.START_OF_HOLD).rig.model({}, {"voltage": commands()}, ROWS)
    assert starts == pytest.approx(np.append(0.0, ends[:-1]), abs=1e-6 * np.ptp(ends))


@pytest.mark.parametrize("kind", KINDS)
def test_a_tunable_parameter_drifts(folder: Path, kind: str) -> None:
    drift = ParameterDrift(parameter="constant", relative_change=0.5, time=20.0)
    course = 0.048 * (1 + 0.5 * (1 - np.exp(-(ROWS + 0.01) / 20.0)))
    expected = motor(VALUES | {"constant": course}, {"voltage": commands()}, ROWS)
    assert read(plant(folder, kind).with_effects(drift)) == pytest.approx(expected, abs=KINDS[kind] * np.ptp(expected))


def test_units_and_parameters_are_those_of_the_fmu(folder: Path) -> None:
    rig = plant(folder).rig
    assert (rig.input_unit, rig.output_unit, rig.sizes.command) == ("V", "rad/s", 3.0)
    assert rig.noise == pytest.approx(np.radians(3.0))
    assert ParameterSet(rig.parameters)["constant"].lower == 0.0  # the FMU's own min


def test_a_fit_through_an_fmu_finds_its_parameters(folder: Path) -> None:
    nominal = plant(folder)
    made = nominal.with_values({"inertia": 1.2e-4, "drag": 2e-5}).record(
        experiment(commands()), np.random.default_rng(3)
    )
    fit = calibrate(nominal, made, starts=1)
    for name, value in {"inertia": 1.2e-4, "drag": 2e-5}.items():
        low, high = fit.interval(name, deviations=3.0)
        assert low < value < high and fit.is_determined(name)


@pytest.mark.parametrize(
    ("values", "said"),
    [({"inertia": 2e-4}, "its process crashed"), ({"drag": 3e-4}, r"fmi2DoStep failed .*the bearings have seized")],
)
def test_an_fmu_that_fails_is_one_line(folder: Path, values: dict[str, float], said: str) -> None:
    with pytest.raises(SimulationError, match=said):
        read(plant(folder).with_values(values))


def test_a_plant_of_an_fmu_is_saved_with_its_digest(folder: Path, tmp_path: Path) -> None:
    saved = plant(folder).to_dict()
    assert Plant.from_dict(saved).rig == plant(folder).rig
    other = tmp_path / "other.fmu"
    other.write_bytes((folder / "motor.fmu").read_bytes() + b"later")
    saved["rig"]["model"]["path"] = str(other)
    with pytest.raises(SimulationError, match="the FMU has changed since"):
        read(Plant.from_dict(saved))


@pytest.mark.parametrize("late", [False, True])
def test_an_fmu_that_deatwin_exported_moves_as_its_plant(tmp_path: Path, late: bool, c_compiler: str) -> None:
    """Of version 3: for model exchange and, with a dead time, for co-simulation."""
    sheet = Plant(rig=Planar(sample_time=0.02), effects=(Delay(time=0.05),) if late else ())
    held = np.repeat(np.random.default_rng(0).uniform(0.0, 3.0, 6), 10)
    path = tmp_path / "sheet.fmu"
    if late:
        export_cosimulation(plant_source(sheet), path)
    else:
        export_model_exchange(sheet, path, name="sheet")
    model = FmuModel.of(path, inputs=("command",), output="displacement")
    found = model({}, {"command": held}, 0.02 * np.arange(held.size))
    run = sheet.runner.run(held, start=0.0, sample_time=0.02, rest_command=0.0, values=sheet.free_values)
    # At whole samples the collocation's own error is 2e-6 of the travel.
    assert found == pytest.approx(run.outputs[1:], abs=1e-5 * np.ptp(run.outputs))


TANK = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Tank(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.area, self.inflow, self.level = 2.0, 0.0, 0.0
        self.register_variable(Real("inflow", causality=Fmi2Causality.input))
        self.register_variable(Real("level", causality=Fmi2Causality.output))
        tunable = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("area", **tunable))

    def do_step(self, current_time, step_size):
        self.level += step_size * self.inflow / self.area
        return True
"""


def test_an_fmu_of_another_tool_runs(tmp_path: Path) -> None:
    builder = pytest.importorskip("pythonfmu.builder", reason="exports the FMU: pip install pythonfmu").FmuBuilder
    (tmp_path / "tank.py").write_text(TANK)
    made = builder.build_FMU(tmp_path / "tank.py", dest=tmp_path)
    model = FmuModel.of(made, inputs=("inflow",), output="level")
    inflow = np.repeat([1.0, 0.0, -0.5], 20)
    assert model({"area": 4.0}, {"inflow": inflow}, 0.1 * np.arange(60)) == pytest.approx(np.cumsum(0.1 * inflow / 4.0))


def test_an_fmu_needs_a_file_beside_it(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "motor.fmu").write_bytes((folder / "motor.fmu").read_bytes())
    with pytest.raises(RigError, match=r"motor\.fmu: an FMU needs a file motor\.toml in the same folder"):
        load_plant(tmp_path / "motor.fmu")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "speed"', 'name = "sped"', "the FMU has no real output 'sped'; did you mean \"speed\"?"),
        ("[parameters.drag]", "[parameters.drug]", "no real parameter 'drug'; did you mean \"drag\"?"),
        ("{kind}", 'kind = "scheduled"', '[model] kind = scheduled; it must be "co-simulation" or "model exchange"'),
        ("size = 3000.0", "sise = 3000.0", '[input] sise is no key of a model file; did you mean "size"?'),
        ("[time]", "[times]", '[times] is no section of a model file; did you mean "time"?'),
        ("upper = 0.5", "", "[parameters.constant] upper is missing: give a number"),
        ("noise = 3.0", "noise = true", "[output] noise = True; it must be a number"),
        ("period_s = 0.1", "period_s = 0", "[time] period_s = 0; it must be above 0"),
        ("lower = 1e-7", "lower = 1e-3", "parameter drag = 1e-05 1 is out of range"),
        ("[parameters.drag]", "[parameters.'der(speed)']\nvalue = 0.0", "der(speed) is computed by the FMU"),
        ("known = true", "known = 1", "[parameters.constant] known = 1; it must be true or false"),
    ],
)
def test_a_mistake_in_the_file_is_one_line(folder: Path, old: str, new: str, said: str) -> None:
    path = folder / "wrong.toml"
    assert old in FILE
    path.write_text(FILE.replace(old, new, 1).replace("{kind}", ""))
    with pytest.raises(RigError) as caught:
        load_plant(path)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_fmu_is_said(tmp_path: Path) -> None:
    (tmp_path / "motor.fmu").write_text("no archive")
    (tmp_path / "motor.toml").write_text(FILE.format(kind=""))
    with pytest.raises(RigError, match="it cannot be read as an FMU: File is not a zip file"):
        load_plant(tmp_path / "motor.toml")

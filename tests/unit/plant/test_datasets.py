"""What results look like as datasets, and that NetCDF files keep them."""

import json
from dataclasses import dataclass, field, replace
from enum import Enum
from operator import attrgetter
from typing import ClassVar

import numpy as np
import pytest

from deatwin.plant import (
    CalibratedPlant,
    Creep,
    DataError,
    Diaphragm,
    Experiment,
    Planar,
    Plant,
    Reading,
    Recording,
    actuation_curve,
)
from deatwin.plant.calibrated import fields_of
from deatwin.plant.datasets import (
    Described,
    attribute,
    columns,
    coordinate,
    dataset,
    document,
    nested,
    several,
    status_of,
    table_along,
    variable,
)

pytest.importorskip("xarray")
pytestmark = pytest.mark.usefixtures("uncompiled")


def test_complex_numbers_units_truth_and_what_is_absent(kept):
    data = dataset(
        {"": ("x", [1 + 2j, 3 - 4j], "m/V"), "gain": ("x", [1j, 2.0]), "bare": ("x", [1, 2])},
        {"x": ("x", [0.5, 1.5], "Hz")},
        {"exact": True, "missing": None, "none": [], "names": ["a", "b"]},
        {"schema": "some/1", "text": "µm", "numbers": [1.5, None]},
    )
    back = kept(data)
    assert back["real"].values.tolist() == [1.0, 3.0] and back["imaginary"].values.tolist() == [2.0, -4.0]
    assert back["real"].attrs["units"] == "m/V" and "units" not in back["gain_imaginary"].attrs
    assert back["gain_imaginary"].values.tolist() == [1.0, 0.0]
    assert set(back.attrs) == {"exact", "names"} and back.attrs["exact"] == 1
    assert json.loads(str(back["document"].values)) == {"schema": "some/1", "text": "µm", "numbers": [1.5, None]}
    assert back["document"].attrs["schema"] == "some/1"


def test_tables_become_columns_with_holes_and_without_what_is_no_cell():
    rows = [{"name": "a", "size": 1.0, "parts": [1]}, {"name": None, "size": None, "late": True}]
    found = columns("row", rows, {"size": "m"})
    assert list(found) == ["row_name", "row_size", "row_late"]
    assert found["row_name"][1].tolist() == ["a", ""] and found["row_size"][2] == "m"
    np.testing.assert_array_equal(found["row_size"][1], [1.0, np.nan])
    np.testing.assert_array_equal(found["row_late"][1], [np.nan, 1.0])
    assert columns("row", []) == {}


class End(Enum):
    """How a run ends."""

    OK = "all is well"


@dataclass(frozen=True)
class Peak:
    """A row of a table."""

    height: float = field(metadata=variable(unit=attrgetter("unit"), about="above the mean"))
    name: str

    DERIVED: ClassVar = {"twice": variable(of=lambda peak: 2 * peak.height, unit="dB")}


@dataclass(frozen=True, eq=False)
class Inner(Described):
    """What stands in another result."""

    level: float = field(metadata=attribute())


@dataclass(frozen=True, eq=False)
class Run(Described):
    """A result with all that a field can be."""

    unit: str
    timepts: np.ndarray = field(metadata=coordinate("time", name="time", unit="s"))
    values: np.ndarray = field(metadata=variable("time", "side", unit=attrgetter("unit"), about="reading"))
    absent: np.ndarray | None = field(metadata=variable("time"))
    end: End = field(metadata=status_of())
    peaks: tuple[Peak, ...] = field(metadata=table_along("peak", kind=Peak))
    inner: Inner = field(metadata=nested())

    DERIVED: ClassVar = {
        "mean": attribute(),
        "double": variable("time", "side", of=lambda run: 2 * run.values),
        "own": several(lambda run: {"a": ("a", [1.0], "m")}),
        "document": document(lambda run: {"schema": "run/1", "unit": run.unit}),
    }

    @property
    def mean(self) -> float:
        """Of all values."""
        return float(np.mean(self.values))


def test_a_dataset_follows_from_the_fields_of_a_result(kept):
    run = Run("V", np.array([0.0, 1.0]), np.array([1.0, 3.0]), None, End.OK, (Peak(2.0, "p"),), Inner(0.5))
    back = kept(run.to_xarray())
    assert set(back.variables) == {"time", "values", "double", "a", "document"} | {
        f"peak_{name}" for name in ("height", "name", "twice")
    }
    assert back["values"].dims == ("time",) and back["values"].attrs == {"units": "V", "long_name": "reading"}
    assert back["time"].attrs["units"] == "s" and back["double"].values.tolist() == [2.0, 6.0]
    assert back["peak_height"].attrs == {"units": "V", "long_name": "above the mean"}
    assert back["peak_twice"].values.tolist() == [4.0] and back["peak_name"].values.tolist() == ["p"]
    assert back.attrs == {"mean": 2.0, "end": "OK", "advice": "all is well", "level": 0.5}
    assert json.loads(str(back["document"].values)) == {"schema": "run/1", "unit": "V"}


def test_values_along_two_axes_have_both_dimensions_and_a_table_may_be_empty():
    found = Run("V", np.zeros(2), np.zeros((2, 3)), None, End.OK, (), Inner(0.5)).to_xarray()
    assert found["values"].dims == ("time", "side")
    assert found["peak_height"].shape == found["peak_twice"].shape == (0,)


def test_without_xarray_the_error_says_what_to_install(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(DataError, match=r"needs the package xarray: pip install xarray"):
        dataset({}, {}, {})


@pytest.fixture(scope="module")
def two_records() -> Experiment:
    blank = [
        Recording.from_arrays(
            np.full(n, 2.0 + n / 100), np.zeros(n), 0.02, start=start, input_units=("V",), output_units=("m",)
        )
        for n, start in ((20, 0.0), (30, 1.0))
    ]
    return Experiment(recordings=tuple(blank))


def test_a_simulation_stands_along_its_experiment(two_records, kept):
    found = Plant(rig=Diaphragm()).simulate(two_records)
    back = kept(found.to_xarray(two_records))
    assert back.sizes == {"sample": 50}
    np.testing.assert_array_equal(back["reading"][20:], found.outputs[1][0])
    np.testing.assert_array_equal(back["time"][[0, 20]], [r.timepts[0] for r in two_records.recordings])
    assert back["record"].values.tolist() == [0] * 20 + [1] * 30
    assert back["command"].attrs["units"] == "V" and float(back["command"][0]) == 2.2
    assert back["reading"].attrs["units"] == "m" and back["time"].attrs["units"] == "s"
    name = next(iter(found.watched[0]))
    np.testing.assert_array_equal(back[name][:20], found.watched[0][name])


def test_all_readings_of_a_simulation_of_commands_alone(kept):
    rig = Planar(further=(Reading(name="current", noise=1e-9), Reading(name="capacitance", noise=1e-12)))
    commands = Recording(
        inputs=np.full((1, 25), 1.0), outputs=np.zeros((0, 25)), sample_time=0.02, output_names=(), output_units=()
    )
    found = Plant(rig=rig).simulate(commands).require()
    back = kept(found.to_xarray(commands))
    expected = {"reading": "m", "current_reading": "A", "capacitance_reading": "F"}
    assert {name: back[name].attrs["units"] for name in expected} == expected
    np.testing.assert_array_equal([back[name] for name in expected], found.outputs[0])
    band = kept(CalibratedPlant.nominal(Plant(rig=rig)).predict(commands).to_xarray(commands))
    np.testing.assert_allclose(band["current_mean"], found.outputs[0][1], rtol=1e-9, atol=1e-15)
    assert band["current_deviation"].attrs["units"] == "A" and band["mean"].attrs["units"] == "m"
    with pytest.raises(DataError, match=r"recordings of \[20\] samples, but those of the simulation have \[25\]"):
        found.to_xarray(commands.section(0, 20))


def test_a_calibrated_plant_and_its_prediction(two_records, kept):
    plant = Plant(rig=Diaphragm()).with_effects(Creep(modulus=40e3))
    names = ("shear_modulus", "creep.modulus")
    known = replace(CalibratedPlant.nominal(plant), names=names, covariance=np.array([[4e-4, 1e-5], [1e-5, 9e-4]]))
    back = kept(known.to_xarray())
    assert float(back["value"].sel(parameter="creep.modulus")) == 40e3
    assert str(back["unit"].sel(parameter="creep.modulus").values) == "Pa"
    assert float(back["covariance"].sel(fitted="shear_modulus", other_fitted="creep.modulus")) == 1e-5
    again = CalibratedPlant(**fields_of(json.loads(str(back["document"].values))))
    assert again.to_dict() == known.to_dict()


def test_a_prediction_stands_along_its_experiment(two_records, kept):
    predicted = CalibratedPlant.nominal(Plant(rig=Diaphragm())).predict(two_records)
    band = kept(predicted.to_xarray(two_records))
    np.testing.assert_array_equal(band["deviation"][20:], predicted.deviation[1])
    assert band["mean"].attrs["units"] == "m"


def test_an_actuation_curve_stands_over_its_command(kept):
    curve = actuation_curve(Plant(rig=Diaphragm()), np.array([1.0, 2.0, 3.0]))
    back = kept(curve.to_xarray())
    np.testing.assert_array_equal(back["command"], [1.0, 2.0, 3.0])
    reading = curve.axes[1][0]
    np.testing.assert_array_equal(back[reading], curve.readings)
    assert back[reading].attrs["units"] == "m" and back["command"].attrs["units"] == "V"
    assert back.attrs["end"] == "COMMAND"


def test_a_result_shows_long_arrays_by_their_shapes():
    plant = Plant(rig=Diaphragm())
    blank = Recording.from_arrays(np.full(200, 3e3), np.zeros(200), 0.02)
    shown = repr(plant.simulate(Experiment(recordings=(blank,))))
    assert len(shown) < 1000 and "<array (" in shown and "status=<RunStatus." in shown

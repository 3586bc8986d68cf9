"""What the unit tests share. Plants of equal structure share compiled equations by themselves."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from deatwin.plant import (
    Creep,
    Diaphragm,
    ElectrodeRC,
    Experiment,
    Hysteresis,
    Parameter,
    PermittivityDrift,
    Plant,
    Recording,
    Rig,
)
from deatwin.plant.builder import Builder
from deatwin.plant.integrator.compiled import compiler


@pytest.fixture
def c_compiler() -> str:
    """Path of the C compiler; where there is none, the test is skipped."""
    found = compiler()
    if found is None:
        pytest.skip("there is no C compiler here")
    return found


# A user's own rig is what stands in this class.


@dataclass(frozen=True, kw_only=True)
class Oscillator(Rig):
    """Force on a mass between a spring and a damper."""

    sample_time: float = 0.02
    noise: float = 1e-6

    kind: ClassVar[str] = "oscillator"
    input_name: ClassVar[str] = "force"
    input_unit: ClassVar[str] = "N"
    output_name: ClassVar[str] = "position"
    output_unit: ClassVar[str] = "m"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="mass", value=1.0, unit="kg", lower=0.0, upper=10.0),
            Parameter(name="damping", value=2.0, unit="N s/m", lower=0.0, upper=100.0),
            Parameter(name="stiffness", value=400.0, unit="N/m", lower=1.0, upper=1e5),
        )

    def write(self, build: Builder) -> Any:
        position, velocity = build.state("position", scale=1e-2), build.state("velocity", scale=0.1)
        build.rate(position, velocity)
        force = build.command - build.parameter("damping") * velocity - build.parameter("stiffness") * position
        build.rate(velocity, force, mass=build.parameter("mass"))
        return position


@pytest.fixture
def oscillator() -> type[Oscillator]:
    """A rig as a user would write it."""
    return Oscillator


@pytest.fixture
def experiment() -> Callable[..., Experiment]:
    """``experiment(commands, start=0.0, sample_time=0.02)``: one record of commands, readings unknown."""

    def make(commands: np.ndarray, start: float = 0.0, sample_time: float = 0.02) -> Experiment:
        record = Recording.from_arrays(commands, np.zeros(len(commands)), sample_time, start=start)
        return Experiment(recordings=(record,))

    return make


@pytest.fixture
def base() -> Plant:
    """The diaphragm without effects."""
    return Plant(rig=Diaphragm())


@pytest.fixture
def full(base: Plant) -> Plant:
    """The diaphragm with all four effects."""
    return base.with_effects(Creep(), PermittivityDrift(), ElectrodeRC(), Hysteresis())


@pytest.fixture
def kept(tmp_path: Path) -> Callable[[Any], Any]:
    """``kept(dataset)``: what comes back of a dataset from a NetCDF file, after a look that nothing was lost."""
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")

    def through_a_file(data: Any) -> Any:
        data.to_netcdf(tmp_path / "kept.nc", engine="h5netcdf")
        with xarray.open_dataset(tmp_path / "kept.nc", engine="h5netcdf") as found:
            back = found.load()
        xarray.testing.assert_equal(back, data)
        units = [{name: v.attrs.get("units") for name, v in one.variables.items()} for one in (back, data)]
        assert units[0] == units[1]
        assert set(back.attrs) == set(data.attrs)
        for name, value in data.attrs.items():
            np.testing.assert_array_equal(np.atleast_1d(back.attrs[name]), np.atleast_1d(value))
        return back

    return through_a_file

"""Recordings in the forms of other libraries, and what is said where such a library is missing."""

import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, write_recording
from deatwin.plant.recording import Recording

pytestmark = pytest.mark.usefixtures("in_one_process")

RECORDING = Recording.from_arrays(
    [1.0, 2.0, 3.0], [0.1, 0.2, 0.3], 0.5, start=7.0, extras={"temperature": [294.0, 295.0, 296.0]}
)


def test_data_frame() -> None:
    pytest.importorskip("pandas")
    frame = RECORDING.to_pandas()
    assert list(frame.columns) == ["command_V", "displacement_m", "temperature_K"]
    np.testing.assert_array_equal(frame.index, [7.0, 7.5, 8.0])
    np.testing.assert_array_equal(frame["temperature_K"], RECORDING.extras["temperature"])


def test_dataset() -> None:
    pytest.importorskip("xarray")
    dataset = RECORDING.to_xarray()
    assert dataset["command"].attrs == {"long_name": "command", "role": "input", "units": "V"}
    np.testing.assert_array_equal(dataset["time"], [7.0, 7.5, 8.0])
    np.testing.assert_array_equal(dataset["displacement"], RECORDING.outputs[0])


def test_input_output_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """The arguments of nonlinear_benchmarks 1.0; the package itself downloads what it needs and is not installed."""

    class Package:
        @staticmethod
        def Input_output_data(u, y, sampling_time=None, name=None, state_initialization_window_length=None):
            return u, y, sampling_time, name

    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", Package)
    u, y, sampling_time, name = RECORDING.to_input_output_data()
    assert (u.shape, y.shape, sampling_time, name) == ((3,), (3,), 0.5, "recording of 7 to 8.5 s")
    two = Recording.from_arrays(np.zeros((2, 5)), np.zeros(5), 1.0)
    assert two.to_input_output_data()[0].shape == (5, 2)


@pytest.mark.parametrize(
    ("ending", "package"), [(".tdms", "nptdms"), (".nc", "h5py"), (".nc", "h5netcdf"), (".nc", "xarray")]
)
def test_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, ending: str, package: str) -> None:
    for other in ("nptdms", "h5py", "h5netcdf", "xarray"):
        monkeypatch.setitem(sys.modules, other, ModuleType(other))
    monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    path = tmp_path / f"rec{ending}"
    with pytest.raises(DataError, match=rf"needs the package {package}: pip install {package}$"):
        write_recording(path, RECORDING)
    assert not list(tmp_path.iterdir())
    path.write_bytes(b"\x89HDF")
    with pytest.raises(DataError, match=rf"rec{ending}: .* needs the package {package}: pip install {package}$"):
        read_recording(path)


def test_matlab_5_needs_no_further_package(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    write_recording(tmp_path / "rec.mat", RECORDING)
    assert read_recording(tmp_path / "rec.mat").n_samples == 3
    (tmp_path / "new.mat").write_bytes(bytes(512) + b"\x89HDF\r\n\x1a\n")
    with pytest.raises(
        DataError, match=r"new.mat: a MATLAB file of version 7.3, or another HDF5 file, needs the package h5py"
    ):
        read_recording(tmp_path / "new.mat")


def test_units_of_extra_channels() -> None:
    recording = Recording.from_arrays(
        [1.0, 2.0], [1.0, 2.0], 1.0, extras={"temperature": [1.0, 2.0], "gas": [0.0, 1.0]}, extra_units={"gas": "Pa"}
    )
    assert recording.extra_units == {"temperature": "K", "gas": "Pa"}
    assert recording.section(1, 2).extra_units == recording.extra_units

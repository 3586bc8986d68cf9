"""NetCDF files of versions 3 and 4 into recordings."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import netcdf_file

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, read_recordings, write_recording
from deatwin.plant.recording import Recording

xarray = pytest.importorskip("xarray")
pytest.importorskip("h5netcdf")

pytestmark = pytest.mark.usefixtures("in_one_process")
N = 50
TIME = 0.02 * np.arange(N)
COMMAND = 2.0 + np.sin(np.arange(N))


def dataset(time_units: str = "s", times: np.ndarray = TIME) -> "xarray.Dataset":
    return xarray.Dataset(
        {
            "command": ("time", COMMAND, {"units": "V"}),
            "displacement": ("time", 0.1 * COMMAND, {"units": "mm"}),
            "map": (("time", "y"), np.zeros((N, 2))),
        },
        coords={"time": ("time", times, {"units": time_units})},
        attrs={"title": "second day"},
    )


def check(recording: Recording) -> None:
    assert (recording.start, recording.n_samples) == (0.0, N)
    assert recording.sample_time == pytest.approx(0.02, rel=1e-12)
    np.testing.assert_array_equal(recording.inputs[0], COMMAND)
    np.testing.assert_allclose(recording.outputs[0], 1e-4 * COMMAND, rtol=1e-15)
    assert recording.provenance["title"] == "second day"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "rec.nc"


@pytest.mark.parametrize(
    ("units", "factor"),
    [
        ("s", 1.0),
        ("ms", 1e3),
        ("seconds", 1.0),
        ("seconds since 2024-01-02", 1.0),
        ("milliseconds since 2024-01-02", 1e3),
        ("Milliseconds since 2024-01-02", 1e3),
        ("ms since 2024-01-02T12:00:00Z", 1e3),
        ("usec since 2024-01-02", 1e6),
    ],
)
def test_version_4(path: Path, units: str, factor: float) -> None:
    dataset(units, TIME * factor).to_netcdf(path, engine="h5netcdf")
    check(read_recording(path))


def test_a_unit_with_a_power_of_ten(path: Path) -> None:
    known = dataset()
    known["displacement"].attrs["units"] = "1e-3 m"
    known.to_netcdf(path, engine="h5netcdf")
    check(read_recording(path))


def test_times_as_dates(path: Path) -> None:
    made = dataset().assign_coords(time=np.datetime64("2024-01-02", "ns") + (TIME * 1e9).round().astype("m8[ns]"))
    made.to_netcdf(path, engine="h5netcdf")
    check(read_recording(path))


def test_packed_values(path: Path) -> None:
    """Integers with scale_factor and add_offset, as the CF conventions pack them."""
    counts = np.arange(N)
    made = dataset().assign(command=("time", 0.5 * counts + 1.0, {"units": "V"}))
    packing = {"dtype": "int16", "scale_factor": 0.5, "add_offset": 1.0, "_FillValue": -1}
    made.to_netcdf(path, engine="h5netcdf", encoding={"command": packing})
    np.testing.assert_array_equal(read_recording(path).inputs[0], 0.5 * counts + 1.0)


@pytest.mark.parametrize("kind", ["int16", "float32", "uint8 as int8"])
@pytest.mark.parametrize(
    "limits",
    [
        {"valid_min": 10, "valid_max": 40},
        {"valid_range": [10, 40]},
        {"missing_value": [7, 9, 41], "valid_max": 41},
        {"_FillValue": 9},
        {"fill_value": 9},
        {"NoData": 9},
    ],
)
@pytest.mark.parametrize("ending", ["nc", "h5", "version 3"])
def test_numbers_outside_their_valid_range_are_missing(tmp_path: Path, kind: str, limits: dict, ending: str) -> None:
    """The limits count as packed, like the numbers (CF conventions, section 8.1)."""
    path = tmp_path / f"r.{ending.replace('version 3', 'nc')}"
    packed = np.linspace(12, 38, N).astype("uint8" if "uint8" in kind else kind)
    packed[[3, 20]] = 9, 41
    signed = packed.view("int8") if "uint8" in kind else packed
    attributes = {name: np.asarray(value).astype(signed.dtype) for name, value in limits.items()}
    attributes |= {"scale_factor": 0.5, "add_offset": 1.0, "units": "mm"}
    attributes |= {"_Unsigned": "true"} if "uint8" in kind else {}
    lost = [3, 20] if {"valid_max", "valid_range"} & limits.keys() else [3]
    signals = {
        "time": (TIME, {"units": "s"}),
        "command": (COMMAND, {"units": "V"}),
        "displacement": (signed, attributes),
    }
    if ending == "h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, (values, about) in signals.items():
                file[name] = values
                file[name].attrs.update(about)
    else:
        made = xarray.Dataset({name: ("time", values, about) for name, (values, about) in signals.items()})
        plain = {name: {"_FillValue": None} for name in ("time", "command")}
        made.to_netcdf(path, engine="scipy" if ending == "version 3" else "h5netcdf", encoding=plain)
    with pytest.raises(DataError, match=r'row 4, column "displacement": there is no value.*--allow-gaps'):
        read_recording(path)
    found = np.concatenate([recording.outputs[0] for recording in read_recordings(path, allow_gaps=True)])
    np.testing.assert_allclose(found, 1e-3 * (0.5 * np.delete(packed, lost).astype(float) + 1.0), rtol=1e-12)


def test_limits_of_unpacked_numbers(path: Path) -> None:
    made = dataset().assign(displacement=("time", np.arange(N, dtype="int16"), {"units": "mm"}))
    made["displacement"].attrs |= {"scale_factor": 0.5, "valid_max": 24.0}
    made.to_netcdf(path, engine="h5netcdf")
    (found,) = read_recordings(path, allow_gaps=True)
    assert found.outputs[0, -1] == 24e-3


@pytest.mark.parametrize("groups", [["bench/run"], ["", "bench"], ["drive", "sensor"]])
def test_groups(path: Path, groups: list[str]) -> None:
    first, last = groups[0], groups[-1]
    made = dataset()
    made[["command"]].to_netcdf(path, group=first, engine="h5netcdf")
    made[["displacement"]].drop_vars("time").to_netcdf(path, group=last, mode="a", engine="h5netcdf")
    check(read_recording(path))


def test_groups_with_the_same_names(path: Path) -> None:
    for k, group in enumerate(("first", "second")):
        made = dataset() * (k + 1)
        made["command"].attrs["units"], made["displacement"].attrs["units"] = "V", "mm"
        made.to_netcdf(path, group=group, mode="a", engine="h5netcdf")
    with pytest.raises(DataError, match=r'the file has .*"first.command"'):
        read_recording(path)
    found = read_recording(path, input_column="second.command", output_column="second.displacement")
    np.testing.assert_array_equal(found.inputs[0], 2.0 * COMMAND)


def test_version_3(path: Path) -> None:
    with netcdf_file(path, "w") as file:
        file.createDimension("time", N)
        file.title = "second day"
        signals = (("time", TIME, "s"), ("command", COMMAND, "V"), ("displacement", 0.1 * COMMAND, "mm"))
        for name, values, unit in signals:
            variable = file.createVariable(name, "d", ("time",))
            variable[:] = values
            variable.units = unit
    check(read_recording(path))


def test_without_times(path: Path) -> None:
    dataset().drop_vars("time").to_netcdf(path, engine="h5netcdf")
    check(read_recording(path, dt=0.02))
    with pytest.raises(DataError, match=r'no column "time_s".*--dt'):
        read_recording(path)


def test_a_head_of_version_4_alone(path: Path) -> None:
    path.write_bytes(b"\x89HDF\r\n\x1a\n and then nothing")
    with pytest.raises(DataError, match=r"rec.nc: cannot be read as a NetCDF file"):
        read_recording(path)


def test_written_for_others(path: Path) -> None:
    write_recording(path, Recording.from_arrays([1.0, 2.0], [3.0, 4.0], 0.5, start=7.0))
    with xarray.open_dataset(path, decode_times=False) as found:
        np.testing.assert_array_equal(found["time"], [7.0, 7.5])
        assert (found["displacement"].attrs["units"], found["displacement"].attrs["role"]) == ("m", "output")
        assert found.attrs["sample_time"] == 0.5


def test_a_few_trials_along_a_dimension_are_signals(path: Path) -> None:
    trials = {
        "u": (("trial", "time"), np.stack([COMMAND, 2.0 * COMMAND]), {"units": "kV"}),
        "x": (("trial", "time"), np.stack([3.0 * COMMAND, 4.0 * COMMAND]), {"units": "um"}),
    }
    xarray.Dataset(trials, coords={"time": ("time", TIME, {"units": "s"})}).to_netcdf(path, engine="h5netcdf")
    found = read_recording(path, input_column="u(2,:)", output_column="x(2,:)")
    np.testing.assert_allclose(found.inputs[0], 2e3 * COMMAND, rtol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 4e-6 * COMMAND, rtol=1e-12)
    assert found.sample_time == pytest.approx(0.02, rel=1e-12)

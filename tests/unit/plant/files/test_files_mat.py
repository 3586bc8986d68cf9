"""MATLAB files of versions 5 and 7.3 into recordings."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_experiment, read_recording, write_csv, write_recording
from deatwin.plant.recording import Recording

pytestmark = pytest.mark.usefixtures("in_one_process")
N = 50
TIME = 0.02 * np.arange(N)
COMMAND = 2.0 + np.sin(TIME)
SIGNALS = {"time_s": TIME, "command_V": COMMAND, "displacement_mm": 0.1 * COMMAND}


def hdf5_mat(path: Path, variables: dict) -> Path:
    """A file as MATLAB writes it with -v7.3: user block, classes as attributes, texts as UTF-16 code units."""
    h5py = pytest.importorskip("h5py")

    def put(group, values: dict) -> None:
        for name, value in values.items():
            if isinstance(value, dict):
                put(group.create_group(name), value)
            elif isinstance(value, list):  # an array of structs: for each field, references to its values
                for field in value[0]:
                    put(file, {f"#refs#/{name}{k}{field}": struct[field] for k, struct in enumerate(value)})
                    nodes = [[file[f"#refs#/{name}{k}{field}"].ref] for k in range(len(value))]
                    group.create_dataset(f"{name}/{field}", data=np.array(nodes, dtype=h5py.ref_dtype))
            elif isinstance(value, str):
                units = np.frombuffer(value.encode("utf-16-le"), dtype="<u2").reshape(-1, 1)
                group.create_dataset(name, data=units).attrs["MATLAB_class"] = np.bytes_("char")
            else:
                data = np.asarray(value, dtype=float)
                data = data.reshape(1, -1) if data.ndim < 2 else data.T  # a column vector; HDF5 has axes reversed
                group.create_dataset(name, data=data).attrs["MATLAB_class"] = np.bytes_("double")

    with h5py.File(path, "w", userblock_size=512) as file:
        put(file, variables)
    content = bytearray(path.read_bytes())
    content[:24] = b"MATLAB 7.3 MAT-file, by "
    path.write_bytes(content)
    return path


def level_5(path: Path, variables: dict) -> Path:
    def put(value):  # SciPy saves a list as a cell
        if isinstance(value, dict):
            return {name: put(field) for name, field in value.items()}
        if isinstance(value, list):
            return np.array([tuple(struct.values()) for struct in value], dtype=[(name, object) for name in value[0]])
        return value

    savemat(path, put(variables), oned_as="row")
    return path


@pytest.fixture(params=[level_5, hdf5_mat], ids=["v5", "v7.3"])
def save(request, tmp_path: Path):
    return lambda variables: request.param(tmp_path / "rec.mat", variables)


def check(recording: Recording) -> None:
    assert (recording.sample_time, recording.start, recording.n_samples) == (0.02, 0.0, N)
    assert (recording.input_units, recording.output_units) == (("V",), ("m",))
    np.testing.assert_array_equal(recording.inputs[0], COMMAND)
    np.testing.assert_allclose(recording.outputs[0], 1e-4 * COMMAND, rtol=1e-15)


class TestBoth:
    def test_vectors(self, save) -> None:
        recording = read_recording(save({**SIGNALS, "temperature_C": np.full(N, 21.0), "kp": 3.0}))
        check(recording)
        assert recording.extras["temperature"][0] == pytest.approx(294.15)
        assert recording.provenance["rows"] == f"1-{N}"

    @pytest.mark.parametrize("shape", [(1, N), (N, 1)])
    def test_rows_and_columns(self, save, shape: tuple[int, int]) -> None:
        check(read_recording(save({name: values.reshape(shape) for name, values in SIGNALS.items()})))

    def test_struct(self, save) -> None:
        check(read_recording(save({"rig": SIGNALS, "title": "second day µ"})))
        recording = read_recording(save({"rig": SIGNALS, "title": "second day µ"}))
        assert recording.provenance["title"] == "second day µ"

    def test_two_structs_need_their_names(self, save) -> None:
        path = save({"one": SIGNALS, "two": SIGNALS})
        with pytest.raises(DataError, match=r'no column "command_V"; the file has .*"one.command_V"'):
            read_recording(path)
        recording = read_recording(path, input_column="two.command_V", output_column="two.displacement_mm")
        np.testing.assert_array_equal(recording.inputs[0], COMMAND)

    def test_two_structs_have_their_own_times(self, save) -> None:
        one, two = ({"t": start + TIME, "u": COMMAND, "y": 0.1 * COMMAND} for start in (1.0, 5.0))
        path = save({"one": one, "two": two})
        recording = read_recording(path, input_column="two.u=V", output_column="two.y=mm")
        assert (recording.start, recording.sample_time) == (5.0, 0.02)
        with pytest.raises(
            DataError, match=r'each of the columns "one.t" and "two.t" may hold the times, and they differ'
        ):
            read_recording(path, input_column="one.u=V", output_column="two.y=mm")

    def test_columns_of_another_length_are_not_the_times(self, save) -> None:
        fast = {"t": TIME, "u": COMMAND, "y": 0.1 * COMMAND}
        path = save({"fast": fast, "slow": {"t": 10.0 * TIME[:5], "T": 20.0 + TIME[:5]}})
        check(read_recording(path, input_column="u=V", output_column="y=mm"))

    def test_array_of_structs(self, save) -> None:
        signals = [{"values": SIGNALS["command_V"], "label": "U"}, {"values": SIGNALS["displacement_mm"], "label": "x"}]
        path = save({"scope": {"time": TIME, "signals": signals}})
        named = {"input_column": "scope.signals(1).values=V", "output_column": "scope.signals(2).values=mm"}
        check(read_recording(path, **named))

    def test_units_by_a_struct(self, save) -> None:
        bare = {name.rpartition("_")[0]: values for name, values in SIGNALS.items()}
        check(read_recording(save({**bare, "units": {"time": "s", "command": "V", "displacement": "mm"}})))

    @pytest.mark.parametrize(("name", "value"), [("Ts", 0.02), ("dt", 0.02), ("fs", 50.0)])
    def test_clock_by_a_scalar(self, save, name: str, value: float) -> None:
        signals = {name: values for name, values in SIGNALS.items() if name != "time_s"}
        check(read_recording(save({**signals, name: value})))
        check(read_recording(save({**SIGNALS, name: value})))
        with pytest.raises(DataError, match=r"its sample time is 0.02 s, but dt is 0.01 s"):
            read_recording(save({**signals, name: value}), dt=0.01)

    def test_no_times(self, save) -> None:
        signals = {name: values for name, values in SIGNALS.items() if name != "time_s"}
        check(read_recording(save(signals), dt=0.02))
        with pytest.raises(DataError, match=r'no column "time_s".*--dt'):
            read_recording(save(signals))


@pytest.mark.parametrize("kind", [str, np.bytes_])
def test_another_hdf5_file_has_its_units_as_attributes(tmp_path: Path, kind: type) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values, unit in (("t", 20.0 * np.arange(N), "ms"), ("u", COMMAND, "V"), ("y", 0.1 * COMMAND, "mm")):
            file.create_dataset(f"run/{name}", data=values).attrs["units"] = kind(unit)
    check(read_recording(tmp_path / "r.h5", input_column="u", output_column="y"))


@pytest.mark.parametrize("kind", [np.int16, np.float64])
def test_packed_values_of_hdf5_are_unpacked(tmp_path: Path, kind: type) -> None:
    """CF conventions, section 8.1: a value is its packed value times scale_factor, plus add_offset."""
    h5py = pytest.importorskip("h5py")
    counts = np.arange(100, 100 + N).astype(kind)
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"] = TIME
        file["command"], file["displacement"] = counts, counts
        file["command"].attrs.update({"units": "V", "scale_factor": np.float32(0.5)})
        file["displacement"].attrs.update({"units": "mm", "scale_factor": [0.25], "add_offset": -3})
    recording = read_recording(tmp_path / "r.h5")
    np.testing.assert_array_equal(recording.inputs[0], 0.5 * counts)
    np.testing.assert_allclose(recording.outputs[0], 1e-3 * (0.25 * counts - 3.0), rtol=1e-15)


@pytest.mark.parametrize("attribute", ["_FillValue", "missing_value"])
def test_a_fill_value_of_hdf5_is_no_reading(tmp_path: Path, attribute: str) -> None:
    h5py = pytest.importorskip("h5py")
    readings = np.arange(N, dtype=np.int16)
    readings[7] = -9999
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"], file["command_V"], file["displacement_mm"] = TIME, COMMAND, readings
        file["displacement_mm"].attrs[attribute] = np.int16(-9999)
    with pytest.raises(DataError, match=r'row 8, column "displacement_mm": there is no value'):
        read_recording(tmp_path / "r.h5")
    assert sum(r.n_samples for r in read_experiment([tmp_path / "r.h5"], allow_gaps=True).recordings) == N - 1


@pytest.mark.parametrize(
    "attribute",
    ["gain", "Scale", "offset_mm", "volts_per_count", "mm_per_unit", "calibration", "LSB", "probe_attenuation"],
)
@pytest.mark.parametrize("kind", [int, float])
def test_numbers_in_an_unknown_scale_are_refused(tmp_path: Path, attribute: str, kind: type) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"], file["command_V"], file["run/displacement"] = TIME, COMMAND, np.arange(N, dtype=kind)
        file["run/displacement"].attrs.update({"units": "mm", attribute: 2e-4})
    with pytest.raises(
        DataError, match=rf'"run.displacement" .* attribute "{attribute}" is 0.0002, which is not applied; scale'
    ):
        read_recording(tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        del file["run/displacement"].attrs[attribute]
    assert read_recording(tmp_path / "r.h5").outputs[0, 2] == 2e-3


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("calibration_date", 20240501),
        ("calibration_year", "2024"),
        ("last_calibration", "1714521600"),
        ("calibration_uncertainty", 0.01),
        ("calibration_id", "4711"),
        ("attenuation_dB", 0.0),
    ],
)
def test_what_scales_nothing_is_no_scale(tmp_path: Path, attribute: str, value: float | str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"], file["displacement_mm"], file["command"] = TIME, COMMAND, COMMAND
        file["command"].attrs.update({"units": "V", attribute: value})
    np.testing.assert_array_equal(read_recording(tmp_path / "r.h5").inputs[0], COMMAND)


@pytest.mark.parametrize(
    ("said", "refused"), [("1000 V/V", True), (b"1e3", True), ("1", False), ("high", False), ("2024-05-01", False)]
)
def test_a_scale_may_be_written_as_text(tmp_path: Path, said: str | bytes, refused: bool) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"], file["displacement_mm"], file["command"] = TIME, COMMAND, COMMAND
        file["command"].attrs.update({"units": "V", "gain": said})
    if not refused:
        np.testing.assert_array_equal(read_recording(tmp_path / "r.h5").inputs[0], COMMAND)
        return
    with pytest.raises(DataError, match='"command" is in V, and its attribute "gain" is 1000, which is not applied'):
        read_recording(tmp_path / "r.h5")


TEXTS = {"text": str, "bytes": np.bytes_, "list of one": lambda unit: np.array([unit.encode()])}


@pytest.mark.parametrize("write", TEXTS)
@pytest.mark.parametrize("attribute", ["Units", "unit", "UNIT", "unit_string", "EngineeringUnits"])
def test_each_way_to_name_a_unit_in_hdf5(tmp_path: Path, attribute: str, write: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values, unit in (("time", 1e3 * TIME, "ms"), ("u", COMMAND, "V"), ("y", 0.1 * COMMAND, "mm")):
            file[name] = values
            file[name].attrs[attribute] = TEXTS[write](unit)
    check(read_recording(tmp_path / "r.h5", input_column="u", output_column="y"))


@pytest.mark.parametrize("units", ["ms, V, mm", ["ms", "V", "mm"]])
def test_units_of_the_fields_of_a_compound_data_set(tmp_path: Path, units: str | list[str]) -> None:
    h5py = pytest.importorskip("h5py")
    rows = np.rec.fromarrays([1e3 * TIME, COMMAND, 0.1 * COMMAND], names="time,u,y")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["samples"] = rows
        file["samples"].attrs["units"] = units
    check(read_recording(tmp_path / "r.h5", input_column="u", output_column="y"))


@pytest.mark.parametrize("field", ["Name", "name", "label"])
def test_a_name_beside_the_only_vector_of_a_struct(tmp_path: Path, field: str) -> None:
    """As dSPACE and Simulink export signals: in the order of the program, each with its name beside its values."""
    signals = [("y", 0.1 * COMMAND, "mm"), ("", np.zeros_like(COMMAND), ""), ("u", COMMAND, "V")]
    kinds = [(field, object), ("Data", object), ("Unit", object)]
    array = np.array([[(name, values, unit) for name, values, unit in signals]], dtype=kinds)
    clock = {field: "Time", "Data": 1e3 * TIME, "Unit": "ms"}
    savemat(tmp_path / "r.mat", {"run_1": {"X": clock, "Y": array}})
    check(read_recording(tmp_path / "r.mat", input_column="u", output_column="y"))


def test_equal_names_beside_vectors_name_none(tmp_path: Path) -> None:
    kinds = [("name", object), ("values", object)]
    array = np.array([[("a", COMMAND), ("a", 2.0 * COMMAND)]], dtype=kinds)
    savemat(tmp_path / "r.mat", {"s": array, "time": TIME})
    read = read_recording(tmp_path / "r.mat", input_column="s(2).values", output_column="s(1).values")
    np.testing.assert_array_equal(read.inputs[0], 2.0 * COMMAND)


@pytest.mark.parametrize("form", ["Units.{}", "unit.{}", "{}_unit", "{}_units"])
def test_each_way_to_name_a_unit_in_matlab(tmp_path: Path, form: str) -> None:
    variables: dict = {"time": 1e3 * TIME, "u": COMMAND, "y": 0.1 * COMMAND}
    for name, unit in (("time", "ms"), ("u", "V"), ("y", "mm")):
        struct, _, field = form.format(name).rpartition(".")
        if struct:
            variables.setdefault(struct, {})[field] = unit
        else:
            variables[field] = unit
    savemat(tmp_path / "r.mat", variables)
    check(read_recording(tmp_path / "r.mat", input_column="u", output_column="y"))


@pytest.mark.parametrize(("name", "value", "unit"), [("dt", 20.0, "ms"), ("Ts_ms", 20.0, ""), ("fs", 0.05, "kHz")])
def test_the_unit_of_a_sample_time(tmp_path: Path, name: str, value: float, unit: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["command_V"], file["displacement_mm"], file[name] = COMMAND, 0.1 * COMMAND, value
        file[name].attrs["units"] = unit
    assert read_recording(tmp_path / "r.h5").sample_time == pytest.approx(0.02, rel=1e-12)


@pytest.mark.parametrize("mark", [9.91e37, 1e30, 3.4028235e38, 9.969209968386869e36])
def test_marks_of_an_overflow_are_refused(tmp_path: Path, mark: float) -> None:
    savemat(tmp_path / "r.mat", SIGNALS | {"displacement_mm": np.where(np.arange(N) == 7, mark, COMMAND)})
    with pytest.raises(DataError, match=r'row 8, column "displacement_mm": .* marks an overflow or a missing value'):
        read_recording(tmp_path / "r.mat")
    rows = "\n".join(f"{t:.2f},1,{mark if k == 7 else k}" for k, t in enumerate(TIME))
    (tmp_path / "r.csv").write_text(f"time_s,command_V,displacement_mm\n{rows}", encoding="utf-8")
    with pytest.raises(DataError, match=r'row 9, column "displacement_mm": .* marks an overflow or a missing value'):
        read_recording(tmp_path / "r.csv")


@pytest.mark.parametrize("ending", ["csv", "mat", "nc", "tdms"])
@pytest.mark.parametrize("size", [6.0e24, 1.7e308])
@pytest.mark.parametrize("name", ["displacement", "density"])
def test_what_was_written_is_no_overflow(tmp_path: Path, ending: str, size: float, name: str) -> None:
    made = Recording.from_arrays([1.0, 2.0], [size, 0.5 * size], 0.5)
    made = replace(made, output_names=(name,), output_units=("m" if name == "displacement" else "1/m3",))
    write_recording(tmp_path / f"r.{ending}", made)
    np.testing.assert_array_equal(read_recording(tmp_path / f"r.{ending}").outputs, made.outputs)


def test_a_large_number_is_no_overflow(tmp_path: Path) -> None:
    write_csv(tmp_path / "r.csv", {"time_s": [0.0, 0.5], "command_V": [1.0, 2.0], "density": [6e24, 7e24]})
    assert read_recording(tmp_path / "r.csv", output_column="density").outputs[0, 1] == 7e24


@pytest.mark.parametrize(("scale", "offset", "refused"), [(1.0, 0.0, False), (1e-4, 0.0, True), (1.0, 2.0, True)])
def test_a_scale_beside_values_and_unit_in_a_struct(tmp_path: Path, scale: float, offset: float, refused: bool) -> None:
    """As Spike2 exports a channel."""
    channels = {
        name: {"units": unit, "values": values, "scale": scale, "offset": offset}
        for name, unit, values in (("u", "V", COMMAND), ("y", "mm", 0.1 * COMMAND))
    }
    savemat(tmp_path / "r.mat", channels)
    named = {"input_column": "u.values", "output_column": "y.values", "dt": 0.02}
    if refused:
        with pytest.raises(
            DataError, match=r'"u.values" is in V, and its attribute "(scale|offset)" is .*, which is not'
        ):
            read_recording(tmp_path / "r.mat", **named)
    else:
        check(read_recording(tmp_path / "r.mat", **named))


@pytest.mark.parametrize("kind", [int, float])
def test_the_resolution_may_scale_whole_numbers_only(tmp_path: Path, kind: type) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["time_s"], file["command_V"], file["displacement"] = TIME, COMMAND, np.arange(N, dtype=kind)
        file["displacement"].attrs.update({"units": "mm", "resolution": 1e-3})
    if kind is int:
        with pytest.raises(
            DataError, match=r'"displacement" is in mm, and its attribute "resolution" is 0.001, which is'
        ):
            read_recording(tmp_path / "r.h5")
    else:
        assert read_recording(tmp_path / "r.h5").outputs[0, 2] == 2e-3


def test_fields_of_a_compound_data_set_are_columns(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    rows = np.array(list(zip(*SIGNALS.values(), strict=True)), dtype=[(name, float) for name in SIGNALS])
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["run1/samples"] = rows
    check(read_recording(tmp_path / "r.h5"))


def test_complex_numbers_of_matlab_are_no_fields(tmp_path: Path) -> None:
    """MATLAB stores complex arrays as compounds of real and imag."""
    path = hdf5_mat(tmp_path / "rec.mat", SIGNALS)
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "r+") as file:
        file["spectrum"] = np.zeros(N, dtype=[("real", float), ("imag", float)])
        file["spectrum"].attrs["MATLAB_class"] = np.bytes_("double")
    check(read_recording(path))
    with pytest.raises(DataError, match=r'no column "real"'):
        read_recording(path, input_column="real")


def test_integers(tmp_path: Path) -> None:
    counts = np.arange(N, dtype=np.int16)
    path = level_5(tmp_path / "rec.mat", {**SIGNALS, "command_V": counts})
    np.testing.assert_array_equal(read_recording(path).inputs[0], counts)


def test_objects_are_no_vectors(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = hdf5_mat(tmp_path / "rec.mat", {"TT": np.array([[3707764736, 2, 1, 1, 1, 1]])})
    with h5py.File(path, "r+") as file:  # as MATLAB marks a timetable
        file["TT"].attrs["MATLAB_object_decode"] = np.int32(3)
    with pytest.raises(DataError, match=r"no vectors of numbers .* writetimetable"):
        read_recording(path)


def test_text_that_matlab_saved(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "r.mat", np.transpose([TIME, COMMAND, 0.1 * COMMAND]), fmt="%24.16e")
    check(read_recording(tmp_path / "r.mat", input_column="#2=V", output_column="#3=mm"))


@pytest.mark.parametrize("content", [b"", b"no matlab", b"MATLAB 5.0 MAT-file" + bytes(300)])
def test_damaged(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "rec.mat"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"rec.mat: (cannot be read as a MATLAB file|no vectors)"):
        read_recording(path)


def test_written_for_matlab(tmp_path: Path) -> None:
    """Column vectors under valid names in SI units, whatever the signals are called."""
    recording = Recording.from_arrays(
        [1.0, 2.0], [3.0, 4.0], 0.5, start=7.0, input_names=["位移 1"], extras={"temperature": [294.0, 295.0]}
    )
    write_recording(tmp_path / "rec.mat", recording)
    found = loadmat(tmp_path / "rec.mat")
    assert {name for name in found if not name.startswith("__")} == {
        "deatwin",
        "displacement_m",
        "signal_1",
        "temperature_K",
        "time_s",
    }
    np.testing.assert_array_equal(found["time_s"], [[7.0], [7.5]])
    assert read_recording(tmp_path / "rec.mat").input_names == ("位移 1",)


EMPS = Path(os.environ.get("DEATWIN_DATA", Path(__file__).parents[5] / "shared" / "data")) / "emps"


@pytest.mark.skipif(not EMPS.is_dir(), reason="the public recordings emps are not here (see DEATWIN_DATA)")
def test_measured_positioning_system() -> None:
    """Written by MATLAB itself; 24841 samples at 1 kHz, as its README says."""
    recording = read_recording(EMPS / "DATA_EMPS.mat", input_column="vir", output_column="qm")
    assert recording.n_samples == 24841
    assert recording.sample_time == pytest.approx(1e-3, rel=1e-6)


@pytest.mark.parametrize("across", [False, True])
def test_the_signals_of_a_matrix_are_its_columns(tmp_path: Path, across: bool) -> None:
    times, values = np.arange(50) * 0.02, np.random.default_rng(3).normal(size=(2, 50))
    matrix = np.vstack([times, values])
    savemat(tmp_path / "lab.mat", {"data": matrix if across else matrix.T, "image": np.ones((70, 90))})
    header = "data({},:)" if across else "data(:,{})"
    for named in (header.format, "#{}".format):
        columns = {f"{role}_column": named(k) for role, k in (("time", 1), ("input", 2), ("output", 3))}
        found = read_recording(tmp_path / "lab.mat", **columns)
        np.testing.assert_array_equal([found.timepts, found.inputs[0], found.outputs[0]], matrix)


TRIALS = np.column_stack([COMMAND, COMMAND[::-1]])


@pytest.mark.parametrize(
    "units",
    [
        {"u_mV": TRIALS, "y_um": 2.0 * TRIALS},
        {"u": TRIALS, "y": 2.0 * TRIALS, "units": {"u": "mV", "y": "um"}},
        {"u": TRIALS, "y": 2.0 * TRIALS, "u_unit": "mV", "y_unit": "um"},
        {"u": TRIALS, "y": 2.0 * TRIALS, "uUnit": "mV", "yUnit": "um"},
    ],
)
@pytest.mark.parametrize("version", [5, 7.3])
def test_each_trial_in_a_matrix_has_the_unit_of_the_matrix(tmp_path: Path, units: dict, version: float) -> None:
    path = tmp_path / "r.mat"
    savemat(path, {"t": TIME, **units}) if version == 5 else hdf5_mat(path, {"t": TIME, **units})
    names = [name for name, value in units.items() if isinstance(value, np.ndarray)]
    found = read_recording(path, input_column=f"{names[0]}(:,2)", output_column=f"{names[1]}(:,1)")
    np.testing.assert_allclose(found.inputs[0], 1e-3 * COMMAND[::-1], rtol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 2e-6 * COMMAND, rtol=1e-12)
    assert (found.input_units, found.output_units) == (("V",), ("m",))


def test_an_attribute_lists_the_units_of_several_signals(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["t"] = TIME
        scope = file.create_dataset("run/scope", data=np.column_stack([COMMAND, 3.0 * COMMAND]))
        scope.attrs["units"] = ["V", "A"]  # volts times amperes would be watts
    found = read_recording(tmp_path / "r.h5", input_column="scope(2,:)", output_column="scope(1,:)")
    np.testing.assert_array_equal(found.inputs[0], 3.0 * COMMAND)
    assert (found.input_units, found.output_units) == (("A",), ("V",))


@pytest.mark.parametrize("cells", [False, True])
def test_data_of_the_identification_toolbox_are_in_the_units_of_its_fields(tmp_path: Path, *, cells: bool) -> None:
    """As ``get(data)`` returns them: ``Ts`` is in ``TimeUnit``."""
    said = {"TimeUnit": "milliseconds", "InputUnit": "kV", "OutputUnit": "mm"}
    if cells:  # of which MATLAB makes one for each channel
        for name in ("InputUnit", "OutputUnit"):
            cell = np.empty((1, 1), dtype=object)
            cell[0, 0] = said[name]
            said[name] = cell
    data = {"InputData": COMMAND.reshape(-1, 1), "OutputData": COMMAND.reshape(-1, 1), "Ts": 20.0, **said}
    savemat(tmp_path / "r.mat", {"data": data})
    found = read_recording(tmp_path / "r.mat", input_column="InputData", output_column="OutputData")
    assert found.sample_time == pytest.approx(0.02)
    np.testing.assert_allclose(found.inputs[0], 1e3 * COMMAND, rtol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 1e-3 * COMMAND, rtol=1e-12)


@pytest.mark.parametrize(("u", "y"), [("run.u", "run.y"), ("/run/u", "/run/y"), ("run/u", "y")])
def test_a_column_may_be_named_by_its_path(tmp_path: Path, u: str, y: str) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values, unit in (("time", 1e3 * TIME, "ms"), ("u", COMMAND, "V"), ("y", 0.1 * COMMAND, "mm")):
            file[f"run/{name}"] = values
            file[f"run/{name}"].attrs["units"] = unit
    check(read_recording(tmp_path / "r.h5", input_column=u, output_column=y))
    savemat(tmp_path / "r.mat", {"run": {"time": TIME, "u_V": COMMAND, "y_mm": 0.1 * COMMAND}})
    check(read_recording(tmp_path / "r.mat", input_column="run.u_V", output_column="run.y_mm"))


@pytest.mark.parametrize("turned", [False, True])
def test_the_first_column_of_a_matrix_may_be_the_times(
    tmp_path: Path, turned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """As Simulink writes to a file: the times, then the signals."""
    matrix = np.vstack([TIME, COMMAND, 0.1 * COMMAND])
    savemat(tmp_path / "r.mat", {"ans": matrix if turned else matrix.T})
    check(read_recording(tmp_path / "r.mat", input_column="#2=V", output_column="#3=mm"))
    assert "the first column, which rises evenly, is taken as the times in s" in caplog.text


def test_the_rate_of_a_group_is_offered(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values, unit in (("u", COMMAND, "V"), ("y", 0.1 * COMMAND, "mm")):
            file[f"run/{name}"] = values
            file[f"run/{name}"].attrs["units"] = unit
        file["run"].attrs["sampling_rate"] = 1.0 / (TIME[1] - TIME[0])
    with pytest.raises(DataError, match='the file says "sampling_rate = ') as caught:
        read_recording(tmp_path / "r.h5", input_column="u", output_column="y")
    assert caught.value.offers.dt == pytest.approx(TIME[1] - TIME[0])

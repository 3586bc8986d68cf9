"""Public recordings: where they are looked for, what is said of them, and that their absence leaves nothing behind."""

import hashlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.io import savemat
from stopping import interrupted

from deatwin.app import stories
from deatwin.app.cli import main
from deatwin.plant.errors import DataError
from deatwin.studies.folder import ResultFolder
from deatwin.studies.public.records import (
    cascaded_tanks,
    csv_columns,
    emps,
    hdf5_vectors,
    matlab_vectors,
    silverbox_table,
)
from deatwin.studies.public.sources import SOURCES, data_folder, origins
from deatwin.studies.stories import Story

pytestmark = pytest.mark.usefixtures("in_one_process")

RNG = np.random.default_rng(0)
BOX = RNG.standard_normal((2, 300))
TANKS = {name: RNG.uniform(1, 9, (40, 1)) for name in ("uEst", "uVal", "yEst", "yVal")}
MOTOR = {
    "vir": RNG.standard_normal((1500, 1)),
    "gtau": np.array([[35.15]]),
    "qm": RNG.standard_normal((1500, 1)),
    "qg": RNG.standard_normal((1500, 1)),
    "t": 1e-3 * np.arange(1500.0)[:, None],
}


class Input_output_data:
    """As nonlinear_benchmarks 1.0 documents it: u and y, and it unpacks into them."""

    def __init__(self, u: np.ndarray, y: np.ndarray, sampling_time: float) -> None:
        self.u, self.y, self.sampling_time = u, y, sampling_time

    def __iter__(self):
        yield self.u
        yield self.y


class Benchmarks:
    """The loaders that the scenarios use, with the files and return types of nonlinear_benchmarks 1.0."""

    def __init__(self, cache: Path) -> None:
        self.cache = cache

    def Silverbox(self, train_test_split: bool = True, data_file_locations: bool = False):
        print("dataset not found downloading from somewhere")
        folder = self.cache / "Silverbox" / "SilverboxFiles"
        folder.mkdir(parents=True, exist_ok=True)
        files = folder / "Schroeder80mV.mat", folder / "SNLS80mV.mat"
        savemat(files[1], {"V1": BOX[:1], "V2": BOX[1:]})
        return tuple(map(str, files)) if data_file_locations else Input_output_data(BOX[0], BOX[1], 1 / 610.35)

    def Cascaded_Tanks(self, data_file_locations: bool = False):
        folder = self.cache / "Cascaded_Tanks" / "CascadedTanksFiles"
        folder.mkdir(parents=True, exist_ok=True)
        savemat(folder / "dataBenchmark.mat", {**TANKS, "Ts": 4.0})
        if data_file_locations:
            return str(folder / "dataBenchmark.mat")
        return tuple(
            Input_output_data(TANKS[f"u{part}"][:, 0], TANKS[f"y{part}"][:, 0], 4.0) for part in ("Est", "Val")
        )

    def EMPS(self, data_file_locations: bool = False):
        folder = self.cache / "EMPS"
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / "DATA_EMPS.mat", folder / "DATA_EMPS_PULSES.mat"]
        savemat(files[0], MOTOR)
        savemat(files[1], {**MOTOR, "pulses_N": np.zeros((1500, 1))})
        return [str(file) for file in files]


@pytest.fixture
def benchmarks(tmp_path, monkeypatch):
    monkeypatch.delenv("DEATWIN_DATA", raising=False)
    package = Benchmarks(tmp_path / "cache")
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", package)
    return package


def test_what_is_downloaded_is_what_its_loader_returns(benchmarks, capsys):
    table, file = silverbox_table(data_folder(None, "silverbox"))
    assert capsys.readouterr().out == ""  # standard output is for results
    u, y = benchmarks.Silverbox(train_test_split=False)
    np.testing.assert_array_equal(table, np.column_stack([u, y]))
    assert file.name == "SNLS80mV.mat"
    tanks = cascaded_tanks(data_folder(None, "cascaded_tanks"))
    for recording, loaded in zip((tanks.train, tanks.test), benchmarks.Cascaded_Tanks(), strict=True):
        np.testing.assert_array_equal(recording.inputs[0], loaded.u)
        np.testing.assert_array_equal(recording.outputs[0], loaded.y)
        assert recording.sample_time == loaded.sampling_time
    # The reference and the pulses, which no Input_output_data has, are in the files.
    assert [path.name for path in emps(data_folder(None, "emps")).files] == ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"]


def test_a_page_says_where_its_recordings_come_from(benchmarks, tmp_path):
    _, file = silverbox_table(data_folder(None, "silverbox"))
    ((title, published, way, name, digest),) = origins(None, {"silverbox": [file]}).rows
    assert (title, name) == ("Silverbox", "SNLS80mV.mat") and "Wigren & Schoukens" in published
    assert way.startswith("the download of nonlinear_benchmarks")
    assert digest == hashlib.sha256(file.read_bytes()).hexdigest()
    assert origins(tmp_path, {"silverbox": [file]}).rows[0][2] == "the folder given by --data"


def test_the_user_s_folder_comes_first(benchmarks, tmp_path):
    (tmp_path / "own" / "silverbox").mkdir(parents=True)
    assert data_folder(tmp_path / "own", "silverbox") == tmp_path / "own" / "silverbox"
    with pytest.raises(DataError, match="no such folder"):
        data_folder(tmp_path / "own", "emps")
    assert not benchmarks.cache.exists()


def test_a_download_that_fails_is_said(monkeypatch):
    def offline(**_: object) -> None:
        raise OSError("the name of the server cannot be resolved")

    monkeypatch.delenv("DEATWIN_DATA", raising=False)
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", SimpleNamespace(EMPS=offline))
    with pytest.raises(DataError, match=r"could not download the recordings emps \(the name .* --data or DEATWIN_DATA"):
        data_folder(None, "emps")


@pytest.mark.parametrize("name", [name for name, source in SOURCES.items() if not source.loader])
def test_what_the_package_lacks_is_asked_for(name, benchmarks):
    with pytest.raises(DataError, match=f"recordings {name}: give their folder with --data or DEATWIN_DATA$"):
        data_folder(None, name)


@pytest.mark.parametrize("name", ["silverbox", "emps", "cascaded-tanks", "bouc-wen", "vhb4910", "real-data"])
@pytest.mark.parametrize("given", [[], ["--data", "absent"]])
def test_without_recordings_no_folder_stays(name, given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DEATWIN_DATA", raising=False)
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
    (tmp_path / "kept").mkdir()
    for out in ("one/two", "kept/three", "kept"):
        assert main(["scenario", name, *given, "--out", out, "--quiet"]) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["kept"] and not list((tmp_path / "kept").iterdir())


def test_what_is_written_stays(tmp_path):
    with pytest.raises(DataError), ResultFolder(tmp_path / "new" / "results") as folder:
        folder.text("first.txt", "done\n")
        ResultFolder(folder.path / "part").__exit__(DataError, None, None)
        raise DataError("the second cannot be had")
    assert [path.name for path in (tmp_path / "new" / "results").iterdir()] == ["first.txt"]
    with ResultFolder(tmp_path / "empty"):
        pass
    assert (tmp_path / "empty").is_dir()  # asked for, and nothing failed


def test_an_interrupted_story_leaves_no_empty_folder(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "stopped_story", SimpleNamespace(run=interrupted))
    own = Story(name="stopped", line="", minutes=1, module="stopped_story")
    monkeypatch.setattr(stories, "entry_points", lambda group: [SimpleNamespace(load=lambda: (own,))])
    assert main(["scenario", "stopped", "--out", str(tmp_path / "new"), "--quiet"]) == 130
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("kind", ["csv", "mat", "h5"])
@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (np.ones(39), r'signals differ in length \("u" has 40, "y" has 39 samples\); download it again'),
        (np.where(np.arange(40) == 7, np.nan, 1.0), '"y" is nan at sample 7; the published file is finite'),
        (np.where(np.arange(40) == 8, np.inf, 1.0), '"y" is inf at sample 8; the published file is finite'),
    ],
)
def test_a_damaged_file_is_said(kind, wrong, says, tmp_path):
    file, right = tmp_path / f"damaged.{kind}", np.ones(40)
    if kind == "csv":
        cells = [*wrong.astype(str), ""]  # a row that lacks its last number
        file.write_text("u,y\n" + "".join(f"1.0,{cells[k]}\n" for k in range(40)))
        says = says if wrong.size == 40 else '"y" is nan at sample 39'
    elif kind == "mat":
        savemat(file, {"u": right, "y": wrong, "gain": 3.0})
    else:
        with pytest.importorskip("h5py").File(file, "w") as made:
            made.create_dataset("set/u", data=right)
            made.create_dataset("set/y", data=wrong)
    with pytest.raises(DataError, match=says):
        if kind == "csv":
            csv_columns(file, ("u", "y"))
        elif kind == "mat":
            matlab_vectors(file, ("u", "y", "gain"))
        else:
            hdf5_vectors(file, "set", ("u", "y"))


def test_the_recorded_motor_force_holds_the_pulses_already(tmp_path):
    # A motor of 35 N/V at 1 V throughout: whatever the column of pulses says, 35 N went in.
    steady = {**MOTOR, "vir": np.ones((1500, 1)), "gtau": [[35.0]]}
    savemat(tmp_path / "DATA_EMPS.mat", steady)
    savemat(tmp_path / "DATA_EMPS_PULSES.mat", {**steady, "pulses_N": np.full((1500, 1), 5.0)})
    np.testing.assert_allclose(emps(tmp_path).test.inputs, 35.0, rtol=1e-3)

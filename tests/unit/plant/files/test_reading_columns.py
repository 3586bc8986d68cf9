"""Columns of further readings in files: named in the rig, with their units, with missing values."""

from pathlib import Path

import numpy as np
import pytest
from rig_files import RIG

from deatwin.plant import DataError, Reading, Recording, RigError, read_experiment, read_recording, read_rig
from deatwin.plant.files import csvtable, write_recording
from deatwin.plant.rigs.rigfile import RigFile

pytestmark = pytest.mark.usefixtures("in_one_process")

SECTIONS = """
[readings.current]
column = "I_mon=nA"
unit = "nA"
noise = 5.0
series_resistance_Mohm = 200.0

[readings.capacitance]
unit = "pF"
noise = 1.5
model_error = 2.0
"""


def rows(header: str, *values: str) -> str:
    lines = [f"{0.02 * k:.2f},{k % 3},{0.1 * k:.2f},{value}" for k, value in enumerate(values)]
    return "\n".join([header, *lines]) + "\n"


def test_a_rig_file_says_which_columns_are_which(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG + SECTIONS)
    rig = read_rig(tmp_path / "rig.toml")
    current, capacitance = rig.readings
    assert (current.unit, current.noise, current.series_resistance) == ("A", pytest.approx(5e-9), pytest.approx(2e8))
    assert (capacitance.unit, capacitance.noise, capacitance.model_error) == ("F", 1.5e-12, 2e-12)
    (tmp_path / "lab.csv").write_text(
        rows("time_s,command_V,displacement_mm,I_mon,C_mess,capacitance_nF", "3,9,1", "4.5,9,1.2", ",9,", "nan,9,1.1")
    )
    read = read_experiment([tmp_path / "lab.csv"], rig=rig).recordings[0]
    assert read.output_names == ("displacement",)
    np.testing.assert_array_equal(read.extras["current"], [3e-9, 4.5e-9, np.nan, np.nan])
    np.testing.assert_array_equal(read.extras["capacitance"], [1e-9, 1.2e-9, np.nan, 1.1e-9])
    assert read.extra_units == {"current": "A", "capacitance": "F"}


def test_a_rig_file_with_readings_is_written_as_it_was_read(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG + SECTIONS)
    rig = read_rig(tmp_path / "rig.toml")
    again = RigFile.from_dict(rig.to_dict(), rig.source)
    assert [vars(reading) for reading in again.readings] == [pytest.approx(vars(reading)) for reading in rig.readings]


@pytest.mark.parametrize("name", ["again.csv", "again.nc"])
def test_missing_values_are_written_and_read_back(tmp_path: Path, name: str) -> None:
    current = np.array([1e-7, np.nan, 3.3e-9, np.nan])
    one = Recording.from_arrays(
        np.arange(4.0), np.arange(4.0), 0.1, extras={"current": current}, provenance={"by": "me"}
    )
    write_recording(tmp_path / name, one)
    np.testing.assert_array_equal(read_recording(tmp_path / name).extras["current"], current)


def test_marks_of_missing_values_are_looked_for_only_where_a_column_has_some(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked: list[str] = []
    known = csvtable._is_absent

    def is_absent(cell: str) -> bool:
        looked.append(cell)
        return known(cell)

    monkeypatch.setattr(csvtable, "_is_absent", is_absent)
    (tmp_path / "lab.csv").write_text(
        rows("time_s,command_V,displacement_mm,current_uA,capacitance_nF", "1,2", "NaN,3", "n/a,4", "5e-1,5")
    )
    read = read_recording(tmp_path / "lab.csv")
    assert looked == ["1", "NaN", "n/a", "5e-1"]
    np.testing.assert_array_equal(read.extras["current"], [1e-6, np.nan, np.nan, 5e-7])
    np.testing.assert_array_equal(read.extras["capacitance"], [2e-9, 3e-9, 4e-9, 5e-9])
    np.testing.assert_array_equal(read.outputs[0], [0.0, 1e-4, 2e-4, 3e-4])


def test_only_electrical_readings_may_have_missing_values(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_text(rows("time_s,command_V,displacement_mm,current_uA", "1", "", "2"))
    read = read_recording(tmp_path / "lab.csv")
    np.testing.assert_array_equal(read.extras["current"], [1e-6, np.nan, 2e-6])
    (tmp_path / "lab.csv").write_text(rows("time_s,command_V,displacement_mm,temperature_C", "1", "", "2"))
    with pytest.raises(DataError, match='row 3, column "temperature_C": the cell is empty'):
        read_recording(tmp_path / "lab.csv")


def test_a_reading_of_a_rig_of_ones_own_is_found_under_its_name(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_text(rows("time_s,command_V,displacement_mm,flow (m/s)", "1", "3", "2"))
    wanted = [Reading(name="flow", unit="m/s", noise=0.1), Reading(name="absent", noise=1.0)]
    assert read_recording(tmp_path / "lab.csv", readings=wanted).extras.keys() == {"flow"}


def test_faults_of_columns_are_said(tmp_path: Path) -> None:
    (tmp_path / "lab.csv").write_text(rows("time_s,command_V,displacement_mm,I_mon", "1", "3", "2"))
    for column, text in (
        ("I_mom=nA", 'no column "I_mom"; .* did you mean "I_mon"'),
        ("I_mon=mm", 'the column "I_mon" is in mm, but the model needs it in A'),
    ):
        with pytest.raises(DataError, match=text):
            read_recording(tmp_path / "lab.csv", readings=[Reading(name="current", noise=1e-9, column=column)])
    bare = Reading(name="current", noise=1e-9, unit="A", column="I_mon")
    with pytest.raises(DataError, match=r'"I_mon=UNIT", with one of A, mA, uA, nA, pA, kA$'):  # A is hardly meant
        read_recording(tmp_path / "lab.csv", readings=[bare])


@pytest.mark.parametrize(
    ("section", "text"),
    [
        ("[readings.current]\nnoise = 1\n", r'\[readings.current\]: the key "unit" is missing'),
        (
            '[readings.current]\nunit = "pF"\nnoise = 1\n',
            r'unit: "pF" is not a unit of the current; it must be one of A, mA',
        ),
        ('[readings.current]\nunit = "nA"\nnoise = 0\n', r"\[readings.current\] noise: 0 is out of range"),
        ('[readings.current]\nunit = "nA"\nnoize = 1\nnoise = 1\n', 'unknown key "noize"; did you mean "noise"'),
    ],
)
def test_faults_of_sections_are_said(tmp_path: Path, section: str, text: str) -> None:
    (tmp_path / "rig.toml").write_text(RIG + section)
    with pytest.raises(RigError, match=text):
        read_rig(tmp_path / "rig.toml")

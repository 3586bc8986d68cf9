"""Excel workbooks, made by openpyxl."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant import safe_read
from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording
from deatwin.plant.files.formats import xlsx

openpyxl = pytest.importorskip("openpyxl")
ASKED = {"input_column": "U (V)", "output_column": "#4"}


def book(path: Path, *, dates: bool) -> Path:
    """A title, a blank row, a header from column B on, samples every 20 ms, and an empty sheet."""
    made = openpyxl.Workbook()
    made.active.append(["Film 7"])
    made.active.append([])
    made.active.append([None, "Time (ms)" if not dates else "Timestamp", "U (V)", "x (mm)", "remark"])
    for k in range(4):
        time = datetime(2024, 5, 1, 12) + timedelta(milliseconds=20 * k) if dates else 20 * k
        made.active.append([None, time, 0.25 * k, k, 'a "remark"\n' if k == 1 else None])
    made.create_sheet("empty")
    made.save(path)
    return path


@pytest.mark.parametrize("dates", [False, True])
def test_sheet(tmp_path: Path, dates: bool) -> None:
    recording = read_recording(book(tmp_path / "rec.xlsx", dates=dates), **ASKED)
    assert (recording.sample_time, recording.start, recording.provenance["rows"]) == (0.02, 0.0, "4-7")
    np.testing.assert_array_equal(recording.inputs, [[0.0, 0.25, 0.5, 0.75]])
    np.testing.assert_array_equal(recording.outputs, [[0.0, 0.001, 0.002, 0.003]])
    assert recording.provenance.get("clock_began") == ("2024-05-01T12:00:00" if dates else None)


@pytest.mark.parametrize("header", ["duty (%)", "duty"])
@pytest.mark.parametrize("shown", ["0.0%", "General"])
def test_percentages(tmp_path: Path, header: str, shown: str) -> None:
    """A cell that holds 0.5 and shows 50.0 % is half the range, whatever the header says; one that shows 50 is 50."""
    made = openpyxl.Workbook()
    made.active.append(["time (s)", header, "x (mm)"])
    duties = [0.07, 0.5, 0.625, 0.4]
    for k, duty in enumerate(duties):
        given = duty if shown == "0.0%" or header == "duty" else 100 * duty
        made.active.append([0.02 * k, given, k])
        made.active.cell(row=k + 2, column=2).number_format = shown
    made.save(path := tmp_path / "rec.xlsx")
    read = read_recording(path, input_column=header, output_column="x (mm)")
    np.testing.assert_allclose(read.inputs, [duties], rtol=1e-15)


def test_several_sheets(tmp_path: Path) -> None:
    path = book(tmp_path / "rec.xlsx", dates=False)
    made = openpyxl.load_workbook(path)
    made["empty"].append(["operator", "Ada"])
    made.save(path)
    np.testing.assert_array_equal(read_recording(path, **ASKED).outputs, [[0.0, 0.001, 0.002, 0.003]])  # only notes
    for row in ("tu", *[(k, k) for k in range(3)]):
        made["empty"].append(tuple(row))
    made.save(path)
    with pytest.raises(DataError, match=r'2 sheets hold cells, "Sheet", "empty"; name one .* as in ".*rec.xlsx#Sheet"'):
        read_recording(path, **ASKED)
    named = read_recording(f"{path}#Sheet", **ASKED)
    np.testing.assert_array_equal(named.outputs, [[0.0, 0.001, 0.002, 0.003]])
    assert named.provenance["file"] == f"{path}#Sheet"
    with pytest.raises(
        DataError, match=r'no sheet "sheet" with cells; did you mean "Sheet"\?; there are "Sheet", "empty"'
    ):
        read_recording(f"{path}#sheet", **ASKED)
    with pytest.raises(DataError, match="no such file"):
        read_recording(tmp_path / "other.xlsx#Sheet", **ASKED)


def test_a_hidden_sheet_is_read_only_by_name(tmp_path: Path) -> None:
    path = book(tmp_path / "rec.xlsx", dates=False)
    made = openpyxl.load_workbook(path)
    made["empty"].title = "old"
    for row in (("time_s", "U (V)", "z", "x (mm)"), *[(k, k, 0, 5 * k) for k in range(9)]):
        made["old"].append(row)
    made["old"].sheet_state = "hidden"
    made.save(path)
    np.testing.assert_array_equal(read_recording(path, **ASKED).outputs, [[0.0, 0.001, 0.002, 0.003]])
    assert read_recording(f"{path}#old", **ASKED).n_samples == 9


def test_a_hidden_sheet_is_named_where_the_visible_one_holds_no_samples(tmp_path: Path) -> None:
    made = openpyxl.Workbook()
    made.active.append(["Operator", "X"])
    data = made.create_sheet("raw")
    for row in (("time_s", "U (V)", "z", "x (mm)"), *[(k, k, 0, 5 * k) for k in range(9)]):
        data.append(row)
    data.sheet_state = "hidden"
    made.save(path := tmp_path / "rec.xlsx")
    with pytest.raises(DataError, match=r'no samples; a hidden sheet is read if .* "\S*rec\.xlsx#raw"'):
        read_recording(path, **ASKED)
    assert read_recording(f"{path}#raw", **ASKED).n_samples == 9


@pytest.mark.parametrize("form", ["", "hh:mm:ss", "mm:ss.0", "[h]:mm:ss"])
def test_times_of_day_go_on_past_midnight(tmp_path: Path, form: str) -> None:
    """As cells of times, and as numbers of days that a program wrote and that a workbook shows as times."""
    made = openpyxl.Workbook()
    made.active.append(["Time", "U (V)", "remark", "x (mm)"])
    for k in range(4):
        of_day = (datetime(2024, 5, 1, 23, 59, 59) + timedelta(seconds=0.5 * k)).time()
        made.active.append([(86399 + 0.5 * k) / 86400 if form else of_day, k, None, k])
        if form:
            made.active.cell(row=k + 2, column=1).number_format = form
    made.save(tmp_path / "rec.xlsx")
    recording = read_recording(tmp_path / "rec.xlsx", **ASKED)
    assert (recording.sample_time, recording.n_samples) == (pytest.approx(0.5, rel=1e-6), 4)


@pytest.mark.parametrize("form", ["h:mm", "d hh:mm:ss", "[h]:mm:ss"])
@pytest.mark.parametrize("hours", [6.0, 24.0, 30.0])
def test_times_over_many_days_are_counted_in_full(tmp_path: Path, form: str, hours: float) -> None:
    """A workbook counts days from 1900, and shows of them what the form asks for."""
    made = openpyxl.Workbook()
    made.active.append(["Time", "U (V)", "remark", "x (mm)"])
    for k in range(8):
        made.active.append([0.5 + k * hours / 24, k, None, k])
        made.active.cell(row=k + 2, column=1).number_format = form
    made.save(tmp_path / "rec.xlsx")
    recording = read_recording(tmp_path / "rec.xlsx", **ASKED)
    assert (recording.sample_time, recording.n_samples) == (pytest.approx(3600 * hours, rel=1e-6), 8)


def test_what_unpacks_to_too_much(tmp_path: Path, monkeypatch) -> None:
    path = book(tmp_path / "rec.xlsx", dates=False)
    monkeypatch.setattr(xlsx, "TEXT_BYTES", 1000)
    assert safe_read.TEXT_BYTES > 1000
    with pytest.raises(DataError, match=r"it unpacks to .*; at most 1"):
        read_recording(path, **ASKED)

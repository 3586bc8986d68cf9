"""Uneven times in files of every shape: the offered clock works, and the columns take a rig's own units."""

import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_commands, read_recording, read_recordings

pytestmark = pytest.mark.usefixtures("in_one_process")

STEP = 0.02
TIMES = STEP * np.arange(60) + 0.001 * np.random.default_rng(4).integers(-6, 7, 60)
SPEED = 50.0 * (TIMES - TIMES[0])  # rpm; a straight line is interpolated exactly
NAMES = ("u", "speed (rpm)")


def table(folder: Path, name: str, cells: list[str], header: str, between: str = ",") -> Path:
    rows = [between.join([cell, "0.5", repr(float(y))]) for cell, y in zip(cells, SPEED, strict=True)]
    path = folder / name
    path.write_text("\n".join([*filter(None, [header]), *rows, ""]), encoding="utf-8")
    return path


def headed(times: str) -> str:
    return ",".join([times, *NAMES])


def named(folder: Path) -> Path:
    return table(folder, "named.csv", [repr(float(1e3 * t)) for t in TIMES], headed("clock"))


def stamped(folder: Path) -> Path:
    header = headed("Timestamp (us)").replace(",", "\t")
    return table(folder, "unit.tsv", [repr(float(1e6 * t)) for t in TIMES], header, "\t")


def unix(folder: Path) -> Path:
    return table(folder, "unix.csv", [f"{1_709_251_199 + t:.3f}" for t in TIMES], headed("unixTime"))


def dates(folder: Path) -> Path:
    began = datetime(2024, 2, 29, 23, 59, 59, 500_000)
    return table(folder, "dates.csv", [str(began + timedelta(seconds=float(t))) for t in TIMES], headed("time"))


def bare(folder: Path) -> Path:
    return table(folder, "bare.dat", [repr(float(t)) for t in TIMES], "", "  ")


def labview(folder: Path) -> Path:
    end = "***End_of_Header***"
    head = [
        "LabVIEW Measurement",
        "Separator\tTab",
        "X_Columns\tOne",
        end,
        "",
        "Channels\t2",
        "Y_Unit_Label\tV\trpm",
        "X_Dimension\tTime\tTime",
        end,
        "X_Value\tu\tspeed\tComment",
    ]
    return table(folder, "labview.lvm", [repr(float(t)) for t in TIMES], "\n".join(head), "\t")


def workbook(folder: Path) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    made = openpyxl.Workbook()
    made.active.append(["Timestamp", *NAMES])
    for time, speed in zip(TIMES, SPEED, strict=True):
        made.active.append([float(time), 0.5, float(speed)])
    made.save(folder / "book.xlsx")
    return folder / "book.xlsx"


def matlab(folder: Path) -> Path:
    scipy.io.savemat(folder / "m.mat", {"clock": 1e3 * TIMES, "u": np.full(60, 0.5), "speed_rpm": SPEED})
    return folder / "m.mat"


BY_NAME = {"input_column": "u", "output_column": "speed"}
SHAPES = [
    (named, {**BY_NAME, "time_column": "clock=ms"}),
    (stamped, BY_NAME),
    (unix, BY_NAME),
    (dates, BY_NAME),
    (bare, {"input_column": "#2", "output_column": "#3=rpm", "time_column": "#1"}),
    (labview, BY_NAME),
    (workbook, BY_NAME),
    (matlab, {**BY_NAME, "time_column": "clock=ms"}),
]


@pytest.mark.parametrize(("shape", "asked"), SHAPES)
@pytest.mark.parametrize("unit", [None, "rad/s", "rpm"])
def test_the_clock_that_is_offered_works(
    tmp_path: Path, shape: Callable[[Path], Path], asked: dict[str, str], unit: str | None
) -> None:
    path = shape(tmp_path)
    with pytest.raises(DataError, match="uneven sampling") as told:
        read_recording(path, output_unit=unit, **asked)
    (step,) = re.findall(r"--resample (\S+), in Python", str(told.value))
    found = read_recording(path, resample=float(step), output_unit=unit, **asked)
    assert found.sample_time == float(step) == pytest.approx(STEP, rel=0.1)
    assert "jitter" in found.provenance["resampled"]
    per_second = 50.0 if unit == "rpm" else 50.0 * np.pi / 30
    np.testing.assert_allclose(found.outputs[0], per_second * (found.timepts - found.start), rtol=1e-9, atol=1e-9)
    assert found.output_units == (unit or "rad/s",)
    np.testing.assert_array_equal(found.inputs, np.full((1, found.n_samples), 0.5))
    commands = {key: name for key, name in asked.items() if key != "output_column"}
    assert read_commands(path, resample=float(step), **commands).n_samples == found.n_samples


@pytest.mark.parametrize("shape", [named, bare])
def test_times_that_nothing_names_are_offered_with_a_clock(tmp_path: Path, shape: Callable[[Path], Path]) -> None:
    asked = {"input_column": "#2", "output_column": "#3"}
    with pytest.raises(DataError) as told:
        read_recording(shape(tmp_path), **asked)
    ((column, step),) = re.findall(r'--time-column "(\S+)" --resample ([\d.]+)', str(told.value))
    found = read_recording(shape(tmp_path), time_column=column, resample=float(step), **asked)
    assert found.n_samples == pytest.approx(60, abs=6)


def test_a_clock_that_needs_gaps_is_offered_with_them(tmp_path: Path) -> None:
    late = TIMES + np.where(np.arange(60) < 30, 0.0, 1.0)
    path = table(tmp_path, "gap.csv", [repr(float(t)) for t in late], headed("time"))
    with pytest.raises(DataError, match="uneven sampling") as told:
        read_recordings(path, **BY_NAME)
    (step,) = re.findall(r"--resample (\S+) --allow-gaps, in Python resample=\S+, allow_gaps=True", str(told.value))
    assert len(read_recordings(path, resample=float(step), allow_gaps=True, **BY_NAME)) == 2


@pytest.mark.parametrize("every", [True, False])
def test_copies_of_rows_are_no_finer_clock(tmp_path: Path, every: bool) -> None:
    rows = [f"{STEP * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    head = ["time_s,command_V,displacement_mm"]
    copied = [row for k, row in enumerate(rows) for _ in range(2 if every or k == 9 else 1)]
    (tmp_path / "r.csv").write_text("\n".join([*head, *copied, ""]), encoding="utf-8")
    said = r"row 3: .* \(40 such rows in all\)" if every else r"row 12: the row repeats the one before"
    with pytest.raises(DataError, match=f"{said}; remove the repeated rows$") as caught:
        read_recording(tmp_path / "r.csv")
    assert not caught.value.offers

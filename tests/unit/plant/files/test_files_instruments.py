"""Tables as instruments export them: the values that are read are those that were written."""

import json
from collections.abc import Callable, Iterable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, read_recordings
from deatwin.plant.files.understood import understand

DT = 0.02
T = DT * np.arange(60)
U, Y = np.round(1.5 + np.sin(9 * T), 4), np.round(2.5 + np.cos(4 * T), 4)


def table(*columns: Iterable[object], mark: str = ",") -> str:
    return "\n".join(mark.join(map(str, row)) for row in zip(*columns, strict=True)) + "\n"


def plain(first: Iterable[object] = np.round(T, 2), mark: str = ",") -> str:
    return table(first, U, Y, mark=mark)


LOGGED = "Number,Date&Time,ms,CH1,CH2,Alarm\nNO.,Time,ms,V,mm,A1234\n" + table(
    range(1, 61),
    [f"2024/05/01 10:11:{12 + k // 50}" for k in range(60)],
    [20 * k % 1000 for k in range(60)],
    U,
    Y,
    "L" * 60,
)
TITLES = "Interval=\t0.02 s\nChannelTitle=\tCommand\tLaser\nRange=\t10 V\t10 mm\nUnitName=\tV\tmm\n"
LIMITS = "TopValue=\t10\t10\nBottomValue=\t-10\t-10\n"
BLOCK = (
    '"BlockNumber",1\n"TraceName"," CH1"," CH2"\n"VUnit"," V"," mm"\n"SampleRate",5.0E+01,5.0E+01\n"HUnit"," s"," s"\n'
    '"Time"," 10:11:12"," 10:11:12"\n"HResolution",2.0E-02,2.0E-02\n"HOffset",0.0E+00,0.0E+00\n\n'
)
STAMPS = [f"23:59:{58 + k // 50}.{20 * k % 1000 + k % 3:03d}" for k in range(60)]  # late by up to 2 ms
READ = {
    "lines with the time at which they came": (
        "23:59:57.999 -> t_ms,Cmd_V,Laser_mm\n" + table((f"{at} -> {20 * k}" for k, at in enumerate(STAMPS)), U, Y),
        "Cmd",
        "Laser",
        {},
    ),
    "times of a meter": (
        "Index,Reading,Unit,Value,Unit,Relative Time\n" + table(range(1, 61), Y, ["mm"] * 60, U, ["V"] * 60, T),
        "Value",
        "Reading",
        {},
    ),
    "units above the names": ("ms,V,mm\nTime,Cmd,Laser\n" + plain(20 * np.arange(60)), "Cmd", "Laser", {}),
    "units above some names": (
        "Units:,V,mm,\nTime (ms),Cmd,Laser,Flag\n" + table(20 * np.arange(60), U, Y, [1] * 60),
        "Cmd",
        "Laser",
        {},
    ),
    "units in columns of their own": (
        "time_s,Cmd,Unit,Laser,Laser unit\n" + table(T, U, ["V"] * 60, Y, ["mm"] * 60),
        "Cmd",
        "Laser",
        {},
    ),
    "units and an unknown word": (
        "Time,Cmd,Laser,Flag\ns,V,mm,status\n" + table(T, U, Y, [1] * 60),
        "Cmd",
        "Laser",
        {},
    ),
    "units and an empty cell": (
        "Time,Cmd,Laser,Note\n[s],[V],[mm],\n" + table(T, U, Y, ["x"] * 60),
        "Cmd",
        "Laser",
        {},
    ),
    "units below channels": (LOGGED, "CH1", "CH2", {"dt": DT}),
    "units behind a mark of comments": (
        "\tPt\tT\tVf\tIm\n\t#\ts\tV\tmm\n" + table([""] * 60, range(60), T, U, Y, mark="\t"),
        "Vf",
        "Im",
        {},
    ),
    "settings behind the units": (
        "X,CH1,CH2,Start,Increment,\nSequence,VOLT,mm,-2.4E+00,2.0E-02\n" + table(range(60), U, Y, [""] * 60),
        "CH1",
        "CH2",
        {"dt": DT},
    ),
    "units without a name": ("[s],Cmd[V],Laser[mm]\n" + plain(), "Cmd", "Laser", {}),
    "units in wide brackets": ("t\uff08s\uff09,u\uff08V\uff09,y\uff08mm\uff09\n" + plain(), "u", "y", {}),
    "units behind in": ("in s,C1 in V,C2 in mm\n" + plain(), "C1", "C2", {}),
    "units of LaTeX below the names": (
        "t,U,x\n\\si{\\milli\\second},\\si{\\kilo\\volt},\\si{\\micro\\metre}\n"
        + table(20 * np.arange(60), [f"{u / 1e3:.7f}" for u in U], [f"{1e3 * y:.1f}" for y in Y]),
        "U",
        "x",
        {},
    ),
    "units in place of names, beside date and time": (
        "Ch,,,CH1,CH2\nDate,Time,sec,kV,um\n"
        + table(
            ["2024/05/01"] * 60,
            [f"10:11:{12 + k // 50}" for k in range(60)],
            [f"{0.02 * k % 1:.2f}" for k in range(60)],
            [f"{u / 1e3:.7f}" for u in U],
            [f"{1e3 * y:.1f}" for y in Y],
        ),
        "kV",
        "um",
        {"dt": DT},
    ),
    "a mark of UTF-8 within joined files": (
        "\ufefftime_s,u_V,y_mm\n" + plain().replace("\n0.5,", "\n\ufeff0.5,"),
        "u_V",
        "y_mm",
        {},
    ),
    "cells kept from a spreadsheet's guesses": (
        '="time_s",="u_V",="y_mm"\n' + "".join(f'="{t:.2f}",="{u}",="{y}"\n' for t, u, y in zip(T, U, Y, strict=True)),
        "u_V",
        "y_mm",
        {},
    ),
    "pages with a header each": (
        "\f".join(
            "time_s u_V y_mm\n" + table(np.round(T, 2)[k : k + 20], U[k : k + 20], Y[k : k + 20], mark=" ")
            for k in (0, 20, 40)
        ),
        "u_V",
        "y_mm",
        {},
    ),
    "units of none of the columns": (
        "time_s,u_V,y_mm\n-,-,-\n" + plain(),
        "u_V",
        "y_mm",
        {},
    ),
    "a block of channels": (BLOCK + table([""] * 60, U, Y), "CH1", "CH2", {"dt": DT}),
    "a block of titles": (TITLES + LIMITS + plain(mark="\t"), "Command", "Laser", {"time_column": "#1"}),
    "a block of titles that ends in units": (TITLES + plain(mark="\t"), "Command", "Laser", {"time_column": "#1"}),
    "a block of titles without times": (TITLES + LIMITS + table(U, Y, mark="\t"), "Command", "Laser", {"dt": DT}),
    "a comment behind a row": (
        "time_s,u_V,y_mm\n" + table(T, U, [f"{y},#* pulse" if k == 9 else y for k, y in enumerate(Y)]),
        "u_V",
        "y_mm",
        {},
    ),
    "dashes before numbers": (
        "Time (s);Cmd (V);Laser (mm)\n" + plain(mark=";").replace(";", ";\u2013"),
        "Cmd (V)",
        "Laser (mm)",
        {},
    ),
    "units among words above remarks": (
        '"TOA5","CR1000","1234","fast"\n"TIMESTAMP","RECORD","Cmd","Laser"\n"TS","RN","V","mm"\n"","","Smp","Avg"\n'
        + table((f"2024-05-01 10:11:{12 + t:05.2f}" for t in T), range(60), U, Y),
        "Cmd",
        "Laser",
        {},
    ),
    "a remark with the name of a clock": (
        "Time\tCmd\tLaser\ns\tV\tmm\nclock\tAO0\tlaser 1\n" + plain(mark="\t"),
        "Cmd",
        "Laser",
        {},
    ),
    "blanks behind the signs": (
        "Time (s),Cmd (V),Laser (mm)\n" + plain().replace(",", ",-   "),
        "Cmd (V)",
        "Laser (mm)",
        {},
    ),
    "durations of MATLAB": ("Time,u_V,y_mm\n" + plain(f"{t:g} sec" for t in T), "u_V", "y_mm", {}),
    "durations in minutes": ("Time;u_V;y_mm\n" + plain((f"{t / 60:.15f} min" for t in T), ";"), "u_V", "y_mm", {}),
    "numbers of rows in R": (
        '"time_s" "u_V" "y_mm"\n' + table((f'"{k}"' for k in range(1, 61)), np.round(T, 2), U, Y, mark=" "),
        "u_V",
        "y_mm",
        {},
    ),
    "a remark at the end": ("time_s,u_V,y_mm\n" + plain() + "End of data", "u_V", "y_mm", {}),
    "a sign with two codes": ("time_s,U\u2126 (V),y_mm\n" + plain(), "U\u03a9 (V)", "y_mm", {}),
    "a label before each name": (
        "Latest: t (s),Latest: u (V),Latest: y (mm)\n" + plain(),
        "Latest: u (V)",
        "Latest: y (mm)",
        {"time_column": "#1"},
    ),
    "a title above a label before each name": (
        "Run 1,,\nLatest: t,Latest: u,Latest: y\ns,V,mm\n" + plain(),
        "Latest: u",
        "Latest: y",
        {"time_column": "#1"},
    ),
    "groups above a label before each name": (
        "clock,drive,laser\nRun: t (s),Run: u (V),Run: y (mm)\n" + plain(),
        "Run: u (V)",
        "Run: y (mm)",
        {"time_column": "#1"},
    ),
    "labels of Simulink": (
        "time,cmd,pos\n,Type: double,Type: double\n,Units: V,Units: mm\n,Interp: zoh,Interp: zoh\n" + plain(),
        "cmd",
        "pos",
        {},
    ),
    "the month first": (
        "Timestamp;u_V;y_mm\n" + plain((f"May 1, 2024 10:11:{12 + t:05.2f}" for t in T), mark=";"),
        "u_V",
        "y_mm",
        {},
    ),
    "units among the settings of an oscilloscope": (
        "Model,MSO64\nHorizontal Units,s\nSample Interval,0.02\nVertical Units,V,mm\nVertical Scale,1,1\n,\nTIME,CH1,CH2\n"
        + plain(),
        "CH1",
        "CH2",
        {},
    ),
    "units among the settings of LabVIEW": (
        "Channels\t2\nSamples\t60\t60\nY_Unit_Label\tV\tmm\nDelta_X\t0.02\t0.02\n***End_of_Header***\nX_Value\tCmd\tLaser\n"
        + plain(mark="\t"),
        "Cmd",
        "Laser",
        {"time_column": "X_Value"},
    ),
    "units of a potentiostat": (
        "\tPt\tT\tVf\tIm\n\t#\ts\tV vs. Ref.\tmm\n" + table([""] * 60, range(60), T, U, Y, mark="\t"),
        "Vf",
        "Im",
        {},
    ),
    "commas between names above blanks": (
        "# t [s], u [V], y [mm]\n" + plain(mark=" "),
        "u [V]",
        "y [mm]",
        {"time_column": "#1"},
    ),
    "commas before units and in numbers": (
        "Zeit, s;Kommando, V;Weg, mm\n" + plain(mark=";").replace(".", ","),
        "Kommando, V",
        "Weg, mm",
        {},
    ),
    "ruled lines of a report": (
        "Time Cmd Laser\n==== === =====\n(s) (V) (mm)\n--------------\n" + plain(mark="  "),
        "Cmd",
        "Laser",
        {},
    ),
    "a table of Markdown": (
        "| t (s) | u (V) | y (mm) |\n|---|---|---|\n" + table([""] * 60, np.round(T, 2), U, Y, mark="|"),
        "u (V)",
        "y (mm)",
        {"time_column": "t (s)"},
    ),
    "dates without marks": (
        "Time,u_V,y_mm\n" + plain(f"202405011011{12000 + round(1e3 * t):05d}" for t in T),
        "u_V",
        "y_mm",
        {},
    ),
    "dates of C": (
        "Timestamp,u_V,y_mm\n" + plain(f"Wed May  1 10:11:{12 + t:05.2f} 2024" for t in T),
        "u_V",
        "y_mm",
        {},
    ),
}


@pytest.mark.parametrize("kind", READ)
def test_values_units_and_times_are_those_of_the_instrument(tmp_path: Path, kind: str) -> None:
    text, command, reading, options = READ[kind]
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column=command, output_column=reading, **options)
    sign = -1.0 if kind in ("dashes before numbers", "blanks behind the signs") else 1.0
    np.testing.assert_allclose(found.inputs[0], sign * U, rtol=1e-12)
    np.testing.assert_allclose(found.outputs[0], sign * 1e-3 * Y, rtol=1e-12)
    assert (found.input_units, found.output_units) == (("V",), ("m",))
    assert found.sample_time == pytest.approx(DT, rel=1e-6)


def test_days_before_a_time_are_counted(tmp_path: Path) -> None:
    """A pandas index of time differences, which passes a whole day."""
    times = [f"{k // 50} days {'23:59:59' if k < 50 else '00:00:00'}.{20 * (k % 50):03d}000" for k in range(60)]
    (tmp_path / "r.csv").write_text(",u_V,y_mm\n" + plain(times), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", time_column="#1")
    assert (found.sample_time, found.n_samples) == (pytest.approx(DT), 60)


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_only_ends_of_lines_part_lines(tmp_path: Path, encoding: str) -> None:
    """In Windows-1252, three dots are the byte 85, which is the end of a line in Latin-1."""
    (tmp_path / "r.csv").write_bytes(
        f"Zeit (s);Weg\u2026 (µm);U \u2013 Soll (V)\n{table(T, Y, U, mark=';')}".encode(encoding)
    )
    found = read_recording(tmp_path / "r.csv", input_column="U \u2013 Soll (V)", output_column="Weg\u2026 (µm)")
    np.testing.assert_allclose(found.outputs[0], 1e-6 * Y, rtol=1e-12)


ROWS = plain(range(1, 61))
REFUSED = {
    "mean values below the samples": (f"No,u_V,y_mm\n{ROWS}Mean,1.5,2.5\n", 'row 62: "Mean" .* at the end'),
    "mean values above the samples": (
        f"No,u_V,y_mm\nMean,1.5,2.5\nPeak,2,3\n{ROWS}",
        'row 2: "Mean" .* below the names',
    ),
    "a factor in a block": (
        f"{TITLES}Scale\t2\t1\n{LIMITS}{plain(mark=chr(9))}",
        '"Scale" begins a line below the names',
    ),
    "an offset in a block": (
        BLOCK.replace('"HOffset",0', '"VOffset",1') + table([""] * 60, U, Y),
        'row 7: "HResolution" begins',
    ),
    "times of a slower channel": (
        "t1_s,u_V,t2_s,y_mm\n" + table(T, U, [*(2 * T[:30]), *[""] * 30], [*Y[:30], *[""] * 30]),
        '"t1_s" and "t2_s" hold different times, and one of them ends before the others',
    ),
    "frames behind a colon": (
        "Time,u_V,y_mm\n" + plain(f"10:11:{12 + k // 25}:{k % 25:02d}" for k in range(60)),
        "a time of day as in 12:00:00.25",
    ),
    "a tab too many in the header": (
        f"time_s\tu_V\t\ty_mm\n{plain(mark=chr(9))}",
        "the row has 3 of 4 cells, like all rows: remove the additional cells of the header",
    ),
    "numbers of samples": (f"Sample,u_V,y_mm\n{ROWS}", "state the sample time|give the sample time in seconds: --dt"),
    "a prefix in the cells": (
        f"time_s,u_V,y_m\n{table(T, U, [f'{y}m' for y in Y])}",
        'm" is not a number; .* in the header',
    ),
    "times of which one is in another unit": (
        f"Time,u_V,y_mm\n{plain('59 sec' if k < 59 else '1 min' for k in range(60))}",
        'row 61, column "Time": "1 min" is not a number',
    ),
    "a date of another form": (
        f"Timestamp,u_V,y_mm\n{plain(f'2024.122.10:11:{12 + t:05.2f}' for t in T)}",
        "is not a number; write a date as in",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_would_be_read_wrongly_is_refused(tmp_path: Path, kind: str) -> None:
    text, said = REFUSED[kind]
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    columns = {"input_column": "#2", "output_column": "#4" if "slower" in kind or "tab" in kind else "#3"}
    options = {"dt": DT} if "values" in kind or kind == "an offset in a block" else {}
    with pytest.raises(DataError, match=said) as error:
        read_recording(tmp_path / "r.csv", **columns, **options)
    if kind == "numbers of samples":
        assert not error.value.offers


@pytest.mark.parametrize(
    "head",
    [
        ("Nr;t;u;y", "-;ms;V;mm"),
        (";ms;V;mm", ";t;u;y"),
        ("-;ms;V;mm", "Nr;t;u;y"),
        ("# ;ms;V;mm", "# ;t;u;y"),
        ("# Nr;t;u;y", "# ;ms;V;mm"),
    ],
)
def test_units_stand_above_or_below_the_names_of_a_table_with_numbered_rows(
    tmp_path: Path, head: tuple[str, str]
) -> None:
    rows = [f"{k};{20 * k};{k % 3};{k % 5}" for k in range(20)]
    (tmp_path / "r.csv").write_text("\n".join([*head, *rows]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u", output_column="y")
    assert (found.sample_time, found.input_units, found.output_units) == (pytest.approx(0.02), ("V",), ("m",))
    np.testing.assert_allclose(found.outputs[0], 1e-3 * (np.arange(20) % 5), rtol=1e-15)


def test_the_last_column_needs_no_unit_below_its_name(tmp_path: Path) -> None:
    """As in a workbook, which stores no empty cells at the end of a row."""
    rows = [f"{20 * k},{k % 3},{k % 5},OK" for k in range(20)]
    (tmp_path / "r.csv").write_text("\n".join(["t,u,y,state", "ms,V,mm", *rows]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u", output_column="y")
    assert (found.sample_time, found.output_units) == (pytest.approx(0.02), ("m",))


@pytest.mark.parametrize(
    ("head", "output", "unit"),
    [
        ("Operator,Smith,Date,Day\nt,s,F,V", "s", ""),
        ("Interval:,0.02\nLevels:,V,V,V\nTime,x,y,V", "y", ""),
        ("Interval:,0.02\nVertical Units:,V,V,V\nTime,x,y,V", "y", "V"),
    ],
)
def test_words_without_names_above_them_are_units_if_their_line_says_so(
    tmp_path: Path, head: str, output: str, unit: str
) -> None:
    (tmp_path / "r.csv").write_text(f"{head}\n{table(T, Y, Y, U)}", encoding="utf-8")
    assert read_recording(tmp_path / "r.csv", input_column="V", output_column=output).output_units == (unit,)


@pytest.mark.parametrize("step", [20.0, 2.5, 16.667])
def test_slow_times_without_a_unit_are_asked_for(tmp_path: Path, step: float) -> None:
    (tmp_path / "r.csv").write_text(f"clock,u_V,y_mm\n{plain(step * np.arange(60) + 0.5)}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", time_column="clock")
    assert "are they milliseconds?" in found.provenance["clock"]


@pytest.mark.parametrize(("header", "said"), [("Tempo en milésimas", "milésimas"), ("Zeit in Ticks", "Ticks")])
def test_a_unit_of_time_in_words_is_asked_for_if_unknown(tmp_path: Path, header: str, said: str) -> None:
    (tmp_path / "r.csv").write_text(f"{header},u_V,y_mm\n{plain(2.5 * np.arange(60))}", encoding="utf-8")
    named = {"input_column": "u_V", "output_column": "y_mm", "time_column": header}
    with pytest.raises(DataError, match=f'said to be in "{said}", which is not a known unit of time'):
        read_recording(tmp_path / "r.csv", **named)
    found = read_recording(tmp_path / "r.csv", **named | {"time_column": f"{header}=ms"})
    assert found.sample_time == pytest.approx(2.5e-3)


@pytest.mark.parametrize("form", ["y ({})", "y_{}"])
def test_a_minimum_beside_a_maximum_is_not_in_minutes(tmp_path: Path, form: str) -> None:
    """As pandas names the columns of an aggregate, and as a logger averages."""
    head = ",".join(["time (min)", "u_V", *map(form.format, ("mean", "min", "max"))])
    (tmp_path / "r.csv").write_text(f"{head}\n{table(T, U, Y, Y - 1, Y + 1)}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column=form.format("min"))
    np.testing.assert_array_equal(found.outputs[0], Y - 1)
    assert (found.output_units, found.sample_time) == (("",), pytest.approx(60 * DT))


@pytest.mark.parametrize("form", ["y_{}_mm", "y_mm_{}", "y {} (mm)", "y (mm) {}"])
def test_a_minimum_beside_a_maximum_keeps_the_unit_of_both(tmp_path: Path, form: str) -> None:
    head = ",".join(["time (min)", "u_V", *map(form.format, ("min", "max"))])
    (tmp_path / "r.csv").write_text(f"{head}\n{table(T, U, Y - 1, Y + 1)}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column=form.format("min"))
    np.testing.assert_allclose(found.outputs[0], 1e-3 * (Y - 1), rtol=1e-12)
    assert found.output_units == ("m",)


@pytest.mark.parametrize(("header", "unit"), [("duration_h", 3600.0), ("Dauer_min", 60.0), ("t1_min", 60.0)])
def test_times_that_are_named_are_in_the_unit_behind_their_name(tmp_path: Path, header: str, unit: float) -> None:
    """Unlike ``pos_h``, which may be a height."""
    (tmp_path / "r.csv").write_text(f"{header},u_V,y_mm\n{plain()}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", time_column=header)
    assert found.sample_time == pytest.approx(unit * DT)


def test_a_meter_that_changes_its_range_gives_no_unit(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(
        "time_s,u_V,Laser,Unit\n" + table(T, U, Y, ["mm"] * 30 + ["um"] * 30), encoding="utf-8"
    )
    with pytest.raises(DataError, match="is in mm or um, but the model needs it in m;"):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="Laser", output_unit="m")


def test_parts_of_the_time_are_no_signals(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(LOGGED, encoding="utf-8")
    assert {c.header: c.role for c in understand(tmp_path / "r.csv").columns}["CH2"] == "output"


@pytest.mark.usefixtures("in_one_process")
def test_a_unit_beside_the_vector_of_a_struct_is_its_unit(tmp_path: Path) -> None:
    channels = np.zeros((1, 2), dtype=[("Name", object), ("Unit", object), ("Data", object)])
    channels[0, 0], channels[0, 1] = ("u", "V", U), ("y", "mm", Y)
    savemat(tmp_path / "r.mat", {"run": {"X": {"Data": 1e3 * T, "Unit": "ms"}, "Y": channels}})
    found = read_recording(tmp_path / "r.mat", input_column="run.Y(1).Data", output_column="run.Y(2).Data")
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-12)
    assert (found.sample_time, found.input_units) == (pytest.approx(DT), ("V",))


@pytest.mark.parametrize(
    ("encoding", "names"),
    [
        ("cp932", ["時間(ms)", "センサー電圧(kV)", "ストローク(μm)"]),
        ("cp932", ["t(ms)", "HV(kV)", "Disp(μm)"]),
        ("cp1251", ["Время, мс", "Напряжение, кВ", "Перемещение, мкм"]),
        ("cp1251", ["ВРЕМЯ (мс)", "НАПРЯЖЕНИЕ (кВ)", "ХОД (мкм)"]),
        ("gbk", ["时间(ms)", "电压(kV)", "位移(um)"]),
        ("cp1252", ["Prüfzeit (ms)", "Spannung über Film (kV)", "Größe (µm)"]),
        ("cp1252", ["t (ms)", "“HV” – déjà vu (kV)", "y (µm)"]),
    ],
)
def test_names_in_the_code_page_of_a_country(tmp_path: Path, encoding: str, names: list[str]) -> None:
    (tmp_path / "r.csv").write_bytes(("\t".join(names) + "\n" + plain(20 * np.arange(60), "\t")).encode(encoding))
    found = read_recording(tmp_path / "r.csv", input_column=names[1], output_column=names[2], time_column=names[0])
    np.testing.assert_allclose(found.inputs[0], 1e3 * U, rtol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 1e-6 * Y, rtol=1e-12)
    assert found.sample_time == pytest.approx(DT, rel=1e-6)


def test_marks_of_missing_values_are_no_names(tmp_path: Path) -> None:
    rows = ["0.00,---,---", "---,---,---", *plain().splitlines()]
    (tmp_path / "r.csv").write_text("\n".join(["t (s),u (kV),y (um)", *rows]), encoding="utf-8")
    with pytest.raises(DataError, match=r'row 3, column "t \(s\)": "---" is not a number'):
        read_recording(tmp_path / "r.csv", input_column="u (kV)", output_column="y (um)", time_column="#1")


def test_a_factor_is_no_position_and_the_number_of_a_row_no_reading(tmp_path: Path) -> None:
    """A name with x10 or x1000 was guessed to be a position, and a meter's one channel to follow its row numbers."""
    (tmp_path / "scope.csv").write_text("time (s),HV x1000 (V),laser (V)\n" + plain(), encoding="utf-8")
    found = understand(tmp_path / "scope.csv")
    assert [column.role for column in found.columns] == ["time", "input", "output"]
    (tmp_path / "meter.csv").write_text("NO.,Time,Value\n" + table(range(60), T, U), encoding="utf-8")
    assert not understand(tmp_path / "meter.csv").recordings


COUNTS = {
    "a sample is missing": ("Sample", [k + (k > 30) for k in range(60)], "goes from 30 to 32 in row 33"),
    "a sample is repeated": ("i", [k - (k > 30) for k in range(60)], "goes from 30 to 30 in row 33"),
    "the count begins again": ("n", [k % 40 + 1 for k in range(60)], "goes from 40 to 1 in row 42"),
    "another trial begins": ("trial", [1 + k // 20 for k in range(60)], "goes from 1 to 2 in row 22"),
    "another run begins": ("Run no.", ["AB"[k // 30] for k in range(60)], "goes from A to B in row 32"),
    "each row has its number": ("Sample", range(60), ""),
    "the counter has one byte": ("seq", [(k + 200) % 256 for k in range(60)], ""),
    "the counter has two digits": ("seq", [(k + 70) % 100 for k in range(60)], ""),
    "another column has levels": ("truncated", [1 + k // 20 for k in range(60)], ""),
    "there is one trial": ("trial", [7] * 60, ""),
}


@pytest.mark.parametrize("kind", COUNTS)
def test_rows_that_do_not_follow_each_other_are_named_if_a_sample_time_is_stated(tmp_path: Path, kind: str) -> None:
    name, column, said = COUNTS[kind]
    (tmp_path / "r.csv").write_text(f"{name},u_V,y_mm\n" + table(column, U, Y), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", dt=0.02)
    np.testing.assert_array_equal(found.inputs[0], U)
    assert said in found.provenance.get("clock", "")
    assert bool(said) == ("clock" in found.provenance)


def test_a_time_that_is_the_same_in_all_rows_is_no_clock(tmp_path: Path) -> None:
    """The time of the start beside a count: another column, or the stated sample time, is the clock."""
    (tmp_path / "r.csv").write_text("Time,ms,u_V,y_mm\n" + table(["10:11:12"] * 60, 20 * np.arange(60), U, Y), "utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(0.02)
    (tmp_path / "r.csv").write_text("Time,n,u_V,y_mm\n" + table(["10:11:12"] * 60, range(60), U, Y), "utf-8")
    with pytest.raises(DataError, match=r'"Time" holds the same time in all rows; .*--dt'):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", dt=0.01)
    assert found.sample_time == 0.01


def test_times_in_samples_are_no_seconds(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("Time (samples),u_V,y_mm\n" + table(range(60), U, Y), "utf-8")
    with pytest.raises(DataError, match="if the column counts the samples, state the sample time: --dt SECONDS"):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", dt=0.01)
    assert found.sample_time == 0.01


def test_the_name_of_a_time_zone_may_follow_its_offset(tmp_path: Path) -> None:
    times = [f"2024-05-01T10:11:{12 + 0.02 * k:05.2f}+02:00[Europe/Berlin]" for k in range(60)]
    (tmp_path / "r.csv").write_text("time,u_V,y_mm\n" + table(times, U, Y), "utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(0.02)
    assert found.provenance["clock_began"] == "2024-05-01T08:11:12+00:00"


def test_a_line_of_units_may_hold_the_one_of_a_ratio(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("t,u,stretch\nms,kV,1\n" + plain(20 * np.arange(60)), "utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u", output_column="stretch")
    np.testing.assert_allclose(found.inputs[0], 1e3 * U, rtol=1e-12)
    np.testing.assert_array_equal(found.outputs[0], Y)


def test_units_in_capitals_are_no_names(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("TIME,VOLTAGE,DISP\nSEC,KV,MM\n" + plain(), "utf-8")
    with pytest.raises(DataError, match=r'"VOLTAGE" is in "KV", which is not a known unit; did you mean "kV"\?'):
        read_recording(tmp_path / "r.csv", input_column="VOLTAGE", output_column="DISP")


@pytest.mark.parametrize("first", ["0,1,2", "1,2,3"])
def test_numbers_of_columns_are_no_sample(tmp_path: Path, first: str) -> None:
    """As pandas writes a frame without names."""
    (tmp_path / "r.csv").write_text(f"{first}\n{plain()}", "utf-8")
    with pytest.raises(DataError, match=r"row 1: \d, \d, \d may be the numbers of the columns, or a sample"):
        read_recording(tmp_path / "r.csv", input_column="#2", output_column="#3", dt=DT)
    (tmp_path / "r.csv").write_text(plain(), "utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="#2", output_column="#3", time_column="#1")
    assert found.n_samples == 60


def test_commas_between_thousands_beside_decimal_commas_are_asked_for(tmp_path: Path) -> None:
    """A column with 213 and 3,130 holds whole volts, or volts with decimals that end in zeros."""
    volts = [f"{213 + 97 * k:,}" for k in range(60)]
    decimals = ([f"{value:.2f}".replace(".", ",") for value in column] for column in (T, Y))
    times, readings = decimals
    (tmp_path / "r.csv").write_text("time_s;u_V;y_mm\n" + table(times, volts, readings, mark=";"), "utf-8")
    with pytest.raises(DataError, match=r'column "u_V": "1,086" may mean thousands or a decimal comma'):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")


@pytest.mark.parametrize(
    "remark", ["# NODATA: {}", "# missing value = {}", "NULL. {} : NULL VALUE", "# fill value is {}"]
)
@pytest.mark.parametrize("mark", ["-999.25", "32767"])
def test_a_mark_that_the_file_declares_is_no_value(tmp_path: Path, remark: str, mark: str) -> None:
    readings = [mark if k in (20, 41) else y for k, y in enumerate(Y)]
    rows = table(np.round(T, 2), U, readings)
    (tmp_path / "r.csv").write_text(
        f"{remark.format(mark)}\ntime_s,command_V,displacement_mm\n{rows}", encoding="utf-8"
    )
    with pytest.raises(DataError, match=rf"row 23, .*the file says that {mark} marks .* \(2 such rows"):
        read_recording(tmp_path / "r.csv")
    (*pieces, last) = read_recordings(tmp_path / "r.csv", allow_gaps=True)
    found = np.concatenate([piece.outputs[0] for piece in (*pieces, last)])
    np.testing.assert_allclose(found, 1e-3 * np.delete(Y, [20, 41]), rtol=1e-12)


@pytest.mark.parametrize(
    ("column", "values", "told"),
    [
        (2, {20: "-9999", 41: "-9999"}, "-9999 stands in 2 rows, far outside"),
        (2, {20: "-99.9999", 30: "99.9999"}, "99.9999 stands in 1 row, far outside"),
        (2, {20: "77", 41: "77"}, "77 stands in 2 rows, far outside"),
        (1, {20: "-9999"}, "-9999 stands in 1 row, far outside"),
        (1, {20: "77", 41: "77"}, ""),  # a level of the command
        (2, {}, ""),
    ],
)
def test_a_value_that_may_mark_missing_ones_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, column: int, values: dict[int, str], told: str
) -> None:
    columns: list[list[object]] = [list(np.round(T, 2)), list(U), list(Y)]
    for row, value in values.items():
        columns[column][row] = value
    (tmp_path / "r.csv").write_text("time_s,command_V,displacement_mm\n" + table(*columns), encoding="utf-8")
    assert read_recording(tmp_path / "r.csv").n_samples == T.size
    assert told in caplog.text
    assert bool(caplog.text) == bool(told)


@pytest.mark.parametrize(("limit", "told"), [(32767, True), (-32768, True), (32766, False)])
def test_the_limit_of_an_integer_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, limit: int, told: bool
) -> None:
    counts = [limit if k in (20, 21) else k * np.sign(limit) * 500 for k in range(60)]
    (tmp_path / "r.csv").write_text("time_s,command_V,adc\n" + table(np.round(T, 2), U, counts), encoding="utf-8")
    read_recording(tmp_path / "r.csv", output_column="adc")
    assert (f"{limit} stands in 2 rows, the limit of an integer" in caplog.text) == told


SECONDS = 1714550400 + np.floor(T + 0.5).astype(int)


@pytest.mark.parametrize(
    ("names", "whole", "part"),
    [
        ("secs,nsecs", SECONDS, [round((t + 0.5) % 1 * 1e9) for t in T]),
        ("header.stamp.sec,header.stamp.nanosec", SECONDS, [round((t + 0.5) % 1 * 1e9) for t in T]),
        ("tv_sec,tv_usec", SECONDS, [round((t + 0.5) % 1 * 1e6) for t in T]),
        ("Time,msec", [f"10:11:{12 + int(t + 0.5)}" for t in T], [f"{round((t + 0.5) % 1 * 1e3):03d}" for t in T]),
        ("Time,Fraction", [f"10:11:{12 + int(t + 0.5)}" for t in T], [f"{(t + 0.5) % 1:.2f}" for t in T]),
    ],
)
def test_whole_seconds_and_the_parts_of_seconds_are_one_time(
    tmp_path: Path, names: str, whole: Iterable[object], part: Iterable[object]
) -> None:
    (tmp_path / "r.csv").write_text(f"{names},command_V,displacement_mm\n{table(whole, part, U, Y)}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv")
    assert (found.n_samples, found.sample_time) == (60, pytest.approx(DT))
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-12)


def test_a_duration_behind_whole_seconds_is_no_part_of_the_time(tmp_path: Path) -> None:
    text = "time_s,loop_ms,command_V,displacement_mm\n" + table(range(60), [20] * 60, U, Y)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    assert read_recording(tmp_path / "r.csv").sample_time == 1.0


@pytest.mark.parametrize(
    ("names", "columns", "mark"),
    [
        ('"Zeit";"ms"', [["10:11:12"] * 30 + ["10:11:13"] * 30, [*range(400, 1000, 20), *range(0, 600, 20)]], ";"),
        (
            "Time ms",
            [
                ['"2024-05-01 10:11:12"'] * 30 + ['"2024-05-01 10:11:13"'] * 30,
                [*range(400, 1000, 20), *range(0, 600, 20)],
            ],
            " ",
        ),
        (
            "Time,ms",
            [
                ["1/31/2024 2:00:12 PM"] * 30 + ["1/31/2024 2:00:13 PM"] * 30,
                [*range(400, 1000, 20), *range(0, 600, 20)],
            ],
            ",",
        ),
        (
            "sec,ms",
            [["7.0"] * 30 + ["8.0"] * 30, [f"{ms}.0" for ms in (*range(400, 1000, 20), *range(0, 600, 20))]],
            ",",
        ),
    ],
)
def test_joined_times_leave_all_other_cells_as_they_are(
    tmp_path: Path, names: str, columns: list[list[object]], mark: str
) -> None:
    cells = [[f'"{value}"'.replace(".", "," if mark == ";" else ".") for value in signal] for signal in (U, Y)]
    notes = [""] * 59 + ['"a, b"'] if mark == "," else ['"a b"'] * 60
    text = f"{names}{mark}u_V{mark}y_mm{mark}note\n" + table(*columns, *cells, notes, mark=mark)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(DT)
    np.testing.assert_allclose(found.inputs[0], U, rtol=1e-12)


@pytest.mark.parametrize("names", ["Hour,Minute,Second", "Date,h,min,s", "Hour,Minute,Second,ms", "t_h,t_min,t_s"])
def test_hours_minutes_and_seconds_are_one_time(tmp_path: Path, names: str) -> None:
    clock = [86399.5 + t for t in T]  # passes midnight
    days = [["2024-05-01" if t < 86400.0 else "2024-05-02" for t in clock]] if "Date" in names else []
    hours, minutes = [int(t // 3600) % 24 for t in clock], [int(t // 60) % 60 for t in clock]
    seconds = [f"{int(t % 60)}" if "ms" in names else f"{t % 60:.2f}" for t in clock]
    parts = [[f"{1e3 * (t % 1):.0f}" for t in clock]] if "ms" in names else []
    text = f"{names},u_V,y_mm\n" + table(*days, hours, minutes, seconds, *parts, U, Y)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert (found.n_samples, found.sample_time) == (60, pytest.approx(DT))


def test_hours_beside_finer_times_are_not_the_times(tmp_path: Path) -> None:
    text = "Elapsed (s),Hour,Min,Sec,u_V,y_mm\n" + table(T, [9] * 60, [5] * 60, T.astype(int), U, Y)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(DT)


def test_a_duration_that_rises_within_each_second_is_no_part_of_the_time(tmp_path: Path) -> None:
    text = "time_s,loop_ms,u_V,y_mm\n" + table(np.arange(60) // 2, [11, 14] * 30, U, Y)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match="times do not increase: 0 s follows 0 s"):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")


def test_finer_times_in_another_column_are_offered(tmp_path: Path) -> None:
    text = "time_s,time_ms,u_V,y_mm\n" + table(T.astype(int), 20 * np.arange(60), U, Y)
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match='those in the column "time_ms" increase; name it: --time-column "time_ms"'):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")


@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f+02:00", "0 days %H:%M:%S.%f"])
def test_a_nameless_index_of_dates_holds_the_times(tmp_path: Path, form: str) -> None:
    stamps = [(datetime(2024, 5, 1) + timedelta(seconds=t)).strftime(form) for t in T]
    (tmp_path / "r.csv").write_text(",u_V,y_mm\n" + plain(stamps), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(DT)
    assert understand(tmp_path / "r.csv").columns[0].how == "by its values"


@pytest.mark.parametrize(
    "write",
    [
        lambda t, u, y: f"t_ms:{1e3 * t:.0f},u_V:{u},y_mm:{y}",
        lambda t, u, y: f"time={t:.2f} u_V={u} y_mm={y}",
        lambda t, u, y: json.dumps({"time": f"10:11:{12 + t:05.2f}", "u_V": u, "y_mm": y, "note": None}),
        lambda t, u, y: json.dumps({"time": t, "u_V": u, "y_mm": y} if t else {"y_mm": y, "time": t, "u_V": u}),
    ],
)
def test_rows_may_repeat_the_names(tmp_path: Path, write: Callable[[float, float, float], str]) -> None:
    rows = [write(*map(float, row)) for row in zip(T, U, Y, strict=True)]
    for name, head in (("r.jsonl", []), ("r.txt", ["Sensor ready", "Probe:10X,Coupling:DC"])):
        (tmp_path / name).write_text("\n".join([*head[:1], *rows]) + "\n", encoding="utf-8")
        found = read_recording(tmp_path / name, input_column="u_V", output_column="y_mm")
        assert found.sample_time == pytest.approx(DT)
        np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-12)
    (tmp_path / "r.txt").write_text("\n".join([*rows[:40], "t_ms:800,u_V:1", *rows[41:]]), encoding="utf-8")
    with pytest.raises(DataError, match="row 41: each row repeats the names, but not this one"):
        read_recording(tmp_path / "r.txt", input_column="u_V", output_column="y_mm")


def test_a_sample_time_is_a_number_of_seconds(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "r.csv").write_text("command_V,displacement_mm\n" + table(U, Y), encoding="utf-8")
    with pytest.raises(DataError, match=r"r\.csv: dt must be one number, in s; got a str"):
        read_recording(tmp_path / "r.csv", dt="50 Hz")
    assert read_recording(tmp_path / "r.csv", dt=50).sample_time == 50.0
    assert "dt is 50 s; if 50 is the sample rate in Hz, give 0.02" in caplog.text


def test_a_file_with_one_signal_says_so(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(table(U), encoding="utf-8")
    with pytest.raises(DataError, match="the file holds only one signal; input and output must be columns of one file"):
        read_recording(tmp_path / "r.csv", dt=DT)
    (tmp_path / "r.csv").write_text("Time,Ampl\n" + table(T, U), encoding="utf-8")
    with pytest.raises(DataError, match="which no other column of the file can be: input and output must be columns"):
        read_recording(tmp_path / "r.csv", input_column="Ampl", output_column="Ampl")


def test_a_scale_in_a_remark_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    rows = "time_s,command_V,displacement_mm\n" + plain()
    for remark, scale in (
        ("# 1 V = 10 kV", "1 V = 10 kV"),
        ("Gain:,2000,", "Gain:,2000"),
        ("# HV divider 1:1000", "1:1000"),
        ("# laser: 10 mm / 10 V", "10 mm / 10 V"),
        ("# Trek 10 kV / 10 mA, 1 V = 1 kV", "1 V = 1 kV"),
        ("# film 100 um, 20 V/um", ""),
        ("# field 50 V/mm", ""),
        ("# E = 120 V/mm, gap 2 mm", ""),
        ("# Feld 3 kV/cm; laser 0.5 V/mm", "0.5 V/mm"),
        ("# Sylgard 184, 10:1", ""),
        ("# run 1/10, objective 10x", ""),
        ("# supply 24 V / 5 A, mains 230 V / 50 Hz, 10 nF / 2 kV", ""),
    ):
        caplog.clear()
        (tmp_path / "r.csv").write_text(f"{remark}\n{rows}", encoding="utf-8")
        np.testing.assert_allclose(read_recording(tmp_path / "r.csv").inputs[0], U)
        assert (f'"{scale}", which is not applied' in caplog.text) == bool(scale)


def controldesk(mark: str = ",", units: bool = True) -> list[str]:
    """A recorder's table of dSPACE ControlDesk: labelled lines, the last of which is the first sample."""
    rows = [f"{t:.3f}{mark}{u:.4f}{mark}{y:.5f}" for t, u, y in zip(T, U, Y, strict=True)]
    head = [
        f"origin{mark}ControlDesk 7.3",
        "",
        f"device{mark}DS1202",
        f"trace_names{mark}{mark}Out1{mark}Out1",
        f"path{mark}{mark}Model Root/u/Out1{mark}Model Root/x/Out1",
    ]
    return [
        *head,
        *[f"unit{mark}s{mark}V{mark}mm"] * units,
        f"trace_values{mark}{rows[0]}",
        *(mark + r for r in rows[1:]),
    ]


@pytest.mark.parametrize(("mark", "units"), [(",", True), (";", True), (",", False)])
def test_lines_with_labels_in_their_first_cell_are_read(tmp_path: Path, mark: str, units: bool) -> None:
    (tmp_path / "r.csv").write_text("\n".join(controldesk(mark, units)) + "\n", encoding="utf-8")
    unit = ("", "") if units else ("=V", "=mm")
    found = read_recording(
        tmp_path / "r.csv", input_column=f"Model Root/u/Out1{unit[0]}", output_column=f"Model Root/x/Out1{unit[1]}"
    )
    np.testing.assert_allclose(found.inputs[0], np.round(U, 4), atol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 1e-3 * np.round(Y, 5), atol=1e-12)
    assert found.sample_time == pytest.approx(DT) and found.provenance["rows"].startswith("7-" if units else "6-")


def test_a_second_block_of_labelled_lines_is_named(tmp_path: Path) -> None:
    lines = controldesk()
    (tmp_path / "r.csv").write_text("\n".join([*lines, "", *lines]), encoding="utf-8")
    with pytest.raises(
        DataError, match=rf"row {len(lines) + 8}: other signals begin here; give each block of signals a"
    ):
        read_recording(tmp_path / "r.csv", input_column="#2", output_column="#3")


@pytest.mark.parametrize("names", ["min,s", "Minute,Second", "t_min,t_sec"])
def test_minutes_and_seconds_are_one_time(tmp_path: Path, names: str) -> None:
    """From 59 min 59.5 s on past the hour."""
    since = [3599.5 + t for t in T]
    rows = zip([int(t // 60) % 60 for t in since], [f"{t % 60:.3f}" for t in since], U, Y, strict=True)
    text = "".join(f"{minute},{second},{u},{y}\n" for minute, second, u, y in rows)
    (tmp_path / "r.csv").write_text(f"{names},u_V,y_mm\n{text}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(DT, rel=1e-12) and found.n_samples == len(T)


@pytest.mark.parametrize(
    "head",
    [
        "Time (s),Actuator,\n,u (V),y (mm)",
        "Time,Drive,Laser\ns,u_V,y_mm",
        "Time,Actuator,\n(s),u (V),y (mm)",
    ],
)
def test_the_name_of_the_times_may_stand_one_line_above(tmp_path: Path, head: str) -> None:
    """As a spreadsheet writes merged cells."""
    (tmp_path / "r.csv").write_text(f"{head}\n{plain()}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="#2", output_column="#3")
    assert found.sample_time == pytest.approx(DT)
    np.testing.assert_allclose(found.inputs[0], U, rtol=1e-9)
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-9)


@pytest.mark.parametrize(
    ("remark", "said"),
    [
        ("# Sample rate: 50 Hz", "Sample rate: 50 Hz"),
        ("Sampling interval,20ms", "Sampling interval,20ms"),
        ("Sample Rate (kS/s),0.05", "Sample Rate (kS/s),0.05"),
        ("% dt = 0.02", "dt = 0.02"),
        ("Abtastfrequenz: 50 1/s", "Abtastfrequenz: 50"),
        ("# fs = 50", "fs = 50"),
        ("# sample time 12:30, dt of fs", ""),
        ("# sample 12 of 50 Hz", ""),
    ],
)
def test_a_rate_above_the_samples_is_offered(tmp_path: Path, remark: str, said: str) -> None:
    (tmp_path / "r.csv").write_text(f"{remark}\nu_V,y_mm\n" + table(U, Y), encoding="utf-8")
    with pytest.raises(DataError, match=r"the file says|if the file holds no times, give the sample time") as caught:
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert (f'the file says "{said}"' in str(caught.value)) == bool(said)
    assert caught.value.offers.dt == (pytest.approx(DT) if said else None)


def test_the_increment_of_an_oscilloscope_is_offered(tmp_path: Path) -> None:
    rows = "".join(f"{k},{u},{y},\n" for k, (u, y) in enumerate(zip(U, Y, strict=True)))
    head = "X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,-6.0e-03,2.0e-02\n"
    (tmp_path / "r.csv").write_text(head + rows, encoding="utf-8")
    with pytest.raises(DataError, match=r'the file says "Increment = 2\.0e-02"; .* --dt 0\.02, in Python dt=0\.02'):
        read_recording(tmp_path / "r.csv", input_column="CH1", output_column="CH2")


@pytest.mark.parametrize("name", ["r.mpt", "r.sto", "r.xls", "r.lvm", "r.001", "r"])
def test_a_table_of_text_is_read_under_any_name(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(f"time_s\tu_V\ty_mm\n{plain(mark=chr(9))}", encoding="utf-8")
    found = read_recording(tmp_path / name, input_column="u_V", output_column="y_mm")
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-9)


def test_what_is_no_table_under_an_unknown_name_is_refused_for_its_name(tmp_path: Path) -> None:
    for name, content in (("r.foo", b"no table\n"), ("r.foo", bytes(range(256))), ("r.parquet", b"PAR1" + bytes(64))):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DataError, match=r"files with the extension \.\w+ cannot be read"):
            read_recording(tmp_path / name)


def test_dates_are_the_times_whatever_their_name(tmp_path: Path) -> None:
    rows = [f"2024-03-14 12:00:{t:06.3f},{u},{y}\n" for t, u, y in zip(T, U, Y, strict=True)]
    (tmp_path / "r.csv").write_text("created_at,u_V,y_mm\n" + "".join(rows), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert found.sample_time == pytest.approx(DT) and found.provenance["clock_began"].startswith("2024-03-14T12:00:00")


@pytest.mark.parametrize("words", [("TRUE", "FALSE"), ("True", "False"), ("true", "false")])
def test_words_of_truth_are_numbers(tmp_path: Path, words: tuple[str, str]) -> None:
    """The command of a valve, as PLCs and spreadsheets write it."""
    opened = [k % 3 == 0 for k in range(len(T))]
    rows = [f"{t:.2f},{words[0] if one else words[1]},{y}\n" for t, one, y in zip(T, opened, Y, strict=True)]
    (tmp_path / "r.csv").write_text("time_s,valve,y_mm\n" + "".join(rows), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="valve", output_column="y_mm")
    np.testing.assert_array_equal(found.inputs[0], opened)
    rows[7] = rows[7].replace(words[0], "error").replace(words[1], "error")
    (tmp_path / "r.csv").write_text("time_s,valve,y_mm\n" + "".join(rows), encoding="utf-8")
    with pytest.raises(DataError, match='row 9, column "valve": "error" is not a number'):
        read_recording(tmp_path / "r.csv", input_column="valve", output_column="y_mm")


def test_names_may_be_wrapped_within_quotes(tmp_path: Path) -> None:
    """As a spreadsheet writes cells with line breaks."""
    (tmp_path / "r.csv").write_text(f'"time\n(s)","u\n(V)","y\nof laser\n(mm)"\n{plain()}', encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u (V)", output_column="y of laser (mm)")
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-9)
    assert found.provenance["rows"] == f"6-{5 + len(T)}"


def test_a_line_of_remarks_may_be_empty_behind_its_label(tmp_path: Path) -> None:
    """As Origin labels the lines of its header."""
    rows = "".join(f",{line}\n" for line in plain().splitlines())
    (tmp_path / "r.csv").write_text(f"Long Name,Time,u,y\nUnits,s,V,mm\nComments,,,\n{rows}", encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u", output_column="y")
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, rtol=1e-9)

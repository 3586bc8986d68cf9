"""Tables as strangers publish them: each is read rightly, or refused with a line that can be followed."""

import json
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant import ReadingTime
from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, read_recordings
from deatwin.plant.files.headers import split_unit

HEAD = "time_s,command_V,displacement_mm"
T = 0.02 * np.arange(40)
U, Y = np.round(np.sin(3 * T), 4), np.round(5 * np.cos(2 * T), 4)
ROWS = [f"{t:.2f},{u:.4f},{y:.4f}" for t, u, y in zip(T, U, Y, strict=True)]


def with_times(texts: list[str]) -> list[str]:
    return [",".join([text, *row.split(",")[1:]]) for text, row in zip(texts, ROWS, strict=True)]


READ = {
    "UTF-32": ("\n".join([HEAD, *ROWS]), "utf-32"),
    "minus signs of typography": ("\n".join([HEAD, *ROWS]).replace("-", "\u2212"), "utf-8"),
    "exponents of double precision": (
        "\n".join([HEAD, *(",".join(f"{v:.6E}".replace("E", "D") for v in row) for row in zip(T, U, Y, strict=True))]),
        "utf-8",
    ),
    "empty rows of a spreadsheet": ("\n".join([HEAD, *ROWS, ",,", ",,"]), "utf-8"),
    "empty rows between the lines of a header": (
        "\n".join(["Film;7;", ";;", "time;command;displacement", " ; ;", "s;V;mm", ";;", ";;"])
        + "\n"
        + "\n".join(row.replace(",", ";") for row in ROWS),
        "utf-8",
    ),
    "channels below the names": ("\n".join(["time,command,displacement", ",AI0,AI1", "s,V,mm", *ROWS]), "utf-8"),
    "a title of as many words": (
        "\n".join(
            ["Rig,B,Operator,Smith", ",time_s,command_V,displacement_mm", *(f"{k},{row}" for k, row in enumerate(ROWS))]
        ),
        "utf-8",
    ),
    "settings above the names": (
        "\n".join(
            ["Units,V,mm", *(f"Vertical {name},1,1" for name in ("offset", "scale", "position")), ",,", HEAD, *ROWS]
        ),
        "utf-8",
    ),
    "comments with several marks": (
        "\n".join(["## Film 7", "#### Second visit ####", "####", HEAD, *ROWS[:9], "## touched", *ROWS[9:]]),
        "utf-8",
    ),
    "an empty comment above the names": ("\n".join(["#Oscilloscope", "#", HEAD, *ROWS]), "utf-8"),
    "remarks below the names": ("\n".join([HEAD, "clock,amplifier,laser", *ROWS]), "utf-8"),
    "times beside each channel": (
        "\n".join(
            ["time_s,command_V,time_s,displacement_mm"]
            + [f"{t:.2f},{u:.4f},{t:.2f},{y:.4f}" for t, u, y in zip(T, U, Y, strict=True)]
        ),
        "utf-8",
    ),
    "days": ("\n".join(["time (days)" + HEAD[6:], *with_times([f"{t / 86400:.15f}" for t in T])]), "utf-8"),
    "UTF-16 without its mark": ("\n".join([HEAD, *ROWS]), "utf-16-le"),
    "zeros where a logger lost power": ("\n".join([HEAD, *ROWS, "\0" * 512]), "utf-8"),
    "a header repeated after a restart": (
        "\n".join(
            ["time,command,displacement", "s,V,mm", *ROWS[:20], "time,command,displacement", "s,V,mm", *ROWS[20:]]
        ),
        "utf-8",
    ),
    "a repeated header that says only the unit of its times": (
        "\n".join(
            ("ms" + HEAD[6:] + "\n") * (k in (0, 20)) + row
            for k, row in enumerate(with_times([f"{1e3 * t:.0f}" for t in T]))
        ),
        "utf-8",
    ),
    "UTC behind the time": (
        "\n".join(["time" + HEAD[6:], *with_times([f"2024-05-01 12:00:{t:06.3f} UTC" for t in T])]),
        "utf-8",
    ),
}


@pytest.mark.parametrize("kind", READ)
def test_it_is_read_rightly(tmp_path: Path, kind: str) -> None:
    text, encoding = READ[kind]
    (tmp_path / "r.csv").write_text(text, encoding=encoding)
    found = read_recording(tmp_path / "r.csv")
    np.testing.assert_allclose(found.inputs[0], U, atol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, atol=1e-12)
    assert found.sample_time == pytest.approx(0.02, rel=1e-6) and found.n_samples == 40


REFUSED = {
    "cells with units": (["0.00 s,0.1 V,3 mm", "0.02 s,0.2 V,4 mm"], 'in row 2 "0.00 s" is not a number'),
    "rows that run backwards": (ROWS[::-1], "the rows run backwards: put them in order"),
    "an Excel file of dates": (with_times([f"{45413.5 + t / 86400:.10f}" for t in T]), '"Time=day" or .*"Time=s"'),
    "times of day in days": (with_times([f"{0.585 + t / 86400:.12f}" for t in T]), '"Time=day" or .*"Time=s"'),
    "ticks": (with_times([str(3 * k) for k in range(40)]), 'said to be in "ticks", .* such as .*"Time .ticks.=s"'),
    "a time zone by name": (
        with_times([f"2024-05-01 12:00:{t:06.3f} CEST" for t in T]),
        'row 2, .*CEST" is not a date, .*; give a time zone as an offset from UTC',
    ),
    "the end of summer time": (
        with_times([f"2026-10-25 0{3 - (t > 0.3)}:00:00.{1000 * t:03.0f}" for t in T]),
        "row 18: times do not increase.*; exactly an hour: where summer time .* offset from UTC; else there the clock",
    ),
    "a clock of twelve hours": (
        with_times(
            [f"2026-10-25 {12 if t < 0.3 else 1:02d}:{59 if t < 0.3 else 0:02d}:{(59.7 + t) % 60:06.3f}" for t in T]
        ),
        "row 17: times do not increase.*; exactly twelve hours: if the clock shows no am and pm, give times of 24 hours",
    ),
    "a clock with points": (
        [row.replace(row.split(",")[0], f"10.11.{12 + float(row[:4]):06.3f}", 1) for row in ROWS],
        r'row 2, .*"10\.11\.12\.000" is not a number; write .* a time of day as in 12:00:00\.25',
    ),
    "tenths of milliseconds": (
        with_times([str(200 * k) for k in range(40)]),
        'said to be in "0.1 ms", .*; convert the times to one, then state it: .*=s"',
    ),
    "an overflow": (
        [*ROWS[:9], "0.18,0.1,-9.9E37", *ROWS[10:]],
        'row 11, .*_mm": -9.9E37 marks an overflow or a missing value',
    ),
    "an error of Excel": (
        [*ROWS[:9], "0.18,0.1,#DIV/0!", *ROWS[10:]],
        "row 11, .*: there is no value; .* --allow-gaps",
    ),
    "dashes": ([*ROWS[:9], "0.18,0.1,---", *ROWS[10:]], "row 11, .*: there is no value; .* --allow-gaps"),
    "a capital unit": (with_times([str(20 * k) for k in range(40)]), 'said to be in "mS", .* such as .*"Time .mS.=ms"'),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_it_is_refused_with_a_line_to_follow(tmp_path: Path, kind: str) -> None:
    rows, said = REFUSED[kind]
    times = {
        "an Excel file of dates": "Time",
        "times of day in days": "Time",
        "ticks": "Time (ticks)",
        "a capital unit": "Time (mS)",
        "tenths of milliseconds": "Time (0.1 ms)",
    }
    time = times.get(kind, "date" if " " in rows[0] and "mm" not in rows[0] else "time_s")
    (tmp_path / "r.csv").write_text("\n".join([HEAD.replace("time_s", time), *rows]), encoding="utf-8")
    with pytest.raises(DataError, match=said):
        read_recording(tmp_path / "r.csv")
    if kind in ("an Excel file of dates", "ticks"):
        unit = "day" if time == "Time" else "ms"
        step = {"day": 0.02, "ms": 0.003}[unit]
        found = read_recording(tmp_path / "r.csv", time_column=f"{time}={unit}")
        assert found.sample_time == pytest.approx(step, rel=1e-3)


@pytest.mark.parametrize(
    ("reading", "rows"), [(ReadingTime.END_OF_HOLD, slice(0, 36)), (ReadingTime.START_OF_HOLD, slice(3, 39))]
)
def test_a_slow_reading_takes_the_mean_command_of_its_rows(tmp_path: Path, reading: ReadingTime, rows: slice) -> None:
    slow = [row if k % 4 == 3 else row.rpartition(",")[0] + "," for k, row in enumerate(ROWS)]
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *slow]), encoding="utf-8")
    (found,) = read_recordings(tmp_path / "r.csv", allow_gaps=True, reading=reading)
    assert (found.sample_time, found.start) == (pytest.approx(0.08), pytest.approx(T[rows.start]))
    np.testing.assert_allclose(found.inputs[0][:9], U[rows].reshape(9, 4).mean(axis=1))
    np.testing.assert_allclose(found.outputs[0][:9], 1e-3 * Y[3:36:4])
    assert "one row in 4 has a reading" in str(found.provenance["clock"])


def test_rows_on_both_sides_of_a_gap_are_not_one_hold(tmp_path: Path) -> None:
    slow = [row if k % 4 == 3 else row.rpartition(",")[0] + "," for k, row in enumerate(ROWS)]
    later = [f"{float(row.partition(',')[0]) + 10.0:.2f},{row.partition(',')[2]}" for row in slow[18:]]
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *slow[:16], *later]), encoding="utf-8")
    first, second = read_recordings(tmp_path / "r.csv", allow_gaps=True)
    np.testing.assert_allclose(first.outputs[0], 1e-3 * Y[3:16:4])
    np.testing.assert_allclose(second.outputs[0], 1e-3 * Y[23 : len(ROWS) : 4])  # the rest of the hold before is lost


BROKEN = {
    "a row that lacks cells": ("\n".join([HEAD, *ROWS, "0.80,0.1"]) + "\n", "row 42 has 2 of 3 cells"),
    "a row that ends behind a delimiter": ("\n".join([HEAD, *ROWS, "0.80,0.1,"]), "row 42 has 2 of 3 cells"),
    "times of day": (
        "\n".join(["time" + HEAD[6:], *with_times([f"12:00:0{t:.3f}" for t in T]), "12:0"]),
        "row 42 has 1 of 3 cells",
    ),
    "quotes": (
        "\n".join([HEAD, *('"' + row.replace(",", '","') + '"' for row in ROWS), '"0.80","0.1","2']),
        "row 42 ends with 2",
    ),
    "blanks": ("\n".join([HEAD, *ROWS, "0.80,0.1"]).replace(",", " "), "row 42 has 2 of 3 cells"),
    "zeros": ("\n".join([HEAD, *ROWS, "0.80,0.1,2.5"]) + "\0" * 64, "the file breaks off within row 42, and zeros"),
    "JSON lines": (
        "\n".join(
            json.dumps(dict(zip(HEAD.split(","), map(float, row.split(",")), strict=True)))
            for row in [*ROWS, "0.80,0.1,0"]
        )[:-9],
        "the file breaks off within row 41",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_last_row_within_which_the_file_breaks_off_is_left_out(
    tmp_path: Path, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    text, said = BROKEN[kind]
    (tmp_path / "r.csv").write_text(text, encoding="utf-8")
    found = read_recording(tmp_path / "r.csv")
    np.testing.assert_allclose(found.inputs[0], U, atol=1e-12)
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y, atol=1e-12)
    assert f"r.csv: the last row was left out, because {said}" in caplog.text


@pytest.mark.parametrize(("encoding", "lost"), [("utf-16", 1), ("utf-16-le", 3), ("utf-8", 1)])
def test_a_file_that_breaks_off_within_a_character_is_read(tmp_path: Path, encoding: str, lost: int) -> None:
    """Its µ is in the encoding of the whole file: read as Windows-1252, the unit would be another one."""
    text = "\n".join([HEAD.replace("_mm", " (µm),note"), *(f"{row},20 °C" for row in ROWS), "0.80,0.1,2.5,20 °"])
    (tmp_path / "r.csv").write_bytes(text.encode(encoding)[:-lost])
    found = read_recording(tmp_path / "r.csv")
    np.testing.assert_allclose(found.outputs[0][:40], 1e-6 * Y, rtol=1e-12)


def test_remarks_alone_are_no_samples(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("#run,,0,2.3,2.8\n", encoding="utf-8")
    with pytest.raises(DataError, match="the file has a header but no samples"):
        read_recording(tmp_path / "r.csv", input_column="#2", output_column="#3")


def test_only_the_last_row_may_lack_cells(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *ROWS[:9], "0.18,0.1", *ROWS[10:]]), encoding="utf-8")
    with pytest.raises(DataError, match=r"row 11, .*: there is no value; .* --allow-gaps"):
        read_recording(tmp_path / "r.csv")


def test_a_power_cut_between_rows_costs_no_row(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    table = "\n".join([HEAD, *ROWS]) + "\n"
    (tmp_path / "r.csv").write_bytes(table.encode() + bytes(64))
    assert read_recording(tmp_path / "r.csv").n_samples == len(ROWS)
    assert "left out" not in caplog.text


@pytest.mark.parametrize(
    ("form", "lost"),
    [("{:.4f}", 1), ("{:.4f}", 4), ("{:.6e}", 1), ("{:.6e}", 4), ("{!r}", 9), ("{:.1f}", 2), ("{:05.0f}", 2)],
)
@pytest.mark.parametrize("ending", ["csv", "lvm"])
def test_a_number_that_is_cut_short_at_the_end_is_no_value(
    tmp_path: Path, form: str, lost: int, ending: str, caplog: pytest.LogCaptureFixture
) -> None:
    values = (1000.0 * np.random.default_rng(5).uniform(2.0, 3.0, 40) ** 0.5).tolist()
    rows = [f"{t:.2f},{u:.4f},{form.format(y)}" for t, u, y in zip(T, U, values, strict=True)]
    head = [HEAD]
    if ending == "lvm":
        head = [
            "LabVIEW Measurement",
            "Separator,Comma",
            "***End_of_Header***",
            "Channels,2",
            "***End_of_Header***",
            HEAD,
        ]
    whole = "\n".join([*head, *rows])
    path = tmp_path / f"r.{ending}"
    for text in (whole, f"{whole}\n", whole[:-lost] + "\n"):  # with its line break, the last number is complete
        path.write_text(text, encoding="utf-8")
        assert read_recording(path).n_samples == 40
    path.write_text(whole[:-lost], encoding="utf-8")
    found = read_recording(path)
    np.testing.assert_allclose(found.outputs[0], [1e-3 * float(form.format(y)) for y in values[:-1]], rtol=1e-12)
    assert "may be cut short (put a line break behind it if it is whole)" in caplog.text


def test_a_number_before_cells_that_are_lost_is_no_value(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    text = "\n".join([f"{HEAD},status", *(f"{row},on" for row in ROWS)])
    for lost, count in ((0, 40), (2, 39), (3, 39), (4, 39)):
        (tmp_path / "r.csv").write_text(text[: len(text) - lost], encoding="utf-8")
        assert read_recording(tmp_path / "r.csv").n_samples == count
        assert ("row 41 has 3 of 4 cells" in caplog.text) == (lost > 0)


@pytest.mark.parametrize("form", ["12:00:0{}.{}", "2024-05-01 12:00:0{}.{}", "{}.{}"])
def test_fractions_without_their_zeros_are_named(tmp_path: Path, form: str) -> None:
    """Milliseconds behind the point, as Arduino prints numbers: 40 ms after the second as .40 and 400 ms as .400."""
    path, first, right = tmp_path / "r.csv", form.format(0, 20), form.format(0, "020")
    rows = with_times([form.format(20 * k // 1000, 20 * k % 1000) for k in range(40)])
    path.write_text("\n".join(["Time" + HEAD[6:], *rows]), encoding="utf-8")
    with pytest.raises(
        DataError, match=rf'row 3, column "Time": the fractions lack zeros .* write "{first}" as "{right}"'
    ):
        read_recording(path)
    rows = with_times([form.format(20 * k // 1000, f"{20 * k % 1000:03d}") for k in range(40)])
    path.write_text("\n".join(["Time" + HEAD[6:], *rows]), encoding="utf-8")
    assert read_recording(path).sample_time == pytest.approx(0.02)


def test_command_and_reading_that_never_share_a_row(tmp_path: Path) -> None:
    """Two channels of half the rate, each with its own times; the held command makes them readable, as is said."""
    rows = [
        f"{t:.2f},{u:.4f}," if k % 2 == 0 else f"{t:.2f},,{y:.4f}"
        for k, (t, u, y) in enumerate(zip(T, U, Y, strict=True))
    ]
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *rows]), encoding="utf-8")
    for allow_gaps in (False, True):
        with pytest.raises(
            DataError, match=r"row 2, .*: there is no value .*; no row has command and reading: fill the empty"
        ):
            read_recordings(tmp_path / "r.csv", allow_gaps=allow_gaps)
    filled = [f"{T[k]:.2f},{U[k - k % 2]:.4f},{f'{Y[k]:.4f}' if k % 2 else ''}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *filled]), encoding="utf-8")
    (found,) = read_recordings(tmp_path / "r.csv", allow_gaps=True)
    np.testing.assert_allclose(found.inputs[0], U[::2])
    np.testing.assert_allclose(found.outputs[0], 1e-3 * Y[1::2])


LONG = {
    "by times": [row for t, u, y in zip(T, U, Y, strict=True) for row in (f"{t:.2f},u,{u}", f"{t:.2f},y,{y}")],
    "by channels": [
        f"{t:.2f},{name},{v}" for name, values in (("u", U), ("y", Y)) for t, v in zip(T, values, strict=True)
    ],
}


@pytest.mark.parametrize("order", LONG)
def test_a_row_for_each_channel_is_refused_with_the_way_to_a_column_for_each(tmp_path: Path, order: str) -> None:
    (tmp_path / "r.csv").write_text("\n".join(["time_s,field,value", *LONG[order]]), encoding="utf-8")
    for named in ({}, {"input_column": "value"}, {"input_column": "value", "output_column": "value"}):
        with pytest.raises(
            DataError, match='the column "field" seems to name the channel of each row; give each channel a'
        ):
            read_recording(tmp_path / "r.csv", **named)


def test_runs_below_each_other_are_no_channels(tmp_path: Path) -> None:
    rows = [f"{name},{row}" for name in ("first", "second") for row in ROWS]
    (tmp_path / "r.csv").write_text("\n".join([f"run,{HEAD}", *rows]), encoding="utf-8")
    with pytest.raises(
        DataError, match=r"row 42: times do not increase.*; there the clock starts again: give each run its"
    ):
        read_recording(tmp_path / "r.csv")


def test_a_date_of_the_day_is_no_time(tmp_path: Path) -> None:
    rows = [f"01/05/2024,12:00:{t:06.3f},{u},{y}" for t, u, y in zip(T, U, Y, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join(["Date,Measurement time[hh:mm:ss]" + HEAD[6:], *rows]), encoding="utf-8")
    for column in (None, "Measurement time[hh:mm:ss]"):
        assert read_recording(tmp_path / "r.csv", time_column=column).sample_time == pytest.approx(0.02)


def test_one_empty_time_does_not_make_a_stated_sample_time_the_clock(tmp_path: Path) -> None:
    """AcqKnowledge writes the number of samples of each channel below the names."""
    (tmp_path / "r.csv").write_text("\n".join([HEAD, ",40,40", *ROWS]), encoding="utf-8")
    with pytest.raises(DataError, match='row 2, column "time_s": the cell is empty'):
        read_recording(tmp_path / "r.csv", dt=0.02)


def test_the_mark_of_dos_at_the_end_is_no_row(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *ROWS, "\x1a"]), encoding="utf-8")
    assert read_recording(tmp_path / "r.csv").n_samples == 40


def test_the_cell_that_is_no_number_is_named_and_not_the_date_before_it(tmp_path: Path) -> None:
    rows = [f"2024-05-01 12:00:{t:06.3f},{u} V,{y} mm" for t, u, y in zip(T, U, Y, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join(["Time,cmd,laser", *rows]), encoding="utf-8")
    with pytest.raises(DataError, match=r'in row 2 "[-\d.]+ V" is not a number'):
        read_recording(tmp_path / "r.csv")


def test_a_header_repeated_without_times_is_refused(tmp_path: Path) -> None:
    """The runs would be joined, although the plant had rested in between."""
    rows = [row.partition(",")[2] for row in ROWS]
    head = HEAD.partition(",")[2]
    (tmp_path / "r.csv").write_text("\n".join([head, *rows, head, *rows]), encoding="utf-8")
    with pytest.raises(DataError, match=f"row {len(ROWS) + 2}"):
        read_recording(tmp_path / "r.csv", dt=0.02)


@pytest.mark.parametrize("error", ["#N/A", "#n/a", "####", "#NV", "#DIV/0!", "#WERT!", "#SAKNAS!", "#NOM?", "#¡VALOR!"])
def test_an_error_of_a_spreadsheet_is_a_missing_value_and_no_comment(tmp_path: Path, error: str) -> None:
    """A row that begins with it would else be left out, and without times all later rows would come too early."""
    head = "displacement_mm,command_V"
    rows = [f"{error if k == 20 else y},{u}" for k, (u, y) in enumerate(zip(U, Y, strict=True))]
    for mark in (",", ";", "\t", *([" "] if error != "####" else [])):
        (tmp_path / "r.csv").write_text("\n".join([head, *rows]).replace(",", mark), encoding="utf-8")
        with pytest.raises(DataError, match='row 22, column "displacement_mm": there is no value'):
            read_recording(tmp_path / "r.csv", dt=0.02)
    timed = [f"{row},{t:.2f}" for row, t in zip(rows, T, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join([f"{head},time_s", *timed]), encoding="utf-8")
    first, second = read_recordings(tmp_path / "r.csv", allow_gaps=True)
    np.testing.assert_allclose(first.outputs[0], 1e-3 * Y[:20])
    np.testing.assert_allclose(second.outputs[0], 1e-3 * Y[21:])
    assert second.start == pytest.approx(T[21])


def test_a_row_of_empty_cells_between_samples_is_no_empty_line(tmp_path: Path) -> None:
    rows = [row.partition(",")[2] for row in ROWS]
    (tmp_path / "r.csv").write_text("\n".join([HEAD.partition(",")[2], *rows[:9], ",", *rows[9:]]), encoding="utf-8")
    with pytest.raises(DataError, match='row 11, column "command_V": there is no value'):
        read_recording(tmp_path / "r.csv", dt=0.02)


def test_a_word_in_place_of_a_value_is_named_with_what_would_work(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("\n".join([HEAD, *ROWS[:9], "0.18,1.0,OL", *ROWS[10:]]), encoding="utf-8")
    with pytest.raises(DataError, match='"OL" is not a number; if it marks a missing value, leave the cell empty'):
        read_recording(tmp_path / "r.csv")


def test_times_too_coarse_to_tell_the_sample_time_are_read_with_it(tmp_path: Path) -> None:
    rows = with_times([f"12:00:0{int(3.7 + t)}" for t in T])  # the second changes once
    (tmp_path / "r.csv").write_text("\n".join(["time" + HEAD[6:], *rows]), encoding="utf-8")
    with pytest.raises(DataError, match=r"stored too coarsely .* --dt SECONDS"):
        read_recording(tmp_path / "r.csv")
    assert read_recording(tmp_path / "r.csv", dt=0.02).sample_time == 0.02


def test_a_unit_of_time_is_offered_only_where_no_more_than_capitals_differ(tmp_path: Path) -> None:
    for unit, offered in (("ticks", None), ("mS", "Time (mS)=ms")):
        (tmp_path / "r.csv").write_text("\n".join([f"Time ({unit})" + HEAD[6:], *ROWS]), encoding="utf-8")
        with pytest.raises(DataError) as error:
            read_recording(tmp_path / "r.csv")
        assert error.value.offers.time_column == offered


def test_a_remark_behind_the_unit_belongs_to_the_name_and_a_factor_leaves_the_unit_unknown() -> None:
    assert split_unit("Weg [mm] (gemittelt)") == ("Weg (gemittelt)", "mm")
    assert split_unit("x [mm] (x10)")[1] == ""
    assert split_unit("(a)" * 7000) == ("(a)" * 7000, "")


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ([HEAD, "x1,x1,x0.001", *ROWS], 'the line of factors in the header has "x0.001", which is not applied'),
        ([HEAD, "x1,*10,x1", *ROWS], r'the line of factors in the header has "\*10"'),
        (
            [
                ",".join(["time_s", *map(str, T)]),
                ",".join(["command_V", *map(str, U)]),
                ",".join(["y_mm", *map(str, Y)]),
            ],
            'row 1: "time_s" and its samples run along the row; give each signal a column, in Python with DataFrame.T',
        ),
        (
            ["block,second,command_V,displacement_mm"]
            + [f"{k // 120},{0.5 * (k % 120):.1f},{k % 7},{k % 5}" for k in range(200)],
            "row 122: .* the seconds of a minute begin again: write hours, minutes and seconds in one column",
        ),
    ],
)
def test_a_layout_that_would_mislead_is_named(tmp_path: Path, lines: list[str], fault: str) -> None:
    (tmp_path / "r.csv").write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=fault):
        read_recording(tmp_path / "r.csv")


def test_a_line_of_units_may_hold_powers_of_ten(tmp_path: Path) -> None:
    # No prefix stands for the second power, and no fraction is applied.
    for said, unit, size in (("10^-3 m", "m", 1e-3), ("10^-5 m", "10^-5 m", 1.0), ("1/10 mm", "1/10 mm", 1.0)):
        (tmp_path / "r.csv").write_text("\n".join(["time,cmd,laser", f"s,V,{said}", *ROWS, ""]), encoding="utf-8")
        found = read_recording(tmp_path / "r.csv", input_column="cmd", output_column="laser")
        assert (found.input_units, found.output_units) == (("V",), (unit,))
        np.testing.assert_allclose(found.outputs[0], size * np.round(Y, 4), rtol=1e-12)
    (tmp_path / "r.csv").write_text("\n".join([HEAD, "x1,X 1.0,x1", *ROWS, ""]), encoding="utf-8")
    assert read_recording(tmp_path / "r.csv").outputs[0, 0] == pytest.approx(5e-3)


@pytest.mark.parametrize(
    ("names", "rows"),
    [
        ("time_s;u_V;y_mm;", ["0;1;2;", "0.02;2;3;", "0.04;3;5"]),
        ("time_s,u_V,y_mm,note", ["0,1,2,a", "0.02,2,3,b", "0.04,3,5"]),
    ],
)
def test_a_last_row_that_lacks_only_unused_cells_is_kept(tmp_path: Path, names: str, rows: list[str]) -> None:
    (tmp_path / "r.csv").write_text("\n".join([names, *rows, ""]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    np.testing.assert_allclose(found.outputs[0], [2e-3, 3e-3, 5e-3], rtol=1e-12)


def test_a_last_letter_of_another_encoding_is_no_cut_character(tmp_path: Path) -> None:
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5},a\n" for k in range(40)]
    (tmp_path / "r.csv").write_bytes("".join(["time_s,u_V,y_mm,note\n", *rows, "0.80,3,4,é"]).encode("latin-1"))
    assert read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm").outputs[0].size == 41


@pytest.mark.parametrize(
    "row",
    ["{t:.3f};0.{k:03};1.{k:03},0", "0,{k:03};0,5;1,{k:03}.5", "{t:.2f};1;512 {k:03}"],
    ids=["another column's points", "another column's commas", "two numbers in a cell"],
)
def test_a_mark_that_is_certain_in_one_column_is_removed_from_no_other(tmp_path: Path, row: str) -> None:
    rows = [row.format(k=k, t=0.02 * k) for k in range(100, 140)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s;u_V;y_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r"thousands|decimal"):
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")


def test_a_minimum_and_a_deviation_are_no_time(tmp_path: Path) -> None:
    rows = [f"{k % 7},{k % 5},{k % 3},{k % 4}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join(["u_V,y_mm,y min,y s", *rows, ""]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm", dt=0.02)
    np.testing.assert_allclose(found.outputs[0], [1e-3 * (k % 5) for k in range(40)], rtol=1e-12)


def test_a_whole_last_object_with_other_names_is_refused(tmp_path: Path) -> None:
    rows = [f'{{"time_s": {0.02 * k:.2f}, "u_V": {k % 7}, "y_mm": {k % 5}}}' for k in range(40)]
    (tmp_path / "r.jsonl").write_text(
        "\n".join([*rows, rows[0].replace("}", ', "note": "stop"}'), ""]), encoding="utf-8"
    )
    with pytest.raises(DataError, match="row 41"):
        read_recording(tmp_path / "r.jsonl", input_column="u_V", output_column="y_mm")


@pytest.mark.parametrize(
    "remark",
    [
        "Sample rate: 1,000 Hz",
        "Sample rate: 2,5 kHz",
        "load cell FS = 50",
        "Ts = 25 (room)",
        "sampling rate: 25 Hz, laser 1000 Hz",
    ],
)
def test_a_rate_that_is_not_certain_is_not_offered(tmp_path: Path, remark: str) -> None:
    rows = [f"{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join([f"# {remark}", "u_V,y_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError) as caught:
        read_recording(tmp_path / "r.csv", input_column="u_V", output_column="y_mm")
    assert "the file says" not in str(caught.value)

"""How a file is understood, and which options read one that is refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recordings
from deatwin.plant.files.understood import understand
from deatwin.plant.readoptions import ReadOptions

Write = Callable[[str, str], Path]
ROWS = "\n".join(f"{0.1 * k:.1f},{np.sin(k):.4f},{np.cos(k):.4f}" for k in range(40))


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def made(name: str, text: str) -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return made


def uneven(step: float) -> str:
    times = step * (np.arange(40) + 0.2 * (np.arange(40) % 3))
    return "\n".join(f"{t:.4f},{np.sin(k):.4f},{np.cos(k):.4f}" for k, t in enumerate(times))


FILES = {
    "as deatwin writes it": ("a.csv", f"time_s,command_V,displacement_mm\n{ROWS}", {}),
    "other names": ("a.csv", f"time_s,u,y\n{ROWS}", {"input_column": "u", "output_column": "y"}),
    "names in the other order": ("a.csv", f"t (s),Position,Voltage\n{ROWS}", {"input_column": "Voltage"}),
    "one name is missing": ("a.csv", f"time_s,command_V,speed (rpm)\n{ROWS}", {"output_column": "speed (rpm)"}),
    "no header": ("a.dat", ROWS.replace(",", " "), {"input_column": "#2", "output_column": "#3"}),
    "times of no name": ("a.csv", f"clock,u,y\n{ROWS}", {"time_column": "clock"}),
    "uneven times": ("a.csv", f"time_s,u,y\n{uneven(0.1)}", {"resample": 0.12}),
    "a gap": ("a.csv", f"time_s,command_V,displacement_mm\n{ROWS}\n9.0,0.1,0.2\n9.1,0.2,0.1", {"allow_gaps": True}),
    "missing readings": (
        "a.csv",
        f"time_s,command_V,displacement_mm\n{ROWS}\n4.0,0.1,\n4.1,0.1,NaN\n4.2,,0.1\n4.3,0.2,0.1",
        {"allow_gaps": True},
    ),
}


@pytest.mark.parametrize("kind", FILES)
def test_options_that_are_told_read_the_file(kind: str, write: Write) -> None:
    name, text, further = FILES[kind]
    found = understand(write(name, text))
    assert further.items() <= found.further.given.items()
    assert bool(found.refused) == bool(further)
    again = read_recordings(write(name, text), **(found.asked | found.further).given)
    assert [record.n_samples for record in again] == [record.n_samples for record in found.recordings]


def test_what_is_refused_says_what_other_commands_say(write: Write) -> None:
    path = write("a.csv", f"time_s,u,y\n{ROWS}")
    with pytest.raises(ValueError, match="no column") as told:
        read_recordings(path)
    assert understand(path).refused == str(told.value)


def test_columns_with_their_units_and_what_tells_them(write: Write) -> None:
    text = "Zeit (ms);U_cmd (V);Weg (mm);Raum\n" + "\n".join(f"{20 * k};{k % 7},5;{k % 5},25;1" for k in range(40))
    found = understand(write("lab.csv", text), ReadOptions(output_column="Weg (mm)"))
    assert [(c.role, c.unit, c.si, c.how) for c in found.columns] == [
        ("time", "ms", "s", "by its header"),
        ("input", "V", "V", "guessed"),
        ("output", "mm", "m", "named by --output-column"),
        ("", "", "", "passed over"),
    ]
    assert sorted(found.options) == ["--input-column", "--output-column", "U_cmd (V)", "Weg (mm)"]


def test_a_further_reading_is_a_column_of_its_own(write: Write) -> None:
    text = "time_s,command_V,displacement_mm,current_uA\n" + "\n".join(
        f"{k},{k % 7},{k % 5},{k % 3}" for k in range(40)
    )
    assert [(c.role, c.how) for c in understand(write("lab.csv", text)).columns][3] == ("extra", "by its header")


def test_a_sample_time_that_only_the_user_knows(write: Write) -> None:
    path = write("a.csv", "u,y\n" + "\n".join(f"{np.sin(k):.4f},{np.cos(k):.4f}" for k in range(40)))
    found = understand(path)
    assert found.recordings == () and found.options[-2:] == ("--dt", "SECONDS")
    assert understand(path, ReadOptions(dt=0.1)).recordings[0].sample_time == 0.1


@pytest.mark.parametrize(
    ("head", "role"), [("time_s,command_V", "output"), ("time_s,displacement_mm", "input"), ("t (s),U (V)", "output")]
)
def test_a_file_with_one_signal_lacks_the_other_one(write: Write, head: str, role: str) -> None:
    path = write("a.csv", f"{head}\n" + "\n".join(f"{0.02 * k:.2f},{k % 7}" for k in range(40)))
    found = understand(path)
    said = f"no other column can be the {role}: input and output must be columns of one file"
    assert said in f"{found.refused} {found.remaining}" and found.placeholders == ()


def test_of_tables_side_by_side_each_has_its_own_times(write: Write) -> None:
    """The second one is sampled half as often, and ends earlier in the second file."""
    times = [(0.02 * k, 0.04 * k) for k in range(40)]
    rows = [f"{a:.2f},{k % 7},{k % 5},,{b:.2f},{k % 3},{k % 4}" for k, (a, b) in enumerate(times)]
    head = "t (s),U (V),x (mm)"
    path = write("a.csv", "\n".join([f"{head},,{head}", *rows]))
    for places, step in ((("#2", "#3"), 0.02), (("#6", "#7"), 0.04)):
        (record,) = read_recordings(path, input_column=places[0], output_column=places[1])
        assert record.sample_time == step
    found = understand(path, ReadOptions(input_column="#2", output_column="#7"))
    assert "may have clocks of their own" in found.remaining or "may have clocks of their own" in found.refused
    assert found.recordings == () and "--dt" not in found.options and "--time-column" not in found.options
    path = write("b.csv", "\n".join([f"{head},,{head}", *rows[:20], *(row.split(",,")[0] for row in rows[20:])]))
    assert read_recordings(path, input_column="#2", output_column="#3")[0].n_samples == 40


def test_times_of_tables_side_by_side_keep_their_own_units(write: Write) -> None:
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5},{40 * k},{k % 3},{k % 4}" for k in range(40)]
    path = write("a.csv", "\n".join(["t,U,x,t,U,x", "s,V,mm,ms,V,mm", *rows]))
    for places, step in ((("#2", "#3"), 0.02), (("#5", "#6"), 0.04)):
        assert read_recordings(path, input_column=places[0], output_column=places[1])[0].sample_time == step


def test_times_behind_their_signals_are_to_be_named(write: Write) -> None:
    rows = [f"{k % 7},{k % 5},{0.02 * k:.2f},{k % 3},{k % 4},{0.04 * k:.2f}" for k in range(40)]
    path = write("a.csv", "\n".join(["U (V),x (mm),t (s),U (V),x (mm),t (s)", *rows]))
    with pytest.raises(DataError, match="may hold the times, and they differ"):
        read_recordings(path, input_column="#4", output_column="#5")
    (record,) = read_recordings(path, input_column="#4", output_column="#5", time_column="#6")
    assert record.sample_time == 0.04


def test_equal_times_beside_each_channel_are_one_clock(write: Write) -> None:
    """As LabVIEW exports a graph."""
    rows = [f"{0.02 * k:.2f},{k % 7},{0.02 * k:.2f},{k % 5}" for k in range(40)]
    path = write("a.csv", "\n".join([",".join(f"{q} - AI{k}" for k in (0, 1) for q in ("Time", "Amplitude")), *rows]))
    found = understand(path)
    assert found.options[-2:] == ("--time-column", "Time - AI0")
    assert found.recordings[0].sample_time == pytest.approx(0.02)
    np.testing.assert_array_equal(found.recordings[0].outputs[0], np.arange(40) % 5)


def test_a_sample_time_in_one_cell_is_passed_over_beside_a_stated_one(write: Write) -> None:
    path = write("a.csv", "u,y,Ts\n0.1,0.2,4\n" + "\n".join(f"{np.sin(k):.4f},{np.cos(k):.4f}," for k in range(40)))
    (record,) = read_recordings(path, input_column="u", output_column="y", dt=4.0)
    assert (record.n_samples, record.sample_time) == (41, 4.0)
    assert understand(path).options[-2:] == ("--dt", "SECONDS")


@pytest.mark.usefixtures("in_one_process")
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", ""),
        ("a.csv", "a letter to a colleague\nwith two lines\n"),
        ("a.csv", "time_s,command_V,displacement_mm\n0,1\n"),
        ("a.csv", "time_s,u,y\n0,1,2\n0,1,2\n0.05,2,1\n-1,2,3\n"),
        ("a.h5", "no table"),
    ],
)
def test_what_nothing_reads_is_one_line_without_options(write: Write, name: str, text: str) -> None:
    found = understand(write(name, text))
    assert found.recordings == () and found.options == ()
    assert found.refused and "\n" not in found.refused


def test_what_the_user_names_is_not_replaced(write: Write) -> None:
    found = understand(write("a.csv", f"time_s,u,y\n{ROWS}"), ReadOptions(input_column="volts"))
    assert found.recordings == () and 'no column "volts"' in found.refused


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    assert "no such file" in understand(tmp_path / "absent.csv").refused


@pytest.mark.parametrize(
    ("header", "rows", "fault"),
    [
        ("time_s,u,y", ["0,1,2", "0.1,2,inf", "0.2,3,4", "0.3,1,2"], 'row 3, column "y"'),
        ("time_s,u,y", ["0,1,2", "0.1,2,3", "0.2,OVER,4", "0.3,1,2"], 'row 4, column "u": "OVER"'),
        ("time_s;u;y", ["0;1,5;2", "0,1;2,5;3", "0,2;1.03,5;4", "0,3;1,5;2"], 'row 4, column "u": "1.03,5"'),
    ],
)
def test_a_bad_cell_does_not_hide_its_column(tmp_path: Path, header: str, rows: list[str], fault: str) -> None:
    path = tmp_path / "lab.csv"
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    found = understand(path)
    assert fault in found.remaining
    assert "--input-column u --output-column y" in found.remaining


def test_a_column_without_any_number_is_named_with_its_cell(tmp_path: Path) -> None:
    rows = [f"{0.02 * k:.2f},{'OPEN' if k % 3 else 'SHUT'},{k % 5}" for k in range(20)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s,u_V,y_mm", *rows]), encoding="utf-8")
    assert 'row 2, column "u_V": "SHUT" is not a number' in understand(tmp_path / "r.csv").remaining


def test_an_error_that_stays_is_told_once(tmp_path: Path) -> None:
    rows = [f"{0.02 * (k // 2):.2f},{'uy'[k % 2]},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s,field,value", *rows]), encoding="utf-8")
    found = understand(tmp_path / "r.csv")
    assert 'the column "field" seems to name the channel' in found.refused and found.remaining == ""


@pytest.mark.parametrize("header", ["u\u200b", "u" * 200])
def test_a_header_that_cannot_be_written_is_offered_by_its_position(tmp_path: Path, header: str) -> None:
    rows = [f"{0.02 * k:.2f},{k % 3},{k % 5}" for k in range(20)]
    (tmp_path / "r.csv").write_text("\n".join([f"time_s,{header},y_mm", *rows]), encoding="utf-8")
    found = understand(tmp_path / "r.csv")
    assert found.recordings and found.options[:2] == ("--input-column", "#2")


def test_the_number_of_a_row_is_no_signal(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    rows = [f"{k},{0.1 * k:.1f},{np.sin(k):.4f},{np.cos(k):.4f}" for k in range(1, 40)]
    path.write_text("\n".join(["Scan,Time,101 (VDC),102 (VDC)", *rows, ""]), encoding="utf-8")
    assert understand(path).options == ("--input-column", "101 (VDC)", "--output-column", "102 (VDC)")


def test_neither_the_times_again_nor_a_date_is_guessed_as_a_signal(write: Write) -> None:
    """Oscilloscopes write the times before each channel, with settings in the first rows beside them."""
    times = [f"{0.1 * k:.1f}" for k in range(40)]
    cells = [row.split(",")[1:] for row in ROWS.split("\n")]
    pairs = "\n".join(f",{t},{u},,{t},{y}" for t, (u, y) in zip(times, cells, strict=True))
    found = understand(write("scope.csv", pairs))
    assert (found.further.input_column, found.further.output_column) == ("#3", "#6")
    dated = "\n".join(f"5.11.2024,10:11:{float(t):04.1f},{u}" for t, (u, _) in zip(times, cells, strict=True))
    found = understand(write("log.csv", f"Date,Time,Vmon (V)\n{dated}"))
    assert "Date" not in (found.further.input_column, found.further.output_column)

"""Dates, times of day, and times that repeat, as loggers write them."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from deatwin.plant import DataError, Recording
from deatwin.plant.files import read_experiment, read_recording, read_recordings
from deatwin.plant.files.dates import is_clock, is_date, moment

STEP = 0.25
BEGAN = datetime(2025, 12, 31, 23, 59, 55)
OURS = "%Y-%m-%dT%H:%M:%S"


def written(folder: Path, cells: list[str], header: str = "Time", mark: str = ";") -> Path:
    """A file of a logger: times, a command and a reading with decimal commas."""
    values = np.sin(np.arange(len(cells)))
    rows = [
        mark.join([cell, *(f"{v:.6f}".replace(".", "," if mark == ";" else ".") for v in (value, value**2))])
        for cell, value in zip(cells, values, strict=True)
    ]
    path = folder / "log.csv"
    path.write_text("\n".join([mark.join([header, "command_V", "displacement_mm"]), *rows]) + "\n", encoding="utf-8")
    return path


def stamps(form: str, began: datetime = BEGAN, count: int = 40) -> list[str]:
    """Python's own writing of the times, with milliseconds where the form says ``~``."""
    moments = [began + timedelta(seconds=STEP * k) for k in range(count)]
    return [m.strftime(form).replace("~", f"{m.microsecond // 1000:03d}") for m in moments]


def the_clock(recording: Recording) -> tuple[float, float]:
    return recording.sample_time, float(recording.timepts[-1] - recording.timepts[0])


@pytest.mark.parametrize(
    "form",
    [
        "%d.%m.%Y %H:%M:%S.~",
        "%d.%m.%Y %H:%M:%S,~",
        "%d.%m.%y %H:%M:%S,~",
        "%d/%m/%Y %H:%M:%S.~",
        "%d-%b-%Y %H:%M:%S.~",
        "%d %b %Y %H:%M:%S.~",
        "%m/%d/%Y %I:%M:%S.~ %p",
        "%m/%d/%y %H:%M:%S:~",
        "%Y/%m/%d %H:%M:%S.~",
        "%Y.%m.%d %H:%M:%S.~",
        "%Y-%m-%dT%H:%M:%S.~Z",
        "%Y%m%dT%H%M%S.~",
        "%Y%m%d%H%M%S.~",
        "%d.%m.%Y %H:%M:%S.~+01:00",
    ],
)
@pytest.mark.parametrize("header", ["Time", "Datum", "Date/Time", "Timestamp (UTC)"])
def test_dates_are_times(tmp_path: Path, form: str, header: str) -> None:
    found = read_recording(written(tmp_path, stamps(form), header))
    assert the_clock(found) == (STEP, STEP * 39)
    began = BEGAN - timedelta(hours=1) if "+" in form else BEGAN
    assert found.provenance["clock_began"][:19] == began.strftime(OURS)


@pytest.mark.parametrize("form", ["%H:%M:%S.~", "%H:%M:%S,~", "%I:%M:%S.~ %p", "%H:%M:%S:~"])
@pytest.mark.parametrize("header", ["Time", "Uhrzeit"])
def test_times_of_day_go_on_past_midnight(tmp_path: Path, form: str, header: str) -> None:
    found = read_recording(written(tmp_path, stamps(form), header))
    assert the_clock(found) == (STEP, STEP * 39)
    assert found.provenance["times"] == "times of day"
    assert "clock_began" not in found.provenance


@pytest.mark.parametrize(
    ("began", "dates", "refused"),
    [
        ("12:00:00", ("2024-05-01", "2024-05-03"), True),  # stopped, and started again two days later
        ("23:59:59.8", ("2024-05-01", "2024-05-03"), True),
        ("23:59:59.8", ("2024-05-01", "2024-05-02"), False),
        ("23:59:59.8", ("4/5/2024", "5/5/2024"), False),
        ("23:59:59.8", ("2024-05-01", "2024-05-01"), False),  # the date of the start
        ("12:00:00", ("01.05.2024", "02.05.2024"), True),
        ("23:59:59.8", ("2024-05-01 23:59:59", "2024-05-02 00:00:00"), False),  # the date with a time of its own
    ],
)
def test_dates_beside_times_of_day_change_at_midnight(
    tmp_path: Path, began: str, dates: tuple[str, str], refused: bool
) -> None:
    first = timedelta(hours=int(began[:2]), minutes=int(began[3:5]), seconds=float(began[6:]))
    clocks = [(datetime(2000, 1, 1) + first + timedelta(milliseconds=20 * k)).time() for k in range(20)]
    rows = [f"{dates[k >= 10]},{clock.isoformat('milliseconds')},{k % 3},{k}" for k, clock in enumerate(clocks)]
    (tmp_path / "r.csv").write_text("\n".join(["Date,Time,command_V,displacement_mm", *rows]), encoding="utf-8")
    if refused:
        with pytest.raises(
            DataError, match=rf'row 12: in the column "Date" {dates[1]} follows {dates[0]}, but the times'
        ):
            read_recording(tmp_path / "r.csv")
    else:
        assert read_recording(tmp_path / "r.csv").sample_time == pytest.approx(0.02)


def test_elapsed_times_go_on_past_a_day(tmp_path: Path) -> None:
    cells = [f"{23 + k // 60}:{k % 60:02d}:00" for k in range(100)]
    assert the_clock(read_recording(written(tmp_path, cells))) == (60.0, 99 * 60.0)
    cells = [f"{k // 240:02d}:{k % 240 / 4:05.2f}" for k in range(300)]  # minutes and seconds
    assert the_clock(read_recording(written(tmp_path, cells, mark=","))) == (STEP, 299 * STEP)


def test_day_and_month_that_nothing_tells(tmp_path: Path) -> None:
    early, late = datetime(2025, 5, 6, 12, 0, 0), datetime(2025, 5, 6, 23, 59, 55)
    found = read_recording(written(tmp_path, stamps("%d/%m/%Y %H:%M:%S.~", early)))
    assert the_clock(found) == (STEP, STEP * 39)  # within one day the order does not matter
    assert "clock_began" not in found.provenance
    first = (tmp_path / "log.csv").rename(tmp_path / "first.csv")
    files = [first, written(tmp_path, stamps("%d/%m/%Y %H:%M:%S.~", early + timedelta(seconds=60)))]
    with pytest.raises(DataError, match=r"first.csv and .*log.csv: some of their dates .* --time-column NAME=dmy"):
        read_experiment(files)
    assert [one.start for one in read_experiment(files, time_column="Time=mdy").recordings] == [0.0, 60.0]
    path = written(tmp_path, stamps("%d/%m/%Y %H:%M:%S.~", late))
    with pytest.raises(DataError, match='state the order: --time-column "Time=dmy" or --time-column "Time=mdy"'):
        read_recording(path)
    assert the_clock(read_recording(path, time_column="Time=dmy")) == (STEP, STEP * 39)
    with pytest.raises(DataError, match=r"a gap from 4\.75 s to 2\.5056e\+06 s"):  # 5 June to 5 July: 29 days
        read_recording(path, time_column="Time=mdy")
    with pytest.raises(DataError, match='holds no dates; remove "=dmy"'):
        read_recording(written(tmp_path, ["1", "2", "3", "4"]), time_column="Time=dmy")


def test_a_year_of_two_digits_may_come_first(tmp_path: Path) -> None:
    cells = stamps("%y/%m/%d %H:%M:%S.~", datetime(2025, 5, 13, 23, 59, 55))
    path = written(tmp_path, cells, mark=",")
    with pytest.raises(
        DataError, match=r'the day or the year first.*: --time-column "Time=dmy" or --time-column "Time=ymd"'
    ):
        read_recording(path)
    found = read_recording(path, time_column="Time=ymd")
    assert the_clock(found) == (STEP, STEP * 39)
    assert found.provenance["clock_began"] == "2025-05-13T23:59:55"
    within = read_recording(written(tmp_path, cells[:20], mark=","))  # on one day, only its date is unknown
    assert "clock_began" not in within.provenance and the_clock(within) == (STEP, STEP * 19)


def test_a_cell_that_is_no_date(tmp_path: Path) -> None:
    cells = stamps("%d.%m.%Y %H:%M:%S")
    with pytest.raises(DataError, match=r'row 9, column "Time": "31.12.2025 25:00:00" is not a date'):
        read_recording(written(tmp_path, [*cells[:7], "31.12.2025 25:00:00", *cells[8:]]))
    cells = stamps("%H:%M:%S.~")
    for wrong in ("noon", "12:60:00"):
        with pytest.raises(DataError, match=f'row 9, column "Time": "{wrong}" is no time of day'):
            read_recording(written(tmp_path, [*cells[:7], wrong, *cells[8:]]))


@pytest.mark.parametrize(
    ("cell", "month"),
    [
        ("4. März 2025 12:00:00,25", 3),
        ("04-Mär-2025 12:00:00.25", 3),  # MATLAB in Germany
        ("Di, 4. Mrz. 2025 12:00:00,25", 3),
        ("4 mars 2025 12:00:00.25", 3),
        ("04-juin-2025 12:00:00.25", 6),
        ("04-juil.-2025 12:00:00.25", 7),
        ("04/août/2025 12:00:00.25", 8),
        ("04-ene-2025 12:00:00,25", 1),
        ("04-ott-2025 12:00:00,25", 10),
        ("4 October 2025, 12:00:00.25", 10),
        ("04Oct2025 12:00:00.25", 10),
        ("2025-Dec-04 12:00:00.250000", 12),  # boost
        ("04-DEZ-25 12:00:00,25", 12),
    ],
)
def test_months_by_their_names(cell: str, month: int) -> None:
    assert is_date(cell) and moment(cell) == datetime(2025, month, 4, 12, 0, 0, 250000)


def test_what_is_a_date() -> None:
    assert all(map(is_date, ["1.2.2025", "1/2/25 3:04", "3-Mar-2025", "2025-01-02"]))
    assert not any(map(is_date, ["1.2", "1.25", "12 13 2025", "3-Foo-2025", "1/2", "16 samples 2025"]))
    assert all(map(is_clock, ["1:02:03", "2:03 PM", "00:01.5", "123:00:00"]))
    assert not any(map(is_clock, ["14:03", "1.5", "#1:2", "a:b:c"]))
    for wrong in ("32.1.2025", "1.13.2025", "1.1.2025 13:00 PM", "1.1.2025 12:60"):
        with pytest.raises(ValueError, match=r"date|time|day|month"):
            moment(wrong)


def test_times_that_are_printed_too_coarsely(tmp_path: Path) -> None:
    path = written(tmp_path, stamps("%d.%m.%Y %H:%M:%S"))  # four rows a second
    with pytest.raises(DataError, match=r"30 such rows in all\); the times are printed too coarsely; .* --dt 0.25"):
        read_recording(path)
    assert read_recording(path, dt=STEP).sample_time == STEP
    with pytest.raises(DataError, match="do not increase"):
        read_recording(path, dt=0.2)


def test_a_column_that_counts_the_rows_is_no_clock_beside_a_sample_time(tmp_path: Path) -> None:
    path = written(tmp_path, [str(k) for k in range(40)], "time [samples]")
    found = read_recording(path, dt=STEP)
    assert the_clock(found) == (STEP, STEP * 39)
    assert "counts the rows" in found.provenance["clock"]
    with pytest.raises(DataError, match='said to be in "samples", which is not a known unit of time'):
        read_recording(path, dt=STEP, time_column="#1")
    with pytest.raises(DataError, match="the stated sample time is"):
        read_recording(path, dt=STEP, time_column="#1=s")


@pytest.mark.parametrize(
    ("times", "says"),
    [
        ([*range(20), 19, *range(20, 40)], "row 22: .*; remove the repeated rows"),
        ([*range(20), 25, 24, *range(26, 40)], "row 23: .* put the rows in order"),
        ([*range(20), *range(20)], "row 22: .* starts again: give each run its own file"),
    ],
)
def test_times_that_do_not_increase(tmp_path: Path, times: list[int], says: str) -> None:
    path = written(tmp_path, [str(time) for time in times], "time (s)")
    for dt in (None, 1.0):
        with pytest.raises(DataError, match=says):
            read_recording(path, dt=dt)


def in_one_number(start: str, step: float, count: int, form: str) -> list[str]:
    """Times of day as receivers of satellites write them."""
    begin = datetime.fromisoformat(f"2024-05-01 {start}")
    times = [begin + timedelta(seconds=step * k) for k in range(count)]
    texts = [f"{time:%H%M%S}.{time.microsecond // 1000:03d}" for time in times]
    return [
        {
            "bare": text.lstrip("0"),
            "whole": text[:6],
            "run on": text.replace(".", ""),
            "comma": text.replace(".", ","),
        }.get(form, text)
        for text in texts
    ]


@pytest.mark.parametrize(
    ("header", "start", "step", "form"),
    [
        ("time", "14:30:05.250", 0.25, "padded"),  # the number goes from 143059.75 to 143100
        ("UTC", "14:59:05", 0.02, "padded"),
        ("time", "09:30:05", 0.25, "bare"),
        ("time", "23:59:30", 0.25, "padded"),
        ("time", "14:30:05", 1.0, "whole"),
        ("timestamp", "14:30:05", 0.25, "run on"),
        ("time", "14:30:05", 0.25, "comma"),
        ("time", "14:30:05", 25.0, "whole"),
        ("UTC (hhmmss.sss)", "00:00:05", 0.25, "padded"),  # the header says so
        ("hhmmss", "14:30:05", 60.0, "whole"),
    ],
)
def test_times_of_day_in_one_number(tmp_path: Path, header: str, start: str, step: float, form: str) -> None:
    times = in_one_number(start, step, 3000 if step < 0.1 else 300, form)
    rows = [f"{time};{k % 7},5;{k}" for k, time in enumerate(times)]
    (tmp_path / "r.csv").write_text("\n".join([f"{header};command_V;displacement_mm", *rows, ""]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv")
    assert (found.n_samples, found.sample_time, found.start) == (len(times), step, 0.0)
    assert found.provenance["times"] == "times of day"


@pytest.mark.usefixtures("in_one_process")
def test_times_of_day_in_one_number_of_an_array(tmp_path: Path) -> None:
    times = np.array(in_one_number("14:30:05", 0.25, 300, "padded"), dtype=float)
    savemat(tmp_path / "r.mat", {"time": times, "command_V": np.arange(300.0), "displacement_mm": np.arange(300.0)})
    assert read_recording(tmp_path / "r.mat").sample_time == 0.25


@pytest.mark.parametrize(("said", "step"), [("hhmmss", 60.0), ("s", 100.0)])
def test_times_of_day_or_seconds_are_asked_for(tmp_path: Path, said: str, step: float) -> None:
    rows = [f"{time},{k % 7},{k}" for k, time in enumerate(in_one_number("14:00:00", 60.0, 60, "whole"))]
    (tmp_path / "r.csv").write_text("\n".join(["time,command_V,displacement_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r'may be times of day, .* or seconds; state it: .*"time=hhmmss" or .*"time=s"'):
        read_recording(tmp_path / "r.csv")
    assert read_recording(tmp_path / "r.csv", time_column=f"time={said}").sample_time == step


@pytest.mark.parametrize(("first", "step"), [(20000, 0.5), (0, 100), (100000, 0.01), (143005, 1)])
def test_seconds_stay_seconds(tmp_path: Path, first: float, step: float) -> None:
    rows = [
        f"{first + step * k:g},{k % 7},{k}" if step > 1 else f"{first + step * k:.2f},{k % 7},{k}" for k in range(200)
    ]
    (tmp_path / "r.csv").write_text("\n".join(["time,command_V,displacement_mm", *rows, ""]), encoding="utf-8")
    found = read_recording(tmp_path / "r.csv")
    assert (found.sample_time, found.start) == (pytest.approx(step, rel=1e-8), first)


def test_minutes_and_seconds_go_on_past_the_hour(tmp_path: Path) -> None:
    """As a spreadsheet writes times with decimals: without the hour."""
    recording = read_recording(written(tmp_path, stamps("%M:%S,~")))
    assert the_clock(recording) == (pytest.approx(STEP), pytest.approx(39 * STEP))


def test_minutes_and_seconds_that_start_again_are_no_pause(tmp_path: Path) -> None:
    """A logger that is started again after 40 minutes did not wait for the hour to end."""
    times = [*(2400.0 + STEP * k for k in range(20)), *(STEP * k for k in range(20))]
    path = written(tmp_path, [f"{int(t // 60):02}:{t % 60:05.2f}" for t in times], mark=",")
    with pytest.raises(DataError, match="the clock starts again: give each run its own file"):
        read_recordings(path, allow_gaps=True)


def test_elapsed_minutes_may_exceed_an_hour(tmp_path: Path) -> None:
    times = [3590.0 + STEP * k for k in range(80)]
    recording = read_recording(written(tmp_path, [f"{int(t // 60)}:{t % 60:05.2f}" for t in times], mark=","))
    assert the_clock(recording) == (pytest.approx(STEP), pytest.approx(79 * STEP))

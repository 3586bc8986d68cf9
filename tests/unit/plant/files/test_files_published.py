"""Files as people publish them: without a header, between blanks, with dates, two columns of one quantity."""

import re
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_commands, read_experiment, read_recording
from deatwin.plant.recording import Recording

U, Y = [0.0, 1.5, 2.0, 0.25], [0.5, 1.0, 0.5, 2.0]
BY_PLACE = {"input_column": "#2", "output_column": "#3"}
NAMED = {"input_column": "u", "output_column": "y"}


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    def write_file(*lines: str, name: str = "rec.csv") -> Path:
        path = tmp_path / name
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        return path

    return write_file


def rows(form: Callable[[int], str], between: str = ",") -> list[str]:
    """The samples, with a cell for the time of each."""
    return [between.join([form(k), str(u), str(y)]) for k, (u, y) in enumerate(zip(U, Y, strict=True))]


def check(recording: Recording, sample_time: float = 0.02) -> None:
    assert recording.sample_time == sample_time
    np.testing.assert_array_equal(recording.inputs, [U])
    np.testing.assert_array_equal(recording.outputs, [Y])


def seconds(k: int) -> str:
    return f"{0.02 * k:.2f}"


class TestNoHeader:
    @pytest.mark.parametrize("between", [",", ";", "\t", "  ", " \t "])
    def test_columns_by_their_places(self, write, between: str) -> None:
        path = write(*rows(seconds, between))
        check(read_recording(path, time_column="#1", **BY_PLACE))
        assert read_recording(path, time_column="#1", **BY_PLACE).provenance["rows"] == "1-4"
        check(read_recording(path, dt=0.02, **BY_PLACE))
        np.testing.assert_array_equal(read_commands(path, input_column="#2", dt=0.02).inputs, [U])

    def test_unit_of_the_times(self, write) -> None:
        check(read_recording(write(*rows(lambda k: str(20 * k))), time_column="#1=ms", **BY_PLACE))

    def test_decimal_commas(self, write) -> None:
        lines = [line.replace(".", ",") for line in rows(seconds, " ")]
        check(read_recording(write(*lines), time_column="#1", **BY_PLACE))

    def test_the_advice_works(self, write) -> None:
        path = write(*rows(seconds))
        with pytest.raises(DataError, match=r"row 1: there is no header") as told:
            read_recording(path)
        advice = dict(re.findall(r'--(\w+)-column "(#\d)"', str(told.value)))
        check(read_recording(path, **{f"{role}_column": place for role, place in advice.items()}))

    def test_a_column_that_does_not_increase_is_not_advised_as_times(self, write) -> None:
        path = write(*rows(lambda k: str(k % 3)))
        with pytest.raises(DataError, match=r'no header.*--output-column "#2" --dt SECONDS'):
            read_recording(path)

    def test_uneven_times_are_advised_with_a_clock_that_works(self, write) -> None:
        path = write(*rows(lambda k: f"{0.02 * k + 0.004 * (k % 2):.3f}"))
        with pytest.raises(DataError, match=r"row 1: there is no header") as told:
            read_recording(path)
        found = re.search(r'--time-column "(#\d)" --resample (\S+) ', str(told.value))
        assert found
        recording = read_recording(path, time_column=found[1], resample=float(found[2]), **BY_PLACE)
        assert recording.sample_time == pytest.approx(0.02, rel=0.25)
        assert "interpolated" in recording.provenance["resampled"]

    @pytest.mark.parametrize("header", ["time,1,2", "0.1;u;y"])
    def test_a_header_that_holds_numbers_is_no_sample(self, write, header: str) -> None:
        lines = rows(seconds, "," if "," in header else ";")
        with pytest.raises(DataError, match=r"no header; .*a name must not be a number"):
            read_recording(write(header, *lines), time_column="#1", **BY_PLACE)

    def test_commas_that_part_digits_too(self, write) -> None:
        lines = [line.replace(".", ",") for line in rows(seconds)]
        with pytest.raises(DataError, match=r"a comma cannot be both delimiter and decimal sign"):
            read_recording(write(*lines), time_column="#1", **BY_PLACE)


class TestBlanks:
    @pytest.mark.parametrize("name", ["rec.dat", "rec.asc", "rec.txt", "REC.DAT"])
    def test_as_numpy_writes_by_default(self, tmp_path: Path, name: str) -> None:
        np.savetxt(tmp_path / name, np.c_[0.02 * np.arange(4), U, Y], header="time u y")
        check(read_recording(tmp_path / name, **NAMED))
        np.savetxt(tmp_path / name, np.c_[0.02 * np.arange(4), U, Y], footer="made by hand")
        check(read_recording(tmp_path / name, time_column="#1", **BY_PLACE))

    @pytest.mark.parametrize(
        "header", ["time u y", "  time\tu  y ", "% time u y", "# 4 samples\n# time u y", "//time u y"]
    )
    def test_headers(self, write, header: str) -> None:
        check(read_recording(write(header, *(f"   {line}" for line in rows(seconds, "  "))), **NAMED))

    @pytest.mark.parametrize("header", ["t [s]  u [V]  y [mm]", "t (s) u (V) y (mm)", "t u y\ns V mm", "t_s u_V y_mm"])
    def test_units(self, write, header: str) -> None:
        recording = read_recording(write(header, *rows(seconds, " \t ")), **NAMED)
        assert (recording.input_units, recording.output_units) == (("V",), ("m",))
        np.testing.assert_array_equal(recording.outputs, [[0.5e-3, 1e-3, 0.5e-3, 2e-3]])

    @pytest.mark.parametrize("rates", ["200 Hz\t200 Hz\t200 Hz", "200 Hz\t±10 V\t50,0 mm", "\t10 kHz\t10 kHz"])
    def test_a_line_of_rates_or_ranges_below_names_and_units(self, write, rates: str) -> None:
        for names in (["time\tu\ty", "s\tV\tmm"], ["time [s]\tu [V]\ty [mm]"]):
            recording = read_recording(write("Test 4", *names, rates, *rows(seconds, "\t")), **NAMED)
            np.testing.assert_array_equal((recording.inputs[0], 1e3 * recording.outputs[0]), (U, Y))
            assert (recording.input_units, recording.output_units) == (("V",), ("m",))

    def test_names_with_blanks_stay_whole_between_tabs(self, write) -> None:
        path = write("Time (s)\tU cmd (V)\tWeg (mm)", *rows(seconds, "\t"))
        assert read_recording(path, input_column="U cmd (V)", output_column="Weg (mm)").output_names == ("Weg",)

    def test_header_of_an_oscilloscope(self, write) -> None:
        for names in (["second,Volt,Volt"], ["x-axis,1,2", "second,Volt,Volt"]):
            recording = read_recording(write(*names, *rows(seconds)), **BY_PLACE)
            check(recording)
            assert recording.output_units == ("V",)


def test_index_without_a_name_before_the_columns(write) -> None:
    """As pandas writes it."""
    check(read_recording(write(",time,u,y", *(f"{k},{row}" for k, row in enumerate(rows(seconds)))), **NAMED))
    check(read_recording(write("#,time,u,y", *(f"{k},{row}" for k, row in enumerate(rows(seconds)))), **NAMED))


@pytest.mark.parametrize(
    "head",
    [
        (",u,y", ",V,mm", "time,,"),
        ("signal,u,y", "unit,V,mm", "time_s,,"),
        (",rig,rig", ",u,y", ",V,mm", "time,,"),
        ("rig,left,left", "signal,u_V,y_mm", "time_s,,"),
        ("time,u,y", "s,V,mm", ",,"),
    ],
)
def test_several_levels_of_names_above_the_name_of_the_index(write, head: tuple[str, ...]) -> None:
    """As pandas writes columns with a MultiIndex."""
    recording = read_recording(write(*head, *rows(seconds)), **NAMED)
    assert (recording.sample_time, recording.output_units, recording.provenance["rows"]) == (
        0.02,
        ("m",),
        f"{len(head) + 1}-{len(head) + 4}",
    )
    np.testing.assert_array_equal(recording.inputs, [U])
    np.testing.assert_allclose(recording.outputs, 1e-3 * np.array([Y]), rtol=1e-15)


def test_a_remark_below_a_title_and_names_does_not_replace_the_name_of_the_times(write) -> None:
    check(read_recording(write("Film 7,,", "time_s,u,y", "Remark,,", *rows(seconds)), **NAMED))


class TestTimes:
    @pytest.mark.parametrize("name", ["ts", "Timestamp", "unixTime", "t", "Time (s)", "time [s]"])
    def test_usual_names(self, write, name: str) -> None:
        check(read_recording(write(f"{name},u,y", *rows(seconds)), **NAMED))

    @pytest.mark.parametrize(
        ("name", "asked"), [("clock", "clock=ms"), ("clock_ms", "clock_ms"), ("clock (ms)", "clock"), ("ms", "ms")]
    )
    def test_units(self, write, name: str, asked: str) -> None:
        path = write(f"{name},u,y", *rows(lambda k: str(20 * k)))
        check(read_recording(path, time_column=asked, **NAMED))

    @pytest.mark.parametrize(
        ("form", "zone"),
        [
            ("2024-02-29 23:59:59.{:03}", ""),
            ("2024-02-29T23:59:59.{:03}", ""),
            ("2024/02/29 23:59:59.{:03}", ""),
            ("2024-02-29T23:59:59.{:03}Z", "+00:00"),
            ("2024-03-01T01:59:59.{:03}+02:00", "+00:00"),
        ],
    )
    def test_dates(self, write, form: str, zone: str) -> None:
        path = write("when,u,y", *rows(lambda k: form.format(900 + 20 * k)))
        recording = read_recording(path, time_column="when", **NAMED)
        check(recording)
        assert recording.start == 0.0
        assert recording.provenance["clock_began"] == f"2024-02-29T23:59:59.900000{zone}"

    @pytest.mark.parametrize(("unit", "per_second"), [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
    def test_unix_times_tell_their_unit(self, write, caplog, unit: str, per_second: int) -> None:
        first = 1709251199  # 2024-02-29 23:59:59 in UTC, by the program date

        def form(k: int) -> str:
            return f"{first}.{2 * k:02}" if per_second == 1 else str(first * per_second + k * per_second // 50)

        recording = read_recording(write("timestamp,u,y", *rows(form)), **NAMED)
        check(recording)
        assert (recording.start, recording.provenance["times"]) == (0.0, f"Unix times in {unit}")
        assert recording.provenance["clock_began"] == "2024-02-29T23:59:59+00:00"
        assert f"Unix times in {unit}, as their size says" in caplog.text

    @pytest.mark.parametrize(("year", "zone"), [(1601, "+00:00"), (1, "")])
    def test_ticks_of_100_ns(self, write, year: int, zone: str) -> None:
        first = (datetime(2024, 2, 29, 23, 59, 59) - datetime(year, 1, 1)) // timedelta(microseconds=1) * 10
        recording = read_recording(write("FileTime,u,y", *rows(lambda k: str(first + 200_000 * k))), **NAMED)
        check(recording)
        assert recording.provenance["clock_began"] == f"2024-02-29T23:59:59{zone}"
        assert recording.provenance["times"] == f"ticks of 100 ns since the year {year}"

    def test_what_deatwin_writes_keeps_its_clock(self, write) -> None:
        path = write("time_s,u,y", *rows(lambda k: f"{1709251199 + k}.0"))
        assert read_recording(path, **NAMED).start == 1709251199.0

    def test_files_with_dates_lie_on_one_clock(self, write) -> None:
        late = write("time,u,y", *rows(lambda k: f"2024-05-01 12:00:{10 + k}"), name="late.csv")
        early = write("time,u,y", *rows(lambda k: f"2024-05-01 11:59:5{k}"), name="early.csv")
        first, second = read_experiment([late, early], **NAMED).recordings
        assert (first.start, second.start) == (0.0, 20.0)
        assert second.provenance["clock_began"] == "2024-05-01T11:59:50"

    @pytest.mark.parametrize(
        ("early", "late", "without"),
        [
            (lambda k: f"2024-05-01 12:00:0{k}", lambda k: str(10 + k), "late.csv"),
            (lambda k: str(1714564800 + k), lambda k: str(10 + k), "late.csv"),
            (lambda k: f"12:00:0{k}", lambda k: f"12:01:0{k}", "early.csv"),
        ],
    )
    def test_files_without_a_date_are_not_put_beside_others(self, write, early, late, without: str) -> None:
        """One clock begins at the first date, the other anywhere."""
        files = [write("time,u,y", *rows(form), name=name) for form, name in ((early, "early.csv"), (late, "late.csv"))]
        with pytest.raises(
            DataError, match=rf"the times of \S*{without} tell no date, so the time between the files is unk"
        ):
            read_experiment(files, **NAMED)


class TestOneQuantity:
    HEADER = "time_s,laser_V,laser_mm,force_V,force_N"
    ROWS = tuple(f"{k},{k % 3},{10 + k % 2},0.{k % 4},{k % 4}" for k in range(4))

    @pytest.mark.parametrize("asked", [("laser_mm", "force_N"), ("#3", "#5")])
    def test_header_or_place_tells_them_apart(self, write, asked: tuple[str, str]) -> None:
        recording = read_recording(write(self.HEADER, *self.ROWS), input_column=asked[0], output_column=asked[1])
        assert (recording.input_names, recording.output_names) == (("laser",), ("force",))
        np.testing.assert_array_equal(recording.inputs, [[0.010, 0.011, 0.010, 0.011]])
        np.testing.assert_array_equal(recording.outputs, [[0.0, 1.0, 2.0, 3.0]])

    def test_both_have_names_of_their_own(self, write) -> None:
        recording = read_recording(write(self.HEADER, *self.ROWS), input_column="laser_V", output_column="laser_mm")
        assert (recording.input_names, recording.output_names) == (("laser_V",), ("laser_mm",))
        np.testing.assert_array_equal(recording.extras["force"], [0.0, 1.0, 2.0, 3.0])  # the one in newtons

    def test_name_that_fits_both(self, write) -> None:
        with pytest.raises(DataError, match=r'occurs 2 times; name one by its whole header, "laser_V" or "laser_mm"'):
            read_recording(write(self.HEADER, *self.ROWS), input_column="laser", output_column="force_N")

    def test_usual_name_in_two_units(self, write) -> None:
        path = write("time_s,command_V,displacement_V,displacement_mm", *(f"{k},1,2,3" for k in range(3)))
        np.testing.assert_array_equal(read_recording(path).outputs, [[0.003] * 3])

    def test_a_name_like_a_usual_one_is_no_misspelling_where_columns_were_named(self, write) -> None:
        path = write("time,u,y,Force_N", *(f"{line},1" for line in rows(seconds)))
        check(read_recording(path, **NAMED))


NAMES = ("time", "Time (ms)", "clock", "u", "U_V", "force_N", "Force (N)", "pos_mm", "position", "state", "force_N")


def test_what_an_error_offers_works(write) -> None:
    """Of 300 random tables with a misspelt name, each offer is one that the same call takes."""
    rng, offers = np.random.default_rng(48), 0
    for _ in range(300):
        headers = [str(name) for name in rng.permutation(NAMES)[: rng.integers(4, 8)]]
        cells = {"state": lambda k: "on", "clock": lambda k: str(k * k), "U_V": lambda k: str(k % 2)}
        body = [",".join(cells.get(name, str)(k) for name in headers) for k in range(4)]
        path = write(",".join(headers), *body)
        asked = {role: str(rng.choice(headers)) for role in ("input_column", "output_column", "time_column")}
        role = str(rng.choice(list(asked)))
        asked[role] = asked[role][:-1] + "x"
        try:
            read_recording(path, **asked)
        except DataError as error:
            found = re.search(r'did you mean "([^"]+)"', str(error))
            if not found or f'no column "{asked[role]}"' not in str(error):
                continue
            offers += 1
            try:
                read_recording(path, **{**asked, role: found[1]})
            except DataError as second:  # another role may be at fault, but not this one
                assert f'"{found[1]}"' not in str(second), (asked, str(error), str(second))
    assert offers > 30, offers


def test_without_a_header_the_first_column_holds_the_times_if_it_rises_evenly(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    rng = np.random.default_rng(0)
    times = 0.25 * np.arange(40)
    np.savetxt(tmp_path / "even.txt", np.c_[times, rng.standard_normal((40, 2))])
    assert read_recording(tmp_path / "even.txt", input_column="#2", output_column="#3").sample_time == 0.25
    assert "is taken as the times in s" in caplog.text
    caplog.clear()
    assert read_recording(
        tmp_path / "even.txt", input_column="#2", output_column="#3", time_column="#1=ms"
    ).sample_time == pytest.approx(0.25e-3)
    assert caplog.text == ""
    # Values that happen to rise, but not evenly, are no times.
    np.savetxt(tmp_path / "uneven.txt", np.c_[np.cumsum(rng.uniform(0.1, 0.9, 40)), rng.standard_normal((40, 2))])
    with pytest.raises(DataError, match="it is unknown which column holds the times"):
        read_recording(tmp_path / "uneven.txt", input_column="#2", output_column="#3")

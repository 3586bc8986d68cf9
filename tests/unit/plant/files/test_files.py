"""Recordings from CSV files and back: formats that occur, and one clear error for each fault."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import (
    read_commands,
    read_experiment,
    read_recording,
    read_recordings,
    write_csv,
    write_text_atomic,
)

HEADER = "time_s,command_V,displacement_mm"


def rows(n: int = 50, start: float = 0.0, step: float = 0.02) -> list[str]:
    """Lines of samples: the command is 1 V and up, the displacement 0.1 mm and up."""
    return [f"{start + k * step:.3f},{1.0 + 0.01 * k:.2f},{0.1 + 0.001 * k:.3f}" for k in range(n)]


def lines_at(times: np.ndarray) -> list[str]:
    return [HEADER, *(f"{time!r},{k % 7},{k % 5}" for k, time in enumerate(times.tolist()))]


@pytest.fixture
def write(tmp_path: Path):
    def write_file(lines: list[str], *, encoding: str = "utf-8", end: str = "\n", name: str = "rec.csv") -> Path:
        path = tmp_path / name
        path.write_bytes((end.join(lines) + end).encode(encoding))
        return path

    return write_file


class TestFormats:
    def test_canonical(self, write) -> None:
        path = write([HEADER, *rows(start=240.0)])
        recording = read_recording(path)
        assert recording.n_samples == 50
        assert (recording.start, recording.sample_time) == (240.0, 0.02)
        assert (recording.inputs[0, 1], recording.outputs[0, 1]) == (1.01, 0.101e-3)
        assert (recording.input_names, recording.output_units) == (("command",), ("m",))
        assert recording.provenance["file"] == str(path)
        assert recording.provenance["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert recording.provenance["rows"] == "2-51"

    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "gbk"])
    def test_chinese_header_with_units_below_quotes_and_blank_lines(self, write, encoding: str) -> None:
        quoted = [",".join(f'"{cell}"' for cell in row.split(",")) for row in rows()]
        lines = ["", "时间,位移,力", "(s),(mm),(N)", *quoted, ""]
        recording = read_recording(write(lines, encoding=encoding, end="\r\n"), input_column="位移", output_column="力")
        assert (recording.input_names, recording.input_units) == (("位移",), ("m",))
        assert (recording.output_names, recording.output_units) == (("力",), ("N",))
        assert (recording.n_samples, recording.inputs[0, 0], recording.outputs[0, 0]) == (50, 1e-3, 0.1)
        assert recording.provenance["rows"] == "4-53"

    def test_latin_1(self, write) -> None:
        path = write(["Zeit [s],Spannung [V],Weg [µm],Überdruck", *(f"{row},1" for row in rows())], encoding="latin-1")
        recording = read_recording(path, input_column="Spannung", output_column="Weg [µm]")
        assert recording.output_names == ("Weg",)
        assert recording.outputs[0, 0] == pytest.approx(0.1e-6)

    def test_columns_by_place(self, write) -> None:
        recording = read_recording(write(["time_s,a,b", *rows()]), input_column="#3", output_column="#2")
        assert (recording.input_names, recording.input_units) == (("b",), ("",))
        assert (recording.inputs[0, 0], recording.outputs[0, 0]) == (0.1, 1.0)

    def test_other_units_in_the_usual_names(self, write) -> None:
        body = [f"{k},{1000 + k},{100 + k}" for k in range(0, 100, 5)]
        recording = read_recording(write(["time_ms,command_mV,displacement_um", *body]))
        assert recording.sample_time == 0.005
        assert (recording.inputs[0, 0], recording.outputs[0, 1]) == (1.0, 105e-6)

    def test_extra_channels_in_si_and_other_columns_passed_over(self, write) -> None:
        header = HEADER + ",current_uA,temperature_C,remark"
        recording = read_recording(write([header, *(f"{row},2.5,21.0,fine" for row in rows())]))
        assert set(recording.extras) == {"current", "temperature"}
        assert recording.extras["current"][0] == 2.5e-6
        assert recording.extras["temperature"][0] == pytest.approx(294.15)

    def test_trailing_delimiter(self, write) -> None:
        assert read_recording(write([HEADER + ",", *(row + "," for row in rows())])).n_samples == 50

    def test_commands_alone(self, write) -> None:
        commands = read_commands(write(["time_s,command_V", *(row.rpartition(",")[0] for row in rows())]))
        assert (commands.n_samples, commands.outputs.shape) == (50, (0, 50))
        ignored = read_commands(write([HEADER, *(row.rpartition(",")[0] + ",?" for row in rows())]))
        np.testing.assert_array_equal(ignored.inputs, commands.inputs)

    def test_experiment_in_any_order(self, write) -> None:
        late = write([HEADER, *rows(start=1.0)], name="late.csv")
        early = write([HEADER, *rows()], name="early.csv")
        experiment = read_experiment([late, early])
        assert [recording.start for recording in experiment.recordings] == [0.0, 1.0]


class TestClock:
    @pytest.mark.parametrize(("rate", "decimals"), [(50.0, 2), (60.0, 4), (300.0, 3), (3.0, 1), (1.0, 0), (48.7, 3)])
    def test_rounded_print_of_even_times(self, write, rate: float, decimals: int) -> None:
        times = np.round(np.arange(3000) / rate, decimals)
        recording = read_recording(write(lines_at(times)))
        assert recording.sample_time == pytest.approx(1.0 / rate, rel=1e-4)
        assert recording.n_samples == 3000
        assert "resampled" not in recording.provenance

    def test_extra_samples_of_a_test_machine_are_interpolated(self, write) -> None:
        times = np.concatenate([0.02 * np.arange(500), 9.981 + 0.02 * np.arange(500)])
        lines = [HEADER, *(f"{time:.3f},{2 * time:.3f},{time:.3f}" for time in times)]
        recording = read_recording(write(lines))
        assert "resampled" in recording.provenance
        assert recording.sample_time == 0.02
        np.testing.assert_allclose(recording.inputs[0], 2.0 * recording.timepts, atol=1e-9)
        assert recording.timepts[-1] <= times[-1] < recording.end

    def test_small_jitter_is_tolerated_and_large_is_not(self, write) -> None:
        rng = np.random.default_rng(1)
        even = 0.02 * np.arange(1000)
        small, large = (even + share * 0.02 * rng.uniform(-1.0, 1.0, 1000) for share in (0.02, 0.2))
        assert read_recording(write(lines_at(small))).sample_time == pytest.approx(0.02, rel=1e-3)
        with pytest.raises(DataError, match=r"uneven sampling"):
            read_recording(write(lines_at(large)))

    def test_wandering_clock_is_uneven(self, write) -> None:
        times = np.cumsum(0.02 * (1.0 + 0.01 * np.sin(np.arange(2000) / 300.0)))
        with pytest.raises(DataError, match=r"uneven sampling: .* from even times every 0.0199905 s"):
            read_recording(write(lines_at(times)))

    def test_two_rates_are_uneven(self, write) -> None:
        times = np.concatenate([0.02 * np.arange(300), 6.0 + 0.04 * np.arange(200)])
        with pytest.raises(DataError, match=r"row 303: uneven sampling: the time 6.04 s is 0.04 s after"):
            read_recording(write(lines_at(times)))

    @pytest.mark.parametrize("late", [0.008, 0.01, -0.01])
    def test_one_late_sample_is_uneven(self, write, late: float) -> None:
        times = np.round(0.02 * np.arange(300), 3)
        times[100] += late
        with pytest.raises(DataError, match=r"row 10[23]: uneven sampling"):
            read_recording(write(lines_at(times)))

    @pytest.mark.parametrize("decimals", [0, 2, 3])
    def test_single_missing_row_is_a_gap(self, write, decimals: int) -> None:
        step = {0: 1.0, 2: 0.02, 3: 0.001}[decimals]
        times = np.delete(np.round(step * np.arange(5000), decimals), 2500)
        with pytest.raises(DataError, match=r"row 2502: a gap .*, in which 1 sample is missing;"):
            read_recording(write(lines_at(times)))

    def test_allowed_gaps_split_and_keep_the_clock(self, write) -> None:
        path = write([HEADER, *rows(50), *rows(20, start=3.0), *rows(30, start=9.0)])
        pieces = read_recordings(path, allow_gaps=True)
        assert [(piece.start, piece.n_samples) for piece in pieces] == [(0.0, 50), (3.0, 20), (9.0, 30)]
        assert {piece.sample_time for piece in pieces} == {0.02}
        assert pieces[1].provenance["rows"] == "52-71"
        assert read_experiment([path], allow_gaps=True).n_samples == 100
        with pytest.raises(DataError, match="use read_experiment or read_recordings, which return all parts"):
            read_recording(path, allow_gaps=True)

    def test_rows_without_a_value_are_gaps(self, write) -> None:
        lines = [HEADER, *rows(50)]
        for place, mark in {11: "", 12: "NaN", 13: "n/a"}.items():
            lines[place] = f"{lines[place].rpartition(',')[0]},{mark}"
        path = write(lines)
        with pytest.raises(
            DataError, match=r'row 12, column ".*": there is no value \(3 such rows in all\)'
        ) as refused:
            read_recording(path)
        pieces = read_recordings(path, **refused.value.offers.given)
        assert [(piece.start, piece.n_samples) for piece in pieces] == [(0.0, 10), (pytest.approx(0.26), 37)]
        assert [piece.provenance["rows"] for piece in pieces] == ["2-11", "15-51"]
        whole = read_recording(write([HEADER, *rows(50)]))
        np.testing.assert_array_equal(pieces[1].outputs, whole.outputs[:, 13:])

    def test_gap_in_one_of_several_recordings(self, write) -> None:
        whole = write([HEADER, *rows(50)], name="whole.csv")
        broken = write([HEADER, *rows(30, start=5.0), *rows(20, start=6.0)], name="broken.csv")
        with pytest.raises(DataError, match=r"broken.csv, row 32: a gap from 5.58 s to 6 s"):
            read_experiment([broken, whole])
        experiment = read_experiment([broken, whole], allow_gaps=True)
        assert [r.start for r in experiment.recordings] == [0.0, 5.0, 6.0]
        assert [r.n_samples for r in experiment.recordings] == [50, 30, 20]
        assert [r.provenance["file"] for r in experiment.recordings] == [str(whole), str(broken), str(broken)]


class TestFaults:
    @pytest.mark.parametrize(
        ("lines", "message"),
        [
            ([HEADER.replace("time_s", "tme-s"), *rows()], r'no column "time_s"; .*mean "tme-s"\?'),
            ([HEADER.replace("command_V", "command"), *rows()], r'"command" has the unit \(none\).*"command_V"'),
        ],
    )
    def test_header(self, write, lines: list[str], message: str) -> None:
        with pytest.raises(DataError, match=message):
            read_recording(write(lines))

    def test_the_near_column_is_shown_as_can_be_printed(self, write) -> None:
        path = write(["time_s,c\x1b[31mommand,displacement_mm", *rows()])
        with pytest.raises(DataError, match=r'did you mean "c\\x1b\[31mommand"\?'):
            read_recording(path)


class TestWriting:
    def test_lengths_and_headers_are_checked(self, tmp_path: Path) -> None:
        with pytest.raises(DataError, match="of one length: a, b"):
            write_csv(tmp_path / "out.csv", {"a": [1.0], "b": [1.0, 2.0]})
        with pytest.raises(DataError, match="holds a comma"):
            write_csv(tmp_path / "out.csv", {"a,b": [1.0]})

    def test_text_replaces_and_leaves_nothing_beside_it(self, tmp_path: Path) -> None:
        path = tmp_path / "note.txt"
        write_text_atomic(path, "old")
        write_text_atomic(path, "µ\n")
        assert path.read_bytes() == "µ\n".encode()
        assert os.listdir(tmp_path) == ["note.txt"]

    @pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
    def test_what_is_no_plain_file_is_left_alone(self, tmp_path: Path) -> None:
        pipe, folder = tmp_path / "pipe", tmp_path / "folder"
        os.mkfifo(pipe)
        folder.mkdir()
        for path, kind in ((pipe, "a pipe"), (folder, "a folder")):
            with pytest.raises(DataError, match=f"{path.name}: this is {kind}; give the name of a file"):
                write_text_atomic(path, "text")
        assert pipe.is_fifo() and sorted(os.listdir(tmp_path)) == ["folder", "pipe"]

    def test_a_link_stays_one(self, tmp_path: Path) -> None:
        (tmp_path / "there").mkdir()
        link, target = tmp_path / "link.txt", tmp_path / "there" / "note.txt"
        target.write_text("old", encoding="utf-8")
        link.symlink_to(target)
        write_text_atomic(link, "new")
        assert link.is_symlink() and target.read_text(encoding="utf-8") == "new"
        assert os.listdir(target.parent) == ["note.txt"]

    def test_folder_that_is_not_there(self, tmp_path: Path) -> None:
        with pytest.raises(DataError, match=r"note.txt: cannot be written: No such file"):
            write_text_atomic(tmp_path / "none" / "note.txt", "text")


DATA = Path(os.environ.get("DEATWIN_DATA", Path(__file__).parents[5] / "shared" / "data")) / "vhb4910"


@pytest.mark.skipif(not DATA.is_dir(), reason="the public recordings vhb4910 are not here (see DEATWIN_DATA)")
def test_measured_coupons() -> None:
    """GBK headers, quoted cells, several header lines, extra samples where the machine turns round."""
    files = sorted(DATA.glob("*/*.csv"))
    assert len(files) == 12
    for file in files:
        recording = read_recording(file, input_column="位移", output_column="力")
        assert recording.sample_time in (0.02, 0.05)
        assert recording.output_units == ("N",)
        assert 0.039 < np.ptp(recording.inputs) < 0.41

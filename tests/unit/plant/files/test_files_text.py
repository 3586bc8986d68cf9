"""CSV files of all kinds are read right, or refused with one clear line; never read as wrong numbers."""

from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_commands, read_recording, read_recordings, write_recording
from deatwin.plant.recording import Recording

HEADER = "time_s,command_V,displacement_mm"
COMMANDS = [1.0, 1.25, 1.5, 1.75]
LINES = [f"{0.02 * k:.2f},{command},{0.1 * (k + 1):.1f}" for k, command in enumerate(COMMANDS)]


@pytest.fixture
def write(tmp_path: Path):
    def write_file(lines: list[str], *, encoding: str = "utf-8", end: str = "\n") -> Path:
        path = tmp_path / "rec.csv"
        path.write_bytes((end.join(lines) + end).encode(encoding))
        return path

    return write_file


def dressed(delimiter: str, decimal: str, quote: str = "") -> list[str]:
    """The same recording with other marks."""
    body = [[cell.replace(".", decimal) for cell in line.split(",")] for line in LINES]
    return [delimiter.join(f"{quote}{cell}{quote}" for cell in row) for row in [HEADER.split(","), *body]]


def check(recording: Recording) -> None:
    assert (recording.sample_time, recording.start) == (0.02, 0.0)
    np.testing.assert_array_equal(recording.inputs[0], COMMANDS)
    np.testing.assert_array_equal(recording.outputs[0], [0.1e-3, 0.2e-3, 0.3e-3, 0.4e-3])  # the literals, exactly


class TestKinds:
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
    @pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    def test_delimiter_encoding_line_end(self, write, encoding: str, delimiter: str, end: str) -> None:
        check(read_recording(write(dressed(delimiter, "."), encoding=encoding, end=end)))

    @pytest.mark.parametrize("delimiter", [";", "\t", "|"])
    @pytest.mark.parametrize("quote", ["", '"'])
    def test_decimal_comma(self, write, delimiter: str, quote: str) -> None:
        check(read_recording(write(dressed(delimiter, ",", quote))))

    def test_decimal_comma_in_quoted_cells_between_commas(self, write) -> None:
        check(read_recording(write(dressed(",", ",", '"'))))

    @pytest.mark.parametrize(
        "above",
        [
            ["Rig A, second day", "Operator,Smith", "Rate,50", "Channels,3"],
            ["Date,2024-01-02,", "Rate [Hz],50,"],  # padded to the width of the table, as spreadsheets do
            ["# made by a logger", "", "# 50 Hz"],
        ],
    )
    def test_lines_with_numbers_above_the_header(self, write, above: list[str]) -> None:
        recording = read_recording(write([*above, HEADER, *LINES]))
        check(recording)
        assert recording.provenance["rows"] == f"{len(above) + 2}-{len(above) + 5}"

    def test_units_below_the_names_some_of_them_unknown(self, write) -> None:
        lines = ["time,command,displacement,pressure", "s,V,mm,(bar)", *(f"{line},9" for line in LINES)]
        check(read_recording(write(lines)))

    @pytest.mark.parametrize("below", [["MX840B,MX840B,MX1609"], ["fast,±10,±5", "MX840B,MX840B,MX1609"]])
    def test_remarks_below_names_and_units(self, write, below: list[str]) -> None:
        check(read_recording(write(["Film 7", "time,command,displacement", "s,V,mm", *below, *LINES])))

    @pytest.mark.parametrize("label", ["Unit", "Units:", "Einheit", "Unité"])
    @pytest.mark.parametrize("first", ["", "7"])
    def test_a_word_before_the_units(self, write, label: str, first: str) -> None:
        lines = ["Name,time,command,displacement", f"{label},s,V,mm", *(f"{first},{line}" for line in LINES)]
        check(read_recording(write(lines)))

    def test_names_below_units_stay_the_names(self, write) -> None:
        lines = ["CH1,CH2,CH3", "s,V,mm", "time,U,x", *LINES]
        named = {"input_column": "U=V", "output_column": "x=mm"}
        check(read_recording(write(lines), **named))

    def test_without_times_the_sample_time_is_asked_for(self, write) -> None:
        path = write([line.partition(",")[2] for line in [HEADER, *LINES]])
        check(read_recording(path, dt=0.02))
        with pytest.raises(DataError, match=r'no column "time_s".*give the sample time in seconds: --dt'):
            read_recording(path)
        with pytest.raises(DataError, match=r"dt is 0.0 s; the sample time must be positive"):
            read_recording(path, dt=0.0)

    def test_single_column(self, write) -> None:
        path = write(["command_V", *map(str, COMMANDS)])
        np.testing.assert_array_equal(read_commands(path, dt=0.02).inputs[0], COMMANDS)


class TestRefused:
    @pytest.mark.parametrize("word", ["Scale", "Offset in V", "Sequence"])
    @pytest.mark.parametrize("first", ["", "7"])
    def test_settings_between_the_names_and_the_samples(self, write, word: str, first: str) -> None:
        body = [f"{first},{line}" for line in LINES]
        settings = [f"{word},1,0.0005,0.0002", "Zero,0,0,0.1"]
        with pytest.raises(DataError, match=rf'row 2: "{word}" begins a line below the names that is no sample'):
            read_recording(write([f"Channel,{HEADER}", *settings, *body]), dt=0.02)
        check(read_recording(write([*settings, f"Channel,{HEADER}", *body])))

    @pytest.mark.parametrize(
        "states", [["idle", "idle", "busy", "busy"], ["n/a", "NaN", "3", "4"], ["3", "on", "4", "on"]]
    )
    def test_a_first_column_of_words_is_no_setting(self, write, states: list[str]) -> None:
        check(
            read_recording(write([f"state,{HEADER}", *(f"{s},{line}" for s, line in zip(states, LINES, strict=True))]))
        )

    @pytest.mark.parametrize(
        ("lines", "message"),
        [
            (
                dressed(",", ","),
                r"row 2: the row has 6 cells separated by comma, but the header in row 1 has 3; a comma cannot",
            ),
            (
                ["command_V", "1,234", "2,345"],
                r"row 2: the row has 2 cells separated by comma, but the header in row 1 has 1",
            ),
            ([HEADER, "0.00,1,1e", *LINES[1:]], r'row 2, column "displacement_mm": "1e" is not a number'),
            (
                ["Title,run 3", "Ratio,,1.0,1.0", "Unit,s,V,mm", "Data,,,", *(f",{line}" for line in LINES)],
                "row 5: the row has 4 cells separated by comma, but the header in row 4 has 1; each column needs a name",
            ),
            (
                ["time_s,command_V,displacement_mm", *(f"{0.02 * k:.2f},{k}%,0" for k in range(9))],
                '"0%" is not a number; write only numbers in the rows',
            ),
        ],
    )
    def test_what_can_be_read_in_two_ways(self, write, lines: list[str], message: str) -> None:
        with pytest.raises(DataError, match=message):
            read_recording(write(lines))

    @pytest.mark.parametrize(
        "second",
        [
            ["time_s,displacement_mm,command_V"],
            ["time_s,command_V,displacement_um"],
            ["", "# s,V,um"],
        ],
    )
    def test_another_header_below_samples_is_refused(self, write, second: list[str]) -> None:
        """It may swap the columns or change a unit."""
        first = [f"{0.02 * k:.2f},{k % 3},{k % 5}" for k in range(20)]
        after = [f"{0.02 * k:.2f},{k % 3},{k % 5}" for k in range(20, 40)]
        row = len(first) + len(second) + 1
        with pytest.raises(DataError, match=f"row {row}: another header begins here; give each part"):
            read_recording(write([HEADER, *first, *second, *after]))
        found = read_recording(write([HEADER, *first, "# valve, opened", *after]))
        assert found.n_samples == 40


class TestDescription:
    """What the columns cannot say stands above them."""

    def test_plain_recording_has_none(self, tmp_path: Path) -> None:
        extras = {"temperature": [294.0, 295.0], "current": [0.0, 1e-6]}
        recording = Recording.from_arrays([1.0, 2.0], [0.1, 0.2], 0.02, start=0.5, extras=extras)
        write_recording(tmp_path / "rec.csv", recording)
        assert (tmp_path / "rec.csv").read_text().splitlines()[0] == HEADER + ",temperature_C,current_uA"

    def test_column_that_is_asked_for_comes_first(self, tmp_path: Path) -> None:
        recording = Recording.from_arrays(np.arange(6.0).reshape(2, 3), np.ones((1, 3)), 1.0)
        write_recording(tmp_path / "rec.csv", recording)
        again = read_recording(tmp_path / "rec.csv", input_column="input_2")
        np.testing.assert_array_equal(again.inputs, recording.inputs[1:])

    def test_what_it_lacks_is_named(self, write) -> None:
        with pytest.raises(DataError, match=r"is damaged \('sample_time'\)"):
            read_recording(write(['# deatwin/recording/1 {"schema": "deatwin/recording/1"}', HEADER, *LINES]))

    def test_rows_taken_out_by_hand_are_noticed(self, tmp_path: Path) -> None:
        path = tmp_path / "rec.csv"
        recording = Recording.from_arrays(np.arange(9.0), np.ones(9), 0.02, provenance={"note": "x"})
        write_recording(path, recording)
        lines = path.read_text().splitlines()
        path.write_text("\n".join(lines[:5] + lines[6:]))
        with pytest.raises(DataError, match=r"a gap from 0.04 s to 0.08 s"):
            read_recording(path)
        assert [piece.start for piece in read_recordings(path, allow_gaps=True)] == pytest.approx([0.0, 0.08])


def test_format_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match=r"files with the extension .xls cannot be written; known are .csv, .mat, .tdms, .nc"
    ):
        write_recording(tmp_path / "rec.xls", Recording.from_arrays([1.0], [1.0], 1.0))


@pytest.mark.parametrize("name", ["Größe", "Maßgröße", "température", "Länge µm"])
def test_letters_of_latin_1_are_no_chinese(tmp_path: Path, name: str) -> None:
    path = tmp_path / "r.csv"
    path.write_bytes(f"time_s;command_V;{name}\n0;0;1\n1;1;2\n".encode("latin-1"))
    found = read_recording(path, output_column=name)
    micro = name.endswith(" µm")  # a unit behind a blank
    assert (found.output_names, found.output_units) == ((name.removesuffix(" µm"),), ("m" if micro else "",))


@pytest.mark.parametrize("unit", ["mm", "degC"])
@pytest.mark.parametrize("form", ["{:.4f}", "{:.17g}", "{:.6E}", "{:g}"])
@pytest.mark.parametrize(("mark", "sign"), [(",", "."), (";", ","), ("\t", "."), (" ", ",")])
def test_even_rows_are_read_as_rows_that_need_a_closer_look(
    tmp_path: Path, unit: str, form: str, mark: str, sign: str
) -> None:
    """Only rows with quotation marks are split one by one."""
    values = np.random.default_rng(7).normal(size=(300, 2)) * [1e-4, 1e3]
    texts = [[form.format(value).replace(".", sign) for value in row] for row in values]
    head = mark.join(["time_s", "u_V", f"y_{unit}"])
    for name, quote in (("even", ""), ("quoted", '"')):
        rows = [mark.join([str(k), row[0], f"{quote}{row[1]}{quote}"]) for k, row in enumerate(texts)]
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *rows, ""]), encoding="utf-8")
    even, quoted = (
        read_recording(tmp_path / f"{name}.csv", input_column="u", output_column="y") for name in ("even", "quoted")
    )
    np.testing.assert_array_equal(even.outputs, quoted.outputs)
    np.testing.assert_array_equal(even.inputs, quoted.inputs)
    np.testing.assert_array_equal(even.inputs[0], [float(row[0].replace(",", ".")) for row in texts])


def test_samples_with_units_in_their_cells_are_refused_with_the_place_for_the_unit(tmp_path: Path) -> None:
    rows = "".join(f"2024-05-01 10:11:{12 + k},{k / 7:.3f} kV,{k % 5} mm\n" for k in range(40))
    (tmp_path / "r.csv").write_text(f"Time,HV,Laser\n{rows}", encoding="utf-8")
    with pytest.raises(
        DataError, match=r'in row 2 "0\.000 kV" is not a number; write only numbers in the rows, and the unit'
    ):
        read_recording(tmp_path / "r.csv", input_column="HV", output_column="Laser")

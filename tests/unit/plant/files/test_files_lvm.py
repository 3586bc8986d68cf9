"""LabVIEW measurement files, made as NI's specification of the format describes them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, read_recordings
from deatwin.plant.recording import Recording

ASKED = {"input_column": "Supply", "output_column": "Laser"}


def lvm(
    *, x: str = "No", tab: str = "\t", comma: bool = False, seconds: tuple[int, ...] = (0,), multi: bool = True
) -> str:
    """Five samples every 0.2 s in each segment; the segments begin at these seconds of a minute."""
    apart = [""] if x == "Multi" else []
    end = "***End_of_Header***"

    def each(tag: str, value: str, other: str = "") -> str:
        return tab.join([tag, value, *apart, other or value, ""])

    lines = [
        f"LabVIEW Measurement{tab}",
        f"Writer_Version{tab}2",
        f"Separator{tab}{'Tab' if tab != ',' else 'Comma'}",
        f"Decimal_Separator{tab}{'C' if comma else '.'}",
        f"Multi_Headings{tab}{'Yes' if multi else 'No'}",
        f"X_Columns{tab}{x}",
        f"Time_Pref{tab}Relative",
        f"Date{tab}2024/05/01",
        f"Time{tab}12:00:00.0",
        f"{end}{tab}",
        tab,
    ]
    for number, second in enumerate(seconds):
        if multi or not number:
            lines += ["***Start_Special***", f"Channels{tab}9", f"1{tab}2", "***End_Special***"]
            lines += [f"Notes{tab}a remark", each("Channels", "2"), each("Samples", "5"), each("Date", "2024/05/01")]
            lines += [each("Time", f"12:00:{second:02}.0000000000000000000"), each("Y_Unit_Label", "Volts", "mm")]
            lines += [each("X_Dimension", "Time"), each("X0", "0.0"), each("Delta_X", "2.0E-1"), end]
            lines += [tab.join(["X_Value", "Supply", *["X_Value"] * len(apart), "Laser", "Comment"])]
        for k in range(5):
            at = "" if x == "No" else f"{0.2 * k:.4f}"
            remark = ['said "so'] if k == 2 else []
            lines.append(tab.join([at, f"{number + 0.5 * k:.3f}", *[at] * len(apart), f"{0.25 * k:.3f}", *remark]))
        lines.append("")
    text = "\r\n".join(lines)
    return text.replace(".", ",").replace("r\tC", "r\t,") if comma else text


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def write_file(text: str) -> Path:
        path = tmp_path / "rec.lvm"
        path.write_bytes(text.encode("latin-1"))
        return path

    return write_file


def check(recording: Recording, segments: int = 1) -> None:
    assert (recording.sample_time, recording.start) == (pytest.approx(0.2, rel=1e-12), 0.0)
    assert (recording.input_units, recording.output_units) == (("V",), ("m",))
    np.testing.assert_array_equal(recording.inputs, [[n + 0.5 * k for n in range(segments) for k in range(5)]])
    np.testing.assert_array_equal(recording.outputs, [[0.25e-3 * k for _ in range(segments) for k in range(5)]])


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
@pytest.mark.parametrize(("tab", "comma"), [("\t", False), ("\t", True), (",", False)])
def test_each_way_to_hold_x_values(write, x: str, tab: str, comma: bool) -> None:
    recording = read_recording(write(lvm(x=x, tab=tab, comma=comma)), **ASKED)
    check(recording)
    assert recording.provenance["clock_began"] == "2024-05-01T12:00:00"
    assert recording.provenance["rows"] == "27-31"


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
def test_segments_that_follow_one_another(write, x: str) -> None:
    check(read_recording(write(lvm(x=x, seconds=(0, 1, 2))), **ASKED), segments=3)


@pytest.mark.parametrize("x", ["No", "One"])
def test_segments_apart(write, x: str) -> None:
    path = write(lvm(x=x, seconds=(0, 7)))
    with pytest.raises(DataError, match=r"a gap from 0.8 s to 7 s"):
        read_recording(path, **ASKED)
    assert [piece.start for piece in read_recordings(path, allow_gaps=True, **ASKED)] == pytest.approx([0.0, 7.0])


def test_one_header_for_all_segments(write) -> None:
    check(read_recording(write(lvm(seconds=(0, 1), multi=False)), **ASKED), segments=2)


@pytest.mark.parametrize("x", ["No", "One", "Multi"])
def test_channels_that_were_started_apart(write, x: str) -> None:
    """Their x values are relative to the dates of their first samples."""
    started = "12:00:00.0000000000000000000"
    before, _, after = lvm(x=x).rpartition(started)
    check(read_recording(write(f"{before}12:00:00.0900000000000000000{after}"), **ASKED))  # less than half a sample
    with pytest.raises(DataError, match=r"row 27: the channels below begin up to 2 s apart \(Date, Time\)"):
        read_recording(write(f"{before}12:00:02.0000000000000000000{after}"), **ASKED)


@pytest.mark.parametrize(("date", "time"), [("1904/01/01", "00:00:00.0"), ("", ""), ("unknown", "unknown")])
def test_an_undated_channel_tells_nothing(write, date: str, time: str) -> None:
    before, _, after = lvm().rpartition("2024/05/01")
    before, after = f"{before}{date}", after.partition("Y_Unit_Label")
    dated, _, rest = after[0].rpartition("12:00:00.0000000000000000000")
    found = read_recording(write(f"{before}{dated}{time}{rest}Y_Unit_Label{after[2]}"), **ASKED)
    check(found)
    assert found.provenance["clock_began"] == "2024-05-01T12:00:00"


def test_place_of_a_fault(write) -> None:
    with pytest.raises(DataError, match=r'row 29, column "Laser": "off" is not a number'):
        read_recording(write(lvm().replace("0.500\tsaid", "off\tsaid")), **ASKED)


def test_x_values_in_another_unit_than_seconds_are_refused(write) -> None:
    text = lvm().replace("X_Dimension\tTime\tTime\t", "X_Dimension\tTime\tTime\t\nX_Unit_Label\tms\tms\t")
    with pytest.raises(DataError, match='its x values are in "ms"; save them in seconds'):
        read_recording(write(text), **ASKED)
    assert read_recording(write(text.replace("ms\tms", "Seconds\ts")), **ASKED).sample_time == pytest.approx(0.2)

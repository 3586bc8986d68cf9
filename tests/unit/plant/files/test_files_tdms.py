"""TDMS files of LabVIEW into recordings."""

from pathlib import Path

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_experiment, read_recording, write_recording
from deatwin.plant.recording import Recording

nptdms = pytest.importorskip("nptdms")

N = 50
COMMAND = 2.0 + np.sin(np.arange(N))
WAVEFORM = {"wf_increment": 0.02, "wf_start_offset": 0.0, "wf_samples": N}


def save(path: Path, *channels: tuple[str, str, np.ndarray, dict], **properties: str) -> Path:
    """Channels as (group, name, values, properties)."""
    with nptdms.TdmsWriter(path) as writer:
        root = nptdms.RootObject(properties)
        writer.write_segment([root, *(nptdms.ChannelObject(*channel) for channel in channels)])
    return path


def pair(about: dict, *, group: str = "rig") -> list[tuple[str, str, np.ndarray, dict]]:
    return [(group, "command_V", COMMAND, about), (group, "displacement_mm", 0.1 * COMMAND, about)]


def check(recording: Recording) -> None:
    assert (recording.sample_time, recording.start, recording.n_samples) == (0.02, 0.0, N)
    np.testing.assert_array_equal(recording.inputs[0], COMMAND)
    np.testing.assert_allclose(recording.outputs[0], 1e-4 * COMMAND, rtol=1e-15)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "rec.tdms"


def test_waveforms(path: Path) -> None:
    recording = read_recording(save(path, *pair(WAVEFORM), title="second day"))
    check(recording)
    assert recording.provenance["title"] == "second day"


@pytest.mark.parametrize(("volts", "millimetres"), [("V", "mm"), ("Volts", "Millimeters")])
@pytest.mark.parametrize("property_name", ["unit_string", "NI_UnitDescription", "Unit"])
def test_units_by_property(path: Path, volts: str, millimetres: str, property_name: str) -> None:
    about = [{**WAVEFORM, property_name: unit} for unit in (volts, millimetres)]
    channels = [("rig", "command", COMMAND, about[0]), ("rig", "displacement", 0.1 * COMMAND, about[1])]
    check(read_recording(save(path, *channels)))


def test_the_unit_of_the_clock(path: Path) -> None:
    about = {"wf_increment": 20.0, "wf_start_offset": -100.0, "wf_xunit_string": "ms"}
    found = read_recording(save(path, *pair(about)))
    assert (found.sample_time, found.start) == (0.02, -0.1)
    with pytest.raises(DataError, match=r'x values of the waveform "command_V" are in "Hz" .* a recording needs times'):
        read_recording(save(path, *pair(about | {"wf_xunit_string": "Hz"})))


def test_a_scale_beside_a_unit_is_refused(path: Path) -> None:
    """DAQmx's own scales, in properties NI_..., are applied by nptdms."""
    with pytest.raises(DataError, match='"command_V" is in V, and its attribute "gain" is 10, which is not applied'):
        read_recording(save(path, *pair(WAVEFORM | {"unit_string": "V", "gain": 10.0})))
    check(read_recording(save(path, *pair(WAVEFORM | {"gain": 10.0, "wf_start_offset": 0.0}))))


@pytest.mark.parametrize("about", [{}, {"wf_increment": 0.0}])
def test_without_waveform_properties_the_sample_time_is_asked_for(path: Path, about: dict) -> None:
    save(path, *pair(about))
    check(read_recording(path, dt=0.02))
    with pytest.raises(DataError, match=r'rec.tdms: no column "time_s".*sample time in seconds: --dt, in Python dt'):
        read_recording(path)


def test_channel_of_times(path: Path) -> None:
    check(read_recording(save(path, ("rig", "time_s", 0.02 * np.arange(N), {}), *pair({}))))


def test_channel_of_time_stamps(path: Path) -> None:
    stamps = np.datetime64("2024-01-02T10:00:00", "us") + np.arange(N) * np.timedelta64(20, "ms")
    check(read_recording(save(path, ("rig", "time", stamps, {}), *pair({}))))


def test_groups_with_channels_of_one_name(path: Path) -> None:
    save(path, *pair(WAVEFORM, group="one"), *pair(WAVEFORM, group="two"))
    with pytest.raises(DataError, match=r'no column "command_V"; the file has "one/command_V"'):
        read_recording(path)
    check(read_recording(path, input_column="two/command_V", output_column="one/displacement_mm"))


def test_waveforms_that_say_when_they_started_share_a_clock(tmp_path: Path) -> None:
    files = []
    for name, start in (("late", "2024-01-02T10:00:03.5"), ("early", "2024-01-02T10:00:00")):
        about = {**WAVEFORM, "wf_start_time": np.datetime64(start, "us")}
        files.append(save(tmp_path / f"{name}.tdms", *pair(about)))
    experiment = read_experiment(files)
    assert [recording.start for recording in experiment.recordings] == [0.0, 3.5]
    assert experiment.recordings[1].provenance["clock_began"].startswith("2024-01-02T10:00:00")


def test_text_channel_is_refused_only_where_it_is_used(path: Path) -> None:
    remarks = ("rig", "remark", np.array(["fine"] * N), WAVEFORM)
    check(read_recording(save(path, *pair(WAVEFORM), remarks)))
    with pytest.raises(DataError, match=r'column "remark": it holds .* values; real numbers are needed'):
        read_recording(path, input_column="remark")


def test_a_head_alone(path: Path) -> None:
    path.write_bytes(b"TDSm")
    with pytest.raises(DataError, match=r"rec.tdms: there are no vectors"):
        read_recording(path)


def test_acquisition_that_broke_off_is_said(path: Path) -> None:
    content = save(path, *pair(WAVEFORM)).read_bytes()
    path.write_bytes(content[:-8])
    with pytest.raises(DataError, match=r'"displacement_mm": 49 samples, but "command_V" has 50'):
        read_recording(path)


def test_written_for_labview(path: Path) -> None:
    """Waveforms with their properties, as LabVIEW and DIAdem read them."""
    write_recording(path, Recording.from_arrays([1.0, 2.0], [3.0, 4.0], 0.02, start=7.0))
    channel = nptdms.TdmsFile.read(path)["recording"]["command"]
    assert channel.properties["unit_string"] == "V"
    np.testing.assert_array_equal(channel.time_track(), [7.0, 7.02])


def test_channels_that_were_started_apart(path: Path) -> None:
    """A start less than half a sample later is that of the next channel; an undated channel tells nothing."""
    began = np.datetime64("2024-05-01T12:00:00.000000")
    first, second = pair(WAVEFORM)
    for late, refused in ((0, False), (9, False), (11, True), (1000, True)):
        dated = {**WAVEFORM, "wf_start_time": began + np.timedelta64(late, "ms")}
        save(path, (*first[:3], {**WAVEFORM, "wf_start_time": began}), (*second[:3], dated))
        if refused:
            with pytest.raises(DataError, match='"command_V" and "displacement_mm" have different clocks'):
                read_recording(path)
        else:
            check(read_recording(path))
    undated = {**WAVEFORM, "wf_start_time": np.datetime64("1904-01-01T00:00:00.000000")}
    check(read_recording(save(path, (*first[:3], {**WAVEFORM, "wf_start_time": began}), (*second[:3], undated))))


def test_a_date_counts_only_where_its_channel_is_used(path: Path) -> None:
    """A run that was recorded before into the same file, or a channel dated 1970, does not shift the clock of a run."""
    runs = [
        (f"run{k}", *channel[1:3], {**WAVEFORM, "wf_start_time": np.datetime64(date, "us")})
        for k, date in enumerate(("2024-05-01T12:00:00", "2024-05-01T13:00:00.013"))
        for channel in pair(WAVEFORM)
    ]
    old = ("rig", "calibration", COMMAND, {**WAVEFORM, "wf_start_time": np.datetime64("1970-01-01", "us")})
    save(path, *runs, old)
    for k in range(2):
        check(read_recording(path, input_column=f"run{k}/command_V", output_column=f"run{k}/displacement_mm"))


def test_a_channel_may_be_named_with_its_group(tmp_path: Path) -> None:
    clock = {"wf_increment": 0.02, "wf_start_offset": 0.0}
    values = np.linspace(1.0, 2.0, 12)
    channels = [
        nptdms.ChannelObject("rig", name, k * values, {"unit_string": "V", **clock}) for k, name in ((1, "u"), (2, "y"))
    ]
    with nptdms.TdmsWriter(tmp_path / "r.tdms") as writer:
        writer.write_segment(channels)
    found = read_recording(tmp_path / "r.tdms", input_column="rig/u", output_column="rig/y")
    np.testing.assert_array_equal(found.outputs[0], 2.0 * values)

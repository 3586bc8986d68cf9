"""Recordings, experiments, and the checks before they are used."""

import dataclasses
import json
import pickle

import numpy as np
import pandas
import pytest

from deatwin.plant.checks import check_command_range, check_motion, require_excitation, require_samples
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.rigfile import DriveSpec


def ramp(n: int = 100, start: float = 0.0, sample_time: float = 0.02) -> Recording:
    values = np.linspace(1.0, 2.0, n)
    return Recording.from_arrays(values, 1e-4 * values, sample_time, start=start)


def rest(n: int = 100, start: float = 0.0) -> Recording:
    return Recording.from_arrays(np.full(n, 2.4), np.linspace(0.0, 1e-4, n), 0.02, start=start)


FRAME = 80e-3  # m
DRIVE = DriveSpec(gain=800.0, start_ramp=2.0, start_hold=3.0, command_min=1.1, command_max=3.75)
DRIVE_WITHOUT_RANGE = DriveSpec(gain=800.0, start_ramp=2.0, start_hold=3.0)


class TestRecording:
    def test_one_dimensional_arrays_become_a_row_with_the_usual_names(self) -> None:
        recording = ramp()
        assert recording.inputs.shape == recording.outputs.shape == (1, 100)
        assert recording.input_names == ("command",) and recording.input_units == ("V",)
        assert recording.output_names == ("displacement",) and recording.output_units == ("m",)

    def test_several_rows_are_numbered(self) -> None:
        recording = Recording.from_arrays(np.zeros((2, 5)), np.zeros((3, 5)), 1.0)
        assert recording.input_names == ("input_1", "input_2")
        assert recording.output_units == ("", "", "")

    def test_clock(self) -> None:
        recording = ramp(start=240.0)
        assert recording.n_samples == 100
        assert recording.timepts[0] == 240.0
        assert recording.timepts[-1] == pytest.approx(241.98, abs=1e-9)
        assert recording.duration == pytest.approx(2.0)
        assert recording.end == pytest.approx(242.0)
        assert repr(recording).startswith(
            "<Recording: 100 samples, every 0.02 s\n  clock 240 to 242 s\n  command [V], "
        )

    def test_section_keeps_the_clock_and_cuts_every_channel(self) -> None:
        whole = dataclasses.replace(ramp(start=240.0), extras={"temperature": np.arange(100.0)})
        section = whole.section(30, 50)
        assert section.start == pytest.approx(240.6)
        np.testing.assert_array_equal(section.inputs, whole.inputs[:, 30:50])
        np.testing.assert_array_equal(section.extras["temperature"], np.arange(30.0, 50.0))

    def test_arrays_are_read_only_and_apart_from_the_caller_s(self) -> None:
        values = np.ones((1, 4))
        recording = Recording.from_arrays(values, values, 1.0)
        values[:] = 7.0
        assert (recording.inputs == 1.0).all()
        with pytest.raises(ValueError, match="read-only"):
            recording.outputs[0, 0] = 3.0
        assert dataclasses.asdict(recording)["extra_units"] == json.loads(json.dumps(recording.extra_units)) == {}

    def test_a_data_frame_that_changes_later_changes_no_recording(self) -> None:
        frame = pandas.DataFrame({"u": np.arange(4.0), "y": np.ones(4)})
        recording = Recording.from_arrays(frame["u"], frame["y"], 1.0)
        frame.loc[0, "u"] = 7.0
        np.testing.assert_array_equal(recording.inputs, [[0.0, 1.0, 2.0, 3.0]])
        assert recording.section(1, 3).inputs.base is not None  # a section of a recording needs no copy

    def test_a_name_or_a_unit_may_stand_alone(self) -> None:
        recording = Recording.from_arrays([1.0, 2.0], [0.0, 1.0], 1.0, input_names="voltage", input_units="kV")
        assert (recording.input_names, recording.input_units) == (("voltage",), ("kV",))

    def test_columns_of_tables_with_other_rows_are_refused(self) -> None:
        frame = pandas.DataFrame({"u": np.arange(4.0), "y": np.ones(4)})
        with pytest.raises(DataError, match="the indexes of inputs and outputs differ"):
            Recording.from_arrays(frame["u"][:-1], frame["y"][1:], 1.0)

    @pytest.mark.parametrize("form", ["times", "durations", "seconds", "milliseconds", "xarray", "rows"])
    def test_an_index_must_be_even_and_agree_with_the_sample_time(self, form: str) -> None:
        times = 0.02 * np.arange(10)
        frame = pandas.DataFrame({"u": np.arange(10.0), "y": np.ones(10)})
        frame.index = {
            "times": pandas.Timestamp("2024-05-01", tz="Europe/Berlin") + pandas.to_timedelta(times, unit="s"),
            "durations": pandas.to_timedelta(times, unit="s"),
            "seconds": pandas.Index(times, name="time_s"),
            "milliseconds": pandas.Index(1e3 * times, name="t (ms)"),
            "xarray": pandas.Index(times, name="time_s"),
        }.get(form, frame.index)
        table = frame.to_xarray() if form == "xarray" else frame
        assert Recording.from_arrays(table["u"], table["y"], 0.02).n_samples == 10
        if form != "rows":  # they tell nothing of the time
            with pytest.raises(DataError, match=r"the index advances by 0\.02 s, but sample_time is 50 s"):
                Recording.from_arrays(table["u"], table["y"], 50)
        for rows in ([0, 2, 1, 3], [0, 1, 1, 2], [0, 1, 2, 6]):
            part = frame.iloc[rows].to_xarray() if form == "xarray" else frame.iloc[rows]
            with pytest.raises(DataError, match=r"at sample \d, so the rows are not evenly spaced; sort them"):
                Recording.from_arrays(part["u"], part["y"], 0.02)
        assert Recording.from_arrays(part["u"].to_numpy(), part["y"].to_numpy(), 0.02).n_samples == 4

    @pytest.mark.parametrize("rate", [300.0, 400.0, 700.0, 900.0])
    def test_an_index_of_whole_milliseconds_may_belong_to_another_rate(self, rate: float) -> None:
        times = pandas.Timestamp("2024-05-01") + pandas.to_timedelta(np.arange(2000) / rate, unit="s")
        column = pandas.Series(np.arange(2000.0), index=times.round("ms"))
        assert Recording.from_arrays(column, column, 1 / rate).n_samples == 2000
        gappy = column.drop(column.index[700:703])
        with pytest.raises(DataError, match="so the rows are not evenly spaced"):
            Recording.from_arrays(gappy, gappy, 1 / rate)
        column.index = column.index.where(np.arange(2000) != 5)  # a time is missing
        with pytest.raises(DataError, match=r"the index goes from .* to NaT at sample 5"):
            Recording.from_arrays(column, column, 1 / rate)

    def test_an_index_of_periods_is_a_clock(self) -> None:
        column = pandas.Series(np.arange(5.0), index=pandas.period_range("2024-05-01", periods=5, freq="15min"))
        assert Recording.from_arrays(column, column, 900).n_samples == 5
        with pytest.raises(DataError, match="the index advances by 900 s, but sample_time is 90 s"):
            Recording.from_arrays(column, column, 90)

    @pytest.mark.parametrize(
        ("sample_time", "told"), [(50, True), (0.02, False), (1.0, False), (12.5, False), (15, False), (300.0, False)]
    )
    def test_a_rate_in_place_of_the_sample_time_is_told(
        self, sample_time: float, told: bool, caplog: pytest.LogCaptureFixture
    ) -> None:
        assert Recording.from_arrays(np.ones(9), np.ones(9), sample_time).sample_time == sample_time
        assert ("is the sample rate in Hz, give 0.02" in caplog.text) == told

    def test_survives_the_way_to_another_process(self) -> None:
        copy = pickle.loads(pickle.dumps(ramp()))
        np.testing.assert_array_equal(copy.outputs, ramp().outputs)
        with pytest.raises(ValueError, match="read-only"):
            copy.outputs[0, 0] = 3.0

    def test_a_unit_of_an_extra_that_is_not_there_is_refused(self) -> None:
        values = np.ones(4)
        with pytest.raises(
            DataError, match='a unit for "curent", which is not among the extras; did you mean "current"'
        ):
            Recording.from_arrays(values, values, 1.0, extras={"current": values}, extra_units={"curent": "mA"})


class TestExperiment:
    def test_puts_recordings_in_order_of_the_clock(self) -> None:
        experiment = Experiment(recordings=(ramp(start=2.0), ramp(start=0.0)))
        assert [recording.start for recording in experiment.recordings] == [0.0, 2.0]
        assert (experiment.start, experiment.n_samples, experiment.sample_time) == (0.0, 200, 0.02)
        assert experiment.end == pytest.approx(4.0)

    def test_a_recording_alone_is_an_experiment(self) -> None:
        alone = ramp()
        assert Experiment(recordings=alone).recordings == (alone,)

    def test_a_further_channel_has_one_unit_in_all_recordings(self) -> None:
        values = np.ones(4)
        first, second, without = (
            Recording.from_arrays(values, values, 1.0, start=start, extras=extras, extra_units=units)
            for start, extras, units in (
                (0.0, {"probe": values}, {"probe": "A"}),
                (10.0, {"probe": values}, {"probe": "mA"}),
                (20.0, {}, {}),
            )
        )
        assert Experiment(recordings=(first, without)).n_samples == 8  # the second one did not measure it
        with pytest.raises(DataError, match='units of "probe" differ: A and mA'):
            Experiment(recordings=(first, second))


class TestChecks:
    def test_one_rest_among_others_is_fine(self) -> None:
        require_excitation([rest(), ramp(start=2.0)])  # no error

    def test_too_few_samples(self) -> None:
        require_samples([ramp(100)], 100, "a NARX model")
        require_samples([ramp(60), ramp(41)], 101, "a NARX model")
        with pytest.raises(ModelError, match="100 samples, but a NARX model needs at least 101"):
            require_samples([ramp(60), ramp(40)], 101, "a NARX model")

    @pytest.mark.parametrize("drive", [DRIVE, DRIVE_WITHOUT_RANGE])
    def test_film_volts_as_command(self, drive: DriveSpec) -> None:
        recording = Recording.from_arrays([1200.0, 2400.0], [0.0, 0.0], 0.02)
        with pytest.raises(
            DataError,
            match=r"command of 2400 V.*look like voltages on the film: .* gain of 800, so that 2400 V becomes 3 V",
        ):
            check_command_range(recording, drive)

    def test_a_range_in_kilovolts_is_no_sign_of_film_volts(self) -> None:
        """3.6 V would be 4.5 mV of the amplifier, which moves no film; the rig file states kV in place of V."""
        drive = DriveSpec(gain=800.0, command_min=0.0, command_max=0.00375)
        with pytest.raises(
            DataError, match=r"of 3.6 V is outside .*, 0 V to 0.00375 V .*; they differ by a factor of about 1000"
        ):
            check_command_range(Recording.from_arrays([0.5, 3.6], [0.0, 0.0], 0.02), drive)

    def test_strains_are_no_stretches(self) -> None:
        """A strip at the stretch of 0.2 would be compressed to a fifth; at a strain of 0.2 it is pulled."""
        recording = Recording.from_arrays([0.2, 0.5], [0.0, 0.0], 0.02)
        with pytest.raises(DataError, match=r"command of 0.5 is outside .*, 0.9 to 20 .* look like strains: add 1 to"):
            check_command_range(recording, DriveSpec(unit="1"))
        check_command_range(recording, DriveSpec(unit="1", command_min=0.1))  # as the rig file states
        check_command_range(Recording.from_arrays([0.999, 1.5], [0.0, 0.0], 0.02), DriveSpec(unit="1"))
        with pytest.raises(DataError, match=r"\(the first one outside is at 0 s\)$"):  # an extension in mm
            check_command_range(Recording.from_arrays([0.0, 25.0], [0.0, 0.0], 0.02), DriveSpec(unit="1"))

    def test_far_outside_but_no_film_volts(self) -> None:
        recording = Recording.from_arrays([2.0, -9.0], [0.0, 0.0], 0.02)
        with pytest.raises(
            DataError, match=r"command of -9 V is outside .*, 1.1 V to 3.75 V \(the first one outside is at 0.02 s\)$"
        ):
            check_command_range(recording, DRIVE)

    @pytest.mark.parametrize("drive", [DRIVE, DRIVE_WITHOUT_RANGE])
    def test_commands_in_and_little_outside_of_the_range(self, drive: DriveSpec) -> None:
        check_command_range(Recording.from_arrays([0.0, 2.4, 4.2], np.zeros(3), 0.02), drive)

    @pytest.mark.parametrize(
        ("size", "said"),
        [
            (
                0.3,
                r"moves over 270 mm, in a rig of 80 mm; this is a thousand times too much, as of µm under displacement_mm",
            ),
            (300.0, r"moves over 2.7e\+05 mm, in a rig of 80 mm$"),
        ],
    )
    def test_a_film_does_not_move_farther_than_its_frame_is_wide(self, size: float, said: str) -> None:
        with pytest.raises(DataError, match=said):
            check_motion(Recording.from_arrays(np.zeros(1001), size * np.linspace(0, 1, 1001), 0.02), FRAME)

    def test_a_spike_and_commands_alone_are_no_motion(self) -> None:
        reading = 1e-3 * np.linspace(0, 1, 1001)
        reading[500] = 5.0
        check_motion(Recording.from_arrays(np.zeros(1001), reading, 0.02), FRAME)
        check_motion(Recording.from_arrays(np.zeros(1001), np.empty((0, 1001)), 0.02), FRAME)

"""Samples at uneven times onto an even clock."""

import re
from pathlib import Path

import numpy as np
import pytest
from rig_files import RIG

from deatwin.plant import read_rig
from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording, read_recordings, write_csv
from deatwin.plant.recording import Recording
from deatwin.plant.resampling import plan_resampling, resample
from deatwin.plant.rigs.base import ReadingTime

STEP = 0.02


def jittered(samples: int = 400, spread: float = 0.3) -> np.ndarray:
    """Times with uniform jitter of a share of a step, the first at 0."""
    times = STEP * (np.arange(samples) + np.random.default_rng(5).uniform(-spread, spread, samples))
    return times - times[0]


def resampled(times: np.ndarray, inputs: np.ndarray, outputs: np.ndarray, step: float = STEP) -> Recording:
    return resample(Recording.from_arrays(inputs, outputs, STEP), step, timepts=times)


def test_readings_are_as_near_as_a_chord_is_to_its_arc() -> None:
    times, omega = jittered(), 2 * np.pi * 2.0
    found = resampled(times, np.zeros(times.size), np.sin(omega * times))
    bound = (omega * np.diff(times).max()) ** 2 / 8
    assert np.abs(found.outputs[0] - np.sin(omega * found.timepts)).max() <= bound


def test_a_staircase_keeps_its_levels_and_its_steps_are_off_by_half_a_sample_at_most() -> None:
    times = jittered()
    levels = np.random.default_rng(1).uniform(-1, 1, 40)
    command = np.repeat(levels, 10)
    found = resampled(times, command, np.zeros(times.size))
    assert set(found.inputs[0]) <= set(levels)
    for k in range(1, 38):
        begins = found.timepts[np.argmax(found.inputs[0] == levels[k])]
        assert abs(begins - times[10 * k]) <= 0.5 * STEP * (1 + 1e-9)


def test_a_command_that_changes_every_row_keeps_its_area() -> None:
    times = jittered()
    command = np.random.default_rng(2).standard_normal(times.size)
    found = resampled(times, command, np.zeros(times.size))
    fine = np.linspace(0.0, found.end, 400_001)[:-1]
    held = command[np.searchsorted(times, fine, side="right") - 1]
    means = held.reshape(found.n_samples, -1).mean(axis=1) if fine.size % found.n_samples == 0 else None
    area = found.inputs[0].sum() * STEP
    np.testing.assert_allclose(area, held.mean() * found.end, atol=1e-3)
    assert means is None or np.abs(means[:-1] - found.inputs[0][:-1]).max() < 0.02


def test_a_tone_beyond_the_new_nyquist_frequency_is_not_folded() -> None:
    times = 0.002 * np.arange(5000)
    tone = np.sin(2 * np.pi * 40.0 * times)  # 25 Hz is the new Nyquist frequency, and it would fold to 10 Hz
    found = resample(Recording.from_arrays(np.zeros(5000), tone, 0.002), 0.02)
    assert found.sample_time == pytest.approx(0.02)
    assert np.abs(found.outputs[0]).max() < 2e-3  # 60 dB


@pytest.mark.parametrize("reading", [ReadingTime.START_OF_HOLD, ReadingTime.END_OF_HOLD])
@pytest.mark.parametrize("step", [0.02, 0.003, 0.0008])
def test_other_rows_keep_when_a_reading_is_taken(reading: ReadingTime, step: float) -> None:
    # The reading is the command of an integrator that began at zero: at the end of its hold, or at its start.
    command = np.sin(2 * np.pi * 0.5 * 0.002 * np.arange(10_000))
    area = 0.002 * np.cumsum(command)
    taken = area if reading is ReadingTime.END_OF_HOLD else area - 0.002 * command
    record = Recording.from_arrays(command, taken, 0.002)
    found = resample(record, step, reading=reading)
    steps = np.diff(found.outputs[0]) / step
    moved = found.inputs[0][1:] if reading is ReadingTime.END_OF_HOLD else found.inputs[0][:-1]
    np.testing.assert_allclose(steps[3:], moved[3:], atol=1e-3)  # before the first reading, none is known


@pytest.mark.parametrize("step", [0.002, 0.007, 0.021, 0.05])
@pytest.mark.parametrize("reading", list(ReadingTime))
def test_a_reading_keeps_its_time_at_any_new_sample_time(reading: ReadingTime, step: float) -> None:
    # The sensor reads sin(w t): in the new rows, too, at the end of a row, at its start, or as its mean.
    omega = 2 * np.pi * 0.5
    share = {ReadingTime.START_OF_HOLD: 0.0, ReadingTime.MEAN_OVER_HOLD: 0.5, ReadingTime.END_OF_HOLD: 1.0}[reading]
    times = STEP * np.arange(2000)
    record = Recording.from_arrays(np.sin(times), np.sin(omega * (times + share * STEP)), STEP)
    found = resample(record, step, reading=reading)
    chord = (omega * STEP) ** 2 / 8
    mean = (omega * step) ** 2 / 24 if reading is ReadingTime.MEAN_OVER_HOLD else 0.0
    expected = np.sin(omega * (found.timepts + share * step))
    ripple = 1e-3 if step > 1.1 * STEP else 0.0  # of a low-pass filter with 60 dB
    assert np.abs(found.outputs[0] - expected).max() <= chord + mean + ripple


@pytest.mark.parametrize("step", [0.005, 0.04, 0.05, 0.1])
@pytest.mark.parametrize("reading", list(ReadingTime))
def test_a_mean_over_a_row_stays_one(reading: ReadingTime, step: float) -> None:
    # A current is the mean rate of a charge, here of sin(w t), over the row that ends with the reading.
    omega, times = 2 * np.pi * 0.5, STEP * np.arange(2000)
    back = 1.0 if reading is ReadingTime.START_OF_HOLD else 0.0

    def current(clock: np.ndarray, row: float) -> np.ndarray:
        begin = clock - back * row
        return (np.sin(omega * (begin + row)) - np.sin(omega * begin)) / row

    record = Recording.from_arrays(
        np.sin(times), np.cos(times), STEP, extras={"current": current(times, STEP)}, extra_units={"current": "A"}
    )
    found = resample(record, step, reading=reading, means=("current",))
    middle = slice(5, -5)  # the last row ends before half of the one that is wanted
    errors = (found.extras["current"] - current(found.timepts, step))[middle]
    # A chord, the ripple of the low-pass filter, and the means over a short and a long row: (w T)^2/24.
    assert np.abs(errors).max() <= omega * ((omega * STEP) ** 2 / 8 + 1e-3 + (omega * step) ** 2 / 24)


def test_the_current_of_a_film_is_a_mean(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(RIG)
    times = STEP * np.arange(2000)
    write_csv(
        tmp_path / "r.csv",
        {
            "time_s": times,
            "command_V": 2 + np.sin(times),
            "displacement_mm": 0.1 * np.cos(times),
            "current_uA": np.sin(2 * np.pi * 0.5 * (times + STEP / 2)),
        },
    )
    found = read_recording(tmp_path / "r.csv", resample=0.1, rig=read_rig(tmp_path / "rig.toml"))
    expected = 1e-6 * np.sin(2 * np.pi * 0.5 * (found.timepts + 0.05))
    assert np.abs(found.extras["current"] - expected).max() < 2e-9  # the ripple of the low-pass filter, twice


def test_the_bandwidth_is_that_of_the_interpolation() -> None:
    times = np.concatenate([[0.0], STEP * (np.arange(500) + 0.5)])  # new rows midway: cos(pi f h), 3 dB at 0.25 / h
    assert plan_resampling(times, STEP, str).bandwidth() == pytest.approx(0.25 / STEP, rel=0.02)
    assert plan_resampling(STEP * np.arange(500), STEP, str).bandwidth() == 0.5 / STEP  # nothing is moved
    finer = plan_resampling(STEP * np.arange(200), STEP / 10, str)  # all places between rows: sinc squared
    x = np.linspace(0.01, 1.0, 10_000)
    assert finer.bandwidth() == pytest.approx(x[np.argmax(np.sinc(x) ** 2 < np.sqrt(0.5))] / STEP, rel=0.15)


def test_gaps_stay_gaps(tmp_path: Path) -> None:
    times = jittered(300)
    rows = np.r_[0:100, 110:300]
    write_csv(
        tmp_path / "r.csv", {"time_s": times[rows], "command_V": np.sin(times[rows]), "displacement_mm": times[rows]}
    )
    with pytest.raises(DataError, match="row 102: a gap"):
        read_recording(tmp_path / "r.csv", resample=STEP)
    whole = Recording.from_arrays(np.sin(times[rows]), times[rows], STEP)
    with pytest.raises(DataError, match=r"sample 100: a gap .*; split the recording there and resample each part"):
        resample(whole, STEP, timepts=times[rows])
    first, second = read_recordings(tmp_path / "r.csv", resample=STEP, allow_gaps=True)
    assert first.end < times[110] <= second.start
    assert (second.start - first.start) / STEP == pytest.approx(round((second.start - first.start) / STEP))
    np.testing.assert_allclose(second.outputs[0], 1e-3 * second.timepts, rtol=1e-9)


def test_what_the_error_offers_works_and_the_recording_says_what_was_done(tmp_path: Path) -> None:
    times = jittered()
    write_csv(tmp_path / "r.csv", {"time_s": times, "command_V": np.sin(times), "displacement_mm": np.cos(times)})
    with pytest.raises(DataError, match="uneven") as error:
        read_recording(tmp_path / "r.csv")
    (step,) = re.findall(r"--resample (\S+),", str(error.value))
    found = read_recording(tmp_path / "r.csv", resample=float(step))
    assert found.sample_time == pytest.approx(STEP, rel=0.05)
    assert "jitter" in found.provenance["resampled"] and "3 dB" in found.provenance["resampled"]


def test_even_times_are_kept_and_uneven_ones_are_not_passed_over_in_silence(tmp_path: Path) -> None:
    even, times = STEP * np.arange(50), 1e3 * jittered(50)
    write_csv(tmp_path / "even.csv", {"time_s": even, "command_V": even, "displacement_mm": even**2})
    found = read_recording(tmp_path / "even.csv", resample=STEP)
    np.testing.assert_array_equal(found.outputs, read_recording(tmp_path / "even.csv").outputs)
    assert "resampled" not in found.provenance
    write_csv(tmp_path / "ticks.csv", {"clock": times, "command_V": even, "displacement_mm": even})
    said = read_recording(tmp_path / "ticks.csv", dt=STEP).provenance["clock"]
    assert '"clock" was ignored' in said
    assert said.endswith(f'--time-column "clock=ms" --resample {STEP}')
    found = read_recording(tmp_path / "ticks.csv", time_column="clock=ms", resample=STEP)
    assert found.end == pytest.approx(1e-3 * times[-1], abs=1.5 * STEP)


@pytest.mark.parametrize("even", [True, False])
def test_times_without_a_unit_that_are_no_seconds(tmp_path: Path, *, even: bool) -> None:
    times = np.round(1e3 * (STEP * np.arange(50) if even else jittered(50)))
    write_csv(tmp_path / "r.csv", {"Timestamp": times, "command_V": np.sin(times), "displacement_mm": times})
    with pytest.raises(DataError, match="is not in seconds") as error:
        read_recording(tmp_path / "r.csv", dt=STEP)
    (column,) = re.findall(r'--time-column "(\S+)"', str(error.value))
    found = read_recording(tmp_path / "r.csv", time_column=column, resample=STEP)
    assert found.sample_time == STEP
    assert found.end == pytest.approx(1e-3 * times[-1], abs=1.5 * STEP)


@pytest.mark.parametrize("header", ["millis", "Time_ms", "t [ms]", "timeMillis", "uptime ms", "Zeit, ms"])
def test_the_name_of_the_times_says_their_unit(tmp_path: Path, header: str) -> None:
    times = 1e3 * jittered(50)
    write_csv(
        tmp_path / "r.csv", {header.replace(",", ""): times, "command_V": np.sin(times), "displacement_mm": times}
    )
    # The step that the user means is offered, not the median of these.
    with pytest.raises(DataError, match=f"--resample {STEP}, in Python"):
        read_recording(tmp_path / "r.csv", dt=STEP)
    found = read_recording(tmp_path / "r.csv", dt=STEP, resample=STEP)
    assert found.end == pytest.approx(1e-3 * times[-1], abs=1.5 * STEP)


def test_whole_numbers_without_a_unit_raise_a_question(tmp_path: Path) -> None:
    times = 100.0 * np.arange(50)
    write_csv(tmp_path / "r.csv", {"time": times, "command_V": np.sin(times), "displacement_mm": times})
    found = read_recording(tmp_path / "r.csv")
    assert found.sample_time == 100.0
    assert "are they milliseconds?" in found.provenance["clock"]
    with pytest.raises(DataError, match=r"999 of 1000 new rows .* --resample 100; if .* --time-column \"time=ms\""):
        read_recording(tmp_path / "r.csv", resample=0.1)
    for column, step in (("time=ms", 0.1), ("time=s", 100.0)):
        told = read_recording(tmp_path / "r.csv", time_column=column, resample=step)
        assert told.sample_time == step
        assert "clock" not in told.provenance
    write_csv(tmp_path / "r.csv", {"time": 0.02 * times, "command_V": np.sin(times), "displacement_mm": times})
    assert "clock" in read_recording(tmp_path / "r.csv").provenance
    write_csv(tmp_path / "r.csv", {"time": 1e-3 * times, "command_V": np.sin(times), "displacement_mm": times})
    assert "clock" not in read_recording(tmp_path / "r.csv").provenance


@pytest.mark.parametrize(
    ("times", "step", "says"),
    [
        ([0.0, 0.1], 0.1, "shape"),
        ([0.0, 0.1, 0.2], 0.009, "choose a sample time of 0.01 s or more"),
        ([0.0, 0.2, 0.1], 0.1, "sample 2: times do not increase"),
        ([0.0, 0.1, 0.2], 0.0, "must be positive"),
        ([0.0, 0.1, 0.2], 5.0, "long enough for two samples"),
    ],
)
def test_what_cannot_be_resampled(times: list[float], step: float, says: str) -> None:
    with pytest.raises(DataError, match=says):
        resample(Recording.from_arrays(np.zeros(3), np.zeros(3), 0.1), step, timepts=times)

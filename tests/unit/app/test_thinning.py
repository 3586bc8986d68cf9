"""Recordings that are sampled too fast for a NARX model."""

import json

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfiltfilt

from deatwin.app.cli import main
from deatwin.app.thinning import lost, thinned
from deatwin.ident.narx import Frols
from deatwin.ident.narx.preprocess import choose_sampling
from deatwin.ident.narx.reliance import hold_out
from deatwin.plant.files import write_csv
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime


@pytest.fixture(scope="module")
def fast():
    """Noise of 5 Hz through a lag of 20 ms, at 1 kHz."""
    noise = np.random.default_rng(4).standard_normal(20_000)
    u = sosfiltfilt(butter(4, 5.0, fs=1000, output="sos"), noise)
    return Recording.from_arrays(u, lfilter([0.05], [1, -0.95], u), 0.001)


def test_it_is_said_and_what_is_offered_does_it(fast):
    said = thinned([fast], None, ReadingTime.END_OF_HOLD, held_out=0.3)
    assert said.records == [fast]
    assert "use --decimate auto, which keeps a sample every" in said.notes[0]
    made = thinned([fast], "auto", ReadingTime.END_OF_HOLD, held_out=0.3)
    factor = choose_sampling(fast.section(0, 14_000)).factor
    assert made.records[0].sample_time == pytest.approx(0.001 * factor)
    assert f"keeps a sample every {made.records[0].sample_time:g} s" in said.notes[0]
    assert f"decimated by {factor}" in made.notes[0]


def test_a_rate_that_is_not_far_above_the_output_is_not_told():
    """A time constant of 6 samples under steps of 10, and one of 40 with a light mode at 5 samples a period."""
    rng = np.random.default_rng(6)
    short = np.repeat(rng.uniform(-1, 1, 300), 10)
    u = np.repeat(rng.uniform(-1, 1, 100), 60)
    rings = lfilter([1.0], [1, -2 * 0.98 * np.cos(2 * np.pi / 5), 0.98**2], u)
    slow = lfilter([0.025], [1, -0.975], u) + 0.05 * rings
    for signal, y in ((short, lfilter([0.15], [1, -0.85], short)), (u, slow)):
        record = Recording.from_arrays(signal, y + 0.005 * y.std() * rng.standard_normal(y.size), 0.02)
        assert thinned([record], None, ReadingTime.END_OF_HOLD, held_out=0.3).notes == []
        (said,) = thinned([record], "auto", ReadingTime.END_OF_HOLD, held_out=0.3).notes
        assert said.startswith("not decimated: the sampling time is suitable")


def test_a_decimated_model_that_is_worse_than_a_linear_one_is_told(fast):
    slower = thinned([fast], "10", ReadingTime.END_OF_HOLD, held_out=0.3).records
    training, unseen = hold_out(slower)
    good = Frols(output_lags=1, input_lags=[0, 1, 2], degree=1).fit(training).model_
    assert lost(good, unseen, [fast]) == []
    (said,) = lost(Frols(output_lags=[40], input_lags=[60], degree=1).fit(training).model_, unseen, [fast])
    assert said.startswith("decimation lost information; leave --decimate out, or choose a smaller factor")
    same = Frols(output_lags=1, input_lags=[9], degree=1).fit([fast]).model_
    assert lost(same, [fast], [fast]) == []


@pytest.mark.parametrize("samples", [12, 40])
def test_a_short_recording_gives_a_model(tmp_path, capsys, samples):
    u = np.random.default_rng(5).standard_normal(samples)
    y = lfilter([0.5], [1.0, -0.6], u)
    write_csv(tmp_path / "r.csv", {"time_s": 0.1 * np.arange(samples), "command_V": u, "displacement_mm": y})
    assert main(["identify", str(tmp_path / "r.csv"), "--out", str(tmp_path / "m.json"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert f"r.csv: {samples} samples do not determine the spectrum" in found["notes"][-1]
    assert found["unseen"][0]["validation"].startswith("residuals not tested: ")
    assert found["unseen"][0]["failed_tests"] is None
    if samples == 40:
        assert found["terms"]["y(k-1)"] == pytest.approx(0.6, abs=1e-3)


def test_an_unstable_pole_is_told_though_the_held_out_part_is_too_short_for_tests(tmp_path, capsys):
    rng = np.random.default_rng(0)  # y(k) = 1.1 y(k-1) + u(k-1) + e(k), held by u = 0.5 (r - y): the loop's pole is 0.6
    wanted, y, u = np.repeat(rng.uniform(-1, 1, 13), 20)[:250], np.zeros(250), np.zeros(250)
    for k in range(1, 250):
        y[k] = 1.1 * y[k - 1] + u[k - 1] + 0.002 * rng.normal()
        u[k] = 0.5 * (wanted[k] - y[k]) + 0.2 * rng.normal()
    write_csv(tmp_path / "r.csv", {"time_s": 0.1 * np.arange(250), "command_V": u, "displacement_mm": y})
    line = ["identify", str(tmp_path / "r.csv"), "--degree", "1", "--out", str(tmp_path / "m.json"), "--json"]
    assert main(line) == 0
    (found,) = json.loads(capsys.readouterr().out)["unseen"]
    assert found["validation"].startswith("residuals not tested: ")
    assert "unstable pole: z = 1.1" in " ".join(found["unstable"])

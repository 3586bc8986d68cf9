"""`deatwin identify`: input lags from the dead time on, and unstable models judged some steps ahead."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.app import identify_lags
from deatwin.app.cli import main
from deatwin.app.identify_lags import choose_input_lags, disagreements
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.preprocess import estimate_dead_time
from deatwin.plant.files import write_recording
from deatwin.plant.recording import Recording

COLUMNS = ["--input-column", "u", "--output-column", "y"]


def named(u, y, sample_time=0.1):
    return Recording.from_arrays(
        u, y, sample_time, input_names=["u"], output_names=["y"], input_units=["1"], output_units=["1"]
    )


def late(lag, n=2000):
    rng = np.random.default_rng(lag)
    u = np.repeat(rng.uniform(-1, 1, n // 10), 10)
    return named(u, lfilter(np.r_[np.zeros(lag), 0.1], [1, -0.9], u) + 0.002 * rng.normal(size=n))


def test_lags_begin_at_the_dead_time_unless_others_are_asked_for():
    found = choose_input_lags([late(25)], None, None)
    assert set(found.lags) >= {25, 26, 27} and found.lags[0] >= 24 and found.lags[-1] == 27
    assert "after 25 samples (2.5 s)" in found.sentences[0] and "24 to 27" in found.sentences[-1]
    asked = choose_input_lags([late(25)], None, 4)
    assert asked.lags == (0, 1, 2, 3, 4)
    assert "end at 4" in asked.sentences[-1] and "--first-input-lag 24 --input-lags 27" in asked.sentences[-1]
    enough = choose_input_lags([late(25)], 20, 30)
    assert enough.lags == tuple(range(20, 31)) and len(enough.sentences) == 1
    assert choose_input_lags([late(1)], None, None).lags == (1, 2)
    assert choose_input_lags([late(0)], None, None).lags == (0, 1, 2)


def test_lags_reach_beyond_a_dead_time_that_may_be_short_or_long(monkeypatch):
    (found,) = estimate_dead_time(late(25))
    for first, lags in ((0, tuple(range(8))), (1, tuple(range(1, 8)))):
        wide = replace(found, probabilities=[float(first <= lag <= 5) for lag in range(10)])
        monkeypatch.setattr(identify_lags, "estimate_dead_time", lambda _, wide=wide: (wide,))
        assert choose_input_lags([late(25)], None, None).lags == lags


def test_an_input_that_repeats_itself_imposes_no_lags():
    u = np.abs(np.arange(800) / 50 % 2 - 1)  # a triangle; after half its period it is its own mirror image
    y = lfilter([0.0, 0.1], [1, -0.9], u)
    record = named(u, y + 0.03 * y.std() * np.random.default_rng(1).normal(size=800))
    found = choose_input_lags([record], None, None)
    assert found.lags == (0, 1, 2) and len(found.sentences) == 1 and "dead time" in found.sentences[0]
    assert found.dead_times[0].status.name in ("ALIKE", "POOR")


def test_a_model_that_begins_elsewhere_than_the_dead_time_says_so():
    found = choose_input_lags([late(1)], None, None)
    agreeing = NarxModel.from_terms({"y(k-1)": 0.9, "u(k-1)": 0.1}, sample_time=0.1)
    assert disagreements(agreeing, found, by_free_run=False) == []
    (said,) = disagreements(
        NarxModel.from_terms({"y(k-1)": 0.9, "u(k-2)": 0.1}, sample_time=0.1), found, by_free_run=False
    )
    assert "after 1 sample" in said and "is 2" in said
    without = NarxModel.from_terms({"y(k-1)": 0.9}, sample_time=0.1)
    for by_free_run, advice in ((False, "stronger input"), (True, "--method frols")):
        (said,) = disagreements(without, found, by_free_run=by_free_run)
        assert "no term of the model contains u" in said and "lags 1 to 2 were candidates" in said and advice in said
    (said,) = disagreements(without, replace(found, lags=(0,)), by_free_run=True)
    assert "--input-lags" in said and "frols" not in said


@pytest.mark.parametrize("method", ["lasso", "frols"])
def test_lags_that_competed_are_not_advised(at_desk, capsys, method):
    """y(k) = 1.02 y(k-1) + 0.1 u(k-1) in a loop: no free run can tell its terms, so that a constant has the best one."""
    rng = np.random.default_rng(3)
    wanted, u, read, y = np.repeat(rng.uniform(-1, 1, 100), 20), np.zeros(2000), np.zeros(2000), 0.0
    for k in range(2000):
        read[k] = y + 0.01 * rng.normal()
        u[k] = 3.0 * (wanted[k] - read[k]) + 0.3 * rng.normal()
        y = 1.02 * y + 0.1 * u[k]
    write_recording("loop.csv", named(u, read))
    assert main(["identify", "loop.csv", *COLUMNS, "--method", method, "--out", "narx.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert not any("candidate input lags" in note for note in told["notes"])
    assert any("use --method frols" in note for note in told["notes"]) == (method == "lasso")
    if method == "frols":
        assert "u(k-1)" in told["terms"]


@pytest.mark.parametrize(("method", "zeta"), [("svb", 1.0), ("frols", None)])
def test_slow_plants_at_twenty_kilohertz_are_learned_by_decimation(at_desk, capsys, zeta, method):
    """A second of a plant of 20 ms: behind the filter the free run follows within a tenth of the output's deviation."""
    rng = np.random.default_rng([1, 3])
    pole = np.exp(-1 / 400)
    u = np.repeat(rng.uniform(-1, 1, 152), 133)[:20_000]
    poles = [pole] if zeta is None else [pole, pole]
    y = lfilter(np.r_[0.0, np.poly(poles).sum()], np.poly(poles), u)
    write_recording("fast.csv", named(u, y + 0.001 * y.std() * rng.normal(size=u.size), 5e-5))
    command = ["identify", "fast.csv", *COLUMNS, "--decimate", "auto", "--method", method, "--out", "narx.json"]
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert "decimated by" in told["clocks"][0]
    assert told["unseen"][0]["finished"] and told["unseen"][0]["free_run"] < 0.1 * y.std()
    assert all(one["status"] != "loop" for one in told["dead_times"])


def test_a_model_that_runs_away_on_its_own_data_is_never_given_without_a_warning(at_desk, capsys):
    """With lags that were asked for nothing is changed, but said."""
    rng = np.random.default_rng([1, 3])
    u = np.repeat(rng.uniform(-1, 1, 152), 133)[:20_000]
    y = lfilter([0.0, 1 - np.exp(-1 / 400)], [1, -np.exp(-1 / 400)], u)
    write_recording("fast.csv", named(u, y + 0.001 * y.std() * rng.normal(size=u.size), 5e-5))
    command = ["identify", "fast.csv", *COLUMNS, "--decimate", "99", "--out", "narx.json", "--json"]
    assert main([*command, "--output-lags", "2"]) == 0
    assert "diverges on its own training recordings" in json.loads(capsys.readouterr().out)["notes"][0]
    assert main(command) == 0
    told = json.loads(capsys.readouterr().out)
    assert (
        "the model uses only 1 lag of the output, because with 2 lags it had" in told["notes"][0]
        and told["unseen"][0]["finished"]
    )


def test_the_command_finds_a_late_input(at_desk, capsys):
    write_recording("late.csv", late(25))
    assert main(["identify", "late.csv", *COLUMNS, "--out", "narx.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["dead_times"][0]["samples"] == 25 and 25 in told["input_lags"]
    assert "u(k-25)" in told["terms"] and told["unseen"][0]["free_run"] < 0.004


def test_the_command_judges_an_unstable_model_ahead(at_desk, capsys):
    rng = np.random.default_rng(3)
    wanted, y, u = np.repeat(rng.uniform(-1, 1, 100), 20), np.zeros(2000), np.zeros(2000)
    for k in range(1, 2000):
        y[k] = 1.1 * y[k - 1] + u[k - 1] + 0.02 * rng.normal()
        u[k] = 0.5 * (wanted[k] - y[k]) + 0.2 * rng.normal()
    write_recording("loop.csv", named(u, y))
    options = ["--degree", "1", "--method", "frols", "--out", "narx.json", "--report", "found"]
    assert main(["identify", "loop.csv", *COLUMNS, *options]) == 0
    told = capsys.readouterr().out
    assert "a closed loop is suspected" in told and "closed loop" in told
    assert "--first-input-lag 0" in told and "u(k) " not in told  # the controller's answer within the sample
    low, high = map(float, re.search(r"95 % interval ([\d.]+) to ([\d.]+)\), \+", told).groups())
    assert low <= 1.1 <= high < low + 0.02
    # z = 1.1 is +0.95 1/s and grows by e in ten samples; the estimate is within some per cent
    pole = float(re.search(r"unstable pole: z = ([\d.]+), \+0\.\d+ 1/s", told).group(1))
    assert (
        pole == pytest.approx(1.1, abs=0.02)
        and " steps ahead, the time in which a deviation grows by a factor of e" in told
    )
    page = (at_desk / "found" / "report.html").read_text()
    assert re.search(r"prediction \d+ steps ahead", page)


def test_a_lone_wrong_reading_is_named_and_rounding_is_no_structure(at_desk, capsys):
    record = late(4)
    wrong = record.outputs[0].copy()
    wrong[700] += 50.0
    write_recording("wrong.csv", named(record.inputs[0], wrong))
    assert main(["identify", "wrong.csv", *COLUMNS, "--out", "narx.json"]) == 0
    told = capsys.readouterr().out
    assert "1 outlying reading, at 70 s" in told and "these samples bias the fit" in told
    exact = np.round(lfilter([0.0, 0.1], [1, -0.9], record.inputs[0]), 9)
    write_recording("exact.csv", named(record.inputs[0], exact))
    assert main(["identify", "exact.csv", *COLUMNS, "--out", "narx.json"]) == 0
    told = capsys.readouterr().out
    assert "the residual is rounding error" in told and "outlying" not in told and "% above" not in told

"""What `deatwin identify` says of noise on readings, of periodic recordings and of nonlinear state spaces."""

import signal

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.app.cli import main
from deatwin.app.identify_narx import biased_by_noise
from deatwin.ident.narx import SvbNarx
from deatwin.ident.narx.reliance import hold_out
from deatwin.ident.nss import NonlinearStateSpace, search
from deatwin.plant.excitation import random_odd_harmonics, random_phase_multisine
from deatwin.plant.recording import Recording

ARGUMENTS = ["identify", "lag.csv", "--method", "nss", "--states", "1", "--out", "nss.json"]


@pytest.mark.parametrize("on_readings", [True, False])
def test_noise_on_the_readings_is_told_from_noise_in_the_dynamics(on_readings):
    """An oscillator with a damping ratio of 0.33: least squares is biased by the former and, as theory has it, not by the latter."""
    said = 0
    for seed in range(6):
        rng = np.random.default_rng([seed, 17])
        a, u = [1.0, -1.7, 0.8], rng.uniform(-1, 1, 1500)
        y, noise = lfilter([0.0, 0.1], a, u), rng.normal(size=1500)
        noise = noise if on_readings else lfilter([1.0], a, noise)
        record = Recording.from_arrays(u, y + 0.05 * y.std() / noise.std() * noise, 0.1)
        training, unseen = hold_out(record)
        model = SvbNarx(degree=1).fit(training).model_
        said += bool(biased_by_noise(model, training, unseen))
    assert said == (6 if on_readings else 0)


@pytest.mark.parametrize(("power", "said"), [(3, True), (2, False)])
def test_an_odd_distortion_asks_for_an_odd_degree(power, said, tmp_path, capsys):
    rng = np.random.default_rng(1)
    harmonics, _ = random_odd_harmonics(rng, 5.12, 20.0)
    u = random_phase_multisine(rng, 5.12, 0.01, harmonics, 1.0, periods=4, lower=-2.0, upper=7.0)
    y = (u - 2.4) + 0.1 * (u - 2.4) ** power + 0.01 * rng.normal(size=u.size)
    table = np.column_stack([0.01 * np.arange(u.size), u, y])
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="time_s,command_V,displacement_mm", comments="")
    options = ["--method", "frols", "--output-lags", "1", "--input-lags", "2", "--max-terms", "4"]
    out = tmp_path / "found"
    report = ["--report", str(out)] if said else []
    assert main(["identify", str(tmp_path / "a.csv"), *options, "--out", str(tmp_path / "m.json"), *report]) == 0
    assert ("allow terms of the third degree (--degree 3)" in capsys.readouterr().out) is said
    assert main(["look", str(tmp_path / "a.csv")]) == 0
    assert ("--degree 3" in capsys.readouterr().out) is said
    if said:
        page = (out / "report.html").read_text(encoding="utf-8")
        assert "Best linear approximation, estimated without a model" in page


def recorded(pole, n=400):
    """Write a lag of first order, or an unstable plant, with a little noise."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-1.0, 1.0, n)
    y = lfilter([0.0, 1.0], [1.0, -pole], u) + 0.01 * rng.normal(size=n)
    rows, header = np.c_[np.arange(n) * 0.01, u, y], "time_s,command_V,displacement_mm"
    np.savetxt("lag.csv", rows, delimiter=",", header=header, comments="")


def test_ctrl_c_leaves_the_best_model(at_desk, monkeypatch, capsys, heard):
    kept, calls = search.triangle, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == 4:
            signal.raise_signal(signal.SIGINT)
        return kept(*arguments)

    recorded(0.8)
    monkeypatch.setattr(search, "triangle", interrupted)
    assert main(ARGUMENTS) == 130
    assert "interrupted: the model is the best" in capsys.readouterr().out
    assert NonlinearStateSpace.load(at_desk / "nss.json").n_states == 1


@pytest.mark.parametrize(("pole", "told"), [(0.8, False), (1.02, True)])
def test_an_unstable_plant_is_noted(at_desk, capsys, pole, told):
    recorded(pole)
    assert main([*ARGUMENTS, "--report", "told"]) == 0
    said = capsys.readouterr().out
    assert ("note: " in said) is told and ("unstable pole, |z| = 1.02" in said) is told
    page = (at_desk / "told" / "report.html").read_text(encoding="utf-8")
    assert "A nonlinear state space of order 1" in page and "linear output-error model of the same order" in page
    assert ("unstable pole" in page) is told and (at_desk / "told" / "figures" / "free_run_1.csv").is_file()

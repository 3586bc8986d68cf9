"""``deatwin identify --method nss``: what an interrupt leaves, and what is said of a plant that no free run follows."""

import signal

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.app.cli import main
from deatwin.ident.nss import NonlinearStateSpace, search

ARGUMENTS = ["identify", "lag.csv", "--method", "nss", "--states", "1", "--out", "nss.json"]


def recorded(pole, n=400):
    """Write a lag of first order, or an unstable plant, with a little noise."""
    rng = np.random.default_rng(0)
    u = rng.uniform(-1.0, 1.0, n)
    y = lfilter([0.0, 1.0], [1.0, -pole], u) + 0.01 * rng.normal(size=n)
    rows, header = np.c_[np.arange(n) * 0.01, u, y], "time_s,command_V,displacement_mm"
    np.savetxt("lag.csv", rows, delimiter=",", header=header, comments="")


def test_ctrl_c_leaves_the_best_model(at_desk, monkeypatch, capsys):
    kept, calls = search.triangle, []

    def interrupted(*arguments):
        calls.append(1)
        if len(calls) == 4:
            signal.raise_signal(signal.SIGINT)
        return kept(*arguments)

    recorded(0.8)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(search, "triangle", interrupted)
    try:
        assert main(ARGUMENTS) == 130
    finally:
        signal.signal(signal.SIGINT, before)
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

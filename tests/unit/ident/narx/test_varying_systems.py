"""Systems whose parameters are given functions of time."""

import numpy as np
import pytest

from deatwin.ident.narx.varying_systems import MOVING_DC, RESONANCE, SYSTEMS, recorded


def test_a_recording_obeys_the_equation_of_each_instant() -> None:
    rng = np.random.default_rng(0)
    for system in SYSTEMS:
        truth = system.truth(duration=20.0)
        u, e = system.excitation(rng, 20.0), 0.01 * rng.standard_normal(400)
        y = recorded(truth, u, e).outputs[0]
        lag = truth.model.table.max_lag
        assert not y[:lag].any()
        for k in range(lag, 400):
            known = {"1": 1.0, "y(k-1)": y[k - 1], "y(k-2)": y[k - 2], "u(k-1)": u[k - 1], "y(k-1)^2": y[k - 1] ** 2}
            terms = [known[str(term)] for term in truth.terms]
            assert y[k] == pytest.approx(truth.theta[:, k] @ terms + e[k], abs=1e-12)


def test_parameters_go_there_and_back() -> None:
    assert RESONANCE.is_linear and not MOVING_DC.is_linear
    for speed in (1.0, 4.0):
        constant = MOVING_DC.truth(speed).theta[0]
        assert constant.max() == pytest.approx(0.5, abs=1e-4)
        turns = np.sum(np.diff(np.sign(constant - 0.25)) != 0)
        assert turns == 2 * speed

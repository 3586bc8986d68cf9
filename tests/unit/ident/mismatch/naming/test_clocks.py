"""Two drifts by one clock."""

from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.clocks import INTERVAL, of_one_clock


def drifting(*times, deviation, names=("permittivity_drift", "sensor_drift")):
    known = {f"{name}.time": time for name, time in zip(names, times, strict=True)}
    half = np.exp(0.5 * INTERVAL * deviation)
    fit = SimpleNamespace(
        names=tuple(known),
        interval=lambda name: (known[name] / half, known[name] * half),
        plant=SimpleNamespace(parameters={name: SimpleNamespace(value=time) for name, time in known.items()}),
    )
    return SimpleNamespace(effects=names, calibration=fit)


@pytest.mark.parametrize(
    ("times", "deviation", "one"),
    [
        ((36.0, 38.0), 0.06, True),
        ((36.0, 60.0), 0.06, False),  # six deviations of the difference apart
        ((36.0, 38.0), 1.1, False),  # each known no better than beforehand: no coincidence
    ],
    ids=["one clock", "two clocks", "unknown times"],
)
def test_two_drifts_of_one_rate_are_one(times, deviation, one):
    names = ("permittivity_drift", "sensor_drift")
    assert of_one_clock(drifting(*times, deviation=deviation)) == (names if one else ())


def test_other_effects_have_clocks_of_their_own():
    assert of_one_clock(drifting(36.0, 36.0, deviation=0.06, names=("creep", "sensor_drift"))) == ()


def test_two_clocks_are_seldom_taken_for_one():
    """Times drawn as beforehand, known to 6 %: one pair in ten is that near by chance."""
    rng = np.random.default_rng(0)
    drawn = 200.0 * np.exp(rng.standard_normal((2000, 2)))
    found = [bool(of_one_clock(drifting(*times, deviation=0.06))) for times in drawn]
    assert 0.05 < np.mean(found) < 0.15

"""Steps in a residual."""

import numpy as np
import pytest

from deatwin.plant import effect_named
from deatwin.plant.effects.onset import LATEST, steps_of


def test_a_step_is_found_at_its_sample_whatever_the_scale():
    times = 0.1 * np.arange(200)
    for scale in (1e-9, 1.0, -1e6):
        (time, height), *_ = steps_of(times, scale * (np.arange(200) >= 120))
        assert time == pytest.approx(11.95)
        assert height == pytest.approx(scale)


def test_two_steps_are_both_among_the_candidates():
    times = np.arange(300.0)
    residual = 1.0 * (times >= 80) - 2.0 * (times >= 210)
    found = {round(t + 0.5) for t, _ in steps_of(times, residual)}
    assert {80, 210} <= found


def test_the_best_step_is_the_one_that_least_squares_takes():
    rng = np.random.default_rng(2)
    times, residual = np.arange(60.0), rng.standard_normal(60)

    def left(k):
        return residual[:k].var() * k + residual[k:].var() * (60 - k)

    best = min(range(1, 60), key=left)
    time, height = steps_of(times, residual)[0]
    assert time == best - 0.5
    assert height == pytest.approx(residual[best:].mean() - residual[:best].mean())


@pytest.mark.parametrize("residual", [np.zeros(0), np.ones(1), np.zeros(50)])
def test_nothing_steps_in_nothing(residual):
    assert steps_of(np.arange(residual.size, dtype=float), residual) == ()


@pytest.mark.parametrize("name", ["sensor_jump", "electrode_loss"])
def test_an_event_that_no_clock_allows_is_no_start(name):
    """A recording may begin days after the clock; what its effect cannot hold must not end the diagnosis."""
    times, residual = 0.02 * np.arange(3000), -1e-5 * (np.arange(3000) >= 1700)
    assert effect_named(name).starts(times, residual)
    assert effect_named(name).starts(times + LATEST, residual) == ()

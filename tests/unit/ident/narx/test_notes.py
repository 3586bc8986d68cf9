"""Fits and validations say that an input acts only after the last lag of the model."""

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.narx import Fixed, Frols, NarxModel, Semp, SvbNarx, validate
from deatwin.plant.recording import Recording


def late(lag, seed=0, n=800, noise=0.02, poles=(0.9,), kind="white"):
    rng = np.random.default_rng([seed, lag])
    u = rng.normal(size=n) if kind == "white" else np.repeat(rng.uniform(-1, 1, n // 10), 10)
    y = lfilter(np.r_[np.zeros(lag), 1.0], np.poly(poles), u)
    return Recording.from_arrays(
        u, y + noise * y.std() * rng.normal(size=n), 0.1, input_names=["u"], output_names=["y"]
    )


def test_every_estimator_and_validation_says_it():
    lag = 9
    record, unseen = late(lag, n=300), late(lag, 1, n=300)
    fits = (Frols(degree=1), Fixed(terms=["y(k-1)", "u(k-1)"]))
    for identifier in fits:
        (note,) = (one for one in identifier.fit(record).notes_ if "begins to act" in one)
        assert f"after {lag} samples" in note and "of u" in note.partition(": allow lags ")[2]
        found = validate(identifier.model_, unseen)
        assert any(f"after {lag} samples" in one for one in found.notes) and f"after {lag} samples" in str(found)


@pytest.mark.parametrize("kind", ["white", "held"])
def test_a_slow_beginning_is_no_dead_time(kind):
    """Two slow poles under 15 % of noise show nothing of the first samples; none of these six fits calls it a dead time."""
    for seed in range(3):
        for lag in (1, 2):
            record = late(lag, seed, 1500, 0.15, (0.95, 0.95), kind)
            assert not any("begins to act" in note for note in Frols(degree=1).fit(record).notes_)


def test_lags_that_reach_it_say_nothing_and_short_or_exact_records_neither():
    assert Frols(degree=1, input_lags=range(20, 28)).fit(late(25)).notes_ == ()
    assert Frols(degree=1, input_lags=30).fit(late(25)).notes_ == ()
    exact = NarxModel.from_terms({"y(k-1)": 0.9, "u(k-1)": 1.0}, sample_time=0.1)
    assert validate(exact, late(1, noise=0.0)).notes == ()
    assert Frols(degree=1, max_terms=3).fit(late(25, n=40)).notes_ == ()


def test_a_constant_input_is_told():
    rng = np.random.default_rng(6)
    y = lfilter([1.0], [1.0, -0.9], rng.normal(size=400))
    inputs = np.vstack([np.ones(400), rng.normal(size=400)])
    record = Recording.from_arrays(inputs, y, 0.1, input_names=["bias", "u"], output_names=["y"])
    for identifier in (Frols(degree=1), Semp(degree=1), SvbNarx(degree=1)):
        told = [note for note in identifier.fit(record).notes_ if "is constant" in note]
        assert told == ['the input "bias" is constant, so the model does not show how the output depends on it']


def test_of_two_inputs_the_late_one_is_named():
    rng = np.random.default_rng(5)
    u = rng.normal(size=(2, 1000))
    y = lfilter([0, 0.5], [1, -0.8], u[0]) + lfilter(np.r_[np.zeros(12), 0.3], [1, -0.8], u[1])
    record = Recording.from_arrays(u, y + 0.05 * rng.normal(size=1000), 0.1, input_names=["valve", "heater"])
    (note,) = Frols(degree=1).fit(record).notes_
    assert note.startswith("heater begins to act") and "after 12 samples" in note

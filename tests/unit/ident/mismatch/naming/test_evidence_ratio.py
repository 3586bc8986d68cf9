"""What recordings say for one explanation over another one."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom

from deatwin.ident.mismatch.naming import evidence_ratio
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.evidence_ratio import LAW, advantage, likeliest

NOISE, COUNT = 2.0, 2000


def explanation(name: str, residuals: np.ndarray, model_error: float = 0.0, parameters: int = 8) -> Candidate:
    plant = SimpleNamespace(rig=SimpleNamespace(model_error=model_error))
    fitted, unseen = np.split(residuals, [int(0.7 * residuals.size)])
    calibration = SimpleNamespace(plant=plant, residuals=fitted, names=("a",) * parameters)
    return Candidate(effects=(name,), calibration=calibration, unseen=unseen, noise=NOISE)


def fast(size: float) -> np.ndarray:
    """A difference at half the sample rate: within a block it has no mean."""
    return size * np.tile([1.0, -1.0], COUNT // 2)


def test_one_over_the_other_is_minus_the_other_over_the_one():
    rng = np.random.default_rng(0)
    noise = NOISE * rng.standard_normal(COUNT)
    one, other = explanation("delay", noise, 1.0, 8), explanation("sensor_lag", noise + fast(0.3), 1.0, 9)
    assert advantage(one, other) == pytest.approx(-advantage(other, one))
    assert advantage(one, replace(one, effects=("leakage",))) == 0.0


def test_what_differs_fast_is_told_by_the_ratio_of_likelihoods():
    rng = np.random.default_rng(1)
    noise = NOISE * rng.standard_normal(COUNT)
    apart = fast(0.05)  # d² = 2000 (0.05 / 2)² = 1.25: a law that is wrong by a third adds 1.25 / 9 to 1
    one, other = explanation("delay", noise, 1.0), explanation("sensor_lag", noise + apart, 1.0)
    white = float(np.sum((noise + apart) ** 2 - noise**2)) / (2 * NOISE**2)
    assert abs(white) < 1.25 / 2  # neither is out of bounds
    assert advantage(one, other) == pytest.approx(white / (1 + LAW**2 * 1.25), rel=0.02)


def test_the_larger_of_the_errors_and_the_smaller_of_the_noises_count(monkeypatch):
    monkeypatch.setattr(Candidate, "evidence", 0.0)
    noise = np.random.default_rng(5).standard_normal(COUNT)
    near, far = explanation("creep", noise, 0.0), explanation("leakage", noise + 0.5, 1.0)
    same = explanation("creep", noise, 1.0)
    assert advantage(near, far) == advantage(same, far) != advantage(near, replace(far, calibration=near.calibration))
    fast_one = explanation("delay", noise + fast(0.05))
    quiet, loud = (replace(fast_one, noise=level) for level in (1.0, 4.0))
    assert advantage(near, loud) == advantage(near, replace(loud, noise=NOISE))
    assert abs(advantage(near, quiet)) > abs(advantage(near, loud))


def test_what_is_slow_averages_out_from_one_experiment_to_the_next(monkeypatch):
    monkeypatch.setattr(Candidate, "evidence", 0.0)
    noise = np.random.default_rng(6).standard_normal(COUNT)
    pair = explanation("creep", noise, 1.0), explanation("leakage", noise + 0.1, 1.0)
    sizes = ((700, 300), (700, 300))
    one, other = (replace(explained, sizes=sizes) for explained in pair)
    assert one.pieces == (700, 700, 300, 300)
    assert sum(one.pieces) == one.residuals.size
    assert advantage(one, other) > advantage(*pair)


def test_what_differs_slowly_counts_no_more_than_by_blocks():
    rng = np.random.default_rng(2)
    noise = NOISE * rng.standard_normal(COUNT)
    slow = 0.3 * np.sin(2 * np.pi * np.arange(COUNT) / COUNT)
    one, other = explanation("creep", noise, 1.0), explanation("sensor_curvature", noise + slow, 1.0)
    # what is a function of the reading, as half of the plant's own error is, no number of samples tells
    one = replace(one, measured=100.0 * slow)
    assert advantage(one, other) == pytest.approx(one.evidence - other.evidence)


@pytest.mark.parametrize("size", [0.15, 0.4, 2.0])
def test_of_two_laws_that_are_nearly_right_as_many_lead_as_it_says(size, monkeypatch):
    """The truth is the one or the other, and errs by a third of what tells them apart: drawn 1000 times."""
    monkeypatch.setattr(Candidate, "evidence", 0.0)  # of blocks, that are not the subject
    monkeypatch.setattr(Candidate, "losses", np.ones(40))
    rng = np.random.default_rng(3)
    apart, said, right = fast(size), [], []
    for _ in range(1000):
        truth = rng.choice([0.0, 1.0])
        reading = (truth + LAW * rng.standard_normal()) * apart + NOISE * rng.standard_normal(COUNT)
        zero, one = explanation("delay", reading), explanation("sensor_lag", reading - apart)
        share = 1 / (1 + np.exp(-advantage(one, zero)))
        said.append(max(share, 1 - share))
        right.append((share > 0.5) == (truth == 1.0))
    # bounds of x make it modest by a little where it is most certain
    low, high = binom.interval(0.998, 1000, np.mean(said))
    assert low <= np.sum(right) <= high + 30


def test_three_that_beat_each_other_in_turn_end_the_search(monkeypatch):
    beats = {("a", "b"): 1.0, ("b", "c"): 1.0, ("c", "a"): 1.0}
    monkeypatch.setattr(
        evidence_ratio,
        "advantage",
        lambda one, other: beats.get(one.effects + other.effects, -beats.get(other.effects + one.effects, 0.0)),
    )
    noise = np.random.default_rng(4).standard_normal(COUNT)
    three = [explanation(name, noise) for name in "abc"]
    assert likeliest(three) in three
    beats[("a", "c")], beats[("c", "a")] = 2.0, -2.0
    assert likeliest(three) is three[0]

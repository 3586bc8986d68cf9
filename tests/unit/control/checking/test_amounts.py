"""Sentences on runs that went far off say so with few digits; their numbers stay as they are."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from made_models import finished

from deatwin.control.checking.amounts import LARGEST, amount
from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.verdict import Runs, judge_runs, judge_width
from deatwin.control.loop.predicted import PredictedLoop

STEP = np.repeat([0.0, 1.0], 60)
TIME = 0.02 * np.arange(STEP.size)


def off_by(size: float) -> Runs:
    """A run that lies above its step by so many steps, and swings by as many from sample to sample."""
    output = STEP + size * (1 + (-1.0) ** np.arange(STEP.size))
    run = finished(STEP, output)
    return Runs(source="plant", steps=run, sine=run)


def texts(size: float, sine_predicted: float) -> dict[str, str]:
    return {f.subject: f.text for f in judge_runs(off_by(size), sine_predicted, Specification())}


def test_numbers_up_to_the_largest_are_written_as_they_are():
    for unit, largest in LARGEST.items():
        assert amount(largest, ".2g", unit) == f"{largest:.0f}{unit}"
        assert amount(np.nextafter(largest, inf), ".2g", unit) == f"more than {largest:.0f}{unit}"
        assert amount(inf, ".1f", unit) == f"more than {largest:.0f}{unit}"
    assert amount(999.4, ".3g", " %") == "999 %"
    assert amount(999.7, ".3g", " %") == "1000 %"
    assert amount(0.0, ".1f", " steps") == "0.0 steps"
    assert amount(1e6, ".3g", " Hz") == "1e+06 Hz"  # of other units nothing is too large


def test_sentences_on_runs_near_the_limits_hold_the_numbers():
    """Twice 0.4 above the step at most, 0.4 in the mean and as rms; the error is then 0.4 √2 in rms."""
    found = texts(0.4, sine_predicted=0.4 * 2**0.5 / 7.0)
    assert "plant model, the output overshoots by 80 % of the step (" in found["overshoot"]
    assert (
        "plant model, the mean error in the last third of a step is 40.0 % of the height of the step"
        in found["steady-state error"]
    )
    assert (
        "plant model, the rms ripple in the last third of a step is 40.0 % of the height of the step" in found["ripple"]
    )
    assert (
        "plant model, the rms error on a slow sine is 7.00 times the error that the identified model predicts"
        in found["tracking"]
    )


@pytest.mark.parametrize("size", [11.0, 7.3e11])
def test_sentences_on_runs_far_off_are_short_and_the_numbers_stay(size):
    found = {f.subject: f for f in judge_runs(off_by(size), 1e-3, Specification())}
    for subject, says in (
        ("overshoot", ", the output overshoots by more than 1000 % of the step ("),
        ("steady-state error", "in the last third of a step is more than 1000 % of the height of the step"),
        ("ripple", ", the rms ripple in the last third of a step is more than 1000 % of the height of the step"),
        (
            "tracking",
            ", the rms error on a slow sine is more than 100 times the error that the identified model predicts",
        ),
    ):
        assert says in found[subject].text
        assert found[subject].verdict is Verdict.FAIL
    assert found["overshoot"].value == pytest.approx(2 * size)
    assert found["steady-state error"].value == pytest.approx(size)
    assert found["ripple"].value == pytest.approx(size)
    assert found["tracking"].value == pytest.approx(size * 2**0.5 / 1e-3)


def test_an_error_that_the_model_does_not_predict_at_all_is_more_than_a_hundred_times_that():
    assert "is more than 100 times the error" in texts(0.1, sine_predicted=0.0)["tracking"]


def test_a_band_of_any_width_is_told():
    spread = np.random.default_rng(0).standard_normal((60, STEP.size))
    band = PredictedLoop(
        timepts=TIME,
        reference=STEP,
        outputs=spread,
        commands=np.zeros_like(spread),
        diverged=0.0,
        command_limits=(-1.0, 1.0),
        input_unit="V",
        output_unit="m",
    )
    half = float(np.median(band.half_width))
    for steps, says in (
        (99.7, "99.7 times the height of the step"),
        (7.0, "7 times"),
        (101.0, "more than 100 times"),
        (3e8, "more than 100"),
    ):
        found = judge_width(replace(band, outputs=spread * steps / half), 1.0, Specification())
        assert f"is {says}" in found.text
        assert found.value == pytest.approx(steps)

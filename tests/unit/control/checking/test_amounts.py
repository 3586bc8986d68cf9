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


def test_numbers_up_to_the_largest_are_written_as_they_are():
    for unit, largest in LARGEST.items():
        assert amount(largest, ".2g", unit) == f"{largest:.0f}{unit}"
        assert amount(np.nextafter(largest, inf), ".2g", unit) == f"more than {largest:.0f}{unit}"
        assert amount(inf, ".1f", unit) == f"more than {largest:.0f}{unit}"
    assert amount(999.4, ".3g", " %") == "999 %"
    assert amount(999.7, ".3g", " %") == "1000 %"
    assert amount(0.0, ".1f", " steps") == "0.0 steps"
    assert amount(1e6, ".3g", " Hz") == "1e+06 Hz"  # of other units nothing is too large


@pytest.mark.parametrize(
    ("size", "sine_predicted", "share", "error", "times"),
    [
        # Twice 0.4 above the step at most, 0.4 in the mean and as rms; the error is then 0.4 √2 in rms.
        (0.4, 0.4 * 2**0.5 / 7.0, "40.0 %", "80 %", "7.00 times"),
        (11.0, 1e-3, "more than 1000 %", "more than 1000 %", "more than 100 times"),
        (7.3e11, 1e-3, "more than 1000 %", "more than 1000 %", "more than 100 times"),
        (11.0, 0.0, "more than 1000 %", "more than 1000 %", "more than 100 times"),  # the model predicts no error
    ],
)
def test_sentences_hold_the_numbers_or_are_short_where_runs_are_far_off(size, sine_predicted, share, error, times):
    found = {f.subject: f for f in judge_runs(off_by(size), sine_predicted, Specification())}
    level = "in the last third of a step is"
    for subject, says, value in (
        ("overshoot", f", the output overshoots by {error} of the step (", 2 * size),
        ("steady-state error", f", the mean error {level} {share} of the height of the step", size),
        ("ripple", f", the rms ripple {level} {share} of the height of the step", size),
        (
            "tracking",
            f", the rms error on a slow sine is {times} the error that the identified model predicts",
            size * 2**0.5 / sine_predicted if sine_predicted else inf,
        ),
    ):
        assert f"plant model{says}" in found[subject].text
        assert found[subject].verdict is Verdict.FAIL
        assert found[subject].value == pytest.approx(value)


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

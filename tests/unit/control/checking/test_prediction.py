"""What a check says of the steps where they leave the outputs of the training data."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import finished

from deatwin.control.checking.specification import Specification, Verdict
from deatwin.control.checking.verdict import judge_prediction
from deatwin.control.loop.closed_loop import ClosedLoop
from deatwin.control.loop.predicted import PredictedLoop

N = 100
TIME = 0.02 * np.arange(N)
SINE = 2e-4 + 5e-5 * np.sin(2 * np.pi * TIME)  # from 150 to 250 µm
WHERE = "in simulation with the plant model"
SENTENCE = "of the output lies inside the band that the identified model predicts"


def run_of(output) -> ClosedLoop:
    return finished(SINE, output)


@pytest.fixture
def predicted() -> PredictedLoop:
    wander = 1e-6 * np.random.default_rng(0).standard_normal((60, N))
    return PredictedLoop(
        timepts=TIME,
        reference=SINE,
        outputs=SINE + wander,
        commands=np.zeros((60, N)),
        diverged=0.0,
        command_limits=(-1.0, 1.0),
        input_unit="V",
        output_unit="m",
        trained=(1e-4, 3e-4),
    )


def test_steps_inside_the_training_data_are_told_without_it(predicted):
    for known in (predicted, replace(predicted, trained=None)):
        found = judge_prediction(known, run_of(SINE), Specification())
        assert (found.verdict, found.value) == (Verdict.PASS, 1.0)
        assert found.text == f"{WHERE}, 100.0 % {SENTENCE}"


@pytest.mark.parametrize("trained", [(1e-4, 2.2e-4), (1.8e-4, 3e-4)])
def test_steps_that_leave_the_training_data_are_told_so_at_either_end_and_judged_alike(predicted, trained):
    output = np.where(np.arange(N) < 20, SINE + 1e-5, SINE)  # a fifth lies outside, as the band is a few µm wide
    known = replace(predicted, trained=trained)
    inside = judge_prediction(predicted, run_of(output), Specification())
    found = judge_prediction(known, run_of(output), Specification())
    assert (found.verdict, found.value) == (inside.verdict, inside.value) == (Verdict.MARGINAL, 0.8)
    low, high = (f"{1e6 * value:.3g}" for value in (output.min(), output.max()))
    least, most = (f"{1e6 * value:.0f}" for value in trained)
    told = f"(output {low} to {high} µm, beyond the range of the training data, {least} to {most} µm), 80.0 %"
    assert told in found.text
    assert told not in inside.text

"""Free runs that inputs alone drive, from given outputs."""

import numpy as np
import pytest

from deatwin.ident.narx import NarxModel
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

MODEL = NarxModel.from_terms(
    {"y(k-1)": 0.6, "y(k-2)": -0.1, "u1(k-1)": 0.5, "u1(k-1)u2(k-5)": 0.4},
    sample_time=0.5,
    input_names=("u", "w"),
    input_units=("", ""),
)


def by_hand(inputs, start, first):
    u, w = inputs
    y = np.zeros(u.size)
    y[first - start.size : first] = start
    for k in range(first, u.size):
        y[k] = 0.6 * y[k - 1] - 0.1 * y[k - 2] + 0.5 * u[k - 1] + 0.4 * u[k - 1] * w[k - 5]
    return y


@pytest.fixture
def inputs():
    return np.random.default_rng(2).uniform(-1, 1, (2, 60))


@pytest.mark.parametrize(
    ("start", "first"), [([0.3, -0.2], 5), ([0.1, 0.2, 0.3, 0.4, 0.5], 5), (list(np.linspace(0, 1, 9)), 9), (None, 5)]
)
def test_a_run_of_bare_inputs_is_the_equation_from_the_outputs_before_it(inputs, start, first):
    run = MODEL.simulate(inputs, initial=start)
    assert run.first == first and run.timepts[3] == 1.5
    wanted = by_hand(inputs, np.zeros(5) if start is None else np.array(start), first)
    assert np.allclose(run.outputs[0, first:], wanted[first:], rtol=1e-12)
    assert np.all(np.isnan(run.measured[0, first:]))


def test_outputs_after_the_last_known_one_are_not_needed(inputs):
    known = np.full(60, np.nan)
    known[:20] = np.random.default_rng(1).normal(size=20)
    run = MODEL.simulate(inputs, initial=known)
    assert run.first == 20 and np.array_equal(run.measured[0, :20], known[:20])
    assert np.allclose(run.outputs[0], by_hand(inputs, known[:20], 20), rtol=1e-12)


def test_a_recording_of_inputs_alone_keeps_its_clock(inputs):
    commands = Recording.from_arrays(inputs, np.zeros((0, 60)), 0.5, start=7.0, output_names=[], input_names=["u", "w"])
    run = MODEL.simulate(commands, initial=[0.3, -0.2])
    assert run.timepts[0] == 7.0
    assert np.array_equal(run.outputs, MODEL.simulate(inputs, initial=[0.3, -0.2]).outputs)
    recorded = Recording.from_arrays(inputs, by_hand(inputs, np.ones(5), 5), 0.5)
    assert np.allclose(MODEL.simulate(recorded).outputs[0], recorded.outputs[0], rtol=1e-12)
    assert np.array_equal(MODEL.simulate(recorded, initial=[0.3, -0.2]).outputs, run.outputs)


def test_several_outputs_and_one_input():
    pair = NarxModel.from_terms({"y1": {"y2(k-1)": 0.5, "u(k)": 1.0}, "y2": {"y1(k-1)": -0.5}}, sample_time=1.0)
    run = pair.simulate([1.0, 2.0, 3.0], initial=[[1.0], [2.0]])
    assert np.allclose(run.outputs, [[1.0, 3.0, 2.75], [2.0, -0.5, -1.5]])
    with pytest.raises(ModelError, match=r"initial has the shape \(2,\); the model takes \(2, m\)"):
        pair.simulate([1.0, 2.0, 3.0], initial=[1.0, 2.0])


@pytest.mark.parametrize(
    ("change", "initial", "says"),
    [
        (lambda x: x[0], None, r"shape \(60,\); the model takes \(2, n\), a row for each of u, w"),
        (lambda x: x.T, None, "transpose them"),
        (lambda x: x, [1.0], "initial holds 1 values of each output; the model needs at least 2"),
        (lambda x: x, [1.0, np.nan, 2.0], "no number at sample 1"),
        (lambda x: x, [1.0, 2.0, np.inf], "infinite"),
        (lambda x: x, np.ones((1, 60)), "at least 61 are needed"),
        (lambda x: x[:, :5], None, "the inputs have 5 samples"),
        (lambda x: np.where(x == x[1, 7], np.nan, x), None, "the input w is nan at sample 7"),
        (lambda x: "inputs.csv", None, "must be an array of real numbers"),
        (lambda x: np.ma.masked_greater(x, 0.5), None, "is nan at sample"),
    ],
)
def test_what_cannot_drive_a_run_is_refused_with_what_could(inputs, change, initial, says):
    with pytest.raises(ModelError, match=says):
        MODEL.simulate(change(inputs), initial=initial)

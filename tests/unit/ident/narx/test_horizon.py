"""Predictions several steps ahead, against a loop that runs each origin by itself."""

import numpy as np
import pytest

from deatwin.ident.narx import NarxModel, ResponseStatus
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

NARMAX = {"y(k-1)": 0.5, "y(k-3)": -0.2, "u(k)": 0.3, "y(k-1)u(k-2)": 0.4, "e(k-1)": 0.6, "y(k-2)e(k-2)": 0.3, "1": 0.1}
PAIR = {
    "y1": {"y1(k-1)": 0.5, "y2(k-2)": 0.3, "u(k-1)": 1.0, "y1(k-1)e2(k-1)": 0.3},
    "y2": {"y2(k-1)": -0.4, "y1(k-1)y2(k-1)": 0.2, "e2(k-1)": 0.5},
}


def make_recording(n=40, outputs=1, seed=1):
    rng = np.random.default_rng(seed)
    return Recording.from_arrays(rng.uniform(-1, 1, n), rng.uniform(-1, 1, (outputs, n)), 0.1)


def one_run(model, u, y, e, origin, steps):
    """Return y(origin + steps) by the equations, with y and e known until the origin."""
    y, e = y.copy(), e.copy()
    e[:, origin + 1 :] = 0.0
    for k in range(origin + 1, origin + steps + 1):
        new = np.zeros(len(y))
        for term, theta, row in zip(model.terms, model.theta, model.equations, strict=True):
            value = theta
            for v, power in term.factors:
                value *= {"y": y, "u": u, "e": e}[v.kind][v.index, k - v.lag] ** power
            new[row] += value
        y[:, k] = new
    return y[:, origin + steps]


@pytest.mark.parametrize(("terms", "outputs"), [(NARMAX, 1), (PAIR, 2)])
@pytest.mark.parametrize("steps", [1, 2, 3, 7])
def test_each_prediction_is_a_run_of_its_own_from_the_last_measured_sample(terms, outputs, steps):
    model = NarxModel.from_terms(terms, sample_time=0.1)
    recording = make_recording(outputs=outputs)
    innovations = recording.outputs - model.predict(recording).outputs
    response = model.predict(recording, steps=steps)
    first = model.table.max_lag + steps - 1
    assert response.status.ok and response.first == first
    assert np.array_equal(response.outputs[:, :first], recording.outputs[:, :first])
    for k in range(first, recording.n_samples):
        wanted = one_run(model, recording.inputs, recording.outputs, innovations, k - steps, steps)
        assert np.allclose(response.outputs[:, k], wanted, rtol=1e-12, atol=1e-13)


def test_runs_in_several_blocks_are_those_of_one():
    model = NarxModel.from_terms({"y(k-1)": 0.9, "u(k-1)": 1.0, "y(k-2)u(k-1)": 0.1}, sample_time=0.1)
    recording = make_recording(n=10_000)
    late = model.predict(recording.section(9000, 10_000), steps=5).outputs[:, 10:]
    assert np.allclose(model.predict(recording, steps=5).outputs[:, 9010:], late, rtol=1e-12)


@pytest.mark.parametrize("steps", [0, -1, 1.5, True, 39])
def test_steps_that_make_no_sense_are_refused(steps):
    model = NarxModel.from_terms({"y(k-2)": 0.5, "u(k-1)": 1.0}, sample_time=0.1)
    with pytest.raises(ModelError, match="steps = "):
        model.predict(make_recording(), steps=steps)


def test_diverged_predictions_stay_finite_and_say_so():
    recording = make_recording(n=400)
    model = NarxModel.from_terms({"y(k-1)^2": 30.0, "u(k-1)": 1.0}, sample_time=0.1)
    response = model.predict(recording, steps=300)
    assert response.status is ResponseStatus.SOME_DIVERGED and response.failed_at_s is not None
    assert np.all(np.isfinite(response.outputs))

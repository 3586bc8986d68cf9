"""NARX models as C, against `NarxModel.simulate`."""

from typing import Any

import numpy as np
import pytest
from made_narx import trained_on

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.export import narx_source
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

SINGLE = {"1": 0.02, "y(k-1)": 0.6, "y(k-3)": -0.1, "u(k)": 0.3, "u(k-2)^2": 0.1, "y(k-1)u(k-1)^2": -0.05}
TWO = {
    "y1": {"y1(k-1)": 0.5, "y2(k-2)": 0.1, "u1(k-1)": 1.0},
    "y2": {"y2(k-1)": 0.3, "y1(k-1)u2(k)": 0.2, "u2(k-3)^3": -0.1},
}
BENT = {
    "y(k-1)": 0.4,
    "|u(k)|": 0.3,
    "sat(u(k-1),0.5)y(k-2)": -0.2,
    "sign(y(k-1)-y(k-3))": 0.05,
    "rbf(u(k-2),0.3,0.2)": 0.4,
    "dead(u(k),0.2)": 0.2,
    "hinge(y(k-1),0.1)": 0.1,
    "spline(u(k-1),-0.5)": -0.1,
}
ROUNDING = 1e-13
"""Of sums of some terms of size 1, over runs that forget within some samples."""


def simulated(model: NarxModel, inputs: np.ndarray) -> np.ndarray:
    """Free run from rest at the model's origins, shape (n, n_outputs)."""
    lag = model.deterministic.table.max_lag
    padded = np.hstack([np.tile(model.input_origin[:, None], lag), inputs])
    record = Recording(
        inputs=padded,
        outputs=np.tile(model.output_origin[:, None], padded.shape[1]),
        sample_time=model.sample_time,
        input_names=model.input_names,
        output_names=model.output_names,
        input_units=model.input_units,
        output_units=model.output_units,
    )
    return model.deterministic.simulate(record).outputs[:, lag:].T


@pytest.mark.parametrize(
    ("terms", "about"),
    [
        *((terms, {}) for terms in (SINGLE, TWO, {"u(k)": 2.0}, BENT)),
        ({"y(k-1)": 0.5, "u(k-1)": 1.0, "u(k-1)e(k-1)": 0.3}, {}),
        (SINGLE, {"input_origin": [40.0], "output_origin": [300.0]}),
    ],
)
def test_the_source_computes_what_the_model_simulates(terms: Any, about: Any, run_c: Any) -> None:
    model = NarxModel.from_terms(terms, sample_time=0.02, **about)
    inputs = np.random.default_rng(0).uniform(-1.0, 1.0, (len(model.input_names), 300)) + model.input_origin[:, None]
    found, status = run_c(narx_source(model), inputs.T)
    expected = simulated(model, inputs)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * np.abs(expected).max())
    assert not status.any()


def test_a_model_that_diverges_says_so_and_holds_its_last_output(run_c: Any) -> None:
    trained = trained_on((-1, 1), (-1, 1))
    model = NarxModel.from_terms({"y(k-1)": 2.0, "u(k)": 1.0}, sample_time=0.1, operating=trained)
    found, status = run_c(narx_source(model), np.ones((20, 1)))
    # 2^n - 1 passes a thousand times the training data's 1 at n = 10.
    np.testing.assert_array_equal(found[:, 0], [min(2.0 ** (k + 1) - 1, 511.0) for k in range(20)])
    np.testing.assert_array_equal(status, [k >= 9 for k in range(20)])


def test_a_model_rests_where_it_is_told_to(run_c: Any) -> None:
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-2)": 1.0}, sample_time=0.1)
    found, _ = run_c(narx_source(model, rest_input=[3.0], rest_output=[6.0]), np.full((5, 1), 3.0))
    np.testing.assert_array_equal(found[:, 0], 6.0)  # y = u / (1 - 0.5), exact in binary


def test_single_precision_loses_digits_only(run_c: Any) -> None:
    model = NarxModel.from_terms(SINGLE, sample_time=0.02)
    inputs = np.random.default_rng(1).uniform(-1.0, 1.0, (1, 300))
    found, _ = run_c(narx_source(model), inputs.T, "-std=c99", "-Wdouble-promotion", "-Werror", "-DNARX_REAL=float")
    # A float rounds at 6e-8; six terms, remembered for some samples.
    np.testing.assert_allclose(found, simulated(model, inputs), rtol=0, atol=3e-6)


def test_a_name_that_is_no_identifier_and_a_rest_of_another_size_are_refused() -> None:
    model = NarxModel.from_terms(SINGLE, sample_time=0.02)
    with pytest.raises(ModelError, match="cannot be a prefix of C names"):
        narx_source(model, name="my model")
    with pytest.raises(ModelError, match="the model has 1 inputs"):
        narx_source(model, rest_input=[1.0, 2.0])


def test_a_unit_cannot_end_the_comment(run_c: Any) -> None:
    model = NarxModel.from_terms({"u(k)": 1.0}, sample_time=0.1, input_units=("*/ #error",))
    found, _ = run_c(narx_source(model), np.ones((1, 1)))
    assert found[0, 0] == 1.0

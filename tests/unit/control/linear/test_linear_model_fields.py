"""What a linear model takes: a covariance, and fields of their kinds."""

from __future__ import annotations

import numpy as np
import pytest

from deatwin.control.errors import ControlError
from deatwin.control.linear.model import LinearModel, LinearStatus
from deatwin.plant.errors import ModelError


def linear_model(**changed):
    fields = {
        "numerator": [0.0, 0.3],
        "denominator": [1.0, -0.7],
        "covariance": np.diag([0.0, 1e-4, 4e-4]),
        "sample_time": 0.02,
        "operating_input": 1.0,
        "operating_output": 2.0,
    }
    return LinearModel(**(fields | changed))


def covariance(row, column, value, other):
    values = np.diag([0.0, 1e-4, 4e-4])
    values[row, column], values[column, row] = value, other
    return values


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (covariance(1, 2, 1e-4, -1e-4), "not symmetric: it holds 0.0001 for b_1 and a_1"),
        (covariance(1, 1, -1e-4, -1e-4), "variance of b_1 is -0.0001"),
        (covariance(1, 2, 3e-4, 3e-4), "eigenvalue -0.5"),  # a correlation of 3e-4 / (1e-2 2e-2) = 1.5
        (covariance(0, 2, 1e-4, 1e-4), "b_0 and a_1, one of which has the variance 0"),
        (covariance(1, 2, np.nan, np.nan), "must be finite"),
        (covariance(2, 2, np.inf, np.inf), "must be finite"),
    ],
)
def test_what_is_no_covariance_is_refused(values, message):
    with pytest.raises(ModelError, match="covariance of a linear model.*" + message):
        linear_model(covariance=values)


def test_a_covariance_unequal_by_rounding_is_made_symmetric():
    values = linear_model(covariance=covariance(1, 2, 1e-4, 1e-4 * (1 + 1e-12))).covariance
    assert (values == values.T).all()
    assert not values.flags.writeable


def test_a_model_without_an_equilibrium_may_hold_no_numbers():
    model = linear_model(covariance=np.full((3, 3), np.nan), status=LinearStatus.NO_EQUILIBRIUM, operating_output=None)
    assert np.isnan(model.covariance).all()


@pytest.mark.parametrize(
    "changed",
    [
        {"status": "OK"},
        {"status": None},
        {"detail": None},
        {"input_name": 1},
        {"output_name": None},
        {"input_unit": 2.0},
        {"output_unit": b"m"},
        {"operating_input": np.nan},
        {"operating_output": np.inf},
        {"operating_output": None},
    ],
)
def test_fields_are_of_their_kind(changed):
    (name,) = changed
    with pytest.raises(ControlError, match=name):
        linear_model(**changed)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda model: model.response("1 Hz"), "omega must be real numbers; got text"),
        (lambda model: model.step_response(-1), "count must be an integer of at least 0; got -1"),
        (lambda model: model.step_response(2.5), "count must be an integer of at least 0; got 2.5"),
    ],
)
def test_arguments_of_its_responses_are_checked(call, said):
    with pytest.raises(ControlError, match=said):
        call(linear_model())


def test_the_gain_of_an_integrator_is_infinite():
    assert linear_model(denominator=[1.0, -1.0]).static_gain == np.inf

"""Linearise a NARX model about an operating point, for the design of controllers."""

from __future__ import annotations

from typing import Any

import numpy as np

from deatwin.control.arguments import instance, taking
from deatwin.control.linear.model import LinearModel
from deatwin.ident.frequency import equilibrium, linear_part
from deatwin.ident.frequency.linear import LinearPart, operating_input_of
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.covariance import transformed
from deatwin.plant.errors import ModelError


@taking(model=instance(NarxModel))
def linearise(model: NarxModel, operating_input: float | None = None) -> LinearModel:
    """Linearise a single-input, single-output model about its equilibrium under a constant input.

    Parameters
    ----------
    model : NarxModel
        Identified model.
    operating_input : float, optional
        Constant input, in its unit; the mean of the training inputs by default.

    Returns
    -------
    LinearModel
        Linear model from the input to the output, where b_0 is the coefficient of the input in the same row of a
        recording. A controller may be able to use a reading only for the command of the next row. Therefore apply
        `LinearModel.in_loop`, which adds this delay if needed, before you design a controller. The status
        says whether there is an equilibrium at which a controller can be designed.

    Raises
    ------
    ModelError
        If the model has several inputs or outputs, or if the operating input is not finite.

    Examples
    --------
    >>> model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)^2": 1.0}, sample_time=0.1)
    >>> linearise(model, operating_input=1.0).static_gain
    4.0
    """
    if len(model.input_names) != 1:
        raise ModelError(f"the model has {len(model.input_names)} inputs; a controller is designed for one")
    point = float(operating_input_of(model, operating_input)[0])
    try:
        rest = equilibrium(model, point)
        part = linear_part(model, point, rest.output)
    except ModelError as error:
        return LinearModel.without_equilibrium(str(error), operating_input=point, **signals_of(model))
    return _of_part(model, part, point, rest.output).judged(rest.is_stable)


def _of_part(model: NarxModel, part: LinearPart, operating_input: float, output: float) -> LinearModel:
    n_b, n_a = int(part.input_lags.max(initial=0)) + 1, int(part.output_lags.max(initial=0))
    numerator, denominator = np.zeros(n_b), np.concatenate([[1.0], np.zeros(n_a)])
    slopes = np.zeros((n_b + n_a, model.theta.size))
    numerator[part.input_lags] = part.b
    slopes[part.input_lags] = part.b_theta
    denominator[part.output_lags] = -part.a
    slopes[n_b + part.output_lags - 1] = -part.a_theta
    return LinearModel(
        numerator=numerator,
        denominator=denominator,
        covariance=transformed(slopes, model.theta_cov),
        operating_input=operating_input,
        operating_output=output,
        **signals_of(model),
    )


def signals_of(model: NarxModel) -> dict[str, Any]:
    """Return names and units of a model's signals, and its sampling time, as the fields of its linear models."""
    return {
        "sample_time": model.sample_time,
        "input_name": model.input_names[0],
        "output_name": model.output_names[0],
        "input_unit": model.input_units[0],
        "output_unit": model.output_units[0],
    }

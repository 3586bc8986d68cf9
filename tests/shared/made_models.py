"""Models, controllers and runs with the few numbers that a test is about; the others are plain."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deatwin.control import ClosedLoop, LinearController
from deatwin.control.controllers.law import Law
from deatwin.control.linear.model import LinearModel
from deatwin.plant import RunStatus


def linear_model(numerator: ArrayLike, denominator: ArrayLike, **given: Any) -> LinearModel:
    """A linear model that is known exactly, of 0.02 s, about zero."""
    size = np.size(numerator) + np.size(denominator) - 1
    plain = {"covariance": np.zeros((size, size)), "sample_time": 0.02, "operating_input": 0.0, "operating_output": 0.0}
    return LinearModel(numerator=numerator, denominator=denominator, **{**plain, **given})


def controller_of(law: Law, windup: ArrayLike, **given: Any) -> LinearController:
    """A controller of 0.02 s about zero, with commands from -1 to 1."""
    plain = {
        "name": "PI",
        "sample_time": 0.02,
        "operating_input": 0.0,
        "operating_output": 0.0,
        "command_min": -1.0,
        "command_max": 1.0,
        "closed_loop_time": 1.0,
    }
    return LinearController(law=law, windup=windup, **{**plain, **given})


def finished(reference: ArrayLike, output: ArrayLike, **given: Any) -> ClosedLoop:
    """A run that reads what it does, every 0.02 s, with commands of zero between -1 and 1."""
    count = np.size(reference)
    plain = {
        "status": RunStatus.DONE,
        "timepts": 0.02 * np.arange(count),
        "measured": output,
        "command": np.zeros(count),
        "command_limits": (-1.0, 1.0),
        "input_unit": "V",
        "output_unit": "m",
    }
    return ClosedLoop(reference=reference, output=output, **{**plain, **given})

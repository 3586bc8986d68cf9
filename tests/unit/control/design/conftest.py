"""Models that are sampled from known transfer functions, and the loop around them by python-control."""

from collections.abc import Callable, Sequence
from functools import reduce

import control
import numpy as np
import pytest
from made_models import linear_model

from deatwin.control import LinearModel

H = 0.02


@pytest.fixture(scope="session")
def sampled() -> Callable[..., LinearModel]:
    """``gain * prod(lead s + 1)/prod(lag s + 1)`` under a hold, with further samples of delay."""

    def make(
        gain: float, lags: Sequence[float], leads: Sequence[float] = (), *, delay: int = 0, point: float = 2.0
    ) -> LinearModel:
        top, bottom = (reduce(np.polymul, [[time, 1.0] for time in times], [1.0]) for times in (leads, lags))
        system = control.c2d(control.tf(gain * np.asarray(top), bottom), H, "zoh")
        num, den = np.ravel(system.num[0][0]), np.ravel(system.den[0][0])
        num = np.concatenate([np.zeros(delay + den.size - num.size), num])
        num[0] = 0.0  # rounding
        return linear_model(num, den, operating_input=point, operating_output=1.0, input_unit="V", output_unit="um")

    return make


@pytest.fixture(scope="session")
def around() -> Callable[..., control.StateSpace]:
    """The closed loop of a model with the law of a controller: from reference to output, command and error."""

    def close(linear: LinearModel, controller) -> control.StateSpace:
        law = controller.local(linear.operating_input).to_control(H)
        plant = linear.state_space()
        plant = control.ss(plant, inputs=["command"], outputs=["reading"], name="plant")
        law = control.ss(law, name="law")
        return control.interconnect([plant, law], inputs=["reference"], outputs=["reading", "command"], name="loop")

    return close

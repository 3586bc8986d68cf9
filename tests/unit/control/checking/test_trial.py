"""The predicted error on the sine reference against a simulation of the linear loop."""

from functools import partial

import numpy as np
import pytest
from made_models import linear_model

from deatwin.control import StaticCurve, lambda_tuning, lqg, with_inverse
from deatwin.control.checking.trial import Trial

H, GAIN, POLE, LIMITS = 0.02, 1e-4, 0.93, (0.0, 5.0)
LINEAR = linear_model([0.0, GAIN * (1.0 - POLE)], [1.0, -POLE], operating_input=2.5, operating_output=0.0)
PI = partial(lambda_tuning, closed_loop_time=0.3)
CURVE = StaticCurve(inputs=np.linspace(0.0, 5.0, 9), outputs=GAIN * (np.linspace(0.0, 5.0, 9) - 2.5))


@pytest.mark.parametrize(
    "controller",
    [
        PI(LINEAR, command_limits=LIMITS),
        lqg(LINEAR, command_limits=LIMITS, closed_loop_time=0.3),
        with_inverse(LINEAR, CURVE, PI, command_limits=LIMITS),
    ],
    ids=lambda controller: controller.name,
)
def test_the_predicted_error_on_a_sine_is_that_of_the_simulated_loop(controller):
    trial = Trial(controller=controller, linear=LINEAR, rng=np.random.default_rng(0))
    angle = 2 * np.pi * trial.frequency_Hz * H * np.arange(4000)
    state, output, errors = controller.start(), 0.0, []
    for wanted in trial.amplitude * np.sin(angle):
        errors.append(wanted - output)
        command, state = controller.command(wanted, output, state)
        output = POLE * output + GAIN * (1.0 - POLE) * (float(command) - 2.5)
    basis = np.stack([np.sin(angle), np.cos(angle)], axis=1)[2000:]
    fitted = np.linalg.lstsq(basis, np.array(errors[2000:]), rcond=None)[0]
    assert trial.sine_error() == pytest.approx(np.hypot(*fitted) / np.sqrt(2.0), rel=1e-6)

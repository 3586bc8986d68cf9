"""What the film bears, on a plate whose pull-in is known."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import controller_of

from deatwin.control import LinearController, Verdict
from deatwin.control.checking.subject import judge_film
from deatwin.control.design.pid import PidGains

H, PULL_IN = 0.02, np.sqrt(1 / 3) * (1 - 1 / 3)
GAINS = PidGains(proportional=0.0, integral=0.1)


def controller(highest: float) -> LinearController:
    return controller_of(
        GAINS.law(H),
        GAINS.windup(H),
        name="I",
        operating_input=0.2,
        operating_output=0.044,
        command_min=0.1,
        command_max=highest,
        closed_loop_time=0.2,
    )


def steps_to(command: float) -> np.ndarray:
    return np.repeat([0.2, command, 0.2], 60)


def test_a_plate_that_is_far_from_pull_in_passes(gap):
    found = judge_film("plant", [gap], steps_to(0.3), controller(0.36))
    assert found.verdict is Verdict.PASS
    assert found.value == 0.0


@pytest.mark.parametrize("highest", [1.02 * PULL_IN, 2.0 * PULL_IN])
def test_a_plate_that_would_pull_in_at_the_limits_is_marginal(gap, highest):
    found = judge_film("plant", [gap], steps_to(0.3), controller(highest))
    assert found.verdict is Verdict.MARGINAL
    assert "limits" in found.text


@pytest.mark.parametrize("used", [0.97 * PULL_IN, 1.5 * PULL_IN])
def test_a_plate_that_would_pull_in_at_what_was_commanded_with_headroom_fails(gap, used):
    """5 % of headroom begin at 0.952 of the pull-in."""
    found = judge_film("plant", [gap], steps_to(used), controller(0.36))
    assert found.verdict is Verdict.FAIL
    assert "5 % more voltage" in found.text
    assert judge_film("plant", [gap], steps_to(0.93 * PULL_IN), controller(0.36)).verdict is Verdict.PASS


def test_plants_are_counted(gap):
    """The pull-in voltage goes with the root of the stiffness."""
    softer = [gap.with_values({"stiffness": k}) for k in (1.0, 0.65, 0.5)]
    found = judge_film("plant", softer, steps_to(0.3), controller(0.32))
    assert found.verdict is Verdict.FAIL
    assert found.value == 2.0
    assert found.text.startswith(
        "in 2 of 3 simulated actuators (parameters within the calibration's intervals), the film "
    )
    found = judge_film("plant", [gap, gap], steps_to(0.3), controller(0.36))
    assert found.text.startswith("in none of 2 simulated actuators")
    assert ") does the film pull in, break down or lose tension, even if " in found.text
    found = judge_film("plant", [gap, gap, softer[1]], steps_to(0.25), controller(0.36))
    assert (found.verdict, found.value) == (Verdict.MARGINAL, 1.0)


def test_the_films_of_a_diaphragm_are_judged_by_their_field_and_tension_too(plant):
    rest = 2.4
    used = np.repeat([rest, 2.6, rest], 30)
    from_film = replace(controller(3.75), operating_input=rest, operating_output=1e-3, command_min=1.1)
    assert judge_film("plant", [plant], used, from_film).verdict is Verdict.PASS
    for limit in (5.0, 6.0, 12.0):
        beyond = replace(from_film, command_max=limit)
        assert judge_film("plant", [plant], used, beyond).verdict is Verdict.MARGINAL, limit

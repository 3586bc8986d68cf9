"""Laws that change with the command."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.control import ControlError, Law
from deatwin.control.design.pid import PidGains

H = 0.02


def pid_law(proportional: float, derivative: float, filter_time: float = 0.1) -> Law:
    gains = {"proportional": proportional, "integral": 2.0, "derivative": derivative, "filter_time": filter_time}
    return PidGains(**gains).law(H)


def test_a_sample_by_hand(made):
    # At 1.75 V, between (0.9, 3) and (0.5, 2): K_p = 0.7, K_i h = 0.05; e = 0.1.
    command, state = made.scheduled.command(1.2, 1.1, np.array([-0.2, 1.75]))
    assert float(command) == pytest.approx(2.0 - 0.2 + 0.75 * 0.1, rel=1e-14)
    # The smoothed command follows by h/T = 0.04.
    assert state == pytest.approx([-0.2 + 0.05 * 0.1, 1.75 + 0.04 * 0.125], rel=1e-14)


def test_beyond_its_ends_the_ends_hold(made):
    for point, gain in ((0.5, 0.96), (1.5, 0.96), (3.0, 0.22), (9.0, 0.22)):
        assert made.scheduled.local(point).feedback[0][0] == pytest.approx(gain, rel=1e-13)


def test_a_change_of_the_law_does_not_move_the_command_at_rest(made):
    laws = (pid_law(0.9, 0.3, 0.05), pid_law(0.5, 0.1), pid_law(0.2, 0.0001, 0.2))
    controller = replace(made.scheduled, laws=laws, windup=np.array([0.1, 0.0]))
    # At rest at a reading of 1.7 with an integral of 0.4 V, whatever law held before.
    for before in (1.5, 2.0, 2.7, 3.0):
        command, state = controller.command(1.7, 1.7, np.array([0.4, 0.7, before]))
        assert float(command) == pytest.approx(2.4, rel=1e-14)
        assert state[:2] == pytest.approx([0.4, 0.7], rel=1e-14)


def test_a_schedule_of_one_law_is_that_law(made):
    same = replace(made.scheduled, laws=(made.pi.law,) * 3, windup=made.pi.windup)
    state, alone = same.start(), made.pi.start()
    for error in 0.3 * np.random.default_rng(2).normal(size=100):
        command, state = same.command(1.0 + error, 1.0, state)
        expected, alone = made.pi.command(1.0 + error, 1.0, alone)
        assert float(command) == pytest.approx(float(expected), rel=1e-12)


def test_far_apart_gains_do_not_throw_it_from_limit_to_limit(made):
    # Held at the upper limit by a large error: the proportional part of 3 V/um at 1.5 V is nearly none at 3 V.
    laws = tuple(PidGains(proportional=p, integral=1.0).law(H) for p in (3.0, 0.5, 0.01))
    windup = np.array([PidGains(proportional=p, integral=1.0).windup(H) for p in (3.0, 0.5, 0.01)])
    controller = replace(made.scheduled, laws=laws, windup=windup)
    state, commands = np.array([-0.7, 1.5]), []
    for _ in range(500):
        command, state = controller.command(4.0, 1.0, state)
        commands.append(float(command))
    assert commands[0] == commands[-1] == 4.0
    assert np.sum(np.abs(np.diff(commands)) > 1.0) <= 2


def test_laws_of_unlike_structure_are_refused(made):
    with pytest.raises(ControlError, match=r"states 1 at 1.5, 2 at 2, 1 at 3"):
        replace(made.scheduled, laws=(made.pi.law, pid_law(0.5, 0.1), made.pi.law))


def test_laws_that_would_move_the_command_at_rest_are_refused(made):
    # The integral of one is in the unit of the error: a change of its gain would move the command.
    moved = Law.of_error([[1.0]], [H], [2.0], 0.5)
    with pytest.raises(ControlError, match=r"that at 3 differs from that at 1.5"):
        replace(made.scheduled, laws=(made.pi.law, made.pi.law, moved))

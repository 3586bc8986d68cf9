"""Overshoot, steady-state error, ripple and effort of runs that are written down by hand."""

import numpy as np
import pytest
from made_models import finished

from deatwin.control import ClosedLoop, ControlError, step_reference
from deatwin.plant import RunStatus

H = 0.02


def run_of(reference, output, command=None, status=RunStatus.DONE, limits=(-1.0, 1.0)):
    reference = np.asarray(reference, dtype=float)
    return finished(
        reference, output, status=status, command_limits=limits, **({} if command is None else {"command": command})
    )


@pytest.mark.parametrize("rise", [0, 1, 8])
def test_levels_begin_where_the_reference_leaves_and_where_it_has_come(rise):
    reference = step_reference(1.0, 0.5, 20, rise=rise)
    levels = run_of(reference, reference).levels
    assert [v.first for v in levels] == [20, 40, 60, 80]
    assert [v.settled for v in levels] == [20 + rise, 40 + rise, 60 + rise, 80 + rise]
    assert [v.stop for v in levels] == [40, 60, 80, 100]
    np.testing.assert_allclose([v.step for v in levels], [0.5, -0.5, -0.5, 0.5], rtol=1e-14)


@pytest.mark.parametrize("rise", [0, 8])
def test_overshoot_is_the_farthest_beyond_a_level_by_its_step(rise):
    reference = step_reference(1.0, 0.5, 20, rise=rise)
    output = reference.copy()
    output[50] = 0.9  # 0.1 beyond 1.0, coming down from 1.5
    assert run_of(reference, output).overshoot == pytest.approx(0.2, rel=1e-12)
    output[65] = 0.8  # 0.3 short of 0.5, coming down: no overshoot
    assert run_of(reference, output).overshoot == pytest.approx(0.2, rel=1e-12)


def test_overshoot_during_a_slow_rise_counts():
    reference = step_reference(0.0, 1.0, 40, rise=30)
    output = reference.copy()
    output[60] = 1.4  # while the reference is still on its way
    assert run_of(reference, output).overshoot == pytest.approx(0.4, rel=1e-12)


def test_steady_error_and_ripple_are_those_of_the_last_third_of_the_worst_level():
    reference = step_reference(0.0, 2.0, 30)
    output = reference.copy()
    output[30:60] += 5.0  # early on the second level it does not matter
    output[50:60] = reference[50:60] + 0.2 * np.tile([1.0, 0.0], 5)
    run = run_of(reference, output)
    assert run.steady_error == pytest.approx(0.1 / 2.0, rel=1e-12)
    assert run.ripple == pytest.approx(0.1 / 2.0, rel=1e-12)  # of 0 and 0.2 in turn: 0.1 beside the mean


def test_the_first_level_is_not_judged():
    reference = step_reference(0.0, 2.0, 30)
    output = reference.copy()
    output[:30] = 9.0
    run = run_of(reference, output)
    assert run.overshoot == run.steady_error == run.ripple == 0.0


def test_a_run_that_was_cut_off_is_judged_on_what_it_lived_through():
    reference = step_reference(1.0, 0.5, 20, rise=5)
    for count, lived in ((0, 0), (3, 0), (22, 0), (28, 0), (30, 1), (52, 2)):
        run = run_of(reference[:count], reference[:count], status=RunStatus.PULL_IN)
        assert len(run.levels) == lived, count
        assert run.overshoot == run.steady_error == run.ripple == run.effort == run.rms_error == 0.0


def test_a_reference_that_comes_back_to_its_level_has_no_step_to_be_judged_by():
    bump = np.concatenate([np.zeros(20), np.sin(np.linspace(0.3, 2.9, 20)), np.zeros(20)])
    run = run_of(bump, 0.9 * bump)
    assert run.overshoot == run.steady_error == run.ripple == 0.0


def test_a_sine_has_no_levels():
    sine = np.sin(0.1 * np.arange(300))
    assert run_of(sine, sine).levels == ()


def test_effort_and_saturation():
    command = np.array([0.0, 1.0, -1.0, -1.0, 0.5])
    run = run_of(np.zeros(5), np.zeros(5), command)
    assert run.effort == pytest.approx((1.0 + 2.0 + 0.0 + 1.5) / (4 * H), rel=1e-12)
    assert run.saturated_share == pytest.approx(3 / 5)


def test_a_command_within_rounding_of_a_limit_is_at_it():
    # The inverse of a static curve returns a limit only to rounding.
    command = np.array([0.9 + 1.1e-16, 4.9 - 8.9e-16, 0.91, 4.89])
    run = run_of(np.zeros(4), np.zeros(4), command, limits=(0.9, 4.9))
    assert run.saturated_share == 0.5


def test_plain_data_come_back():
    reference = step_reference(1.0, 0.5, 8, rise=2)
    run = run_of(reference, 0.9 * reference)
    again = ClosedLoop.from_dict(run.to_dict())
    assert again.to_dict() == run.to_dict()
    assert not again.output.flags.writeable


@pytest.mark.parametrize("late", [0.02, 0.01, np.nan])
def test_times_of_a_run_ascend(late):
    runs = dict.fromkeys(("reference", "output", "measured", "command"), np.zeros(4))
    with pytest.raises(ControlError, match=r"timepts\[2\] of a run is (0.02|0.01|nan) s: it must be later than 0.02 s"):
        ClosedLoop(
            status=RunStatus.DONE,
            timepts=[0.0, 0.02, late, 0.06],
            command_limits=(-1.0, 1.0),
            input_unit="V",
            output_unit="mm",
            **runs,
        )

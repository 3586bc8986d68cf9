"""What acts like an effect, on a rig that only passes the command on: all is known in closed form."""

from typing import Any

import numpy as np
import pytest
from made_fits import made_problem
from made_rigs import Wire

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.naming import siblings as module
from deatwin.ident.mismatch.naming.contribution import contribution
from deatwin.ident.mismatch.naming.screen import linearised_responses
from deatwin.ident.mismatch.naming.siblings import siblings
from deatwin.plant import Delay, Experiment, Plant, Recording, SensorCurvature, SensorDrift, SensorJump, SensorLag
from deatwin.plant.excitation import band_limited_noise

STEP, GAIN, LAG = 0.02, 1e-4, 0.03
MIRROR = Plant(rig=Wire(noise=1e-8))


COMMANDS = 2.0 + band_limited_noise(np.random.default_rng(3), 30.0, STEP)


def lagged(commands: np.ndarray, time: float) -> np.ndarray:
    """The exact lag of held commands, from rest at 0 V."""
    decay, y, found = np.exp(-STEP / time), 0.0, []
    for x in commands:
        y = x + (y - x) * decay
        found.append(y)
    return np.array(found)


def measured(readings: np.ndarray) -> Recording:
    return Recording.from_arrays(
        COMMANDS,
        readings,
        STEP,
        input_names=("command",),
        input_units=("V",),
        output_names=("displacement",),
        output_units=("m",),
    )


def explained(lag: float = LAG) -> tuple[Any, Any]:
    part = Part.whole(Experiment(recordings=(measured(GAIN * lagged(COMMANDS, lag)),)))
    fit = calibrate(MIRROR.with_effects(SensorLag(time=0.02)), [part], tolerance=1e-10, starts=1)
    return made_problem(fitted=(part,), nominal=MIRROR), fit


def off(change: np.ndarray) -> np.ndarray:
    """Off gain and zero."""
    basis = np.linalg.qr(np.column_stack([COMMANDS, np.ones_like(COMMANDS)]))[0]
    return change - basis @ (basis.T @ change)


def late(time: float) -> np.ndarray:
    """The commands after a dead time; one that is s samples long interpolates the readings linearly."""
    times = STEP * np.arange(COMMANDS.size)
    return np.interp(times - time, np.concatenate([[-1.0, -STEP], times]), np.concatenate([[0.0, 0.0], COMMANDS]))


def share_of(time: float, lag: float) -> float:
    """Share of what a lag does, that a delay could do to first order, both in closed form."""
    wanted, change = off(lagged(COMMANDS, lag) - COMMANDS), off(late(time) - COMMANDS)
    return float((change @ wanted) ** 2 / (change @ change) / (wanted @ wanted))


def test_a_delay_acts_as_a_lag_does_and_a_drift_does_not():
    problem, fit = explained()
    others = [SensorDrift(), SensorCurvature(), Delay()]
    (found,) = siblings(problem, fit, ("sensor_lag",), others, {})
    assert found.effect.name == "delay"
    share = share_of(found.estimate.time, LAG)
    assert share > 0.5
    assert found.share == pytest.approx(share, rel=0.02)  # the start from rest, one sample, is not quite the same


@pytest.mark.parametrize(("lag", "alike"), [(0.4, True), (0.6, False)])
def test_what_correlates_by_a_half_at_the_strength_that_the_typical_one_promises_is_alike(lag, alike):
    typical = Delay().time  # which does no more than the lag
    wanted, change = off(lagged(COMMANDS, lag) - COMMANDS), off(late(typical) - COMMANDS)
    strength = typical * (change @ wanted) / (change @ change)
    assert 0.15 < share_of(strength, lag) < 0.35
    assert (share_of(strength, lag) > 0.25) is alike
    problem, fit = explained(lag)
    found = siblings(problem, fit, ("sensor_lag",), [SensorDrift(), Delay()], {})
    assert [lead.effect.name for lead in found] == ["delay"] * alike


@pytest.mark.parametrize("curvature", [20.0, -20.0])
def test_a_sibling_begins_on_its_own_side(curvature):
    """Readings biased the other way are explained by a negative strength, and by no positive one."""
    biased = MIRROR.with_effects(SensorCurvature(curvature=curvature))
    blank = Recording.from_arrays(COMMANDS, np.zeros_like(COMMANDS), STEP)
    readings = biased.simulate(Experiment(recordings=(blank,))).require().outputs[0][0]
    part = Part.whole(Experiment(recordings=(measured(readings),)))
    plant = MIRROR.with_effects(SensorCurvature(curvature=0.1))
    fit = calibrate(plant, [part], tolerance=1e-10, starts=1)
    problem = made_problem(fitted=(part,), nominal=MIRROR)
    (found,) = siblings(problem, fit, ("sensor_curvature",), [SensorCurvature(curvature=1.0)], {})
    assert np.sign(found.estimate.curvature) == np.sign(curvature)


def test_what_an_effect_does_by_itself_is_the_difference_without_it():
    problem, fit = explained()
    does = contribution(problem, fit, ("sensor_lag",))
    np.testing.assert_allclose(does, GAIN * (lagged(COMMANDS, LAG) - COMMANDS), atol=1e-9)
    assert not contribution(problem, fit, ()).any()


def test_where_nothing_else_may_be_tried_there_are_no_siblings():
    problem, fit = explained()
    assert siblings(problem, fit, ("sensor_lag",), [], {}) == []


def test_responses_are_simulated_once_except_those_of_what_is_sought_in_the_residual(monkeypatch):
    problem, fit = explained()
    asked = []

    def responses(problem, bare, effects, done):
        asked.append([effect.name for effect in effects])
        return linearised_responses(problem, bare, effects, done)

    monkeypatch.setattr(module, "linearised_responses", responses)
    known = {}
    first = siblings(problem, fit, ("sensor_lag",), [Delay(), SensorJump()], known)
    again = siblings(problem, fit, ("sensor_lag",), [Delay(), SensorJump(), SensorCurvature()], known)
    assert asked == [["delay", "sensor_jump"], ["sensor_jump", "sensor_curvature"]]
    assert [lead.estimate for lead in again] == [lead.estimate for lead in first]
    assert set(known) == {"delay", "sensor_curvature"}

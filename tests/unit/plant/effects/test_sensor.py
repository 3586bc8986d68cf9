"""The sensor, on a bare chain and behind the film."""

import numpy as np
import pytest
from scipy.linalg import expm

from deatwin.plant.effects.sensor_curvature import SensorCurvature
from deatwin.plant.effects.sensor_drift import SensorDrift
from deatwin.plant.effects.sensor_jump import SensorJump
from deatwin.plant.effects.sensor_lag import SensorLag
from deatwin.plant.effects.sensor_saturation import SensorSaturation
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(4), 4.0, 0.02)
MOTION, SAMPLE = 1e-4 * NOISE, 0.02
ENDS = SAMPLE * np.arange(1, NOISE.size + 1)

pytestmark = pytest.mark.usefixtures("uncompiled")


def test_a_lag_is_exact_under_held_motion(chain):
    decay, y, exact = np.exp(-SAMPLE / 0.05), 0.0, []
    for x in MOTION:
        y = x + (y - x) * decay
        exact.append(y)
    np.testing.assert_allclose(chain(NOISE, SensorLag(time=0.05))["reading"], exact, rtol=1e-9)


@pytest.mark.parametrize("inertia", [0.25, 0.5, 1.0])
def test_a_lag_with_inertia_is_exact_under_held_motion(chain, inertia):
    """The transition matrix of the second-order equation is that of scipy's matrix exponential."""
    time = 0.05
    rates = np.array([[0.0, 1.0, 0.0], [-1 / inertia, -1 / inertia, 1 / inertia], [0.0, 0.0, 0.0]]) / time
    step, state, exact = expm(SAMPLE * rates), np.zeros(2), []
    for x in MOTION:
        state = step[:2, :2] @ state + step[:2, 2] * x
        exact.append(state[0])
    found = chain(NOISE, SensorLag(time=time, inertia=inertia))["reading"]
    np.testing.assert_allclose(found, exact, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("inertia", [0.0, 0.5])
def test_no_lag_passes_the_reading(chain, inertia):
    np.testing.assert_allclose(chain(NOISE, SensorLag(time=0.0, inertia=inertia))["reading"], MOTION, rtol=1e-13)


def test_a_sensor_that_clips_leaves_the_ball_alone(base, experiment):
    free = base.simulate(experiment(NOISE)).require()
    clipped = base.with_effects(SensorSaturation(limit=0.1e-3)).simulate(experiment(NOISE)).require()
    np.testing.assert_allclose(clipped.watched[0]["displacement"], free.outputs[0][0], atol=1e-12)
    assert clipped.outputs[0].max() < 0.1e-3 + 1e-9 < free.outputs[0].max()


def test_the_chain_of_a_sensor_is_bent_then_shifted_then_late_then_clipped(chain):
    effects = (
        SensorCurvature(curvature=80.0),
        SensorDrift(change=40e-6, time=30.0),
        SensorJump(change=30e-6, at=2.01),
        SensorLag(time=0.0),
        SensorSaturation(limit=0.3e-3),
    )
    step = (1 + np.tanh((ENDS - 2.01) / 0.005 / 2)) / 2
    shifted = MOTION + 80.0 * MOTION**2 + 40e-6 * (1 - np.exp(-ENDS / 30.0)) + 30e-6 * step
    exact = shifted - 1e-6 * np.logaddexp(0.0, (shifted - 0.3e-3) / 1e-6)
    for order in (effects, effects[::-1]):
        np.testing.assert_allclose(chain(NOISE, *order)["reading"], exact, rtol=1e-12)


def test_a_jump_starts_where_the_residual_steps():
    rng = np.random.default_rng(6)
    times = np.concatenate([0.02 * np.arange(1500), 40 + 0.02 * np.arange(1500)])  # two records, a gap between
    residual = 2e-6 * rng.standard_normal(3000) - 12e-6 * (times > 47.0)
    first, *others = SensorJump().starts(times, residual)
    assert first.at == pytest.approx(47.0, abs=0.02)
    assert first.change == pytest.approx(-12e-6, abs=4 * 2e-6 / np.sqrt(1000))
    assert len(others) <= 2
    assert all(abs(o.at - first.at) > 0.5 for o in others)

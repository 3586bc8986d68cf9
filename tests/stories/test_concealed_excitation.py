"""The recording behind a concealed electrode: its noise, and whether it reaches where the designs are judged."""

import numpy as np
import pytest

from deatwin.control.linear.plant import linearise_plant
from deatwin.ident.narx.excited import excitation as excited
from deatwin.plant import Diaphragm, Plant
from deatwin.plant.excitation import band_limited_noise
from deatwin.scenarios.control_check.concealed import (
    CLOSED_LOOP_TIME,
    EFFECTS,
    FAST,
    LIMITS,
    LOWER,
    MEAN,
    OPERATING,
    SECONDS,
    UPPER,
    VARIANCE,
    excitation,
)
from deatwin.scenarios.control_check.trials import recorded

H = 0.02
SLOWEST = 1.0 / (2 * np.pi * CLOSED_LOOP_TIME)


def test_half_of_the_power_lies_below_the_loop_s_bandwidth_and_half_is_spread_to_the_fast_end():
    """Clipping at 2.2 deviations leaves 0.953 of a Gaussian's variance, nearly all of it where it was."""
    commands = excitation(np.random.default_rng(0), H)
    assert commands.shape == (round(SECONDS / H),)
    assert commands.min() >= LOWER
    assert commands.max() <= UPPER
    power = np.abs(np.fft.rfft(commands - commands.mean())) ** 2
    frequency = np.fft.rfftfreq(commands.size, H)
    slow, fast = power[frequency <= SLOWEST].sum(), power[(frequency > SLOWEST) & (frequency <= FAST)].sum()
    # Of the fast half, SLOWEST / FAST = 2 % lie below the slow end.
    assert slow / power.sum() == pytest.approx(0.51, abs=0.03)
    assert fast / power.sum() == pytest.approx(0.49, abs=0.03)
    # A slow half of 2 * 120 s * 0.4 Hz = 96 degrees of freedom is clipped by more or less.
    assert commands.var() == pytest.approx(0.953 * VARIANCE, rel=0.1)
    assert commands.mean() == pytest.approx(MEAN, abs=0.1)


@pytest.mark.parametrize("seed", [0, 4, 21])
def test_the_film_moves_as_far_as_the_operating_points_of_a_check(seed):
    """Those lie 30 % of the room to the nearer limit to either side; noise of 5 Hz alone does not reach them."""
    plant = Plant(rig=Diaphragm()).with_effects(EFFECTS["electrode_rc"]())
    room = 0.3 * min(OPERATING - LIMITS[0], LIMITS[1] - OPERATING)
    ends = [linearise_plant(plant, OPERATING + side * room).operating_output for side in (-1.0, 1.0)]

    def reached(commands) -> bool:
        outputs = recorded(plant, commands, np.random.default_rng(seed)).outputs[0]
        noise = 4.0 * plant.rig.noise  # a reading of noise does not count as a place that was reached
        return bool(outputs.min() < ends[0] - noise and outputs.max() > ends[1] + noise)

    rng = np.random.default_rng(seed)
    assert reached(excitation(rng, H))
    assert not reached(band_limited_noise(rng, SECONDS, H, band=5.0))


def test_the_recording_excites_the_frequency_of_the_gain_margin():
    """Of lambda tuning on the nominal plant the loop's phase passes -180 degrees at the frequency of its margin."""
    from deatwin.control.design.lambda_tuning import lambda_tuning

    plant = Plant(rig=Diaphragm())
    seen = linearise_plant(plant, OPERATING).in_loop(plant.rig.reading)
    controller = lambda_tuning(seen, command_limits=LIMITS, closed_loop_time=CLOSED_LOOP_TIME)
    omega = 2 * np.pi * np.geomspace(0.05, 0.99 * 0.5 / H, 4000)
    loop = controller.local(OPERATING).feedback_response(omega, H) * seen.response(omega)
    phase = np.unwrap(np.angle(loop))
    crossover = omega[np.argmax(phase <= -np.pi)] / (2 * np.pi)
    assert 10.0 < crossover < FAST
    recording = recorded(plant, excitation(np.random.default_rng(0), H), np.random.default_rng(0))
    assert excited(recording).highest_Hz > crossover

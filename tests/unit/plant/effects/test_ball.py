"""Effects at the ball, on a mass between spring and damper for which there are closed forms."""

import numpy as np
import pytest
from made_rigs import Pushed
from runs import readings
from scipy.integrate import cumulative_trapezoid, solve_ivp, trapezoid
from scipy.optimize import brentq

from deatwin.plant import Hysteresis, Plant
from deatwin.plant.effects.coulomb_friction import CoulombFriction
from deatwin.plant.effects.cubic_stiffness import CubicStiffness
from deatwin.plant.effects.end_stop import EndStop
from deatwin.plant.effects.hysteresis import HysteresisSpectrum
from deatwin.plant.effects.quadratic_damping import QuadraticDamping
from deatwin.plant.effects.resonance import Resonance

MASS, STIFFNESS, SAMPLE = 3e-3, 30.0, 0.02  # the ball on its film: 16 Hz


pytestmark = pytest.mark.usefixtures("uncompiled")


def move(commands, *effects, damper=0.05, **more):
    """Readings under forces in newtons."""
    rig = Pushed(mass=MASS, damping=damper, stiffness=STIFFNESS, push=1.0, **more)
    return readings(Plant(rig=rig, effects=effects), commands)


def integrated(commands, force, damper=0.05):
    """The same mass with a further force on it, by an integrator of others."""
    state, ends = np.zeros(2), []
    for u in commands:
        state = solve_ivp(
            lambda _, s, u=u: [s[1], (u - STIFFNESS * s[0] - damper * s[1] + force(s[0], s[1])) / MASS],
            (0, SAMPLE),
            state,
            method="DOP853",
            rtol=1e-10,
            atol=1e-14,
        ).y[:, -1]
        ends.append(state[0])
    return np.array(ends)


def triangles(amplitude, period, count=3):
    quarter = round(period / SAMPLE / 4)
    up = np.linspace(0, amplitude, quarter, endpoint=False)
    return np.tile(np.concatenate([up, amplitude - up, -up, up - amplitude]), count)


def play(commands, force):
    """Quasi-static motion under Coulomb friction: the spring force lags the drive by at most the friction."""
    spring, path = 0.0, []
    for u in commands:
        spring = min(max(spring, u - force), u + force)
        path.append(spring / STIFFNESS)
    return np.array(path)


@pytest.mark.parametrize(("amplitude", "period"), [(3e-3, 4.0), (8e-3, 4.0), (3e-3, 16.0)])
def test_friction_is_the_play_of_a_slow_drive(amplitude, period):
    drive, friction = triangles(amplitude, period), 1e-3
    got = move(drive, CoulombFriction(force=friction, slip=50e-9), damper=0.5)
    # The drive climbs 4 A/T a second, so what moves lags by c/k * 4 A/(T k); a ball that breaks loose jolts as much.
    lag = 4 * amplitude / period * (0.5 / STIFFNESS + SAMPLE) / STIFFNESS
    np.testing.assert_allclose(got, play(drive, friction), rtol=0, atol=2 * lag)
    # At the drive's zero, going up and going down: a loop of 2 F_c/k, whatever the rate and the amplitude.
    quarter = round(period / SAMPLE / 4)
    width = got[-2 * quarter] - got[-4 * quarter]
    assert width == pytest.approx(2 * friction / STIFFNESS, abs=2 * lag)


def test_a_ball_that_sticks_stays():
    # Pushed by 5 mN and let go to 4.5 mN with 2 mN of friction: it stays where 5 mN brought it.
    drive = np.concatenate([np.linspace(0, 5e-3, 200), np.full(100, 5e-3), np.full(1000, 4.5e-3)])
    got = move(drive, CoulombFriction(force=2e-3, slip=50e-9), damper=0.5)
    assert abs(got[-1] - got[290]) < 50e-9 * 20  # creeping with at most 50 nm/s
    assert got[290] == pytest.approx(3e-3 / STIFFNESS, abs=1e-6)  # the ramp ended at 40 µm/s, with c/k = 17 ms
    # A friction that is a function of velocity alone would be back at 4.5 mN/k after 20 s.
    assert got[-1] < 0.7 * 4.5e-3 / STIFFNESS


def test_a_ball_that_slips_below_its_friction_is_held_as_by_a_damper():
    # F_c/v_s = 1 N s/m beside the damper of 0.5: 50 ms on the spring, where the mass has 1.5 ms on the two.
    drive, damper, friction, slip = np.full(40, 0.5e-3), 0.5, 1e-3, 1e-3
    got = move(drive, CoulombFriction(force=friction, slip=slip), damper=damper)
    times, late = SAMPLE * np.arange(1, drive.size + 1), MASS / (damper + friction / slip)
    slow = (damper + friction / slip) / STIFFNESS
    expected = drive / STIFFNESS * (1 - (slow * np.exp(-times / slow) - late * np.exp(-times / late)) / (slow - late))
    np.testing.assert_allclose(got, expected, rtol=0.01, atol=0.02 * drive[0] / STIFFNESS)


def test_small_drives_move_nothing_but_the_bristles_of_hysteresis():
    drive = triangles(0.5e-3, 4.0)
    stuck = move(drive, CoulombFriction(force=1e-3, slip=50e-9), damper=0.5)
    assert np.ptp(stuck) < 50e-9 * drive.size * SAMPLE
    held = move(drive, Hysteresis(force=1e-3, distance=30e-6), damper=0.5)
    # Elastically held by k + F_h/x_h = 63 N/m: 0.5 mN on them, either way, softer as the memory fills.
    assert 1e-3 / (STIFFNESS + 1e-3 / 30e-6) < np.ptp(held) < 1.5e-3 / (STIFFNESS + 1e-3 / 30e-6)


def memory_of(path, distance, beta):
    """Bouc and Wen's memory along a path, in steps that are solved exactly but where it changes sign."""
    memory, found = 0.0, []
    for step in np.diff(path, prepend=0.0):
        along = np.copysign(memory, memory * step)
        rate = 1.0 if along >= 0 else 2 * beta - 1  # of the motion's sign, and against it
        share = -np.expm1(-rate * abs(step) / distance) / rate if rate else abs(step) / distance
        memory = np.copysign(1.0, step) * (along + (1 - rate * along) * share)
        found.append(memory)
    return np.array(found)


@pytest.mark.parametrize(
    ("hysteresis", "distances"),
    [
        *((Hysteresis(force=1e-3, distance=50e-6, beta=beta), [50e-6]) for beta in (0.5, 1.0, 2.0)),
        (HysteresisSpectrum(force=1e-3, distance=50e-6, beta=1.0, decades=2.0), [5e-6, 50e-6, 500e-6]),
    ],
)
def test_slow_hysteresis_follows_its_own_law_and_no_other(hysteresis, distances):
    amplitude, period, damper = 15e-3, 48.0, 0.5
    drive = triangles(amplitude, period, count=2)  # from no memory, and round a whole loop
    got = move(drive, hysteresis, damper=damper)
    slowly = 3 * damper * 4 * amplitude / period / STIFFNESS
    held = drive - STIFFNESS * got

    def force(beta, distances):
        return hysteresis.force * np.mean([memory_of(got, distance, beta) for distance in distances], axis=0)

    np.testing.assert_allclose(held, force(hysteresis.beta, distances), rtol=0, atol=slowly)
    if len(distances) == 1:
        assert held.max() == pytest.approx(hysteresis.force, abs=slowly)
        other = force(hysteresis.beta + 1, distances)
    else:
        other = force(hysteresis.beta, [hysteresis.distance])
    assert np.abs(held - other).max() > 2 * slowly


def test_a_free_swing_under_friction_loses_as_much_at_each_turn():
    # 4 F_c/k a period, the textbook's straight envelope under Coulomb damping.
    friction, fine = 1e-4, 1e-3
    # From rest it swings by 0.2 mm, loses 7 µm at each turn and sticks after 30 turns of 31 ms.
    drive = np.concatenate([np.full(1500, 6e-3), np.zeros(400)])
    got = move(drive, CoulombFriction(force=friction, slip=50e-9), damper=0.0, sample_time=fine)[1500:]
    turns = np.flatnonzero((got[1:-1] - got[:-2]) * (got[2:] - got[1:-1]) < 0) + 1
    heights = np.abs(got[turns[:8]])
    np.testing.assert_allclose(-np.diff(heights), 2 * friction / STIFFNESS, rtol=0.05)


def test_drag_is_what_an_integrator_gives():
    rng = np.random.default_rng(1)
    drive = rng.uniform(-5e-3, 5e-3, 8).repeat(10)
    got = move(drive, QuadraticDamping(coefficient=2.0))
    exact = integrated(drive, lambda x, v: -2.0 * v * abs(v))
    # |v| v has a kink in its slope's slope where v changes its sign, in the middle of a step: 0.1 µm of 300 µm,
    # a twentieth of the sensor's noise.
    np.testing.assert_allclose(got, exact, rtol=0, atol=1e-7)


@pytest.mark.parametrize("force", [-4e-3, 2e-3, 12e-3])
@pytest.mark.parametrize("cubic", [-2e6, 2e7])
def test_a_cubic_spring_rests_at_the_root(force, cubic):
    got = move(np.full(300, force), CubicStiffness(stiffness=cubic), damper=0.5)[-1]
    root = brentq(lambda x: STIFFNESS * x + cubic * x**3 - force, -1.5e-3, 1.5e-3, xtol=1e-15)
    assert got == pytest.approx(root, rel=1e-9)


def test_a_stop_shares_the_load_with_the_spring():
    stop = EndStop(stiffness=300.0, position=0.25e-3)
    for force in (3e-3, 7.4e-3, 9e-3, 15e-3):
        got = move(np.full(300, force), stop, damper=0.5)[-1]

        def excess(x, force=force):
            return STIFFNESS * x + 300.0 * stop.width * np.logaddexp(0, (x - 0.25e-3) / stop.width) - force

        assert got == pytest.approx(brentq(excess, 0, 1e-3, xtol=1e-15), rel=1e-9)
    # Far from the touch the corner is sharp: the springs share what is beyond it.
    assert move(np.full(300, 3e-3), stop, damper=0.5)[-1] == pytest.approx(0.1e-3, rel=1e-9)
    beyond = (40e-3 - STIFFNESS * 0.25e-3) / (STIFFNESS + 300.0)
    assert move(np.full(300, 40e-3), stop, damper=0.5)[-1] == pytest.approx(0.25e-3 + beyond, rel=1e-6)


@pytest.mark.parametrize("loss", [0.0, 0.25, 0.5])
def test_a_stop_takes_the_energy_of_a_slow_impact(loss):
    # To first order the stop takes lambda k d v more at each depth on the way in and gives as much less on the way out;
    # spring and stop say how fast the ball is there. The second order is some lambda v = 2.5 % of that.
    swing, position, step, stop = -0.5e-3, 0.25e-3, 1e-4, 3e3
    period = round(2 * np.pi / np.sqrt(STIFFNESS / MASS) / step)
    # Half a cosine that lasts whole periods and a half leaves no swing of its own: 1 + cos(omega T) = 0.
    risen = round(4.5 * period)
    rise = np.sin(np.linspace(0, np.pi / 2, risen)) ** 2
    drive = np.concatenate([STIFFNESS * swing * rise, np.zeros(2 * period)])
    got = move(drive, EndStop(stiffness=stop, position=position, loss=loss), damper=0.0, sample_time=step)

    y = np.linspace(position - 50e-6, position + 50e-6, 4001)
    push = stop * EndStop.width * np.logaddexp(0, (y - position) / EndStop.width)
    energy = STIFFNESS * (swing**2 - y**2) / 2 - cumulative_trapezoid(push, y, initial=0)
    speed = np.sqrt(np.maximum(2 * energy / MASS, 0))
    back = got[risen + period // 2 :].min()
    lost = STIFFNESS * (swing**2 - back**2) / 2
    assert lost == pytest.approx(2 * loss * trapezoid(push * speed, y), rel=0.05, abs=2e-4 * STIFFNESS * swing**2)


def test_a_second_mass_gives_the_response_of_two():
    second = Resonance(mass=0.4e-3, frequency=8.0, damping_ratio=0.05)
    omega_2 = 2 * np.pi * second.frequency
    spring, damper = second.mass * omega_2**2, 2 * second.damping_ratio * second.mass * omega_2
    fine = 1e-3
    times = fine * np.arange(
        4000
    )  # after 3 s free swings have died to exp(-7), and their mean over the last one is less
    for frequency in (2.0, 6.0, 8.0, 12.0):
        s = 2j * np.pi * frequency
        coupling = damper * s + spring
        absorber = second.mass * s**2 * coupling / (second.mass * s**2 + coupling)
        exact = 1 / (MASS * s**2 + 0.2 * s + STIFFNESS + absorber)
        got = move(1e-3 * np.sin(2 * np.pi * frequency * times), second, damper=0.2, sample_time=fine)[-1000:]
        tone = np.exp(-2j * np.pi * frequency * (times[-1000:] + fine))
        # 2/N sum y e^(-iwt) = -i H A; holds of 1 ms smooth by sinc and come half a sample late.
        held = np.sinc(frequency * fine) * np.exp(-1j * np.pi * frequency * fine)
        response = 1j * 2 * np.mean(got * tone) / 1e-3
        assert abs(response / (exact * held) - 1) < 2e-3


def test_a_resonance_starts_where_the_residual_peaks():
    rng = np.random.default_rng(3)
    times = SAMPLE * np.arange(3000)
    drive = 1e-3 * rng.standard_normal(3000)
    residual = move(drive, Resonance(mass=0.3e-3, frequency=7.0)) - move(drive)
    starts = Resonance().starts(times, residual)
    assert 1 <= len(starts) <= 4
    assert min(abs(e.frequency - 7.0) for e in starts) < 0.3
    assert Resonance().starts(times[:10], residual[:10]) == ()

"""The plants of the stories with real recordings: closed forms, other integrators, and sections of the records."""

import numpy as np
import pytest
from public_recordings import recordings
from runs import readings
from scipy.integrate import solve_ivp

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.greybox.parts import Part
from deatwin.plant import Experiment, Plant
from deatwin.scenarios.real_physics import bouc_wen, cascaded_tanks, emps, silverbox
from deatwin.scenarios.real_physics.silverbox import derivatives, held


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_held_samples_act_like_the_band_limited_input(uncompiled):
    # A multisine on a linear oscillator has a closed form; three periods let the start die out (damping 43 1/s).
    rig, count = silverbox.LinearOscillator(), 256
    plant = Plant(rig=rig)
    p = {name: q.value for name, q in plant.parameters.items()}
    angles = np.exp(2j * np.pi * np.outer(np.arange(1, 60), np.arange(3 * count)) / count)
    phases = np.exp(2j * np.pi * np.random.default_rng(3).random(59))
    omega = 2 * np.pi * np.arange(1, 60) / (count * rig.sample_time)
    response = p["gain"] / (p["stiffness"] - omega**2 + 1j * p["damping"] * omega)
    exact = np.real((response * phases) @ angles)
    found = readings(plant, held(np.real(phases @ angles)))
    last = slice(-count, None)
    assert rms(found[last] - exact[last]) < 2e-3 * rms(exact[last])
    # Held as they are, the samples act half a sample late: at 70 Hz that alone is 0.36 rad.
    assert rms(readings(plant, np.real(phases @ angles))[last] - exact[last]) > 0.2 * rms(exact[last])


def test_derivatives_of_a_sine():
    step, omega = 1e-3, 2 * np.pi * 5
    timepts = step * np.arange(1000)
    values, first, second = derivatives(np.sin(omega * timepts), step, 20.0)
    assert values == pytest.approx(np.sin(omega * timepts), abs=1e-12)
    assert first == pytest.approx(omega * np.cos(omega * timepts), abs=1e-9 * omega)
    assert second == pytest.approx(-(omega**2) * np.sin(omega * timepts), abs=1e-9 * omega**2)


def test_bouc_wen_is_the_benchmark_s_own_spring(uncompiled):
    # The benchmark's equations and constants (Noël & Schoukens 2016), by an integrator of others.
    alpha, beta, gamma, delta = 5e4, 1e3, 0.8, -1.1
    rig = bouc_wen.LinearOscillator()
    commands = 120.0 * np.sin(2 * np.pi * 30 * np.arange(150) / bouc_wen.RATE)
    state, ends = np.zeros(3), [0.0]
    for force in commands[:-1]:

        def rates(_: float, s: np.ndarray, force: float = force) -> list[float]:
            y, v, z = s
            change = alpha * v - beta * (gamma * abs(v) * z + delta * v * abs(z))
            return [v, (force - 5e4 * y - 10.0 * v - z) / 2.0, change]

        state = solve_ivp(rates, (0, rig.sample_time), state, rtol=1e-9, atol=1e-13).y[:, -1]
        ends.append(state[0])
    effect = bouc_wen.BoucWen(force=alpha / (beta * gamma), distance=1 / (beta * gamma), hardening=-delta / gamma)
    own = {"mass": 2.0, "damping": 10.0, "stiffness": 5e4}
    found = readings(Plant(rig=rig, effects=(effect,), values=own), commands)
    # |v| and |z| are smoothed over 1e-6 of what they reach; the steps of both integrators are of higher order.
    assert rms(found - ends) < 1e-3 * rms(np.array(ends))


def test_without_hardening_it_is_the_catalogue_s(uncompiled):
    from deatwin.plant import Hysteresis

    rig = bouc_wen.LinearOscillator()
    commands = 60.0 * np.sin(0.25 * np.arange(200))
    own, usual = (kind(force=10.0, distance=4e-4) for kind in (bouc_wen.BoucWen, _unbounded(Hysteresis)))
    one, other = (readings(Plant(rig=rig, effects=(effect,)), commands) for effect in (own, usual))
    assert rms(one - other) < 1e-4 * rms(other)


def _unbounded(kind: type) -> type:
    from deatwin.plant import Parameter
    from deatwin.plant.parameters import Scale

    class Wide(kind):
        def describe(self) -> tuple[Parameter, ...]:
            return (
                Parameter(name="force", value=self.force, unit="N", lower=0.0, upper=1e3),
                Parameter(
                    name="distance", value=self.distance, unit="m", lower=1e-6, upper=1.0, scale=Scale.LOGARITHMIC
                ),
                Parameter(name="beta", value=self.beta, unit="1", lower=0.5, upper=2.0),
            )

    return Wide


def test_tanks_with_a_brim(uncompiled):
    # The documented balances with overflow, by an integrator of others, from levels that are not at rest.
    rig = cascaded_tanks.Tanks()
    effect = cascaded_tanks.Overflow(rate=0.4, brim=10.0, caught=0.6)
    plant = Plant(rig=rig, effects=(effect,), values={"upper_start": 6.0, "lower_start": 4.0})
    p = {name: q.value for name, q in plant.parameters.items()}
    commands = 4.0 + 3.0 * np.sin(0.05 * np.arange(150))

    def spill(level: float) -> float:
        return 0.4 * effect.width * np.logaddexp(0.0, (level - 10.0) / effect.width)

    state, ends = np.array([6.0, 4.0]), [4.0]
    for pump in commands[:-1]:

        def rates(_: float, s: np.ndarray, pump: float = pump) -> list[float]:
            between, out = p["upper_outlet"] * np.sqrt(s[0]), p["lower_outlet"] * np.sqrt(s[1])
            caught = p["area_ratio"] * (between + 0.6 * spill(s[0]))
            return [p["pump"] * (pump - p["threshold"]) - between - spill(s[0]), caught - out - spill(s[1])]

        state = solve_ivp(rates, (0, 4.0), state, rtol=1e-8, atol=1e-10, method="LSODA").y[:, -1]
        ends.append(state[1])
    assert max(ends) > 10.0
    # Steps of 4 s through the corner of the overflow: 1 mV is what the plant's scheme leaves there.
    assert np.abs(readings(plant, commands) - ends).max() < 5e-3


def test_the_controlled_carriage_lags_a_ramp(uncompiled):
    # Steady motion: motor (gain_v (gain_p e - v)) = viscosity v - offset + friction, so e has a closed form.
    rig = emps.ControlledCarriage()
    friction = next(e for e in rig.effects() if e.name == "coulomb_friction")
    values = {"viscosity": 200.0, "offset": -3.0, "coulomb_friction.force": 20.0, "coulomb_friction.slip": 1e-4}
    plant = Plant(rig=rig, effects=(friction,), values=values)
    speed = 0.1
    reference = speed * rig.sample_time * (np.arange(800) + 0.5)
    drive, gain = 35.15 * 243.45, 160.18
    lag = (drive * speed + 200.0 * speed + 3.0 + 20.0) / (drive * gain)
    found = speed * rig.sample_time * 799 - readings(plant, reference)[-1]
    assert found == pytest.approx(lag, rel=1e-4)


def test_a_pulse_acts_as_volts_at_the_motor(uncompiled):
    rig = emps.ControlledCarriage()
    pushed = readings(Plant(rig=rig), np.zeros(800), pulse_V=np.full(800, 5.0))
    assert pushed[-1] == pytest.approx(5.0 / (243.45 * 160.18), rel=1e-3)


CASES = {
    "silverbox": (silverbox, "silverbox", 4000, 0.2),
    "bouc_wen": (bouc_wen, "boucwen_benchmark_h5", 3000, 0.1),
    "emps": (emps, "emps", 4000, 0.5),
    "cascaded_tanks": (cascaded_tanks, "cascaded_tanks", 1024, 0.6),
}


@pytest.mark.parametrize("story", CASES)
def test_the_documented_physics_lowers_the_error_on_a_section(story):
    # By how much at least is far from what it does on the whole records (0.08, 0.04, 0.26, 0.5): sections are poorer.
    module, folder, samples, share = CASES[story]
    own = module.case(recordings(folder))
    record = own.fitted[0].recordings[0]
    part = [Part.whole(Experiment(recordings=(record.section(0, min(samples, record.n_samples)),)))]
    effect = next(e for e in own.plant.rig.effects() if e.name in own.documented[:1])
    base, amended = (calibrate(plant, part, starts=1) for plant in (own.plant, own.plant.with_effects(effect)))
    assert base.status.ok
    assert amended.rms < share * base.rms


def test_nothing_that_judges_is_fitted():
    own = cascaded_tanks.case(recordings("cascaded_tanks"))
    fitted, judged = own.fitted[0].recordings[0].outputs, own.held_out[0].measured
    assert not np.array_equal(fitted[0][: judged.size], judged)


def test_the_rest_of_a_record_begins_where_the_fit_ends():
    own = emps.case(recordings("emps"))
    assert own.held_out[1].first == own.fitted[0].recordings[0].n_samples
    assert own.held_out[1].measured.size + own.held_out[1].first == own.held_out[1].experiment.recordings[0].n_samples

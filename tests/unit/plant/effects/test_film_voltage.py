"""What happens between the amplifier and the Maxwell stress, on a bare chain."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from deatwin.plant.effects.charge_injection import ChargeInjection
from deatwin.plant.effects.dielectric_absorption import AbsorptionSpectrum, DielectricAbsorption
from deatwin.plant.effects.electrode_rc import ElectrodeRC
from deatwin.plant.effects.leakage import Leakage
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(4), 4.0, 0.02)
GAIN, SAMPLE = 800.0, 0.02
STEP = np.concatenate([np.zeros(20), np.full(200, 3.0), np.full(100, 1.0)])


def circuit(commands, resistance, cable):
    """Charge on film and cable behind a resistance, in coulombs, with the chain's own swelling film."""
    film, ends, state = 1e-9, [], np.zeros(2)

    def rates(_, state, command):
        charge, swelling = state
        voltage = charge / (film * (1 + swelling) + cable)
        return [(GAIN * command - voltage) / resistance, ((command / 3) ** 2 - swelling) / 0.1]

    for u in commands:
        state = solve_ivp(rates, (0, SAMPLE), state, args=(u,), method="LSODA", rtol=1e-10, atol=1e-16).y[:, -1]
        ends.append(state[0] / (film * (1 + state[1]) + cable))
    return np.array(ends)


@pytest.mark.parametrize("cable", [0.0, 0.4e-9, 3e-9])
def test_a_film_charges_as_the_circuit_says(chain, cable):
    resistance = 40e6
    effect = ElectrodeRC(time=resistance * (1e-9 + cable), film_share=1e-9 / (1e-9 + cable))
    for commands in (STEP, NOISE):
        exact = circuit(commands, resistance, cable)
        np.testing.assert_allclose(chain(commands, effect)["film_voltage"], exact, atol=1e-3)


def test_a_lag_that_does_not_see_the_film_is_linear(chain):
    voltage = chain(np.full(50, 2.0), ElectrodeRC(time=0.05, film_share=0.0))["film_voltage"]
    # five stages: the first coefficient of the error of exp(-0.4) is below 1e-11
    np.testing.assert_allclose(voltage, 1600 * (1 - np.exp(-0.02 * np.arange(1, 51) / 0.05)), rtol=1e-9)


def test_the_lag_grows_with_the_voltage(chain):
    # A lag of tau under commands held for h is V_k = (1 - e) u_k + e V_(k-1) with e = exp(-h/tau): a small slow tone
    # comes h e/(1 - e) late. At 3 V the film has twice the capacitance, and its swelling takes charge besides.
    times, tone = SAMPLE * np.arange(300), 2 * np.pi * 0.5
    lags = []
    for bias in (0.1, 3.0):
        got = chain(bias + 0.01 * np.sin(tone * times), ElectrodeRC(time=0.02, film_share=1.0))["film_voltage"][100:]
        lags.append(-np.angle(np.mean((got - got.mean()) * np.exp(-1j * tone * times[100:])) * 1j) / tone)
    still = [SAMPLE / np.expm1(SAMPLE / tau) for tau in (0.02, 0.04)]
    assert lags[0] == pytest.approx(still[0], rel=0.02)
    assert lags[1] > 0.98 * still[1]


def test_a_leak_takes_off_what_the_circuit_says(chain):
    effect = Leakage(resistance=2e9, field_scale=30e6)
    area_stretch, thickness = 3.5 * 4.0, 0.5e-3
    area = 4e-8 / thickness * area_stretch

    def drop(voltage):
        field = voltage / (thickness / area_stretch)
        return effect.resistance * 3.23e-14 * np.exp(abs(field) / effect.field_scale) * field * area

    commands = np.linspace(-3.75, 3.75, 31)
    exact = [np.sign(u) * brentq(lambda v, u=u: v + drop(v) - GAIN * abs(u), 0, 4e3, xtol=1e-9) for u in commands]
    got = chain(commands, effect)["film_voltage"]
    np.testing.assert_allclose(got, exact, atol=1e-6)
    share = GAIN * commands[16:] / got[16:] - 1  # R I/V grows e-fold with each step of the field
    fields = got[16:] * area_stretch / thickness
    np.testing.assert_allclose(np.diff(np.log(share)), np.diff(fields) / effect.field_scale, rtol=1e-6)


def test_a_leak_comes_after_the_charging(chain):
    # Slowly driven, both orders agree; at the first sample after a step the film has hardly charged, so little leaks.
    both = chain(STEP, ElectrodeRC(time=0.2), Leakage(resistance=5e9))["film_voltage"]
    charging = chain(STEP, ElectrodeRC(time=0.2))["film_voltage"]
    leaking = chain(STEP, Leakage(resistance=5e9))["film_voltage"]
    assert both[21] == pytest.approx(charging[21], rel=1e-2)
    assert both[219] == pytest.approx(leaking[219], rel=1e-2)


def first_order(commands, time, share=1.0):
    """Exact: a state that follows held commands."""
    state, ends = 0.0, []
    for u in commands:
        target = share * GAIN * u
        state = target + (state - target) * np.exp(-SAMPLE / time)
        ends.append(state)
    return np.array(ends)


REVERSAL = np.concatenate([np.full(300, 2.0), np.full(200, -2.0), np.zeros(100)])


def test_injected_charge_takes_off_the_field(chain):
    effect = ChargeInjection(share=0.08, time=2.0)
    field = chain(REVERSAL, effect)["field_voltage"]
    np.testing.assert_allclose(field, GAIN * REVERSAL - first_order(REVERSAL, 2.0, 0.08), rtol=1e-9, atol=1e-6)
    filled = 1 - np.exp(-300 * SAMPLE / 2.0)
    force = chain(REVERSAL, effect)["squared_voltage"] / 1600.0**2
    assert force[299] == pytest.approx((1 - 0.08 * filled) ** 2, rel=1e-9)  # falls after a step,
    assert force[300] == pytest.approx((1 + 0.08 * filled) ** 2, abs=0.01)  # rises at a reversal,
    left = first_order(REVERSAL, 2.0, 0.08)[500]
    assert force[500] == pytest.approx((left / 1600) ** 2, rel=1e-9)  # and is left at 0 V
    assert abs(left) > 0.04 * 1600


@pytest.mark.parametrize(
    ("effect", "times"),
    [
        (DielectricAbsorption(share=0.1, time=2.0), (2.0,)),
        (AbsorptionSpectrum(share=0.1, time=2.0, decades=2.0), (0.2, 2.0, 20.0)),
    ],
)
def test_slow_dipoles_give_their_share_in_time(chain, effect, times):
    voltage, adapted = GAIN * REVERSAL, np.mean([first_order(REVERSAL, time) for time in times], axis=0)
    force = chain(REVERSAL, effect)["squared_voltage"]
    np.testing.assert_allclose(force, 0.9 * voltage**2 + 0.1 * voltage * adapted, rtol=1e-9, atol=1e-6)
    left, rate = np.mean(np.exp(-300 * SAMPLE / np.array(times))), np.mean(1 / np.array(times))
    assert force[0] / 1600**2 == pytest.approx(0.9, abs=0.1 * SAMPLE * rate * 1.01)  # at once,
    assert force[299] / 1600**2 == pytest.approx(1.0 - 0.1 * left, rel=1e-9)  # in time,
    assert force[300] / 1600**2 == pytest.approx(1 - 0.1 * (2 - left), abs=0.2 * SAMPLE * rate)  # at a reversal,
    np.testing.assert_allclose(force[500:], 0.0, atol=1e-6)  # and nothing without a field


def test_dipoles_follow_the_field_that_charge_leaves(chain):
    both = (ChargeInjection(share=0.08, time=2.0), DielectricAbsorption(share=0.1, time=1.0))
    signals = chain(NOISE, *both)
    alone = chain(NOISE, both[0])
    np.testing.assert_allclose(signals["field_voltage"], alone["field_voltage"], rtol=1e-12)
    assert np.all(signals["squared_voltage"][5:] < alone["squared_voltage"][5:] * 1.05)

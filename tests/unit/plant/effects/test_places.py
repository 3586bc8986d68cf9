"""Effects at further places: the same law on another signal, against closed forms."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from oscillator import DAMPING, MASS, STIFFNESS, Oscillator
from runs import readings

from deatwin.plant import (
    Creep,
    Delay,
    Diaphragm,
    Effect,
    PeriodicDisturbance,
    Plant,
    Pressure,
    SensorDrift,
    SensorLag,
    Sizes,
    effect_named,
)
from deatwin.plant.effects.catalogue import machine_catalogue
from deatwin.plant.effects.places import everywhere
from deatwin.plant.errors import RigError

PLACED = [effect for effect in everywhere(machine_catalogue()) if effect.placed_at]
each = pytest.mark.parametrize("effect", PLACED, ids=lambda effect: effect.name)
pytestmark = pytest.mark.usefixtures("uncompiled")
RATE = 50.0
TIME = np.arange(500) / RATE


def read(*effects: Effect, command: float = 10.0) -> np.ndarray:
    """Displacement at the ends of the samples, which follow `TIME` by one."""
    return readings(Oscillator().with_effects(*effects), np.full(TIME.size, command))


def line(values: np.ndarray, frequency: float) -> complex:
    """Complex amplitude of a tone over the last 5 s, 50 time constants of the transient or 0.4 s each."""
    late = TIME >= 5.0
    angle = 2 * np.pi * frequency * (TIME[late] + 1 / RATE)
    columns = np.column_stack([np.cos(angle), -np.sin(angle), np.ones(angle.size)])
    real, imaginary, _ = np.linalg.lstsq(columns, values[late], rcond=None)[0]
    return complex(real, imaginary)


@pytest.mark.parametrize(("at", "per_unit"), [("command", 1e-3), ("force", 1.0)])
def test_a_tone_behind_the_plant_is_filtered_by_it(at, per_unit):
    f, omega = 6.0, 2 * np.pi * 6.0
    tone = replace(PeriodicDisturbance(frequency=f, phase=0.4).placed(at), amplitude=0.02)
    expected = per_unit * 0.02 * np.exp(0.4j) / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)
    assert abs(line(read(tone), f) / expected - 1) < 1e-3


@pytest.mark.parametrize(("time", "frequency"), [(0.03, 6.0), (0.1, 6.0), (0.1, 12.0), (0.137, 9.0)])
def test_a_late_reading_is_the_same_one_later(time, frequency):
    """To what the polynomial through five nodes of a sample leaves of a sine (`test_late_reading.py`)."""
    tone = replace(PeriodicDisturbance().placed("force"), amplitude=0.02, frequency=frequency)
    late = Delay(time=time).placed("reading")
    turned = line(read(tone, late), frequency) / line(read(tone), frequency)
    assert abs(turned * np.exp(2j * np.pi * frequency * time) - 1) < (2 * np.pi * frequency / RATE) ** 5 / 15120 + 1e-6


def test_many_samples_late():
    held = np.sin(2 * np.pi * 3.0 * np.arange(1000) / 1000.0)
    plant = Oscillator(sample_time=1e-3)
    sound, late = (readings(plant.with_effects(*e), held) for e in ((), (Delay(time=0.1).placed("reading"),)))
    np.testing.assert_allclose(late[100:], sound[:-100], atol=1e-9 * np.ptp(sound))
    np.testing.assert_allclose(late[:100], 0.0, atol=1e-9 * np.ptp(sound))


def test_gains_and_offsets_drift_by_their_shares():
    elapsed = 1 - np.exp(-(TIME + 1 / RATE) / 20.0)
    settled = TIME > 3.0
    gain = replace(SensorDrift(time=20.0).placed("reading_gain"), change=0.1)
    np.testing.assert_allclose((read(gain) / read())[settled], (1 + 0.1 * elapsed)[settled], rtol=1e-6)
    # The plant follows a drift of 20 s within its own 0.4 s.
    for at, change in (("command_gain", 0.1), ("command", 1.0)):
        drift = replace(SensorDrift(time=20.0).placed(at), change=change)
        np.testing.assert_allclose((read(drift) / read())[settled], (1 + 0.1 * elapsed)[settled], rtol=5e-3)


def test_a_lag_of_the_command_equals_one_of_the_reading_of_a_linear_plant():
    tone = replace(PeriodicDisturbance().placed("command"), amplitude=0.5, frequency=3.0)
    lag = SensorLag(time=0.03, inertia=0.3)
    one, other = (line(read(tone, at), 3.0) for at in (lag, lag.placed("command")))
    assert abs(one / other - 1) < 1e-3


@each
def test_a_placed_effect_keeps_its_cause_and_comes_back_from_pickles_and_model_files(effect):
    assert effect.name == f"{effect.cause}_at_{effect.placed_at}"
    assert effect_named(effect.name) == effect
    assert isinstance(effect, type(effect_named(effect.cause)))
    assert pickle.loads(pickle.dumps(effect)) == effect
    assert effect.wording.format(**{p.name: "x" for p in effect.describe()})
    circuit = Sizes(motion=0.1, force=2e4, period=0.015, command=0.1, motion_unit="V", force_unit="V/s2")
    sized = circuit.of(effect_named(effect.cause)).placed(effect.placed_at)
    assert sized.name == effect.name
    assert pickle.loads(pickle.dumps(sized)) == sized
    rig = Pressure() if effect.placed_at == "pressure" else Diaphragm()
    assert Plant.from_dict(rig.with_effects(effect).to_dict()).effects == (effect,)


def test_a_rig_has_the_places_whose_signals_it_has():
    tone = PeriodicDisturbance()
    assert Pressure().with_effects().accepts(tone.placed("pressure"))
    assert not Diaphragm().with_effects().accepts(tone.placed("pressure"))


def test_another_place_is_refused_with_those_that_there_are():
    with pytest.raises(RigError, match=r"periodic_disturbance has no place 'ball'.*command, force, pressure"):
        PeriodicDisturbance().placed("ball")
    with pytest.raises(RigError, match=r"creep has no place 'reading'.*no other"):
        Creep().placed("reading")

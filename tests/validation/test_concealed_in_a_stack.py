"""Effects concealed in a stack of films, a hundred times as stiff as a diaphragm, in recordings of another integrator.

The energy of a neo-Hookean film and the field in it give the forces; semi-implicit Euler steps of 10 µs give the motion.
The stack rings at about 160 Hz, above the sampling rate of 100 Hz. No equation of the plants is used.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import lfilter

from deatwin.ident.mismatch import diagnose
from deatwin.plant import Material, Parameter, Plant, Recording, Scale, Stack
from deatwin.plant.laws import VACUUM_PERMITTIVITY, neo_hookean

LAYERS, THICKNESS, AREA, LOAD, MASS, DAMPING = 80, 80e-6, 3e-4, 0.4, 40e-3, 30.0
LENGTH, HIGHEST, SAMPLE_TIME, SUBSTEPS, SAMPLES = LAYERS * THICKNESS, 3360.0, 0.01, 1000, 10_000
MODULUS, PERMITTIVITY = 300e3, 2.8
NOISE = 1.5e-3
"""Of the readings, relative to the stroke."""


def _commands(rng: np.random.Generator) -> np.ndarray:
    """Rest, random levels of a second, and noise below 1 Hz, as film voltages."""
    levels = np.concatenate([np.zeros(200), np.repeat(rng.uniform(0.1, 1.0, 22), 100), np.zeros(100)])
    noise = lfilter([0.06], [1.0, -0.94], rng.standard_normal(SAMPLES))
    commands = np.clip(0.5 + 0.5 * noise / np.abs(noise).max(), 0.0, 1.0)
    commands[: levels.size] = levels
    return HIGHEST * commands


def recorded(effect: str, seed: int) -> tuple[Plant, Recording, float]:
    """The plant that the experimenter has, a recording of a stack with an effect, and its size, SI."""
    rng = np.random.default_rng(seed)
    modulus, permittivity = MODULUS * rng.uniform(0.9, 1.1), PERMITTIVITY * rng.uniform(0.95, 1.05)
    volume = LAYERS * THICKNESS * AREA

    def held(x: float, volts: float) -> float:
        """Force along the contraction x, from the derivatives of the stored energy and of the capacitance."""
        short = 1.0 - x / LENGTH
        elastic = volume * modulus / LENGTH * (1.0 / short**2 - short)
        pull = LAYERS * permittivity * VACUUM_PERMITTIVITY * AREA / THICKNESS / (LENGTH * short**3)
        return pull * volts**2 - elastic - LOAD

    rest = brentq(held, -0.3 * LENGTH, 0.3 * LENGTH, args=(0.0,))
    stroke = brentq(held, rest, 0.4 * LENGTH, args=(HIGHEST,)) - rest
    spring = (held(rest - 1e-6, 0.0) - held(rest + 1e-6, 0.0)) / 2e-6
    size = {"amplifier_offset": 0.02 * HIGHEST}.get(effect, 0.06 * spring * stroke)
    distance, pitch = 0.04 * stroke, 2 * np.pi * rng.uniform(3.0, 20.0)
    commands, readings = _commands(rng), np.empty(SAMPLES)
    position, speed, memory, step = rest, 0.0, 0.0, SAMPLE_TIME / SUBSTEPS
    for k, command in enumerate(commands):
        volts = command + (size if effect == "amplifier_offset" else 0.0)
        for j in range(SUBSTEPS):
            force = held(position, volts) - DAMPING * speed
            if effect == "periodic_disturbance":
                force += size * np.sin(pitch * (k * SAMPLE_TIME + j * step))
            elif effect == "hysteresis":
                memory += step * (speed - abs(speed) * memory) / distance
                force -= size * memory
            speed += step * force / MASS
            if effect == "coulomb_friction":
                speed = np.sign(speed) * max(abs(speed) - step * size / MASS, 0.0)
            position += step * speed
        readings[k] = position - rest
    noise = NOISE * stroke
    modulus_stated = Parameter(
        name="shear_modulus", value=MODULUS, unit="Pa", lower=1e5, upper=1e6, scale=Scale.LOGARITHMIC
    )
    stated = Parameter(name="permittivity", value=PERMITTIVITY, unit="1", lower=1.5, upper=10.0)
    film = Material(name="mine", energy=neo_hookean, elastic=(modulus_stated,), permittivity=stated)
    shape = {"layers": LAYERS, "thickness": THICKNESS, "area": AREA, "load": LOAD, "mass": MASS}
    rig = Stack(material=film, gain=1.0, noise=noise, sample_time=SAMPLE_TIME, **shape)
    noisy = readings + noise * rng.standard_normal(SAMPLES)
    return Plant(rig=rig), Recording(inputs=commands[None], outputs=noisy[None], sample_time=SAMPLE_TIME), size


@pytest.mark.study
@pytest.mark.parametrize("effect", ["coulomb_friction", "hysteresis", "amplifier_offset", "periodic_disturbance"])
def test_it_is_found_in_a_stiff_rig(effect):
    plant, recording, _ = recorded(effect, 7)
    found = diagnose(plant, recording)
    assert [cause.effect for cause in found.causes] == [effect], found.sentence


@pytest.mark.study
def test_nothing_is_found_where_nothing_is_concealed():
    plant, recording, _ = recorded("", 8)
    found = diagnose(plant, recording)
    assert not found.causes, found.sentence


@pytest.mark.study
@pytest.mark.parametrize(
    ("effect", "parameter", "seed"),
    [("amplifier_offset", "offset", 9), ("coulomb_friction", "force", 7), ("hysteresis", "force", 7)],
)
def test_its_size_is_in_its_interval(effect, parameter, seed):
    """Of a friction, only the ratio to the modulus shows; the interval allows for the modulus that the rig states."""
    plant, recording, size = recorded(effect, seed)
    found = diagnose(plant, recording).causes[0].parameters[parameter]
    assert found.low <= size <= found.high

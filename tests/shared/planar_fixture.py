"""A free planar film by equations of its own and another integrator, with a concealed fault and four readings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from deatwin.plant import (
    AmplifierSaturation,
    Builder,
    Effect,
    Experiment,
    Family,
    Leakage,
    Parameter,
    PermittivityDrift,
    Place,
    Recording,
    Scale,
)

STEP, GAIN = 0.02, 800.0
LENGTH, THICKNESS, PRESTRETCH = 50e-3, 0.5e-3, 3.0
MODULUS, LIMIT, BRANCH, RELAXES, PERMITTIVITY = 25e3, 107.0, 26.06e3, 0.6074, 4.5
MASS, DAMPING = 5e-3, 1.0
VACUUM = 8.8541878128e-12
VOLUME = LENGTH**2 * THICKNESS
SERIES_RESISTANCE = 1e5
"""Ohm; the fixtures that leak conduct over it."""
CORNER = 150.0
"""Rounding of the saturation, V: an output stage that runs out of current, which looks like a leak."""
NOISE = {"displacement": 2e-5, "current": 2e-7, "capacitance": 2e-11, "film_voltage": 2.0}
FAULTS = ("none", "permittivity_drift", "gain_drift", "leakage", "amplifier_saturation")

Law = Callable[[float, float], float]


def _pull(stretch: float) -> float:
    """Derivative of the Gent energy by the stretch of both sides, Pa."""
    return 2 * MODULUS * LIMIT * (stretch - stretch**-5) / (LIMIT + 3 - 2 * stretch**2 - stretch**-4)


def capacitance(stretch: np.ndarray, time: np.ndarray, permittivity: Law) -> np.ndarray:
    """Permittivity times area over thickness, F."""
    return VACUUM * permittivity(time, 0.0) * stretch**4 * LENGTH**2 / THICKNESS


def _laws(fault: str, size: float) -> tuple[Law, Law, Law]:
    """Permittivity by time, film voltage by time and command, conduction by the field, A/m²."""

    def drift(time: float) -> float:
        return 1 + size * (1 - np.exp(-np.maximum(time, 0.0) / 30.0))

    drifts, gains = fault == "permittivity_drift", fault == "gain_drift"
    conductivity = 3.23e-14 * size / SERIES_RESISTANCE if fault == "leakage" else 0.0

    def yielding(voltage: float) -> float:
        excess = CORNER * np.logaddexp(0.0, (voltage - size) / CORNER)
        return voltage - excess if fault == "amplifier_saturation" else voltage

    return (
        lambda time, _: PERMITTIVITY * (drift(time) if drifts else 1.0),
        lambda time, command: yielding(GAIN * command * (drift(time) if gains else 1.0)),
        lambda field, _: conductivity * np.exp(field / 40e6) * field,
    )


def _film_voltage(given: float, stretch: float, conduction: Law) -> float:
    """What the drop of the leakage current over the series resistance leaves, V."""

    def left(voltage: float) -> float:
        current = conduction(voltage * stretch**2 / THICKNESS, 0.0) * (stretch * LENGTH) ** 2
        return voltage + SERIES_RESISTANCE * current - given

    return brentq(left, 0.0, given, xtol=1e-6) if left(given) > 0.0 and given > 0.0 else given


def recorded(
    fault: str, size: float, commands: np.ndarray, rng: np.random.Generator, noise: Mapping[str, float] = NOISE
) -> Experiment:
    """Displacement, current, capacitance and film voltage under held commands, from rest, with white noise."""
    permittivity, drive, conduction = _laws(fault, size)
    load = _pull(PRESTRETCH) / 2 * LENGTH * THICKNESS

    def voltage(time: float, stretch: float) -> float:
        command = float(commands[min(int(time / STEP), commands.size - 1)])
        return _film_voltage(drive(time, command), stretch, conduction)

    def rates(time: float, state: np.ndarray) -> list[float]:
        position, velocity, viscous = state
        stretch = position / LENGTH
        elastic = stretch / viscous
        stress = _pull(stretch) + BRANCH * 2 * (elastic - elastic**-5) / viscous
        maxwell = 2 * VACUUM * permittivity(time, 0.0) * stretch**3 * (voltage(time, stretch) / THICKNESS) ** 2
        force = 2 * load - VOLUME * (stress - maxwell) / LENGTH - DAMPING * velocity
        return [velocity, force / MASS, viscous * (elastic**2 - elastic**-4) / (6 * RELAXES)]

    state, stretches, volts = np.array([PRESTRETCH * LENGTH, 0.0, PRESTRETCH]), [PRESTRETCH], [0.0]
    for number in range(commands.size):  # the command is smooth within a sample only
        span = (number * STEP, (number + 1) * STEP * (1 - 1e-12))
        state = solve_ivp(rates, span, state, method="LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
        stretches.append(state[0] / LENGTH)
        volts.append(voltage(span[1], stretches[-1]))
    stretch, volt, ends = np.array(stretches), np.array(volts), STEP * np.arange(commands.size + 1)
    held = capacitance(stretch, ends, permittivity)
    area = (stretch * LENGTH) ** 2
    leak = np.array([conduction(field, 0.0) for field in volt * stretch**2 / THICKNESS]) * area
    exact = {
        "displacement": LENGTH * (stretch[1:] - PRESTRETCH),
        "current": np.diff(held * volt) / STEP + leak[1:],
        "capacitance": held[1:],
        "film_voltage": volt[1:],
    }
    noisy = {name: row + noise[name] * rng.standard_normal(row.size) for name, row in exact.items()}
    displacement = noisy.pop("displacement")
    return Experiment(recordings=(Recording.from_arrays(commands, displacement, STEP, extras=noisy),))


def excitation(seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Commands below 1 Hz between 0.8 and 2.5 V."""
    count = round(seconds / STEP)
    times = STEP * np.arange(count)
    tones = np.linspace(0.05, 0.8, 12)
    waves = np.sin(2 * np.pi * tones[:, None] * times + rng.uniform(0, 2 * np.pi, (12, 1))).sum(axis=0)
    return 1.65 + 0.85 * waves / np.abs(waves).max()


@dataclass(frozen=True, kw_only=True)
class GainDrift(Effect):
    """The amplifier's gain relaxes to another one."""

    relative_change: float = -0.03
    time: float = 60.0

    name: ClassVar[str] = "gain_drift"
    family: ClassVar[Family] = Family.ELECTRICAL
    place: ClassVar[Place] = Place.DRIVE
    signal: ClassVar[str] = "amplifier_voltage"
    strength: ClassVar[str] = "relative_change"
    wording: ClassVar[str] = "The amplifier's gain drifts by {relative_change} with a time constant of {time}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="relative_change", value=self.relative_change, unit="1", lower=-0.6, upper=1.0),
            Parameter(name="time", value=self.time, unit="s", lower=5.0, upper=2e4, scale=Scale.LOGARITHMIC),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        grown = 1 - ca.exp(-ca.fmax(build.time, 0) / self.own("time", build))
        return signal * (1 + self.own("relative_change", build) * grown)


DRIFTS = (PermittivityDrift(relative_change=-0.05, time=60.0), GainDrift())
COMPRESSIONS = (Leakage(resistance=1e9), AmplifierSaturation(limit=1.8e3, rounding=100.0))

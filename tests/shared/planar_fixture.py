"""A free planar film by equations of its own and another integrator, with a concealed fault and four readings."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from deatwin.plant import (
    AmplifierSaturation,
    Builder,
    Creep,
    DielectricAbsorption,
    Effect,
    ElectrodeLoss,
    Experiment,
    Family,
    Leakage,
    Parameter,
    PermittivityDrift,
    Place,
    Recording,
    Scale,
)
from deatwin.plant.effects.onset import LATEST, steps_of
from deatwin.plant.effects.smooth import smooth_step

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
INSTANT = 0.4
"""Share of the recording after which electrode or sensor step."""
SLOW = 20.0
"""Time constant of the film's creep and of the slow polarisation, s."""
NOISE = {"displacement": 2e-5, "current": 2e-7, "capacitance": 2e-11, "film_voltage": 2.0}
Law = Callable[[float, float], float]


def _pull(stretch: float) -> float:
    """Derivative of the Gent energy by the stretch of both sides, Pa."""
    return 2 * MODULUS * LIMIT * (stretch - stretch**-5) / (LIMIT + 3 - 2 * stretch**2 - stretch**-4)


@dataclass(frozen=True, kw_only=True)
class _Laws:
    """The equations that a fault changes; without a fault, those of the sound film."""

    permittivity: Law = lambda time, _: PERMITTIVITY
    drive: Law = lambda time, command: GAIN * command  # Film voltage by time and command
    conduction: Law = lambda field, _: 0.0  # A/m²
    contact: Law = lambda time, _: 1.0  # Share of the electrode that is connected
    reading: Law = lambda time, displacement: displacement
    creeping: float = 0.0  # Modulus of the branch that creeps, Pa
    lagging: float = 0.0  # Share of the polarisation that lags


def _laws(fault: str, size: float, instant: float) -> _Laws:
    """Return the equations of a fault, which acts from `instant` on if it is a step."""

    def drift(time: float) -> float:
        return 1 + size * (1 - np.exp(-np.maximum(time, 0.0) / 30.0))

    def step(time: float) -> float:
        return 1 + size * (time > instant)

    def yielding(voltage: float) -> float:
        return voltage - CORNER * np.logaddexp(0.0, (voltage - size) / CORNER)

    conductivity = 3.23e-14 * size / SERIES_RESISTANCE
    return {
        "none": _Laws(),
        "permittivity_drift": _Laws(permittivity=lambda time, _: PERMITTIVITY * drift(time)),
        "gain_drift": _Laws(drive=lambda time, command: GAIN * command * drift(time)),
        "leakage": _Laws(conduction=lambda field, _: conductivity * np.exp(field / 40e6) * field),
        "amplifier_saturation": _Laws(drive=lambda time, command: yielding(GAIN * command)),
        "electrode_loss": _Laws(contact=lambda time, _: step(time)),
        "gain_step": _Laws(reading=lambda time, displacement: displacement * step(time)),
        "creep": _Laws(creeping=size),
        "dielectric_absorption": _Laws(lagging=size),
    }[fault]


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
    laws = _laws(fault, size, STEP * (round(INSTANT * commands.size) + 0.01))
    load = _pull(PRESTRETCH) / 2 * LENGTH * THICKNESS

    def voltage(time: float, stretch: float) -> float:
        command = float(commands[min(int(time / STEP), commands.size - 1)])
        return _film_voltage(laws.drive(time, command), stretch, laws.conduction)

    def displaced(time: float, field: float, polarisation: float) -> float:
        """Charge of the film per area, C/m²: the dipoles of the share that lags add their own."""
        return (1 - laws.lagging) * VACUUM * laws.permittivity(time, 0.0) * field + polarisation

    def rates(time: float, state: np.ndarray) -> list[float]:
        position, velocity, viscous, crept, polarisation = state
        stretch = position / LENGTH
        elastic, further = stretch / viscous, np.log(stretch / crept)
        field = voltage(time, stretch) * stretch**2 / THICKNESS
        stress = (
            _pull(stretch) + BRANCH * 2 * (elastic - elastic**-5) / viscous + 12 * laws.creeping * further / stretch
        )
        maxwell = 2 * laws.contact(time, 0.0) * field * displaced(time, field, polarisation) / stretch
        force = 2 * load - VOLUME * (stress - maxwell) / LENGTH - DAMPING * velocity
        adapts = laws.lagging * VACUUM * laws.permittivity(time, 0.0) * field - polarisation
        flows = viscous * (elastic**2 - elastic**-4) / (6 * RELAXES)
        return [velocity, force / MASS, flows, crept * further / SLOW, adapts / SLOW]

    states = [np.array([PRESTRETCH * LENGTH, 0.0, PRESTRETCH, PRESTRETCH, 0.0])]
    volts = [0.0]
    for number in range(commands.size):  # the command is smooth within a sample only
        span = (number * STEP, (number + 1) * STEP * (1 - 1e-12))
        states.append(solve_ivp(rates, span, states[-1], method="LSODA", rtol=1e-8, atol=1e-10).y[:, -1])
        volts.append(voltage(span[1], states[-1][0] / LENGTH))
    stretch, polarisation = np.array(states)[:, 0] / LENGTH, np.array(states)[:, 4]
    volt, ends, area = np.array(volts), STEP * np.arange(commands.size + 1), (stretch * LENGTH) ** 2
    field = volt * stretch**2 / THICKNESS
    leak = np.array([laws.conduction(one, 0.0) for one in field]) * area
    exact = {
        "displacement": laws.reading(ends, LENGTH * (stretch - PRESTRETCH)),
        "current": laws.contact(ends, 0.0) * np.diff(displaced(ends, field, polarisation) * area, prepend=0.0) / STEP
        + leak,
        "capacitance": laws.contact(ends, 0.0) * displaced(ends, 1.0, 0.0) * stretch**2 / THICKNESS * area,
        "film_voltage": volt,
    }
    noisy = {name: row[1:] + noise[name] * rng.standard_normal(row.size - 1) for name, row in exact.items()}
    displacement = noisy.pop("displacement")
    return Experiment(recordings=(Recording.from_arrays(commands, displacement, STEP, extras=noisy),))


def excitation(seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Commands below 1 Hz between 0.8 and 2.5 V."""
    count = round(seconds / STEP)
    times = STEP * np.arange(count)
    tones = np.linspace(0.05, 0.8, 12)
    waves = np.sin(2 * np.pi * tones[:, None] * times + rng.uniform(0, 2 * np.pi, (12, 1))).sum(axis=0)
    return 1.65 + 0.85 * waves / np.abs(waves).max()


def holds(seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Commands between 0.8 and 2.5 V, each held for 5 s: slow tails are seen best after steps."""
    count, each = round(seconds / STEP), round(5.0 / STEP)
    return np.repeat(rng.uniform(0.8, 2.5, -(-count // each)), each)[:count]


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


@dataclass(frozen=True, kw_only=True)
class GainStep(Effect):
    """The sensor's gain steps at some time; `SensorJump` is a step of its zero."""

    relative_change: float = -0.03
    at: float = 10.0

    name: ClassVar[str] = "gain_step"
    family: ClassVar[Family] = Family.SENSOR
    place: ClassVar[Place] = Place.SENSOR
    signal: ClassVar[str] = "reading"
    strength: ClassVar[str] = "relative_change"
    event: ClassVar[str] = "at"
    wording: ClassVar[str] = "At {at} the sensor's gain steps by {relative_change}"

    def describe(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="relative_change", value=self.relative_change, unit="1", lower=-0.6, upper=1.0),
            Parameter(name="at", value=self.at, unit="s", lower=0.0, upper=LATEST),
        )

    def rewrite(self, signal: Any, build: Builder) -> Any:
        width = build.constant("gain_step_width", build.signal("sample_time") / 4)
        stepped = smooth_step((build.time - self.own("at", build)) / width)
        return signal * (1 + self.own("relative_change", build) * stepped)

    def starts(self, timepts: np.ndarray, residual: np.ndarray) -> tuple[Effect, ...]:
        return tuple(replace(self, at=time) for time, _ in steps_of(timepts, residual))


DRIFTS = (PermittivityDrift(relative_change=-0.05, time=60.0), GainDrift())
COMPRESSIONS = (Leakage(resistance=1e9), AmplifierSaturation(limit=1.8e3, rounding=100.0))
STEPS = (ElectrodeLoss(share=0.03, at=10.0), GainStep())
TAILS = (Creep(modulus=1e3, time=20.0), DielectricAbsorption(share=0.03, time=20.0))
PAIRS: tuple[tuple[Effect, Effect], ...] = (DRIFTS, COMPRESSIONS, STEPS, TAILS)

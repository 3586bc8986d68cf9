"""Effects concealed in discs, cones, inflated films and machines, in recordings of other equations and another integrator.

The film is a membrane of straight pieces, whose statics are tabulated over position and squared voltage; SciPy integrates
the motion. No equation of the plants is used. What is concealed, how strongly, and in which specimen is drawn by a seed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from machines import MACHINES, Hidden, drawn_log, machine_record
from made_rigs import Pushed
from scipy.integrate import solve_ivp
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq
from scipy.signal import butter, sosfiltfilt

from deatwin.ident.mismatch import Diagnosis, Verdict, diagnose
from deatwin.plant import Cone, Coupon, Disc, Experiment, Plant, Pressure, Recording, effect_named
from deatwin.plant.laws import VACUUM_PERMITTIVITY

PIECES, HEIGHTS, SQUARES = 60, 28, 9
MODULUS, RELATIVE, GRAVITY, GAIN = 330e3, 2.8, 9.80665, 1000.0
Rng = np.random.Generator


@dataclass(frozen=True, kw_only=True)
class Specimen:
    """A film as it is built, SI; the load is a mass on a cone and a pressure behind a film."""

    kind: str
    thickness: float
    prestretch: float
    frame: float
    inner: float
    load: float
    highest: float  # Position up to which it is tabulated, as a share of the size


SPECIMENS = {
    "disc": Specimen(kind="disc", thickness=100e-6, prestretch=1.25, frame=25e-3, inner=10e-3, load=0.0, highest=0.25),
    "cone": Specimen(kind="cone", thickness=50e-6, prestretch=1.2, frame=20e-3, inner=8e-3, load=20e-3, highest=0.75),
    "pressure": Specimen(
        kind="pressure", thickness=50e-6, prestretch=1.2, frame=20e-3, inner=0.0, load=500.0, highest=0.6
    ),
}


@lru_cache(maxsize=3)
def _statics(one: Specimen) -> tuple[RectBivariateSpline, float, float]:
    """Force (for an inflated film: pressure) that holds a position at a squared voltage in kV² for a modulus of one
    `MODULUS`; the position without voltage under the load, and the highest voltage to drive, V.
    """
    around = one.kind == "disc"
    rho = np.sqrt(np.linspace((one.inner / one.prestretch) ** 2, (one.frame / one.prestretch) ** 2, PIECES + 1))
    radius, height, square, pressure = (
        ca.SX.sym("r", PIECES + 1),
        ca.SX.sym("z", PIECES + 1),
        ca.SX.sym("v"),
        ca.SX.sym("p"),
    )
    middle, width = (rho[1:] + rho[:-1]) / 2, np.diff(rho)
    wide, tall = radius[1:] - radius[:-1], height[1:] - height[:-1]
    first, second = ca.sqrt(wide**2 + tall**2) / width, (radius[1:] + radius[:-1]) / 2 / middle
    volume = 2 * np.pi * middle * width * one.thickness
    maxwell = RELATIVE * VACUUM_PERMITTIVITY / 2 * square * 1e6 / one.thickness**2

    def stored(l1: Any, l2: Any) -> Any:
        return MODULUS / 2 * (l1**2 + l2**2 + (l1 * l2) ** -2 - 3)

    field_on = 0.0 if around else maxwell * (first * second) ** 2
    energy = ca.dot(volume, stored(first, second) - field_on)
    if around:  # the electrode is stretched evenly
        stretch = radius[0] / rho[0]
        energy += np.pi * rho[0] ** 2 * one.thickness * (stored(stretch, stretch) - maxwell * stretch**4)
    swept = np.pi / 3 * (radius[1:] ** 2 + radius[1:] * radius[:-1] + radius[:-1] ** 2)
    energy += pressure * ca.dot(swept, tall)
    fixed = ca.vertcat(radius[-1], height[-1], *(height[:-1].elements() if around else [radius[0]]))
    values = ca.DM([one.frame, 0.0, *([0.0] * PIECES if around else [one.inner])])
    energy = ca.substitute(energy, fixed, values)
    driven = radius[0] if around else height[0]
    free = radius[1:-1] if around else ca.vertcat(radius[1:-1], height[1:-1])
    inflated = one.kind == "pressure"
    unknown = ca.vertcat(pressure, free) if inflated else free
    equations = ca.vertcat(*([ca.gradient(energy, driven)] if inflated else []), ca.gradient(energy, free))
    equations, force = (
        f if inflated else ca.substitute(f, pressure, 0.0) for f in (equations, ca.gradient(energy, driven))
    )
    residual = ca.Function("f", [unknown, driven, square], [equations, ca.jacobian(equations, unknown), force])
    size = one.inner if around else one.frame - one.inner
    start = one.inner if around else 0.02 * size
    positions = np.linspace(start - 0.02 * size * around, start + one.highest * size, HEIGHTS)
    place = (one.prestretch * rho[1:-1] - one.inner) / (one.frame - one.inner)
    squares = np.linspace(0.0, (one.thickness / one.prestretch**2 * 70.0) ** 2 * 1e6, SQUARES)  # to 70 kV/mm
    table = np.full((HEIGHTS, SQUARES), np.nan)
    for column, level in enumerate(squares):
        lifted = [] if around else positions[0] * (1 - place)
        guess = np.concatenate([[100.0] * inflated, one.prestretch * rho[1:-1], lifted])
        for row, position in enumerate(positions):
            for _ in range(50):
                value, slope, held = residual(guess, position, level)
                step = np.linalg.solve(np.asarray(slope), np.asarray(value)).ravel()
                moved = np.max(np.abs(step[1:]))
                guess = guess - step * min(1.0, 5e-4 / max(moved, 1e-12))
                if moved < 1e-10:
                    break
            table[row, column] = guess[0] if inflated else float(held)
    spline = RectBivariateSpline(positions, squares, table, kx=3, ky=3)
    load = {"disc": 0.0, "cone": one.load * GRAVITY, "pressure": one.load}[one.kind]
    rest = brentq(lambda s: spline(s, 0.0)[0, 0] - load, positions[0], positions[-1])
    fine = np.linspace(rest, positions[-1], 400)
    bears = [level for level in np.linspace(0.0, squares[-1], 80) if (spline(fine, level)[:, 0] > load).any()]
    return spline, float(rest), 0.85e3 * float(np.sqrt(bears[-1]))


FILM_EFFECTS: Mapping[str, Callable[[Rng], dict[str, float]]] = {
    "creep": lambda rng: {"share": drawn_log(rng, 0.08, 0.25), "time": drawn_log(rng, 4.0, 15.0)},
    "electrode_rc": lambda rng: {"time": drawn_log(rng, 0.02, 0.1)},
    "permittivity_drift": lambda rng: {"change": -drawn_log(rng, 0.05, 0.2), "time": drawn_log(rng, 20.0, 60.0)},
    "sensor_drift": lambda rng: {"change": drawn_log(rng, 0.03, 0.1), "time": drawn_log(rng, 20.0, 60.0)},
    "sensor_jump": lambda rng: {"change": drawn_log(rng, 0.02, 0.1), "at": rng.uniform(0.2, 0.8)},
    "amplifier_saturation": lambda rng: {"limit": rng.uniform(0.7, 0.9)},
    "periodic_disturbance": lambda rng: {"size": drawn_log(rng, 0.01, 0.05), "frequency": drawn_log(rng, 0.5, 12.0)},
    "coulomb_friction": lambda rng: {"share": drawn_log(rng, 0.01, 0.04)},
    "end_stop": lambda rng: {"stiffness": drawn_log(rng, 2.0, 10.0), "at": rng.uniform(0.5, 0.75)},
    "delay": lambda rng: {"time": rng.uniform(0.012, 0.045)},
}
POOLS = {
    "disc": ("creep", "electrode_rc", "permittivity_drift", "sensor_drift", "sensor_jump", "amplifier_saturation",
             "periodic_disturbance"),
    "cone": ("creep", "coulomb_friction", "end_stop", "delay", "electrode_rc", "sensor_jump", "permittivity_drift"),
    "pressure": ("creep", "delay", "electrode_rc", "permittivity_drift", "amplifier_saturation", "sensor_drift",
                 "periodic_disturbance"),
}  # fmt: off
RATES = {"disc": (0.02, 1500), "cone": (0.01, 2400), "pressure": (0.02, 1500)}


def _commands(rng: Rng, number: int, sample_time: float, highest: float) -> np.ndarray:
    """Noise to 4 Hz for the first two thirds, then levels that are held for a second or so, V."""
    first = 2 * number // 3
    spectrum = rng.normal(size=first // 2 + 1) + 1j * rng.normal(size=first // 2 + 1)
    tones = np.fft.rfftfreq(first, sample_time)
    spectrum[(tones > 4.0) | (tones == 0.0)] = 0.0
    noise = np.fft.irfft(spectrum, first)
    noise = np.clip(0.6 + 0.25 * noise / noise.std(), 0.05, 1.0)
    hold = round(1.2 / sample_time)
    levels = np.repeat(rng.uniform(0.1, 1.0, -(-(number - first) // hold)), hold)[: number - first]
    return highest / GAIN * np.concatenate([noise, levels])


def film_record(kind: str, hidden: Hidden, rng: Rng) -> tuple[Plant, Recording]:
    """A recording of a film with something concealed, and the plant that its experimenter has."""
    one, (width, number) = SPECIMENS[kind], RATES[kind]
    spline, rest, highest = _statics(one)
    commands = _commands(rng, number, width, highest)
    stiff = rng.uniform(0.9, 1.1)  # against the modulus of the table; the squared voltage counts relative to it
    top = highest**2 / 1e6
    load = {"disc": 0.0, "cone": one.load * GRAVITY, "pressure": one.load}[kind]
    unit = np.pi * one.frame**2 / 3 if kind == "pressure" else 1.0  # from pressure to force on the apex
    if kind == "cone":  # the weight bears on a film of another modulus
        rest = brentq(lambda s: stiff * spline(s, 0.0)[0, 0] - load, *spline.get_knots()[0][[0, -1]])
    elif kind == "pressure":
        stiff = 1.0
    stroke = brentq(lambda s: stiff * spline(s, top)[0, 0] - load, rest, spline.get_knots()[0][-1]) - rest
    spring = unit * (stiff * spline(rest + 0.05 * stroke, 0.0)[0, 0] - load) / (0.05 * stroke)
    mass = one.load if kind == "cone" else 0.0
    damping = 0.12 * 2 * np.sqrt(spring * mass) if mass else 3e-3 * spring
    creep, creep_time = hidden.get("creep", "share") * spring, hidden.get("creep", "time") or 1.0
    friction = hidden.get("coulomb_friction", "share") * spring * stroke
    stop, stop_at = hidden.get("end_stop", "stiffness") * spring, hidden.get("end_stop", "at") * stroke
    lag, late = hidden.get("electrode_rc", "time"), hidden.get("delay", "time")
    limit = hidden.get("amplifier_saturation", "limit") * highest if hidden.name == "amplifier_saturation" else np.inf
    fades, fade_time = hidden.get("permittivity_drift", "change"), hidden.get("permittivity_drift", "time") or 1.0

    def rates(t: float, x: np.ndarray, volts: float) -> list[float]:
        position, speed, slow, charged = x
        film = charged if lag else volts
        square = film**2 / 1e6 * (1 + fades * (1 - np.exp(-t / fade_time)))
        force = unit * (load - stiff * spline.ev(position, square)) - creep * (position - slow)
        force -= stop * max(position - rest - stop_at, 0.0)
        into = [(position - slow) / creep_time, (volts - film) / lag if lag else 0.0]
        if not mass:
            return [force / damping, 0.0, *into]
        rubbing = friction * np.tanh(speed / 1e-4)
        return [speed, (force - damping * speed - rubbing) / mass, *into]

    state, readings, whole = np.array([rest, 0.0, rest, 0.0]), [], int(late / width)
    split = width * (late / width - whole)
    for row in range(number):
        pieces = ((0.0, split, row - whole - 1), (split, width, row - whole)) if split else ((0.0, width, row),)
        for begin, end, acting in pieces:
            volts = min(GAIN * commands[acting] if acting >= 0 else 0.0, limit)
            run = solve_ivp(
                rates, (row * width + begin, row * width + end), state, "LSODA", args=(volts,), rtol=1e-7, atol=1e-10
            )
            state = run.y[:, -1]
        readings.append(state[0] - rest)
    clock = width * (1 + np.arange(number))
    read = np.array(readings)
    if hidden.name == "sensor_drift":
        read += hidden.values["change"] * stroke * (1 - np.exp(-clock / hidden.values["time"]))
    if hidden.name == "sensor_jump":
        read += hidden.values["change"] * stroke * (clock > hidden.values["at"] * number * width)
    if hidden.name == "periodic_disturbance":
        read += hidden.values["size"] * stroke * np.sin(2 * np.pi * hidden.values["frequency"] * clock + 1.0)
    noise = 2e-3 * stroke
    read += noise * rng.standard_normal(number)
    shape: dict[str, Any] = {"thickness": one.thickness, "prestretch": one.prestretch, "frame_radius": one.frame}
    shape |= {"gain": GAIN, "sample_time": width, "noise": noise, "material": "Elastosil 2030"}
    rigs = {
        "disc": lambda: Disc(electrode_radius=one.inner, **shape),
        "cone": lambda: Cone(disc_radius=one.inner, mass=one.load, **shape),
        "pressure": lambda: Pressure(pressure=one.load, **shape),
    }
    return Plant(rig=rigs[kind]()), Recording.from_arrays(commands, read, width)


@dataclass(frozen=True, kw_only=True)
class Case:
    """A rig, and the effect that is concealed in it; none if the name is empty."""

    kind: str
    effect: str
    seed: tuple[int, ...]

    def diagnosed(self, jobs: int = 1) -> tuple[Hidden, Diagnosis]:
        hidden, plant, recording = self.made()
        return hidden, diagnose(plant, Experiment(recordings=(recording,)), jobs=jobs)

    def made(self) -> tuple[Hidden, Plant, Recording]:
        rng = np.random.default_rng(self.seed)
        drawn = (MACHINES[self.kind].effects if self.kind in MACHINES else FILM_EFFECTS).get(self.effect)
        hidden = Hidden(name=self.effect, values=drawn(rng)) if drawn else Hidden()
        return hidden, *(machine_record if self.kind in MACHINES else film_record)(self.kind, hidden, rng)


def cases(seed: int) -> tuple[list[Case], list[Case]]:
    """Draw twenty cases with an effect, five of a disc, a cone, an inflated film and machines, and eight without."""
    rng = np.random.default_rng(seed)
    machines = [(kind, effect) for kind, machine in MACHINES.items() for effect in machine.effects]
    drawn = [(kind, str(effect)) for kind, pool in POOLS.items() for effect in rng.permutation(pool)[:5]]
    drawn += [machines[k] for k in rng.permutation(len(machines))[:5]]
    clean = [kind for kind in POOLS for _ in range(2)] + [str(k) for k in rng.permutation(list(MACHINES))[:2]]
    return (
        [Case(kind=kind, effect=effect, seed=(seed, k)) for k, (kind, effect) in enumerate(drawn)],
        [Case(kind=kind, effect="", seed=(seed, 100 + k)) for k, kind in enumerate(clean)],
    )


SEED = 20261127


@pytest.mark.study
@pytest.mark.parametrize("number", range(20))
def test_nothing_is_named_wrongly(number):
    case = cases(SEED)[0][number]
    _, found = case.diagnosed()
    named = [cause.effect for cause in found.causes] if found.verdict.value in ("named", "partly") else [case.effect]
    assert named == [case.effect], found.sentence


@pytest.mark.study
@pytest.mark.parametrize("number", range(8))
def test_nothing_is_named_where_nothing_is_concealed(number):
    _, found = cases(SEED)[1][number].diagnosed()
    assert not found.causes, found.sentence


def test_a_strip_that_creeps_in_proportion_to_the_logarithm_of_time_lacks_creep_alone():
    """Thirteen branches over four decades, each solved by SciPy; with one relaxation time, a drift would be named too."""
    rng, step, strip, (modulus, limit) = np.random.default_rng(5), 0.1, Coupon(), (25e3, 107.0)
    clock = step * np.arange(1, 1501)
    turns = [0, 1, 40, 41, 70, 71, 100, 101, 130, 131, 150], [1, 1.8, 1.8, 1.2, 1.2, 2.2, 2.2, 1.5, 1.5, 1.1, 1.1]
    held = np.interp(clock, *turns)
    slow = sosfiltfilt(butter(2, 0.8, fs=1 / step, output="sos"), rng.normal(size=clock.size))
    stretch = np.clip(held + 0.075 * slow / slow.std(), 1.0, 3.0)
    extension = stretch**2 + 2 / stretch - 3
    stress = modulus * (stretch - stretch**-2) * limit / (limit - extension)
    for time in np.geomspace(0.1, 1000.0, 13):

        def flow(
            at: float, log_xi: Any, time: float = time
        ) -> Any:  # tau d(ln xi)/dt = (le² - 1/le)/3, le = stretch/xi
            elastic = np.interp(at, np.r_[0.0, clock], np.r_[1.0, stretch]) / np.exp(log_xi)
            return (elastic**2 - 1 / elastic) / 3 / time

        log_xi = solve_ivp(flow, (0.0, clock[-1]), [0.0], method="Radau", t_eval=clock, max_step=1.0, rtol=1e-7).y[0]
        elastic = stretch / np.exp(log_xi)
        stress += 60e3 / 13 * (elastic**2 - 1 / elastic) / stretch
    force = strip.width * strip.thickness * stress
    noise = 0.01 * force.std()
    record = Recording.from_arrays(stretch, force + noise * rng.normal(size=force.size), step)
    found = diagnose(Plant(rig=Coupon(sample_time=step, noise=noise)), Experiment(recordings=(record,)), jobs=1)
    assert (found.verdict, [cause.effect for cause in found.causes]) == (Verdict.NAMED, ["creep"])
    assert found.causes[0].parameters["decades"].low > 1.0


def test_a_mass_held_by_elements_that_yield_one_after_another_has_hysteresis_of_the_right_force():
    """Twelve elements of Prandtl and Ishlinskii; with a single distance, the force would be told as 0.7 mN."""
    rng, step, within, (mass, damping, stiffness, push), force = (
        np.random.default_rng(1),
        0.02,
        200,
        (3e-3, 0.3, 30.0, 6e-3),
        0.8e-3,
    )
    slow = sosfiltfilt(butter(2, 1.0, fs=1 / step, output="sos"), rng.normal(size=2000))
    commands = np.concatenate([slow / slow.std(), np.repeat(rng.uniform(-2, 2, 20), 50)])
    distances = np.geomspace(5e-6, 300e-6, 12)
    position, speed, stretched, readings = 0.0, 0.0, np.zeros(12), []
    for command in commands:
        for _ in range(within):
            pull = push * command - damping * speed - stiffness * position - force * stretched.mean()
            speed += step / within * pull / mass
            position += step / within * speed
            stretched = np.clip(stretched + step / within * speed / distances, -1, 1)
        readings.append(position)
    noise = 0.5e-6
    record = Recording.from_arrays(commands, readings + noise * rng.normal(size=commands.size), step)
    rig = Pushed(mass=mass, damping=0.25, stiffness=27.0, push=push, noise=noise, sample_time=step)
    known = [effect_named(name) for name in ("coulomb_friction", "hysteresis")]
    found = diagnose(Plant(rig=rig), Experiment(recordings=(record,)), effects=known, jobs=1)
    assert found.verdict in (Verdict.NAMED, Verdict.PARTLY)
    assert [cause.effect for cause in found.causes] == ["hysteresis"]
    told = found.causes[0].parameters
    assert told["force"].value == pytest.approx(force, rel=0.1)  # laws of one mechanism differ by 5 %
    # Twelve elements fill a box of 12/11 of the decades between the outer ones, three a box of 3/2 of theirs.
    assert told["decades"].value == pytest.approx(np.log10(60) * 12 / 11 * 2 / 3, rel=0.2)
    assert told["distance"].value == pytest.approx(np.sqrt(5e-6 * 300e-6), rel=0.25)

r"""Cone and inflated film against the equations of a membrane of revolution, solved here by shooting.

With P_i = dW/dlambda_i less the Maxwell part, r' = lambda_1 cos(a), z' = -lambda_1 sin(a) and Q = rho P1 cos(a):

    H Q' = H P2 - p r lambda_1 sin(a),    rho P1 sin(a) = S = F/(2 pi H) in a cone and p r^2/(2 H) under pressure.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from deatwin.plant import Cone, Parameter, Plant, Pressure, actuation_curve
from deatwin.plant.actuation import CurveEnd
from deatwin.plant.laws import VACUUM_PERMITTIVITY, gent
from deatwin.plant.material import Material

THICKNESS, RELATIVE, DENSITY, MODULUS, LIMIT = 50e-6, 2.8, 1080.0, 0.35e6, 60.0
PERMITTIVITY = RELATIVE * VACUUM_PERMITTIVITY
PRESTRETCH, FRAME, DISC = 1.25, 20e-3, 8e-3
FILM = {
    "material": Material(
        name="Gent",
        energy=gent,
        elastic=(
            Parameter(name="shear_modulus", value=MODULUS, unit="Pa", lower=1e3, upper=1e7),
            Parameter(name="stretch_limit", value=LIMIT, unit="1", lower=1.0, upper=1e6),
        ),
        permittivity=Parameter(name="permittivity", value=RELATIVE, unit="1", lower=1.0, upper=10.0),
        density=DENSITY,
    ),
    "thickness": THICKNESS,
    "prestretch": PRESTRETCH,
    "frame_radius": FRAME,
    "gain": 1.0,
}


def nominal(first, second, square):
    """Nominal stress along the first direction under a squared nominal field, Pa."""
    extension = first**2 + second**2 + (first * second) ** -2 - 3
    return (
        MODULUS / (1 - extension / LIMIT) * (first - first**-3 * second**-2) - PERMITTIVITY * square * first * second**2
    )


def along(stress, second, square):
    """Stretch that has a nominal stress, by Newton's method from the stiff side."""
    first, slight = 1.2, 1e-7
    for _ in range(60):
        here = nominal(first, second, square)
        step = (here - stress) * slight / (nominal(first + slight, second, square) - here)
        first -= np.clip(step, -0.2, 0.2)
        if abs(step) < 1e-12:
            break
    return first


def integrated(begin, start, square, pressure, force):
    """Radius at the ring and height of the film's inner end above it, from the radius and Q at a reference radius."""

    def slopes(rho, state):
        radius, _, pull = state
        rise = pressure * radius**2 / (2 * THICKNESS) if force is None else force / (2 * np.pi * THICKNESS)
        whole, second = np.hypot(pull, rise), radius / rho
        first = along(whole / rho, second, square)
        across = nominal(second, first, square)
        load = pressure / THICKNESS * radius * first * rise / whole
        return [first * pull / whole, -first * rise / whole, across - load]

    found = solve_ivp(slopes, (begin, FRAME / PRESTRETCH), [start[0], 0.0, start[1]], rtol=1e-6, atol=1e-9)
    return found.y[0, -1], -found.y[1, -1]


def cone_height(force, voltage):
    """Height of the disc that a force holds."""
    begin, square = DISC / PRESTRETCH, (voltage / THICKNESS) ** 2
    flat = begin * nominal(PRESTRETCH, PRESTRETCH, 0.0)

    def missed(pull):
        return integrated(begin, (DISC, pull), square, 0.0, force)[0] - FRAME

    pull = brentq(missed, 0.05 * flat, 3.0 * flat, xtol=1e-9 * flat)
    return integrated(begin, (DISC, pull), square, 0.0, force)[1]


def apex(stretch, pressure):
    """Voltage and height at which the apex has a stretch."""
    begin = 1e-4 * FRAME

    def ends(square):
        pull = begin * nominal(stretch, stretch, square)
        return integrated(begin, (stretch * begin, pull), square, pressure, None)

    most = 0.98 * nominal(stretch, stretch, 0.0) / (PERMITTIVITY * stretch**3)
    square = brentq(lambda s: ends(s)[0] - FRAME, 0.0, most, xtol=1e-9 * most)
    return THICKNESS * np.sqrt(square), ends(square)[1]


def apex_radius(stretch, pressure):
    """Radius of the ring that a film without voltage needs to have a stretch at its apex."""
    begin = 1e-4 * FRAME
    return integrated(begin, (stretch * begin, begin * nominal(stretch, stretch, 0.0)), 0.0, pressure, None)[0]


BIASES = {
    "mass": {"mass": 20e-3},
    "spring": {"mass": 1e-3, "spring_rate": 60.0, "spring_preload": 0.4},
    "bistable": {"mass": 2e-3, "spring_preload": 0.3, "snap_force": 0.2, "snap_middle": 3e-3, "snap_reach": 2e-3},
}


def bias(height, mass=0.0, spring_rate=0.0, spring_preload=0.0, snap_force=0.0, snap_middle=3e-3, snap_reach=2e-3):
    away = (height - snap_middle) / snap_reach
    snap = snap_force * 3 * np.sqrt(3) / 2 * (away - away**3)
    return mass * 9.80665 + spring_preload - spring_rate * height + snap


@pytest.mark.parametrize("name", BIASES)
def test_a_cone_is_where_the_membrane_bears_its_bias(name):
    plant = Plant(rig=Cone(disc_radius=DISC, **FILM, **BIASES[name]))
    curve = actuation_curve(plant, np.linspace(0.0, 6e3, 61))
    assert curve.end is CurveEnd.PULL_IN
    top = curve.slack_command or curve.commands[-1]
    for share in (0.0, 0.7):
        k = int(np.argmin(np.abs(curve.commands - share * top)))
        height, voltage = curve.unknowns["position"][k], curve.commands[k]
        print("  ", name, voltage, height, cone_height(bias(height, **BIASES[name]), voltage) / height)


def test_pull_in_of_a_cone_is_the_highest_voltage_that_the_membrane_bears():
    plant = Plant(rig=Cone(disc_radius=DISC, **FILM, **BIASES["bistable"]))
    curve = actuation_curve(plant, np.linspace(0.0, 4e3, 41))
    last, found = curve.unknowns["position"][-1], curve.commands[-1]
    assert curve.end is CurveEnd.PULL_IN and curve.slack_command is None
    heights, voltages = last * np.array([0.9, 1.0, 1.1]), []
    for height in heights:
        force = bias(height, **BIASES["bistable"])
        voltages.append(brentq(lambda v: cone_height(force, v) - height, 0.7 * found, 1.05 * found, xtol=1e-2))
    a, b, c = np.polyfit(heights, voltages, 2)
    print(found, c - b**2 / (4 * a), voltages, -b / 2 / a / last)


def test_inflated():
    for pressure in (600.0,):
        plant = Plant(rig=Pressure(pressure=pressure, damping=1e-6, **FILM))
        curve = actuation_curve(plant, np.linspace(0.0, 6e3, 61))
        print(pressure, curve.commands[-1], curve.unknowns["position"][[0, -1]], curve.slack_command)
        least = brentq(lambda s: apex_radius(s, pressure) - FRAME, 1.0001 * PRESTRETCH, 1.3 * PRESTRETCH)
        stretches = least * np.array([1.02, 1.06, 1.1, 1.15, 1.2])
        pairs = [apex(stretch, pressure) for stretch in stretches]
        volts = np.array([v for v, _ in pairs])
        heights = np.array([h for _, h in pairs])
        top = volts.argmax()
        print(volts.max(), heights[top], stretches[top] / least)
        c2 = actuation_curve(plant, volts[:top])
        print(c2.unknowns["position"] / heights[:top])

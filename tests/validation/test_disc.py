"""The disc against the equations of a flat membrane, solved here by shooting, and its first mode by finite differences.

A membrane in its plane obeys d(rho P1)/d(rho) = P2 with P_i = dW/dlambda_i, lambda_1 = dr/drho, lambda_2 = r/rho; under
the electrode both stretches are one number. Nothing of the plant is used here but the plant.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh_tridiagonal, solve_banded
from scipy.special import jn_zeros

from deatwin.plant import Disc, Parameter, Plant, actuation_curve
from deatwin.plant.actuation import CurveEnd
from deatwin.plant.laws import VACUUM_PERMITTIVITY, gent
from deatwin.plant.material import Material
from deatwin.plant.simulate import Simulator

THICKNESS, RELATIVE, DENSITY = 100e-6, 2.8, 1080.0
PERMITTIVITY = RELATIVE * VACUUM_PERMITTIVITY


def nominal(modulus, limit, first, second):
    """Nominal stress along the first direction of a Gent film, Pa."""
    extension = first**2 + second**2 + (first * second) ** -2 - 3
    return modulus / (1 - extension / limit) * (first - first**-3 * second**-2)


def rig(modulus, limit, **shape):
    elastic = (
        Parameter(name="shear_modulus", value=modulus, unit="Pa", lower=1e3, upper=1e7),
        Parameter(name="stretch_limit", value=limit, unit="1", lower=1.0, upper=1e6),
    )
    permittivity = Parameter(name="permittivity", value=RELATIVE, unit="1", lower=1.0, upper=10.0)
    film = Material(name="Gent", energy=gent, elastic=elastic, permittivity=permittivity, density=DENSITY)
    return Disc(material=film, thickness=THICKNESS, gain=1.0, damping=1e-6, **shape)


def shot(modulus, limit, prestretch, electrode, frame):
    """Edge of the electrode and voltage, for each meridional stretch at the frame from which the ring is integrated."""
    inner, outer, slight = electrode / prestretch, frame / prestretch, 1e-6

    def ring(rho, state):
        radius, first = state
        second = radius / rho
        stress = nominal(modulus, limit, first, second)
        by_first = (nominal(modulus, limit, first + slight, second) - stress) / slight
        by_second = (nominal(modulus, limit, first, second + slight) - stress) / slight
        across = nominal(modulus, limit, second, first)
        return [first, ((across - stress) - by_second * (first - second)) / (rho * by_first)]

    edges, voltages = [], []
    for first in prestretch * (1.0 - 0.45 * np.linspace(0.0, 1.0, 300)[1:] ** 2.5):
        found = solve_ivp(ring, (outer, inner), [frame, first], rtol=1e-10, atol=1e-13)
        radius, meridional = found.y[:, -1]
        stretch = radius / inner
        held = nominal(modulus, limit, meridional, stretch)
        square = (nominal(modulus, limit, stretch, stretch) - held) / (PERMITTIVITY * stretch**3)
        if not (found.success and square > 0.0):
            break
        edges.append(radius)
        voltages.append(THICKNESS * np.sqrt(square))
        if len(voltages) > 2 and voltages[-1] < 0.97 * max(voltages):
            break
    return np.array(edges), np.array(voltages)


CASES = {
    "silicone": (0.33e6, 60.0, 1.2, 10e-3, 25e-3),
    "soft and little stretched": (20e3, 200.0, 1.1, 8e-3, 40e-3),
    "acrylic": (25e3, 100.0, 3.5, 10e-3, 40e-3),
    "large electrode": (0.5e6, 40.0, 1.5, 20e-3, 30e-3),
    "far from its limit": (25e3, 1e5, 3.0, 6e-3, 60e-3),
}


@pytest.mark.parametrize("case", CASES)
def test_statics_and_pull_in_are_those_of_the_membrane(case):
    modulus, limit, prestretch, electrode, frame = CASES[case]
    edges, voltages = shot(*CASES[case])
    top = int(np.argmax(voltages))
    plant = Plant(rig=rig(modulus, limit, prestretch=prestretch, electrode_radius=electrode, frame_radius=frame))
    curve = actuation_curve(plant, np.concatenate([voltages[:top:4], [1.1 * voltages[top]]]))
    slack = curve.slack_command or np.inf
    in_tension = curve.commands[:-1] < min(0.98 * voltages[top], slack)
    assert in_tension.sum() >= 10
    moved = edges[:top:4][: in_tension.size][in_tension] - electrode
    assert curve.readings[:-1][in_tension] == pytest.approx(moved, rel=0.01)
    # The large film turns back without slack before, or just beyond it; the others lose their tension long before.
    assert (curve.end is CurveEnd.PULL_IN) is (case != "acrylic")
    if slack > 0.95 * voltages[top]:
        assert curve.commands[-1] == pytest.approx(voltages[top], rel=0.005)


def first_mode(modulus, limit, prestretch, electrode, frame, voltage, elements=300):
    """First natural frequency, Hz, of a film of many straight pieces with point masses."""
    inner, outer = electrode / prestretch, frame / prestretch
    within = max(8, round(elements * inner / outer))
    rho = np.concatenate([np.linspace(0, inner, within + 1), np.linspace(inner, outer, elements - within + 1)[1:]])
    middle, width = (rho[1:] + rho[:-1]) / 2, np.diff(rho)
    weight = 2 * np.pi * middle * width * THICKNESS

    def stresses(first, second, field):
        return (
            nominal(modulus, limit, first, second) - field * first * second**2,
            nominal(modulus, limit, second, first) - field * second * first**2,
        )

    def tangent(radius, field):
        first, second, slight = np.diff(radius) / width, (radius[1:] + radius[:-1]) / 2 / middle, 1e-6
        p1, p2 = stresses(first, second, field)
        a1, b1 = (stresses(*moved, field)[0] for moved in ((first + slight, second), (first, second + slight)))
        c11, c12 = (a1 - p1) / slight, (b1 - p1) / slight
        c22 = (stresses(first, second + slight, field)[1] - p2) / slight
        force, diagonal, half = np.zeros(rho.size), np.zeros(rho.size), 1 / (2 * middle)
        for end, slope in ((slice(0, -1), -1 / width), (slice(1, None), 1 / width)):
            force[end] += weight * (p1 * slope + p2 * half)
            diagonal[end] += weight * (c11 * slope**2 + 2 * c12 * slope * half + c22 * half**2)
        return force, diagonal, weight * (c22 * half**2 - c11 / width**2)  # the mixed terms of two ends cancel

    radius, kept = prestretch * rho, slice(1, -1)
    for share in np.linspace(0.0, 1.0, 11):
        field = share * PERMITTIVITY * (voltage / THICKNESS) ** 2 * (middle < inner)
        for _ in range(20):
            force, diagonal, beside = tangent(radius, field)
            above = np.concatenate([[0.0], beside[1:-1]])
            step = solve_banded((1, 1), np.stack([above, diagonal[kept], np.roll(above, -1)]), force[kept])
            radius[kept] -= step
    mass = np.zeros(rho.size)
    mass[:-1] += DENSITY * weight / 2
    mass[1:] += DENSITY * weight / 2
    root = np.sqrt(mass[kept])
    square = eigh_tridiagonal(
        diagonal[kept] / root**2,
        beside[1:-1] / (root[1:] * root[:-1]),
        eigvals_only=True,
        select="i",
        select_range=(0, 0),
    )[0]
    return np.sqrt(square) / (2 * np.pi)


def own_frequency(plant, voltage):
    """First natural frequency of the plant at rest under a voltage, Hz, from its own equations."""
    curve = actuation_curve(plant, np.linspace(0.0, voltage, 11) if voltage else np.array([0.0]))
    x = np.array([curve.unknowns[name][-1] for name in plant.equations.states])
    equations, values = plant.equations, plant.free_values
    held = equations.hold(x, [], values, equations.constants)

    def rates(state):
        f = equations.dynamics(state, [], held, [voltage], 0.0, values, equations.constants)
        return np.asarray(f).ravel() / np.asarray(equations.mass(values, equations.constants)).ravel()

    slopes = [(rates(x + step) - rates(x - step)) / 2e-7 for step in 1e-7 * np.eye(x.size)]
    turning = np.linalg.eigvals(np.array(slopes).T).imag
    return np.min(turning[turning > 1.0]) / (2 * np.pi)


@pytest.mark.parametrize("case", CASES)
def test_first_mode(case):
    modulus, limit, prestretch, electrode, frame = CASES[case]
    plant = Plant(rig=rig(modulus, limit, prestretch=prestretch, electrode_radius=electrode, frame_radius=frame))
    ends = actuation_curve(plant, np.linspace(0.0, 1e4, 101))
    top = ends.slack_command or ends.commands[-1]
    for share in (0.0, 0.5, 0.9):
        expected = first_mode(*CASES[case], share * top)
        assert own_frequency(plant, share * top) == pytest.approx(expected, rel=0.015)
        if share == 0.0:
            # J1(omega B sqrt(density/A11)) = 0 with A11 = d sigma1/d ln lambda1 - sigma, by differences.
            slight, stretch = 1e-6, prestretch
            first, beyond = (nominal(modulus, limit, lam, stretch) for lam in (stretch, stretch + slight))
            tangent = stretch**2 * (beyond - first) / slight
            wave = np.sqrt(tangent / DENSITY)
            assert expected == pytest.approx(jn_zeros(1, 1)[0] * wave / (2 * np.pi * frame), rel=1e-3)


def test_a_small_voltage_moves_the_edge_as_the_closed_form_says():
    modulus, limit, prestretch, electrode, frame = CASES["silicone"]
    plant = Plant(rig=rig(modulus, limit, prestretch=prestretch, electrode_radius=electrode, frame_radius=frame))
    slight = 1e-6
    first, beyond = (nominal(modulus, limit, lam, prestretch) for lam in (prestretch, prestretch + slight))
    tangent, ratio = prestretch**2 * (beyond - first) / slight, (frame / electrode) ** 2
    pressure = PERMITTIVITY * (100.0 * prestretch**2 / THICKNESS) ** 2
    growth = pressure / (tangent * 2 * ratio / (ratio - 1) - 2 * pressure)
    reading = actuation_curve(plant, np.array([0.0, 100.0])).readings[-1]
    assert reading / electrode == pytest.approx(growth, rel=1e-3)


def test_the_viscosity_of_the_film_makes_one_lag_of_it():
    """Stiffness and viscosity of a film that is stretched evenly have the same shapes: its edge follows as a spring of
    2 pi h A11 2q/(q - 1) on the stated damping does."""
    modulus, limit, prestretch, electrode, frame = CASES["silicone"]
    shape = {"prestretch": prestretch, "electrode_radius": electrode, "frame_radius": frame}
    plant = Plant(rig=rig(modulus, limit, **shape), values={"damping": 5.0})
    slight = 1e-6
    first, beyond = (nominal(modulus, limit, lam, prestretch) for lam in (prestretch, prestretch + slight))
    tangent, ratio = prestretch**2 * (beyond - first) / slight, (frame / electrode) ** 2
    lag = 5.0 / (2 * np.pi * THICKNESS / prestretch**2 * tangent * 2 * ratio / (ratio - 1))
    times = lag * np.linspace(0.0, 4.0, 21)
    commands = np.full(20, 100.0)
    values = plant.free_values
    run = Simulator(plant.equations).run(commands, start=0.0, sample_time=lag / 5, rest_command=0.0, values=values)
    rest = actuation_curve(plant, np.array([0.0, 100.0])).readings[-1]
    assert run.outputs == pytest.approx(rest * (1 - np.exp(-times / lag)), abs=1e-3 * rest)

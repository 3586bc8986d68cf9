"""Cone and inflated film against a membrane of many straight pieces: statics, pull-in and the first mode.

The pieces store the energy 2 pi rho d(rho) H [W - eps/2 (V/H)^2 (l1 l2)^2]. Its height is prescribed at the inner end
and the voltage is unknown, so that a curve passes pull-in, its highest voltage. CasADi serves to differentiate; no
equation of the plant is used. 150 pieces leave
less than 0.5 % of the stroke.
"""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.special import jn_zeros

from deatwin.plant import Cone, Parameter, Plant, Pressure, actuation_curve
from deatwin.plant.actuation import CurveEnd
from deatwin.plant.laws import VACUUM_PERMITTIVITY, gent
from deatwin.plant.material import Material

THICKNESS, RELATIVE, DENSITY, MODULUS, LIMIT = 50e-6, 2.8, 1080.0, 0.35e6, 60.0
PRESTRETCH, FRAME, DISC, PIECES = 1.25, 20e-3, 8e-3, 150
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
    "damping": 1e-6,
}
BIASES = {
    "mass": {"mass": 20e-3},
    "spring": {"mass": 1e-3, "spring_rate": 60.0, "spring_preload": 0.4},
    "bistable": {"mass": 2e-3, "spring_preload": 0.3, "snap_force": 0.2, "snap_middle": 3e-3, "snap_reach": 2e-3},
}


def work_of(height, mass=0.0, spring_rate=0.0, spring_preload=0.0, snap_force=0.0, snap_middle=0.0, snap_reach=1.0):
    """Work of weight and bias up to a height, J: the bistable spring has the well of a quartic."""
    well = snap_force * 3 * np.sqrt(3) / 8 * snap_reach
    away = (height - snap_middle) / snap_reach
    return mass * 9.80665 * height + spring_preload * height - spring_rate / 2 * height**2 - well * (1 - away**2) ** 2


class Pieces:
    """A membrane of straight pieces from an inner reference radius to the ring; `held` fixes the inner radius."""

    def __init__(self, inner, work, pressure=0.0, load=0.0, held=True):
        # Pieces of equal area have no needles at the apex.
        rho = np.sqrt(np.linspace(inner**2, (FRAME / PRESTRETCH) ** 2, PIECES + 1))
        radius, height, square = ca.SX.sym("r", PIECES + 1), ca.SX.sym("z", PIECES + 1), ca.SX.sym("v")
        middle, width = (rho[1:] + rho[:-1]) / 2, np.diff(rho)
        wide, tall = radius[1:] - radius[:-1], height[1:] - height[:-1]
        first, second = ca.sqrt(wide**2 + tall**2) / width, (radius[1:] + radius[:-1]) / 2 / middle
        extension = first**2 + second**2 + (first * second) ** -2 - 3
        stored = -MODULUS * LIMIT / 2 * ca.log(1 - extension / LIMIT)
        field = RELATIVE * VACUUM_PERMITTIVITY / 2 * square * 1e6 / THICKNESS**2  # `square` in kV²
        weight = 2 * np.pi * middle * width
        energy = ca.dot(weight * THICKNESS, stored - field * (first * second) ** 2) - work(height[0])
        swept = np.pi / 3 * (radius[1:] ** 2 + radius[1:] * radius[:-1] + radius[:-1] ** 2)
        energy += pressure * ca.dot(swept, tall)
        self.start, self.inner = PRESTRETCH * rho, DISC if held else 0.0
        ends = ca.vertcat(radius[0], radius[-1], height[-1])
        energy = ca.substitute(energy, ends, ca.vertcat(self.inner, FRAME, 0.0))
        free = ca.vertcat(radius[1:-1], height[1:-1])
        forces = ca.gradient(energy, ca.vertcat(height[0], free))
        unknown = ca.vertcat(square, free)
        self.residual = ca.Function("f", [unknown, height[0]], [forces, ca.jacobian(forces, unknown)])
        moving = ca.vertcat(height[0], free)
        self.stiffness = ca.Function("k", [unknown, height[0]], [ca.hessian(energy, moving)[0]])
        share = DENSITY * THICKNESS * weight / 2
        mass = np.concatenate([share, [0.0]]) + np.concatenate([[0.0], share])
        self.mass = np.concatenate([[mass[0] + load], mass[1:-1], mass[1:-1]])
        self.flat = self.start[1:-1]

    def at(self, height, guess):
        """Unknowns at a height of the inner end, by Newton's method; None where it finds none."""
        for _ in range(40):
            force, slope = self.residual(guess, height)
            step = np.linalg.solve(np.asarray(slope), np.asarray(force)).ravel()
            guess = guess - step * min(1.0, 1e-3 / np.max(np.abs(step[1:])))
            if not np.isfinite(step).all():
                return None
            if np.max(np.abs(step[1:])) < 1e-10:
                return guess
        return None

    def curve(self, heights):
        """Squared voltages, V², and unknowns at rising heights."""
        place = (self.start[1:-1] - self.inner) / (FRAME - self.inner)
        shape = 1 - (place if self.inner else place**2)
        guess = np.concatenate([[0.0], self.flat, heights[0] * shape])
        found = []
        for height in heights:
            guess = self.at(height, guess)
            # Well beyond pull-in the pieces fold up.
            most = max((unknown[0] for unknown in found), default=-np.inf)
            if guess is None or guess[0] < most - 0.05 * abs(most):
                break
            found.append(guess)
        return 1e6 * np.array([unknown[0] for unknown in found]), found

    def first_mode(self, unknown, height):
        """First natural frequency, Hz."""
        stiff = np.asarray(self.stiffness(unknown, height))
        return np.sqrt(eigh(stiff, np.diag(self.mass), eigvals_only=True, subset_by_index=[0, 0])[0]) / (2 * np.pi)


def own_frequency(plant, curve, point):
    """First natural frequency of the plant at a point of a curve, Hz, from its own equations."""
    equations, values, constants = plant.equations, plant.free_values, plant.equations.constants
    x, z = (np.array([curve.unknowns[n][point] for n in names]) for names in (equations.states, equations.coordinates))
    held, voltage, whole = equations.hold(x, z, values, constants), curve.commands[point], np.concatenate([x, z])
    mass = np.asarray(equations.mass(values, constants)).ravel()

    def rates(w):
        return np.asarray(equations.dynamics(w[: x.size], w[x.size :], held, [voltage], 0.0, values, constants)).ravel()

    slope = np.array([(rates(whole + d) - rates(whole - d)) / 2e-7 for d in 1e-7 * np.eye(whole.size)]).T
    n = x.size
    reduced = slope[:n, :n] - slope[:n, n:] @ np.linalg.solve(slope[n:, n:], slope[n:, :n]) if z.size else slope
    turning = np.linalg.eigvals(reduced / mass[:, None]).imag
    return np.min(turning[turning > 1.0]) / (2 * np.pi)


def compared(plant, pieces, rise):
    """Compare heights, first mode and pull-in of a plant and of the pieces up to a share of the rise above rest."""
    rest = actuation_curve(plant, np.array([0.0])).unknowns["position"][0]
    heights = rest * (1 + np.linspace(-0.02, rise, 60))
    squares, found = pieces.curve(heights)
    # Straight pieces lie somewhat lower at rest than the film that they stand for.
    own_rest, voltages = np.interp(0.0, squares[:4], heights[:4]), np.sqrt(np.maximum(squares, 0.0))
    top = int(np.argmax(voltages))
    sound = int(np.argmax(voltages > 0.97 * voltages[top]))  # beyond, a height is worth hardly any voltage
    some = np.linspace(4, sound, 5).astype(int)
    curve = actuation_curve(plant, voltages[some])
    for point in (0, -2):
        mode = pieces.first_mode(found[some[point]], heights[some[point]])
        assert own_frequency(plant, curve, point) == pytest.approx(mode, rel=0.02)
    end = actuation_curve(plant, np.linspace(0.0, 1.1 * voltages[top], 12))
    assert curve.readings == pytest.approx(heights[some] - own_rest, rel=0.01)
    assert (end.end is CurveEnd.PULL_IN) and 0 < top < len(voltages) - 1
    assert end.commands[-1] == pytest.approx(voltages[top], rel=0.005)


@pytest.mark.parametrize(("name", "rise"), [("mass", 4.0), ("spring", 2.0), ("bistable", 1.0)])
def test_a_cone_is_where_the_membrane_bears_its_bias(name, rise):
    bias = BIASES[name]
    plant = Plant(rig=Cone(disc_radius=DISC, **FILM, **bias))
    compared(plant, Pieces(DISC / PRESTRETCH, lambda height: work_of(height, **bias), load=bias["mass"]), rise)


@pytest.mark.parametrize(("pressure", "rise"), [(200.0, 6.0), (700.0, 2.5)])
def test_an_inflated_film_is_where_the_membrane_bears_its_pressure(pressure, rise):
    plant = Plant(rig=Pressure(pressure=pressure, **FILM))
    compared(plant, Pieces(0.0, lambda height: 0.0, pressure=pressure, held=False), rise)


def test_a_film_that_is_hardly_inflated_is_a_drum():
    plant = Plant(rig=Pressure(pressure=1.0, **FILM))
    stress = MODULUS / (1 - (2 * PRESTRETCH**2 + PRESTRETCH**-4 - 3) / LIMIT) * (PRESTRETCH**2 - PRESTRETCH**-4)
    drum = jn_zeros(0, 1)[0] / (2 * np.pi * FRAME) * np.sqrt(stress / DENSITY)
    rest = actuation_curve(plant, np.array([0.0]))
    assert own_frequency(plant, rest, 0) == pytest.approx(drum, rel=1e-3)
    assert rest.unknowns["position"][0] == pytest.approx(FRAME**2 / (4 * stress * THICKNESS / PRESTRETCH**2), rel=1e-3)

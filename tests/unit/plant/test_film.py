"""Films: how branches flow at a point, and what virtual stretches tell."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.plant.builder import Builder
from deatwin.plant.film import FilmPoint, PointwiseFilm, film_points, point_capacitances
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.laws.energies import gent
from deatwin.plant.parameters import ParameterSet

VOLUME, THICKNESS, MODULUS, TIME = 2e-8, 0.5e-3, 26e3, 0.6


def sheet(build, stretches):
    """A film of one point under an electrode, stretched as told."""
    points = film_points([FilmPoint(volume=VOLUME, stretches=stretches, radius=0.5)], build)
    return PointwiseFilm(
        points=points,
        elastic=VOLUME * gent(*points[0].stretches, 25e3, 107.0),
        prestretches=(3.5, 3.5),
        capacitances=point_capacitances(points, 4.5, THICKNESS),
    )


def rates(stretches, viscous):
    """Rates of both viscous stretches, 1/s, and the branch's energy in J."""
    build = Builder(ParameterSet([]), ())
    film = sheet(build, stretches).with_branch("branch", MODULUS, TIME, build)
    unknowns = [build.written.states[f"branch_stretch_0_{axis}"][0] for axis in (1, 2)]
    values = [build.written.rates[symbol.name()][0] / TIME for symbol in unknowns]
    zeros = ca.vertcat(*film.points[0].virtual)
    function = ca.Function("rates", [*unknowns, zeros], [*values, film.relaxing])
    return [float(v) for v in function(*viscous, [0.0, 0.0])]


def test_a_branch_flows_as_an_incompressible_fluid_of_its_viscosity():
    # Foo et al. 2012, written anew: eta = mu tau, and the spring's true stresses drive the flow.
    stretches, viscous = (4.2, 3.1), (3.5, 3.6)
    first, second = stretches[0] / viscous[0], stretches[1] / viscous[1]
    stress_1 = MODULUS * (first**2 - 1 / (first * second) ** 2)
    stress_2 = MODULUS * (second**2 - 1 / (first * second) ** 2)
    viscosity = MODULUS * TIME
    rate_1, rate_2, energy = rates(stretches, viscous)
    assert rate_1 == pytest.approx(viscous[0] * (stress_1 - stress_2 / 2) / (3 * viscosity), rel=1e-12)
    assert rate_2 == pytest.approx(viscous[1] * (stress_2 - stress_1 / 2) / (3 * viscosity), rel=1e-12)
    extension = first**2 + second**2 + 1 / (first * second) ** 2 - 3
    assert energy == pytest.approx(VOLUME * MODULUS / 2 * extension, rel=1e-12)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_small_step_relaxes_with_the_branchs_time(axis):
    # 1e-4 of stretch: quadratic terms are of that relative size.
    size = 1e-4
    stretches = [3.5, 3.5]
    stretches[axis] *= 1 + size
    answer = solve_ivp(
        lambda t, xi: rates(tuple(stretches), tuple(xi))[:2], (0.0, 2 * TIME), [3.5, 3.5], rtol=1e-10, atol=1e-13
    )
    left = (stretches[axis] - answer.y[axis, -1]) / (3.5 * size)
    assert left == pytest.approx(np.exp(-2.0), rel=1e-3)
    assert answer.y[1 - axis, -1] == pytest.approx(3.5, abs=1e-7)


def test_virtual_stretches_give_the_stresses():
    # P_i = dW/dl_i - eps E² / l_i of a Gent film, differentiated by hand.
    build = Builder(ParameterSet([]), ())
    first, second, squared = 3.9, 3.2, 2.0e3**2
    film = sheet(build, (ca.SX(first), ca.SX(second)))
    zeros = ca.vertcat(*film.points[0].virtual)
    work = ca.Function("work", [zeros], [film.force(zeros, squared)])([0.0, 0.0])
    across = 1 / (first * second) ** 2
    factor = 25e3 * 107.0 / (107.0 - (first**2 + second**2 + across - 3))
    maxwell = 4.5 * VACUUM_PERMITTIVITY * squared * (first * second / THICKNESS) ** 2
    for stress, stretch in zip(np.asarray(work).ravel() / VOLUME, (first, second), strict=True):
        assert stress * stretch == pytest.approx(factor * (stretch**2 - across) - maxwell, rel=1e-12)

"""Radau IIA: coefficients, order, and states without mass."""

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from deatwin.plant import Plant
from deatwin.plant.integrator import collocation, newton, stages
from deatwin.plant.integrator.collocation import radau, step_functions
from deatwin.plant.rest import rest_state


@pytest.mark.parametrize("stages", range(1, 7))
def test_the_coefficients_integrate_polynomials_exactly(stages):
    nodes, matrix = radau(stages)
    assert nodes[-1] == 1.0
    assert np.all(np.diff(nodes) > 0)
    for power in range(stages):  # each stage, up to degree s - 1 (conditions C(s))
        np.testing.assert_allclose(matrix @ nodes**power, nodes ** (power + 1) / (power + 1), atol=1e-13)
    for power in range(2 * stages - 1):  # the whole step, up to degree 2s - 2 (conditions B(2s - 1))
        assert matrix[-1] @ nodes**power == pytest.approx(1 / (power + 1), abs=1e-13)


def position_after(plant, steps, duration=0.2, force=4.0):
    equations, step = plant.equations, step_functions(plant.equations).plain
    x = np.array([0.0, 0.0])
    for _ in range(steps):
        x, *_ = step(x, [], [], force, 0.0, duration / steps, plant.free_values, equations.constants)
    return float(x[0])


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_the_order_is_twice_the_stages_less_one(stages, oscillator):
    plant = Plant(rig=oscillator(), stages=stages)
    system = np.array([[0, 1, 0], [-400.0, -2.0, 4.0], [0, 0, 0]])  # x' = v, v' = -400x - 2v + force
    exact = (expm(system * 0.2) @ [0, 0, 1])[0]
    coarse = {1: 1024, 2: 128, 3: 32}[stages]  # near the limit of small steps, and far from rounding
    errors = [abs(position_after(plant, steps) - exact) for steps in (coarse, 2 * coarse)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * stages - 1, abs=0.1)


@pytest.mark.parametrize(("stages", "error"), [(5, 4e-9), (4, 3e-7)])
def test_the_order_resolves_a_ringing_ball_mode_at_50_samples_a_second(stages, error, oscillator):
    # 16 Hz ball mode, 3 g, k = 30 N/m: two radians a sample. With the stability function R of Radau IIA,
    # |R(2i) - exp(2i)| is 2.0e-6 for five stages and 1.6e-4 for four. In ten steps a mode of 1 mm decays to 0.19 mm.
    plant = Plant(rig=oscillator(), values={"mass": 3e-3, "damping": 0.05, "stiffness": 30.0}, stages=stages)
    system = np.array([[0, 1, 0], [-30 / 3e-3, -0.05 / 3e-3, 0.03 / 3e-3], [0, 0, 0]])
    exact = (expm(system * 0.2) @ [0, 0, 1])[0]
    assert position_after(plant, 10, force=0.03) == pytest.approx(exact, abs=error)


def test_a_state_without_mass_is_an_algebraic_one(oscillator):
    # m = 0: c x' = F - k x, a first-order lag, though the equations keep both states
    plant = Plant(rig=oscillator(), values={"mass": 0.0})
    exact = 4.0 / 400 * (1 - np.exp(-400 / 2.0 * 0.02))
    assert position_after(plant, 20, duration=0.02) == pytest.approx(exact, rel=1e-9)


def test_large_and_small_plants_take_steps_of_the_same_scheme(base, monkeypatch):
    # Straight-line elimination against sparse QR: both solve the same systems, to some rounding.
    equations = base.equations
    rest = rest_state(equations, 2.0, base.free_values)
    slopes = (np.asarray(rest.x_p), np.asarray(rest.d_p))
    known = (rest.d, 3.0, 0.0, 0.02, base.free_values, equations.constants)
    steps = [step_functions(equations)]
    monkeypatch.setattr(stages, "UNROLLED", 0)
    steps.append(step_functions(equations))
    small, large = (step.plain(rest.x, rest.z, *known) for step in steps)
    for a, b in zip(small[:3], large[:3], strict=True):
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=1e-12)
    small, large = (np.asarray(step.sensitive(rest.x, rest.z, *slopes, *known)[2]) for step in steps)
    np.testing.assert_allclose(small, large, rtol=1e-10, atol=1e-10 * np.abs(small).max())


def test_a_step_that_the_simplified_method_leaves_is_still_solved(base, monkeypatch):
    # Without corrections every step falls back on the full method; both settle to SETTLED.
    equations = base.equations
    rest = rest_state(equations, 2.0, base.free_values)
    start = (rest.x, rest.z, rest.d, 3.0, 0.0, 0.02, base.free_values, equations.constants)
    usual = step_functions(equations).plain(*start)
    monkeypatch.setattr(newton, "FIRST_CORRECTIONS", 0)
    monkeypatch.setattr(newton, "CORRECTIONS", 0)
    full = step_functions(equations).plain(*start)
    assert float(full[-1]) <= newton.SETTLED
    differences = np.asarray(ca.vertcat(*full[:2]) - ca.vertcat(*usual[:2])).ravel() / equations.scale
    assert np.abs(differences).max() < 2 * newton.SETTLED


@pytest.mark.parametrize(
    ("errors", "left"), [((1e-3, 2e-3), 2e-3), ((5e-3, 2e-3), 5e-3), ((np.nan, 1.0), np.nan), ((1.0, np.nan), np.nan)]
)
def test_two_steps_of_a_divided_sample_are_told_their_middles_and_as_wrong_as_the_worse(errors, left):
    """A step that writes down what it was given: the state is 10 x + middle, the reading when it ends."""
    names = ("x", "z", "d", "u", "t", "h", "p", "c")
    x, z, d, u, t, h, p, c = (ca.MX.sym(name, 3 if name == "u" else 2 if name == "p" else 1) for name in names)
    error = ca.if_else(u[1] < t_middle(0.5), p[0], p[1])
    step = ca.Function("step", [x, z, d, u, t, h, p, c], [10 * x + u[1], z + h, t + h, u[0] + u[2], error])
    found = collocation._in_two(step, 2, 1)(1.0, 0.0, 0.0, [7.0, 0.0, 8.0], 40.0, 2.0, errors, 0.0)
    state, widths, end, others, worse = (float(v) for v in found)
    assert state == pytest.approx(10 * (10 * 1.0 + t_middle(0.25)) + t_middle(0.75))
    assert (widths, end, others) == (2.0, 42.0, 15.0)
    np.testing.assert_allclose(worse, left, rtol=1e-12)


def t_middle(phase):
    """Clock time in a sample of 2 s that begins at 40 s."""
    return 40.0 + 2.0 * phase

"""Laws of the permittivity."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from deatwin.plant import DataError
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.laws.permittivity import (
    displacement,
    polarisation_rate,
    polarised_energy,
    random_walk,
    relaxing,
    stretched,
)
from deatwin.plant.laws.stress import true_stress


@pytest.mark.parametrize(("stretch", "measured"), [(1.0, 4.68), (3.0, 3.71), (4.0, 3.34), (5.0, 2.62)])
def test_the_quoted_fit_meets_the_quoted_measurements(stretch, measured):
    # Wissler & Mazza's values as later papers quote them; a straight line meets them within 5 %.
    assert stretched(stretch, stretch, 4.68, -0.053) == pytest.approx(measured, rel=0.05)


def test_relaxation_goes_from_one_value_to_the_other():
    assert float(relaxing(-5.0, 4.5, -0.1, 300.0)) == 4.5
    assert float(relaxing(0.0, 4.5, -0.1, 300.0)) == 4.5
    assert float(relaxing(300.0 * np.log(2), 4.5, -0.1, 300.0)) == pytest.approx(4.5 * 0.95, rel=1e-12)
    assert float(relaxing(1e6, 4.5, -0.1, 300.0)) == pytest.approx(4.05, rel=1e-12)


def test_a_walk_spreads_with_the_root_of_time():
    # The sum of squared steps over their variance is chi-squared; both tails of 1e-4.
    times, values = random_walk(np.random.default_rng(5), 1000.0, 0.5, 4.5, spread=0.05, spread_time=200.0)
    assert times[0] == 0 and times[-1] == 1000.0 and values[0] == 4.5 and times.shape == values.shape
    steps = np.diff(np.log(values))
    squares = np.sum(steps**2) / (0.05**2 * 0.5 / 200.0)
    assert chi2.ppf(1e-4, steps.size) < squares < chi2.ppf(1 - 1e-4, steps.size)
    ends = [random_walk(np.random.default_rng(k), 200.0, 10.0, 4.5, 0.05, 200.0)[1][-1] for k in range(400)]
    squares = np.sum(np.log(np.array(ends) / 4.5) ** 2) / 0.05**2
    assert chi2.ppf(1e-4, 400) < squares < chi2.ppf(1 - 1e-4, 400)


def test_a_walk_covers_its_duration_and_never_becomes_negative():
    times, values = random_walk(np.random.default_rng(1), 10.05, 0.1, 4.5, spread=5.0, spread_time=1.0)
    assert times[-1] == pytest.approx(10.1) and times.size == 102
    assert values.min() > 0
    assert random_walk(np.random.default_rng(1), 1.1, 0.1, 4.5)[0].size == 12  # 1.1 / 0.1 rounds to a little over 11


@pytest.mark.parametrize(
    "wrong", [{"duration": 0.0}, {"interval": -1.0}, {"spread": -0.1}, {"permittivity": 0.0}, {"spread_time": 0.0}]
)
def test_a_walk_refuses_what_makes_no_sense(wrong):
    values = {"duration": 10.0, "interval": 0.1, "permittivity": 4.5} | wrong
    with pytest.raises(DataError, match="random walk over"):
        random_walk(np.random.default_rng(0), **values)


def test_a_lagging_polarisation_answers_a_harmonic_field_as_debye_says():
    # D/(e0 E) = e_inf + step/(1 + i w tau), from the rate by integration over ten time constants and one period.
    at_once, step, tau, omega = 4.0, 0.5, 3.0, 0.7
    period = 2 * np.pi / omega
    times = np.linspace(30.0, 30.0 + period, 401)
    solved = solve_ivp(
        lambda t, p: polarisation_rate(np.cos(omega * t), p, step, tau),
        (0, times[-1]),
        [0.0],
        t_eval=times,
        rtol=1e-10,
        atol=1e-24,
    )
    field = np.cos(omega * times)
    answer = displacement(field, at_once, solved.y[0]) / VACUUM_PERMITTIVITY
    found = 2 * np.mean((answer * np.exp(-1j * omega * times))[:-1])
    expected = at_once + step / (1 + 1j * omega * tau)
    assert found == pytest.approx(expected, rel=1e-4)  # what is left of the start: e^-10


def test_the_lagging_film_is_pulled_by_field_times_displacement():
    nominal, polarisation, step = 20e6, 3e-4, 0.5
    found = true_stress(polarised_energy, 1.3, 1.7, 4.0, nominal, polarisation, step)
    field = nominal * 1.3 * 1.7
    expected = -float(displacement(field, 4.0, polarisation)) * field
    assert [float(part) for part in found] == pytest.approx([expected, expected], rel=1e-12)


def test_the_polarisation_slides_down_its_energy():
    # tau P' = -(step e0) dw/dP: what the rate dissipates is a square.
    polarisation = ca.SX.sym("P")
    energy = polarised_energy(1.3, 1.7, 4.0, 20e6, polarisation, 0.5)
    slope = ca.Function("f", [polarisation], [ca.gradient(energy, polarisation)])
    rate = polarisation_rate(20e6 * 1.3 * 1.7, 3e-4, 0.5, 3.0)
    assert -0.5 * VACUUM_PERMITTIVITY * float(slope(3e-4)) / 3.0 == pytest.approx(rate, rel=1e-12, abs=0)


def test_a_settled_polarisation_is_a_larger_permittivity():
    settled = 0.5 * VACUUM_PERMITTIVITY * 1e6
    assert polarisation_rate(1e6, settled, 0.5, 3.0) == 0
    assert displacement(1e6, 4.0, settled) == pytest.approx(4.5 * VACUUM_PERMITTIVITY * 1e6, rel=1e-12, abs=0)

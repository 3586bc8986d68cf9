"""Gain and modes over operating points and over time, against closed forms and quantiles."""

from dataclasses import replace

import numpy as np
import pytest
from made_narx import trajectory_of

from deatwin.control.linear.bands import Banded
from deatwin.control.linear.family import linearise_many
from deatwin.control.linear.narx import linearise
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.linear.schedule import GainSchedule, gain_schedule, linearise_along
from deatwin.ident.frequency import hold_equilibrium, tv_gfrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant import CalibratedPlant, Creep, Diaphragm, ModelError, Plant

H = 0.02
POINTS = np.linspace(1.4, 3.2, 5)


@pytest.fixture(scope="module")
def schedule(model) -> GainSchedule:
    return gain_schedule(model, POINTS, np.random.default_rng(1), 300)


def test_the_schedule_of_a_model_is_the_model_at_each_point_with_its_band(model, schedule):
    for i, point in enumerate(POINTS):
        linear = linearise(model, point)
        assert schedule.static_gain.value[i] == pytest.approx(linear.static_gain, rel=1e-9)
        assert schedule.operating_output.value[i] == pytest.approx(linear.operating_output, rel=1e-9)
        # The normal law's half width; 300 draws know a 2.5 % quantile to some 10 %.
        half = 1.96 * linear.static_gain_deviation
        assert schedule.static_gain.high[i] - linear.static_gain == pytest.approx(half, rel=0.4)
        assert linear.static_gain - schedule.static_gain.low[i] == pytest.approx(half, rel=0.4)
    assert schedule.stable.all() and schedule.stable_share.tolist() == [1.0] * 5


def test_modes_are_time_constants_frequencies_and_damping_ratios():
    # A pair of 1.5 Hz with a damping ratio of 0.3, a real pole of 2 s.
    size = 2 * np.pi * 1.5
    pair = np.exp(H * size * (-0.3 + 1j * np.sqrt(1 - 0.3**2)))
    coefficients = np.poly([pair, pair.conj(), np.exp(-H / 2.0)]).real
    terms = {f"y(k-{lag})": -a for lag, a in enumerate(coefficients) if lag} | {"u(k-1)": 1.0}
    modes = GainSchedule(family=linearise_many(NarxModel.from_terms(terms, sample_time=H), [0.0])).modes
    np.testing.assert_allclose(modes.time_constant.value[0], [2.0, *2 * [1 / (0.3 * size)]], rtol=1e-8)
    np.testing.assert_allclose(modes.frequency.value[0, 1:], 1.5, rtol=1e-8)
    np.testing.assert_allclose(modes.damping.value[0], [1.0, 0.3, 0.3], rtol=1e-8)
    assert modes.poles[0, 1].imag > 0.0


def test_a_mode_keeps_its_column_where_two_cross():
    # Poles 0.5 + 0.4 u and 0.9 - 0.4 u: they cross at u = 0.5.
    def poles(u: float) -> tuple[float, float]:
        return 0.5 + 0.4 * u, 0.9 - 0.4 * u

    inputs = np.array([0.0, 0.2, 0.4, 0.45, 0.48])
    a1, a2 = np.array([sum(poles(u)) for u in inputs]), np.array([-np.prod(poles(u)) for u in inputs])
    thetas = np.column_stack([a1, a2, np.ones(inputs.size)])
    model = NarxModel.from_terms({"y(k-1)": 0.5, "y(k-2)": 0.1, "u(k-1)": 1.0}, sample_time=H)
    family = linearise_many(model, [0.0], thetas)
    # The samples in the place of points.
    turned = replace(
        family,
        operating_inputs=inputs,
        operating_outputs=family.operating_outputs.T,
        numerators=family.numerators.swapaxes(0, 1),
        denominators=family.denominators.swapaxes(0, 1),
        exists=family.exists.T,
        stable=family.stable.T,
        has_gain=family.has_gain.T,
    )
    schedule = GainSchedule(family=turned)
    np.testing.assert_allclose(schedule.modes.poles[:, 0], [poles(u)[1] for u in inputs], rtol=1e-9)
    np.testing.assert_allclose(schedule.slowest.value, [-H / np.log(poles(u)[1]) for u in inputs], rtol=1e-9)


def test_a_band_is_of_what_exists():
    values = np.array([[5.0, *range(1, 42), np.nan, np.nan], [np.nan] * 44])
    band = Banded.over_samples(values)
    assert (band.value[0], band.low[0], band.high[0]) == (5.0, 2.0, 40.0)
    assert np.isnan([band.value[1], band.low[1], band.high[1]]).all()


def test_an_unstable_mode_grows_and_is_counted():
    terms = {"y(k-1)": 0.99, "u(k-1)": 1.0}
    model = NarxModel.from_terms(terms, sample_time=H, theta_cov=np.diag([0.01**2, 0.0]))
    schedule = gain_schedule(model, [0.0], np.random.default_rng(0), 2000)
    assert schedule.slowest.low[0] < 0.0 < schedule.slowest.value[0]
    # P(a < 1) of one standard deviation.
    assert schedule.stable_share[0] == pytest.approx(0.841, abs=0.03)


def test_plants_and_calibrated_plants_have_schedules():
    plant = Plant(rig=Diaphragm()).with_effects(Creep())
    alone = gain_schedule(plant, [2.0, 3.0, 6.0], np.random.default_rng(0))
    assert alone.static_gain.value[:2] == pytest.approx([linearise_plant(plant, u).static_gain for u in (2.0, 3.0)])
    assert np.isnan(alone.static_gain.value[2]) and alone.stable.tolist() == [True, True, False]
    names, covariance = ("creep.time", "permittivity"), np.diag([0.1**2, 0.03**2])
    known = CalibratedPlant(plant=plant, noise=1e-6, model_error=0.0, names=names, covariance=covariance)
    schedule = gain_schedule(known, [2.0], np.random.default_rng(0), 60)
    assert schedule.family.n_samples == 61
    assert schedule.static_gain.value[0] == pytest.approx(alone.static_gain.value[0], rel=1e-12)
    # Far below its instability the stroke goes with the permittivity: 1.96 * 3 %, and a little more.
    width = (schedule.static_gain.high - schedule.static_gain.low)[0] / schedule.static_gain.value[0]
    assert 0.08 < width < 0.25
    assert schedule.slowest.low[0] < schedule.slowest.value[0] < schedule.slowest.high[0]


def test_nothing_else_has_a_schedule():
    with pytest.raises(ModelError, match="str has no gain schedule"):
        gain_schedule("model.json", [1.0], np.random.default_rng(0))


def drifting(theta_cov: float = 1e-6) -> ThetaTrajectory:
    """y = a(t) y + 0.1 u + 0.05, a from 0.8 to 0.9: gain and level double."""
    terms = {"y(k-1)": 0.9, "u(k-1)": 0.1, "1": 0.05}
    timepts = np.arange(101) * H
    theta = np.array([np.linspace(0.8, 0.9, 101), np.full(101, 0.1), np.full(101, 0.05)])
    covariance = np.repeat(np.diag([theta_cov, 0.0, 0.0])[None], 101, axis=0)
    model = NarxModel.from_terms(terms, sample_time=H, theta_cov=covariance[0])
    return ThetaTrajectory(model=model, timepts=timepts, theta=theta, theta_cov=covariance, drift_variance=np.zeros(3))


def test_along_time_each_model_is_frozen_about_its_own_equilibrium():
    trajectory = drifting()
    times = trajectory.timepts[::25]
    varying = linearise_along(trajectory, 2.0, times, rng=np.random.default_rng(0), samples=400)
    a = np.linspace(0.8, 0.9, 101)[::25]
    np.testing.assert_allclose(varying.static_gain.value, 0.1 / (1 - a), rtol=1e-9)
    np.testing.assert_allclose(varying.operating_output.value, 0.25 / (1 - a), rtol=1e-9)
    np.testing.assert_allclose(varying.slowest.value, -H / np.log(a), rtol=1e-9)
    half = 1.96 * 1e-3 * 0.1 / (1 - a) ** 2
    # 400 draws: 9 % of a quantile, and a curved law.
    np.testing.assert_allclose(varying.static_gain.high - varying.static_gain.low, 2 * half, rtol=0.25)
    expected = tv_gfrf(trajectory, 1, [3.0], timepts=times, operating_input=2.0)
    found = [varying.family.at(i, 0).response([3.0])[0] for i in range(times.size)]
    np.testing.assert_allclose(found, expected.values[:, 0], rtol=1e-9)


def test_an_equilibrium_that_is_held_leaves_the_change_of_the_dynamics():
    varying = linearise_along(hold_equilibrium(drifting(), 1.0, 2.0), 2.0, rng=np.random.default_rng(0), samples=5)
    np.testing.assert_allclose(varying.operating_output.value, 1.0, rtol=1e-9)
    assert varying.static_gain.value[-1] == pytest.approx(1.0, rel=1e-9)


def test_a_time_without_an_equilibrium_has_no_gain():
    terms = {"y(k-1)^2": 1.0, "1": 0.1, "u(k-1)": 1.0}
    timepts = np.arange(11.0)
    theta = np.array([np.ones(11), np.linspace(0.0, 0.5, 11), np.ones(11)])
    trajectory = trajectory_of(NarxModel.from_terms(terms, sample_time=1.0), timepts, theta)
    varying = linearise_along(trajectory, 0.0, rng=np.random.default_rng(0), samples=3)
    known = theta[1] < 0.25  # where the discriminant is positive
    assert np.isfinite(varying.static_gain.value).tolist() == known.tolist()
    assert not varying.stable[~known].any() and (varying.stable_share[~known] == 0.0).all()


@pytest.mark.parametrize("name", ["plot", "plot_time_constants", "plot_poles"])
def test_pictures_are_drawn_with_units(schedule, name):
    from matplotlib import pyplot

    varying = linearise_along(drifting(), 2.0, rng=np.random.default_rng(0), samples=5)
    for result, along in ((schedule, "command (V)"), (varying, "time (s)")):
        figure, given = pyplot.subplots()
        axes = getattr(result, name)(given)
        assert axes is given
        assert all(
            text in "".join(ax.get_xlabel() + ax.get_ylabel() for ax in figure.axes)
            for text in ((along,) if name != "plot_poles" else (along, "Re z", "Im z"))
        )
    if name == "plot":
        assert "mm/V" in schedule.plot().get_ylabel()

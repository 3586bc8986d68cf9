"""The linearised plant against small-signal simulation, closed forms, and its own matrices."""

from dataclasses import replace

import control
import numpy as np
import pytest
from made_rigs import Gap
from scipy.signal import lfilter

import deatwin.control.linear.plant as plant_module
from deatwin.control.linear.model import LinearStatus
from deatwin.control.linear.plant import draw_plants, linearise_plant, linearise_plants
from deatwin.control.linear.realisation import Realisation
from deatwin.plant import (
    AmplifierSlew,
    BowTie,
    CalibratedPlant,
    ChargeInjection,
    Coupon,
    Creep,
    Delay,
    Diaphragm,
    DielectricAbsorption,
    ElectrodeRC,
    Leakage,
    ModelError,
    Planar,
    Plant,
    ReadingTime,
    Resonance,
    SensorLag,
    SensorSaturation,
    actuation_curve,
    thesis_plant,
)
from deatwin.plant.fleet import specification
from deatwin.plant.small_signal import small_signals

FILM = Plant(rig=Diaphragm())


def gap_voltage(position: float) -> float:
    return np.sqrt(position) * (1 - position)


def simulated(plant: Plant, command: float, size: float, settle: int, deviations: np.ndarray) -> np.ndarray:
    """Odd part of the answer to small deviations, by unit of the command, at the end of each sample."""
    readings = []
    for sign in (1.0, -1.0):
        rest = plant.rig.start.rest_command if settle else command
        stepper = plant.simulator.stepper(
            plant.free_values, rest_command=rest, start=0.0, sample_time=plant.rig.sample_time
        )
        for _ in range(settle):
            stepper.advance(command)
        readings.append([])
        for deviation in deviations:
            assert stepper.advance(command + sign * size * deviation).ok
            readings[-1].append(stepper.reading)
    return (np.array(readings[0]) - np.array(readings[1])) / (2 * size)


AT_START = Plant(rig=Gap(reading=ReadingTime.START_OF_HOLD))
STILL = {"permittivity_drift.relative_change": 0.0}
"""A simulation drifts by the clock, a linear model does not."""


@pytest.mark.parametrize(
    ("plant", "command", "size", "settle"),
    [
        pytest.param(FILM, 2.5, 1e-3, 0, id="diaphragm"),
        pytest.param(FILM, 3.75, 1e-4, 0, id="diaphragm near its largest gain"),
        # |v| bends the answer of hysteresis by the motion against its 30 µm, 4e-3 of it at 0.1 mV.
        pytest.param(thesis_plant().with_values(STILL), 2.5, 1e-6, 0, id="thesis"),
        pytest.param(specification(), 1.1, 1e-6, 0, id="specification"),
        pytest.param(FILM.with_effects(Creep()), 3.0, 1e-3, 0, id="creep"),
        # What is held at 0 V, the capacitance at rest, is held: the simulation has to walk from there.
        pytest.param(FILM.with_effects(ElectrodeRC()), 3.0, 1e-3, 600, id="electrode_rc"),
        pytest.param(FILM.with_effects(Delay(time=0.033)), 2.5, 1e-3, 0, id="delay"),
        pytest.param(FILM.with_effects(SensorLag()), 2.5, 1e-3, 0, id="sensor_lag"),
        # The corner of the slew rate is some volts of the film wide.
        pytest.param(FILM.with_effects(AmplifierSlew()), 2.5, 1e-4, 0, id="amplifier_slew"),
        pytest.param(FILM.with_effects(DielectricAbsorption(), Resonance()), 2.5, 1e-3, 0, id="absorption, mode"),
        pytest.param(Plant(rig=Coupon()), 1.0, 1e-3, 0, id="coupon"),
        pytest.param(Plant(rig=Planar()), 2.0, 1e-4, 0, id="planar"),
        pytest.param(Plant(rig=BowTie()), 3.0, 1e-4, 0, id="bow tie"),
        pytest.param(Plant(rig=Gap()), gap_voltage(0.2), 1e-4, 400, id="user's rig"),
        pytest.param(AT_START, gap_voltage(0.1), 1e-4, 400, id="read at the start"),
    ],
)
def test_it_answers_as_the_simulation_does_to_small_signals(plant, command, size, settle, uncompiled):
    deviations = np.random.default_rng(3).standard_normal(80)
    expected = simulated(plant, command, size, settle, deviations)
    linear = linearise_plant(plant, command).require()
    if plant.rig.reading is ReadingTime.START_OF_HOLD:
        assert linear.numerator[0] == 0.0
        expected = np.concatenate([[0.0], expected[:-1]])
    answer = lfilter(linear.numerator, linear.denominator, deviations)
    assert np.sqrt(np.mean((answer - expected) ** 2)) < 1e-4 * np.sqrt(np.mean(expected**2))


def test_a_users_rig_has_the_gain_and_the_pole_of_its_closed_form():
    for position in (0.05, 0.2, 0.3):
        linear = linearise_plant(Plant(rig=Gap()), gap_voltage(position))
        slope = (1 - position) ** 2 - 2 * position * (1 - position)
        voltage = gap_voltage(position)
        assert linear.static_gain == pytest.approx(2 * voltage / slope, rel=1e-9)
        assert linear.operating_output == pytest.approx(position, rel=1e-10)
        # Scheme of order 9 over a fifth of the time constant.
        stiffness = 1 - 2 * position / (1 - position)
        np.testing.assert_allclose(linear.poles, [np.exp(-0.02 / 0.1 * stiffness)], rtol=1e-10)
    assert (linear.input_name, linear.input_unit, linear.output_unit) == ("voltage", "V", "mm")


@pytest.mark.parametrize("command", [2.5, 4.1])
def test_a_resistance_leaves_the_static_gain_and_adds_its_lag(command):
    # At 4.1 V the film's capacitance is six times that at 0 V, which is held: the charge at rest lies far away.
    bare = linearise_plant(FILM, command)
    whole = linearise_plant(FILM.with_effects(ElectrodeRC(film_share=1.0)), command)
    assert whole.static_gain == pytest.approx(bare.static_gain, rel=1e-9)
    lag = linearise_plant(FILM.with_effects(ElectrodeRC(time=2.0, film_share=0.0)), command)
    # Of a lag that does not see the film, the pole is its own, beside those of the film.
    np.testing.assert_allclose(
        np.sort_complex(lag.poles), np.sort_complex([*bare.poles, np.exp(-0.02 / 2.0)]), rtol=1e-8
    )


MANY = (Creep(), ElectrodeRC(), Delay(time=0.033), SensorLag(), AmplifierSlew())


@pytest.mark.parametrize("effects", [(), (Creep(),), (Creep(time=400.0), ElectrodeRC()), MANY])
def test_coefficients_keep_the_response_of_the_matrices(effects):
    plant = thesis_plant().with_effects(*effects)
    linear, (small,) = linearise_plant(plant, 3.0), small_signals(plant, [3.0])
    omega = 2 * np.pi * np.geomspace(1e-3, 25.0, 300)
    exact = Realisation(a=small.a, b=small.b, c=small.c, d=small.d).response(np.exp(-0.02j * omega))
    # A slow pole at 0.9998 beside the film's at 0.97: (1 - p) products of 1e-5 of which the coefficients hold 1e-16.
    np.testing.assert_allclose(linear.response(omega), exact, rtol=1e-8)
    assert linear.detail == ""


def test_lost_digits_are_said():
    # Three slow modes beside the film's: a product of 1 - p of 1e-13, while coefficients up to 500 round to 1e-13.
    slow = (Creep(time=400.0), DielectricAbsorption(), ChargeInjection())
    plant = thesis_plant().with_effects(*slow, ElectrodeRC(), Resonance(), SensorLag(), AmplifierSlew())
    linear = linearise_plant(plant, 2.5)
    assert linear.status is LinearStatus.OK
    assert "slow modes" in linear.detail


THREE_BRANCHES = Plant(rig=Diaphragm(material="VHB 4910 Hossain 2012"), values={"shear_modulus": 25e3})
SLOW = (Creep(time=1500.0), DielectricAbsorption(), ChargeInjection())


@pytest.mark.parametrize(
    ("plant", "count"),
    [
        pytest.param(Plant(rig=Diaphragm(resolution="fine")), 26, id="fine film"),
        pytest.param(THREE_BRANCHES.with_effects(*SLOW), 8, id="slow modes"),
        pytest.param(thesis_plant().with_values(STILL), 3, id="with hysteresis"),
    ],
)
def test_many_modes_keep_their_static_gain_and_their_poles(plant, count, uncompiled):
    """The gain is the slope of the static curve, and all poles of a film at rest lie inside the unit circle."""
    linear = linearise_plant(plant, 2.4).require()
    assert linear.poles.size == count
    assert np.abs(linear.poles).max() < 1.0
    if "hysteresis" not in plant.effect_names:  # there the curve bends by the motion, and the model is a spring
        curve = actuation_curve(plant, np.array([2.398, 2.402]))
        assert linear.static_gain == pytest.approx(np.diff(curve.readings)[0] / 0.004, rel=1e-3)
    (small,) = small_signals(plant, [2.4])
    assert linear.static_gain == pytest.approx(small.static_gain, rel=1e-6)
    # What goes to python-control is the same system.
    omega = 2 * np.pi * np.geomspace(1e-4, 20.0, 9)
    np.testing.assert_allclose(linear.state_space()(np.exp(0.02j * omega)), linear.response(omega), rtol=1e-6)


def test_a_gain_that_is_not_the_slope_of_the_static_curve_is_no_sound_model(monkeypatch):
    def wrong(*arguments, **named):
        found = small_signals(*arguments, **named)
        return tuple(replace(small, static_gain=1.01 * small.static_gain) for small in found)

    monkeypatch.setattr(plant_module, "small_signals", wrong)
    linear = linearise_plant(FILM, 2.5)
    assert linear.status is LinearStatus.INACCURATE
    with pytest.raises(ModelError, match="static curve"):
        linear.require()


def test_modes_that_nothing_excites_are_left_out():
    # The memory of hysteresis follows the ball: with it the system has one mode more, which stays where it is.
    plant = thesis_plant()
    (small,) = small_signals(plant, [2.0])
    assert np.abs(np.linalg.eigvals(small.a) - 1.0).min() < 1e-12
    linear = linearise_plant(plant, 2.0).require()
    assert linear.denominator.size == len(small.a)
    assert np.abs(linear.poles).max() < 0.99


def test_a_system_of_hidden_modes_is_reduced_to_what_is_seen():
    rng = np.random.default_rng(5)
    seen = np.diag([0.99, 0.5, 0.2])
    whole = np.zeros((6, 6))
    whole[:3, :3] = seen
    whole[3:5, 3:5] = [[0.6, 0.5], [-0.5, 0.6]]  # a pair that is not excited
    whole[5, :] = [*rng.normal(size=5), 0.9]  # excited by all, not seen
    whole[:3, 3:5] = rng.normal(size=(3, 2))
    turn = rng.normal(size=(6, 6)) + 3 * np.eye(6)
    b, c = np.array([1.0, 2.0, -1.0, 0.0, 0.0, 1.0]), np.array([1.0, 0.5, 1.0, 0.3, 0.1, 0.0])
    system = Realisation(
        a=turn @ whole @ np.linalg.inv(turn), b=(turn @ b)[:, None], c=c @ np.linalg.inv(turn), d=np.array([0.3])
    )
    numerator, denominator = system.minimal().coefficients()
    np.testing.assert_allclose(denominator, np.poly([0.99, 0.5, 0.2]), atol=1e-11)
    expected = control.ss2tf(control.ss(seen, b[:3, None], c[None, :3], 0.3, 0.02))
    np.testing.assert_allclose(numerator, expected.num[0][0], atol=1e-10)


@pytest.mark.parametrize(
    ("plant", "command", "status"),
    [
        (Plant(rig=Gap()), 1.001 * gap_voltage(1 / 3), LinearStatus.NO_EQUILIBRIUM),
        (Plant(rig=Gap()), 0.999 * gap_voltage(1 / 3), LinearStatus.OK),
        (Plant(rig=Gap()), 0.0, LinearStatus.NO_GAIN),
        (Plant(rig=Gap(stiffness=-1.0)), 0.1, LinearStatus.UNSTABLE),
        (FILM, 0.0, LinearStatus.NO_GAIN),
        (thesis_plant().with_effects(*MANY), 0.0, LinearStatus.NO_GAIN),
        (FILM.with_effects(Leakage()), 0.0, LinearStatus.NO_GAIN),
        (FILM.with_effects(SensorSaturation()), 3.75, LinearStatus.NO_GAIN),
        (FILM, 4.5, LinearStatus.NO_EQUILIBRIUM),
        (Plant(rig=Coupon()), 0.0, LinearStatus.NO_EQUILIBRIUM),  # a strip of no length
        (thesis_plant(), 1e3, LinearStatus.NO_EQUILIBRIUM),
    ],
)
def test_status(plant, command, status):
    linear = linearise_plant(plant, command)
    assert linear.status is status
    assert np.isfinite(linear.numerator).all() and np.isfinite(linear.denominator).all()
    assert (linear.detail != "") == (not status.ok)


@pytest.fixture(scope="module")
def calibrated() -> CalibratedPlant:
    plant = Plant(rig=Gap())
    covariance = np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    return CalibratedPlant(
        plant=plant, noise=1e-3, model_error=0.0, names=("stiffness", "damping"), covariance=covariance
    )


def test_plants_are_drawn_with_the_covariance_of_the_calibration(calibrated):
    plants = draw_plants(calibrated, np.random.default_rng(1), 4000)
    values = np.array([[p.parameters[n].value for n in calibrated.names] for p in plants])
    # Standard errors of 4000 draws: 2.2 % of a variance.
    np.testing.assert_allclose(np.cov(values.T), calibrated.covariance, rtol=0.12)
    exact = CalibratedPlant.nominal(calibrated.plant)
    assert draw_plants(exact, np.random.default_rng(1), 2) == (calibrated.plant,) * 2


def test_samples_of_a_calibration_spread_as_the_derivative_of_the_gain_says(calibrated):
    position, voltage = 0.1, gap_voltage(0.1)
    family = linearise_plants(draw_plants(calibrated, np.random.default_rng(2), 200), [voltage])
    gains = family.static_gains[0]
    nearby = [linearise_plant(calibrated.plant.with_values({"stiffness": 1 + s}), voltage) for s in (-1e-4, 1e-4)]
    slope = (nearby[1].static_gain - nearby[0].static_gain) / 2e-4
    # 200 draws: 5 % of a deviation; the damping has no part in the static gain.
    assert gains.std() == pytest.approx(abs(slope) * 0.02, rel=0.15)
    assert position == pytest.approx(family.operating_outputs.mean(), abs=1e-3)


def test_logarithmic_parameters_are_drawn_in_their_coordinate_and_stay_in_range():
    plant = thesis_plant().with_effects(Creep())
    wide = CalibratedPlant(
        plant=plant, noise=1e-6, model_error=0.0, names=("creep.time",), covariance=np.array([[25.0]])
    )
    times = np.array([p.parameters["creep.time"].value for p in draw_plants(wide, np.random.default_rng(3), 200)])
    np.testing.assert_allclose([times.min(), times.max()], [2.0, 2000.0], rtol=1e-12)  # bounds of the parameter
    assert np.median(np.log(times / 60.0)) == pytest.approx(0.0, abs=1.5)


def test_a_family_of_plants_is_the_plants_one_by_one(calibrated):
    plants = draw_plants(calibrated, np.random.default_rng(4), 5)
    points = [0.1, gap_voltage(1 / 3), 0.3]  # of the second some pull in
    heard: list[float] = []
    family = linearise_plants(plants, points, progress=heard.append)
    assert heard[-1] == 1.0
    for i, point in enumerate(points):
        for k, plant in enumerate(plants):
            one, same = linearise_plant(plant, point), family.at(i, k)
            assert one.status is same.status
            omega = np.array([0.1, 3.0])
            np.testing.assert_allclose(same.response(omega), one.response(omega), rtol=1e-12)
    assert not family.exists[1].all() and family.exists[[0, 2]].all()

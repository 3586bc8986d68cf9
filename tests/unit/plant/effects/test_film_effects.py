"""Effects in the film, on a pulled strip and on the diaphragm, against closed forms."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from runs import readings as play
from scipy.special import erf

from deatwin.plant import BlockedPlanar, Coupon, Diaphragm, Planar, Plant, Roll
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.builder import Builder
from deatwin.plant.effects.mullins import Mullins
from deatwin.plant.effects.permittivity_drift import PermittivityDrift
from deatwin.plant.effects.permittivity_stretch import PermittivityStretch
from deatwin.plant.effects.prestretch_relaxation import PrestretchRelaxation
from deatwin.plant.effects.strain_stiffening import StrainStiffening
from deatwin.plant.effects.thermal_stiffness import ThermalStiffness
from deatwin.plant.film import Film, FilmPoint
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY
from deatwin.plant.parameters import ParameterSet

STRIP = Coupon()
AREA = STRIP.width * STRIP.thickness
MU, LIMIT, SAMPLE = 25e3, 107.0, 0.02
QUIET = {"damping": 0.5, "branch_modulus": 1.0}  # no ringing and no creep of the film's own
GRAVITY = 9.80665


pytestmark = pytest.mark.usefixtures("uncompiled")


def strip(stretch, *effects, start=0.0):
    return play(Plant(rig=STRIP, effects=effects), stretch, start)


def gent_force(stretch, modulus=MU, limit=LIMIT):
    extension = stretch**2 + 2 / stretch - 3
    return AREA * modulus * (stretch - stretch**-2) * limit / (limit - extension)


def gent_density(stretch):
    return -MU * LIMIT / 2 * np.log(1 - (stretch**2 + 2 / stretch - 3) / LIMIT)


def static_gain(plant, command, start=0.0):
    return play(plant, np.full(150, command), start)[-1]


def test_a_relaxing_strip_loses_its_share():
    effect = PrestretchRelaxation(relative_loss=0.2, time=30.0)
    times = 100.0 + SAMPLE * np.arange(1, 201)
    exact = gent_force(2.0) * (1 - 0.2 * (1 - np.exp(-times / 30.0)))
    np.testing.assert_allclose(strip(np.full(200, 2.0), effect, start=100.0), exact, rtol=1e-12)
    # Nothing decays before the clock's zero.
    np.testing.assert_allclose(strip(np.full(20, 2.0), effect, start=-10.0), gent_force(2.0), rtol=1e-12)


def test_a_relaxing_film_sinks_and_gains_together():
    # Sag goes with 1/tension: m g ln(B/r_c)/(2 pi N) (physics of small slopes; its own stiffening is 1 %).
    rig, loss = Diaphragm(), 0.02
    base = Plant(rig=rig, values=QUIET)
    relaxed = base.with_effects(PrestretchRelaxation(relative_loss=loss, time=20.0))
    stress = MU * (3.5**2 - 3.5**-4) * LIMIT / (LIMIT - (2 * 3.5**2 + 3.5**-4 - 3))
    sag = rig.mass * GRAVITY * np.log(rig.frame_radius / rig.contact_radius)
    sag /= 2 * np.pi * stress * rig.thickness / 3.5**2
    sunk = static_gain(relaxed, 0.0, start=1000.0)
    assert sunk == pytest.approx(sag * (1 / (1 - loss) - 1), rel=0.03)
    # A finite-element membrane gives d ln(stroke)/d ln(modulus) = -2.4 at 1.92 kV (contact radius 1.5 mm there).
    gain = (static_gain(relaxed, 2.4, start=1000.0) - sunk) / static_gain(base, 2.4)
    assert np.log(gain) / np.log(1 - loss) == pytest.approx(-2.4, rel=0.1)
    # Permittivity of the same size moves the gain by 1.45 and leaves the sag alone.
    drifted = base.with_effects(PermittivityDrift(relative_change=loss, time=20.0))
    assert abs(static_gain(drifted, 0.0, start=1000.0)) < 1e-12
    gain = static_gain(drifted, 2.4, start=1000.0) / static_gain(base, 2.4)
    assert np.log(gain) / np.log(1 + loss) == pytest.approx(1.45, rel=0.1)


def pull(*turns, rate=0.2):
    """Stretches that go from 1 to each of the turning points at a rate in 1/s."""
    points = (1.0, *turns)
    legs = [np.linspace(a, b, round(abs(b - a) / rate / SAMPLE), endpoint=False) for a, b in pairwise(points)]
    return np.concatenate([*legs, [points[-1]]])


def test_a_strip_softens_below_its_largest_stretch_only():
    effect = Mullins(softening=0.3, energy=8e3)
    path = pull(2.0, 1.2, 1.9, 1.1, 2.4, 1.5)
    force = strip(path, effect)
    largest = np.maximum.accumulate(path)
    below = (gent_density(largest) - gent_density(path)) / effect.energy
    exact = gent_force(path) * (1 - effect.softening * erf(below))
    # The maximum lags by T dw/dt, at most 2 ms * 0.2/s * 70 kJ/m³ = 0.004 m, and its corner and that of the
    # softening are rounded by 0.01 m each: the argument of erf errs by at most 0.024, so the force by 0.3 * 1.13 of it.
    np.testing.assert_allclose(force, exact, rtol=0.3 * 1.13 * 0.024)
    new = path >= largest - 1e-12
    np.testing.assert_allclose(force[new], gent_force(path[new]), rtol=1e-12)


def test_a_softened_strip_does_not_recover_and_does_no_work_below_its_maximum():
    effect = Mullins(softening=0.3, energy=8e3)
    there = np.concatenate([pull(2.0), np.full(50, 2.0)])
    back = there[::-1]
    force = strip(np.concatenate([there, back, np.ones(3000), there, back]), effect)
    first, second = force[: there.size], force[-2 * there.size : -there.size]
    assert (first - second).max() > 0.1 * first.max()
    # A minute later, the way up is the way down. The hold brought the maximum to 0.01 T/t = 2e-5 m of its end.
    np.testing.assert_allclose(second, force[-there.size :][::-1], rtol=0.3 * 1.13 * 1e-4)


def test_cycles_of_voltage_soften_once():
    plant = Plant(rig=Diaphragm(), values=QUIET)
    rise = 3.2 * np.linspace(0, 1, 400)  # 2.6 kV
    cycle = np.concatenate([rise, rise[::-1]])
    base = play(plant, np.tile(cycle, 2))
    soft = play(plant.with_effects(Mullins(softening=0.1, energy=3e3)), np.tile(cycle, 2))
    first, down, again = soft[:400], soft[400:800][::-1], soft[800:1200]
    np.testing.assert_allclose(first, base[:400], rtol=0, atol=1e-9)
    middle = slice(150, 300)  # 1 to 2 kV
    assert np.all(again[middle] - first[middle] > 5e-6)
    # Back along the same way, but for the lag of a damped ball: 0.5 N s/m on 25 N/m is 20 ms of the drive.
    lag = np.gradient(soft[800:1200], 0.02)[middle] * 2 * (0.5 / 25 + 0.02)
    assert np.all(np.abs(again - down)[middle] < 1.5 * lag + 1e-7)
    # At the top the film is as it was, but that its damped ball, on the first way up, went on a little at the turn.
    added = (again - first)[150:] / first[150:]
    assert abs(added[-1]) < 0.15 * added.max()


def test_a_strip_stiffens_by_what_gent_has_more_than_neo_hooke():
    stretch = pull(3.0)
    exact = gent_force(stretch) + gent_force(stretch, 10e3, 60.0) - AREA * 10e3 * (stretch - stretch**-2)
    force = strip(stretch, StrainStiffening(modulus=10e3, limit=60.0))
    np.testing.assert_allclose(force, exact, rtol=1e-10, atol=1e-14)
    small = 1 + 1e-4  # nothing is added at small stretch: of second order
    added = strip(np.full(3, small), StrainStiffening(modulus=10e3))[-1] / gent_force(small) - 1
    assert 0 < added < 1e-8


def permitting(effect, stretch):
    """Force against a stretch of a film that is one point under the electrode, at 1 V², and its permittivity."""
    build = Builder(ParameterSet(effect.parameters), (effect,))
    symbol = ca.SX.sym("stretch")
    point = FilmPoint(volume=1e-8, stretches=(symbol, symbol), radius=0.5)
    capacitance = 4.5 * VACUUM_PERMITTIVITY / (0.5e-3) ** 2 * 1e-8 * symbol**4
    film = Film(
        points=[point],
        elastic=ca.SX(0),
        capacitances=[capacitance],
        relaxed=lambda xi: [(xi, xi)],
        prestretches=(3.5, 3.5),
    )
    changed = effect.rewrite(film, build)
    slope = build.own("permittivity_stretch.slope")
    found = [ca.Function("f", [symbol, slope], [f.force(symbol, 1.0), f.capacitance]) for f in (film, changed)]
    return [[float(v) for v in f(stretch, effect.slope)] for f in found]


@pytest.mark.parametrize(
    "rig",
    [Roll(), Planar(sides="free", side_prestretch=3.0**-0.5), BlockedPlanar(prestretch=2.0)],
    ids=lambda r: r.kind,
)
def test_a_permittivity_is_that_of_the_prestretch_also_where_that_is_unequal(rig):
    with_law = Plant(rig=rig, effects=(PermittivityStretch(slope=-0.07),))
    found = [actuation_curve(p, np.array([0.0])).signals["capacitance"][0] for p in (Plant(rig=rig), with_law)]
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.mark.parametrize("stretch", [3.5, 4.2])
@pytest.mark.parametrize("slope", [-0.08, 0.05])
def test_a_stretched_permittivity_adds_electrostriction(stretch, slope):
    (ideal, capacitance), (force, changed) = permitting(PermittivityStretch(slope=slope), stretch)
    ratio = 1 + slope * 2 * (stretch - 3.5)
    assert changed / capacitance == pytest.approx(ratio, rel=1e-12)
    # d ln eps/d ln(lambda_i) of one direction, at equal stretches: c lambda/(eps/eps_0).
    electrostriction = 1 + slope * stretch / ratio / 2
    assert force / ideal == pytest.approx(ratio * electrostriction, rel=1e-12)


def test_a_stretched_permittivity_acts_like_a_smaller_one_at_small_stroke():
    # At 0.4 kV the film hardly moves: the Maxwell stress is multiplied by 1 + c lambda_p/2 where the film is flat.
    base = Plant(rig=Diaphragm(), values=QUIET)
    small = 0.5
    ratio = static_gain(base.with_effects(PermittivityStretch(slope=-0.07)), small) / static_gain(base, small)
    assert ratio == pytest.approx(1 - 0.07 * 3.5 / 2, abs=0.01)
    assert abs(static_gain(base.with_effects(PermittivityStretch(slope=-0.07)), 0.0)) < 1e-12


def test_a_strip_follows_the_swing_of_a_room_that_nobody_measured():
    effect = ThermalStiffness(change_per_kelvin=-0.03, period=40.0, phase=0.7)
    times = SAMPLE * np.arange(1, 1001)
    swing = np.cos(2 * np.pi * times / 40.0 + 0.7) - np.cos(0.7)
    np.testing.assert_allclose(strip(np.full(1000, 2.0), effect), gent_force(2.0) * (1 - 0.03 * swing), rtol=1e-12)


def test_a_strip_follows_the_thermometer_where_there_is_one():
    temperature = 295.0 + np.linspace(0, 4, 300)
    plant = Plant(rig=STRIP, effects=(ThermalStiffness(change_per_kelvin=0.02),))
    force = play(plant, np.full(300, 2.0), temperature=temperature)
    np.testing.assert_allclose(force, gent_force(2.0) * (1 + 0.02 * (temperature - 293.15)), rtol=1e-12)


@pytest.mark.parametrize("period", [100.0, 700.0, 1500.0])
def test_a_thermal_cycle_starts_from_the_residual(period):
    rng = np.random.default_rng(2)
    times = np.arange(0, 1000, 0.2)
    residual = 3e-6 * np.cos(2 * np.pi * times / period + 0.4) + 2e-6 * rng.standard_normal(times.size)
    starts = ThermalStiffness().starts(times, residual)
    assert 1 <= len(starts) <= 3
    assert starts[0].change_per_kelvin < 0  # softer is deeper
    # The grid's step is a factor of 1.08; a record shorter than the period leaves it uncertain by tens of percent.
    assert abs(np.log(starts[0].period / period)) < (0.08 if period < 1000 else 0.3)
    if period < 1000:
        assert abs(np.angle(np.exp(1j * (starts[0].phase - 0.4)))) < 0.6
    assert ThermalStiffness().starts(times[:10], residual[:10]) == ()

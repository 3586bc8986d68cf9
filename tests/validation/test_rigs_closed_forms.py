"""Planar, stack, bow-tie and roll against closed forms and energy balances.

A1, A2 and the dead-load table: free energy of an ideal dielectric elastomer (Zhao & Suo, Appl. Phys. Lett. 91
(2007) 061921, doi:10.1063/1.2768641). Films are neo-Hookean without branches here, so that closed forms are exact:
tolerances are those of Newton's method, of a bisection, or of the digits of a table, as each test says.
"""

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.optimize import brentq

import deatwin.plant.material as materials
from deatwin.plant import Parameter, Plant
from deatwin.plant.actuation import CurveEnd, actuation_curve
from deatwin.plant.laws.dielectric import VACUUM_PERMITTIVITY, maxwell_strain
from deatwin.plant.laws.energies import neo_hookean
from deatwin.plant.rigs.bow_tie import BowTie
from deatwin.plant.rigs.planar import BlockedPlanar, Planar
from deatwin.plant.rigs.roll import Roll
from deatwin.plant.rigs.stack import Stack

MU, RELATIVE = 25e3, 4.5
PERMITTIVITY = RELATIVE * VACUUM_PERMITTIVITY
FIELD = np.sqrt(MU / PERMITTIVITY)
NEO = "neo-Hookean"
THICKNESS = 0.5e-3
VOLTS = {"material": NEO, "gain": 1.0}
FREE = {"sides": "free", "side_prestretch": None, **VOLTS}


@pytest.fixture(autouse=True)
def _neo_hookean_material(monkeypatch):
    modulus = Parameter(name="shear_modulus", value=MU, unit="Pa", lower=1e3, upper=1e6)
    permittivity = Parameter(name="permittivity", value=RELATIVE, unit="1", lower=1.0, upper=10.0)
    film = materials.Material(name=NEO, energy=neo_hookean, elastic=(modulus,), branches=(), permittivity=permittivity)
    monkeypatch.setattr(materials, "MATERIALS", {**materials.MATERIALS, NEO: film})


def curve(rig, top, n=41):
    return actuation_curve(Plant(rig=rig), np.linspace(0.0, top, n))


def stress(first, second, field):
    """Nominal stress along 1 of a film under a nominal field."""
    return MU * (first - first**-3 * second**-2) - PERMITTIVITY * field**2 * first * second**2


# -- planar ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sides", ["equal", "free"])
def test_a1_the_free_film_pulls_in_at_26_per_cent(sides):
    found = curve(Planar(prestretch=1.0, sides=sides, **VOLTS), FIELD * THICKNESS)
    stretch = found.unknowns["position"][-1] / 50e-3
    assert found.end is CurveEnd.PULL_IN
    # E~ = sqrt(mu/eps) sqrt(l^-2 - l^-8) has its maximum sqrt(3) 2^(-4/3) at l = 2^(1/3). Newton ends where the
    # Jacobian is too flat for steps of 1e-11: the field is right to that, the stretch to its root.
    assert found.commands[-1] / THICKNESS / FIELD == pytest.approx(np.sqrt(3) * 2 ** (-4 / 3), rel=1e-9)
    assert found.commands[-1] / THICKNESS / FIELD == pytest.approx(0.6874, abs=5e-5)
    assert stretch == pytest.approx(2 ** (1 / 3), rel=1e-4)
    assert found.signals["field"][-1] / FIELD == pytest.approx(1.091, abs=5e-4)


# prestretch: stretch and nominal field at pull-in over the prestretch and sqrt(mu/eps); digits of the table
DEAD_LOAD = {2.0: (1.485, 0.1951), 3.0: (1.4987, 0.1285), 3.5: (1.4995, 0.1100)}


@pytest.mark.parametrize("prestretch", DEAD_LOAD)
def test_a2_dead_load_takes_pull_in_to_50_per_cent_at_a_lower_voltage(prestretch):
    found = curve(Planar(prestretch=prestretch, **VOLTS), FIELD * THICKNESS)
    assert found.end is CurveEnd.PULL_IN
    field = found.commands[-1] / THICKNESS / FIELD
    # e E² = mu (l^-2 - l^-8 - p l^-3) with p = P/mu = lp - lp^-5; its slope vanishes where 2 l^6 - 3 p l^5 - 8 = 0.
    load = prestretch - prestretch**-5
    roots = np.roots([2.0, -3.0 * load, 0, 0, 0, 0, -8.0])
    (stretch,) = roots[(abs(roots.imag) < 1e-9) & (roots.real > prestretch)].real
    assert field == pytest.approx(np.sqrt(stretch**-2 - stretch**-8 - load * stretch**-3), rel=1e-9)
    assert found.unknowns["position"][-1] / 50e-3 == pytest.approx(stretch, rel=1e-4)
    # The table, to half of its last digit.
    assert field == pytest.approx(DEAD_LOAD[prestretch][1], abs=5e-5)
    assert stretch / prestretch == pytest.approx(DEAD_LOAD[prestretch][0], abs=5e-4 if prestretch == 2.0 else 5e-5)


def test_the_linear_model_is_good_below_ten_per_cent_for_a_true_field_only():
    found = curve(Planar(prestretch=1.0, **VOLTS), 0.6873 * FIELD * THICKNESS, n=400)
    along = found.unknowns["position"] / 50e-3 - 1
    thinned = 1 - (1 + along) ** -2
    by_field = -maxwell_strain(RELATIVE, found.signals["field"], 3 * MU)
    by_voltage = -maxwell_strain(RELATIVE, found.commands / THICKNESS, 3 * MU)
    # With t = 1 - e the neo-Hookean film has eps E² / Y = (1/t - t²)/3 = e + e³/3 + e⁴/3 + ... in the true field,
    # and (t - t⁴)/3 = e - 2 e² + 4/3 e³ - e⁴/3 in the nominal one.
    low = (thinned > 1e-3) & (thinned < 0.1)
    assert np.all(np.abs(by_field[low] / thinned[low] - 1) < 0.4 * thinned[low] ** 2)
    at_ten = np.interp(0.1, thinned, by_voltage)
    assert at_ten == pytest.approx(0.1 - 2 * 0.01 + 4 / 3 * 1e-3 - 1e-4 / 3, rel=1e-3)
    along_ten = np.interp(0.1, thinned, by_field / 2 / along.clip(1e-12))
    assert along_ten == pytest.approx(0.928, abs=2e-3)  # (l² - l⁻⁴)/6/(l - 1) at l = 0.9^-1/2
    # At pull-in it has seen less than half of the strain.
    assert by_voltage[-1] < 0.5 * thinned[-1]


def test_clamped_sides_are_pure_shear():
    rig = Planar(prestretch=2.0, side_prestretch=3.0, sides="clamped", **VOLTS)
    found = curve(rig, 0.12 * FIELD * THICKNESS, n=5)
    assert found.end.ok
    held = stress(2.0, 3.0, 0.0)
    for voltage, position in zip(found.commands, found.unknowns["position"], strict=True):
        exact = brentq(lambda s, v=voltage: stress(s, 3.0, v / THICKNESS) - held, 1.5, 2.9, xtol=1e-14)
        assert position / rig.length == pytest.approx(exact, rel=1e-10)


def test_free_sides_follow_their_own_dead_loads():
    rig = Planar(prestretch=2.0, side_prestretch=4.0, sides="free", **VOLTS)
    found = curve(rig, 0.1 * FIELD * THICKNESS, n=5)
    assert found.end.ok
    along, across = found.unknowns["position"] / rig.length, found.unknowns["side_stretch"]
    field = found.commands / THICKNESS
    np.testing.assert_allclose(stress(along, across, field), stress(2.0, 4.0, 0.0), rtol=1e-9)
    np.testing.assert_allclose(stress(across, along, field), stress(4.0, 2.0, 0.0), rtol=1e-9)


def test_a_blocked_film_loses_the_maxwell_force_whatever_its_modulus():
    rig = BlockedPlanar(prestretch=2.0, side_prestretch=3.0, **VOLTS)
    found = curve(rig, 2000.0, n=5)
    section = rig.width * rig.thickness
    exact = section * (stress(2.0, 3.0, found.commands / THICKNESS) - stress(2.0, 3.0, 0.0))
    np.testing.assert_allclose(found.readings - found.readings[0], exact, rtol=1e-10, atol=1e-15)


# -- stack -------------------------------------------------------------------------------------------------------


def test_an_unloaded_stack_shortens_linearly_at_small_strain_and_pulls_in_as_a_free_film():
    rig = Stack(load=0.0, **VOLTS)
    found = curve(rig, FIELD * rig.thickness, n=101)
    height = rig.layers * rig.thickness
    strain = -maxwell_strain(RELATIVE, found.commands[1] / rig.thickness, 3 * MU)
    assert found.readings[1] == pytest.approx(height * strain, rel=3 * strain)  # next term: twice the strain
    assert found.commands[-1] / rig.thickness / FIELD == pytest.approx(np.sqrt(3) * 2 ** (-4 / 3), rel=1e-9)
    assert found.readings[-1] / height == pytest.approx(1 - 2 ** (-2 / 3), rel=1e-4)


def balance(found, elastic, work):
    """What the field has done along a slow path, over what the film stores and what was lifted: 1 if balanced.

    Integral of V²/2 dC = V²C/2 - integral of C V dV; by Simpson, whose error falls with the fourth power of the
    step and is below 1e-7 here.
    """
    volts, farads = found.commands, found.signals["capacitance"]
    field = volts[-1] ** 2 * farads[-1] / 2 - simpson(farads * volts, x=volts)
    return field / (elastic[-1] - elastic[0] + work)


def test_a_stack_lifts_its_load_with_the_work_of_the_field():
    rig = Stack(load=1.0, **VOLTS)
    found = curve(rig, 0.5 * FIELD * rig.thickness, n=201)
    assert found.end.ok
    third = 1 - found.unknowns["position"] / (rig.layers * rig.thickness)
    elastic = rig.layers * rig.area * rig.thickness * neo_hookean(third**-0.5, third**-0.5, MU)
    lifted = rig.load * (found.readings[-1] - found.readings[0])
    assert lifted > 0.1 * (elastic[-1] - elastic[0])
    assert balance(found, elastic, lifted) == pytest.approx(1.0, abs=1e-6)


# -- bow-tie -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("sides", "across"), [("free", None), ("clamped", 3.0)])
def test_a_bow_tie_of_constant_width_is_the_planar_strip(sides, across):
    size = {"length": 40e-3, "prestretch": 2.0, "sides": sides, **VOLTS}
    tie = BowTie(waist_width=30e-3, bar_width=30e-3, side_prestretch=across, **size)
    strip = Planar(width=30e-3, side_prestretch=tie.across, **size)
    top = 0.15 * FIELD * THICKNESS
    np.testing.assert_allclose(curve(tie, top, 9).readings, curve(strip, top, 9).readings, rtol=1e-9, atol=1e-15)


def stations(found, rig):
    """Widths, weights and stretches of a bow-tie's strips."""
    places, shares = np.polynomial.legendre.leggauss(rig.stations)
    places, shares = (1 + places) / 2, shares / 2
    widths = rig.waist_width + (rig.bar_width - rig.waist_width) * places
    along = [found.unknowns[f"stretch_{k}"] for k in range(rig.stations - 1)]
    rest = found.unknowns["position"] / rig.length - sum(s * a for s, a in zip(shares, along, strict=False))
    across = [found.unknowns[f"side_stretch_{k}"] for k in range(rig.stations)]
    return widths, shares, np.array([*along, rest / shares[-1]]), np.array(across)


def test_all_strips_of_a_bow_tie_carry_its_load_and_the_field_does_its_work():
    rig = BowTie(**FREE)
    found = curve(rig, 0.18 * FIELD * THICKNESS, n=201)
    assert found.end.ok
    widths, shares, along, across = stations(found, rig)
    field = found.commands / THICKNESS
    load = (rig.waist_width + rig.bar_width) / 2 * stress(1.5, 1.5**-0.5, 0.0)
    np.testing.assert_allclose(widths[:, None] * stress(along, across, field), load, rtol=1e-8)
    np.testing.assert_allclose(stress(across, along, field), 0.0, atol=1e-6 * MU)
    np.testing.assert_allclose(found.signals["field"], field * along[0] * across[0], rtol=1e-12)  # at the waist
    volumes = rig.length * rig.thickness * widths * shares
    elastic = volumes @ neo_hookean(along, across, MU)
    work = -load * rig.thickness * (found.readings[-1] - found.readings[0])
    assert balance(found, elastic, work) == pytest.approx(1.0, abs=1e-6)


def test_a_bow_tie_pulls_in_at_its_waist():
    tie = curve(BowTie(**FREE), FIELD * THICKNESS)
    strip = curve(BowTie(waist_width=40e-3, bar_width=40e-3, **FREE), FIELD * THICKNESS)
    assert tie.end is strip.end is CurveEnd.PULL_IN
    assert tie.commands[-1] < 0.9 * strip.commands[-1]
    _, _, along, _ = stations(tie, BowTie(**FREE))
    strain = along[:, -1] / along[:, 0] - 1
    assert np.all(np.diff(strain) < 0)
    assert strain[0] > 2 * strain[-1]


def test_four_stations_are_enough_for_a_bow_tie():
    top = 0.18 * FIELD * THICKNESS
    tie = curve(BowTie(**FREE), top, 9)
    # Gauss with n points, and a stretch that goes with 1/width: pole at 1/2 of the half length beyond the waist, so
    # the error falls as (2 + sqrt 3)^-2n, to 3e-5 with 4 points.
    fine = curve(BowTie(stations=8, **FREE), top, 9)
    assert tie.readings[-1] == pytest.approx(fine.readings[-1], rel=2e-3)
    finer = curve(BowTie(stations=6, **FREE), top, 9)
    assert abs(finer.readings[-1] - fine.readings[-1]) < 0.1 * abs(tie.readings[-1] - fine.readings[-1])


# -- roll --------------------------------------------------------------------------------------------------------


def test_a_roll_is_where_film_and_spring_balance():
    rig = Roll(load=0.2, **VOLTS)
    found = curve(rig, 0.12 * FIELD * THICKNESS, n=7)
    assert found.end.ok
    section = rig.width * rig.thickness
    free = rig.prestretch * rig.length + (section * stress(3.0, 4.5, 0.0) - rig.load) / rig.spring_rate

    def imbalance(stretch, voltage):
        film = section * stress(stretch, rig.hoop_prestretch, voltage / THICKNESS)
        return film - rig.spring_rate * (free - stretch * rig.length) - rig.load

    for voltage, reading in zip(found.commands, found.readings, strict=True):
        exact = brentq(imbalance, 2.5, 6.0, args=(voltage,), xtol=1e-14)
        assert reading == pytest.approx((exact - 3.0) * rig.length, rel=1e-9, abs=1e-14)
    assert found.readings[-1] > 1e-3

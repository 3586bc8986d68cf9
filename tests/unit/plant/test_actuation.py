"""Actuation curves: their end, their points, their picture."""

import numpy as np
import pytest

from deatwin.plant import Diaphragm, Plant, SensorLag, SimulationError
from deatwin.plant.actuation import CurveEnd, actuation_curve
from deatwin.plant.laws.breakdown import HUANG_2012
from deatwin.plant.rigs.planar import BlockedPlanar, Planar


def test_a_curve_does_not_depend_on_its_steps():
    plant = Plant(rig=Planar(prestretch=1.0))
    coarse, fine = (actuation_curve(plant, np.linspace(0, 12, n)) for n in (5, 121))
    assert coarse.end is fine.end is CurveEnd.PULL_IN
    assert coarse.commands[-1] == pytest.approx(fine.commands[-1], rel=1e-9)
    np.testing.assert_allclose(coarse.readings[1:4], fine.readings[30:120:30], rtol=1e-9)


@pytest.mark.parametrize("rig", [Planar(), Diaphragm()])
def test_a_lag_of_the_sensor_does_not_change_where_the_reading_comes_to_rest(rig):
    commands = np.array([0.5, 1.0, 1.5])
    plain, lagging = (actuation_curve(Plant(rig=rig, effects=e), commands) for e in ((), (SensorLag(),)))
    assert np.all(np.diff(plain.readings) > 0)
    np.testing.assert_allclose(lagging.readings, plain.readings, rtol=1e-9)
    settled = lagging.unknowns["lagged_reading"]
    np.testing.assert_allclose(settled, plain.readings, rtol=1e-9)


def test_breakdown_is_where_the_field_meets_the_law():
    rig = Planar()
    curve = actuation_curve(Plant(rig=rig), np.linspace(0, 10, 401))
    at = curve.breakdown_command
    stretch = np.interp(at, curve.commands, curve.unknowns["position"]) / rig.length
    limit = HUANG_2012.at(rig.thickness / stretch**2, stretch, stretch)
    # between two points of the curve: the second order of a step of 25 mV
    assert 800.0 * at * stretch**2 / rig.thickness == pytest.approx(limit, rel=1e-4)


def test_a_film_that_survives_has_no_breakdown():
    assert actuation_curve(Plant(rig=Planar()), np.linspace(0, 2, 5)).breakdown_command is None


def test_a_plant_without_rest_says_so():
    plant = Plant(rig=Planar(), values={"load": 1e5})
    with pytest.raises(SimulationError, match="no state of rest"):
        actuation_curve(plant, np.array([1.0]))


def test_the_picture_has_the_curve_and_its_end():
    curve = actuation_curve(Plant(rig=Planar(prestretch=1.0)), np.linspace(0, 12, 31))
    axes = curve.plot()
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 1e3 * curve.readings)
    assert [text.get_text() for text in axes.texts] == ["pulls in"]
    assert axes.get_xlabel() == "command (V)" and axes.get_ylabel() == "displacement (mm)"


def test_a_held_film_goes_slack_where_maxwell_stress_is_its_tension():
    rig = BlockedPlanar(prestretch=3.5, side_prestretch=3.5)
    curve = actuation_curve(Plant(rig=rig), np.linspace(0, 6, 121))
    gent = 25e3 * 107.0 / (107.0 - (2 * 3.5**2 + 3.5**-4 - 3)) * (3.5**2 - 3.5**-4)
    volts = rig.thickness / 3.5**2 * np.sqrt(gent / (4.5 * 8.8541878188e-12))
    # the stress is a parabola, taken as a line over 50 mV: (0.025 / 5)² / 2 of the command at most
    assert 800.0 * curve.slack_command == pytest.approx(volts, rel=1e-4)


def test_a_film_that_is_slack_or_broken_from_the_first_command_on_says_so():
    unstretched = BlockedPlanar(prestretch=1.0, side_prestretch=1.0)
    assert actuation_curve(Plant(rig=unstretched), np.array([0.0, 1.0, 2.0])).slack_command == 0.0
    pushed = Planar(sides="clamped", side_prestretch=0.3)
    assert actuation_curve(Plant(rig=pushed), np.array([0.5, 1.0])).slack_command == 0.5
    held = BlockedPlanar(prestretch=3.5, side_prestretch=3.5)  # breaks down at 10.2 kV, by the law of Huang et al.
    assert actuation_curve(Plant(rig=held), np.array([13.0, 14.0])).breakdown_command == 13.0


def test_a_film_that_hangs_free_has_no_tension_to_lose():
    for sides in ("equal", "free"):
        curve = actuation_curve(Plant(rig=Planar(prestretch=1.0, sides=sides)), np.linspace(0, 8, 5))
        assert curve.slack_command is None

"""The planar film's own: its loads and what it refuses."""

import numpy as np
import pytest
from scipy.optimize import brentq

from deatwin.plant import Plant, RigError, RunStatus
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.rigs.planar import Planar

MU, LIMIT = 25e3, 107.0

pytestmark = pytest.mark.usefixtures("uncompiled")


def test_the_dead_load_holds_the_prestretch():
    rig = Planar(prestretch=3.0, width=40e-3)
    gent = MU * LIMIT / (LIMIT - (2 * 9 + 1 / 81 - 3)) * (3.0 - 3.0**-5)
    assert Plant(rig=rig).parameters["load"].value == pytest.approx(gent * 40e-3 * 0.5e-3, rel=1e-12)
    curve = actuation_curve(Plant(rig=rig), np.array([0.0]))
    assert curve.unknowns["position"][0] == pytest.approx(3.0 * rig.length, rel=1e-10)
    assert curve.readings[0] == pytest.approx(0.0, abs=1e-14)


def test_it_says_what_it_cannot_be():
    with pytest.raises(RigError, match='did you mean "clamped"'):
        Planar(sides="clampd")
    with pytest.raises(RigError, match="equal sides have one prestretch"):
        Planar(prestretch=2.0, side_prestretch=3.0)
    with pytest.raises(RigError, match=r"a side_prestretch of at least 0\.5774, not 0\.1"):
        Planar(sides="free", side_prestretch=0.1)
    with pytest.raises(RigError, match=r"below its limit, here 7\.4"):
        _ = Planar(prestretch=8.0).parameters  # Gent's limit of 107 is at 7.4


def test_breakdown_has_a_status(experiment):
    simulation = Plant(rig=Planar()).simulate(experiment(np.linspace(0.0, 9.0, 400)))

    def gent(stretch):
        return MU * LIMIT / (LIMIT - (2 * stretch**2 + stretch**-4 - 3)) * (stretch - stretch**-5)

    def voltage(stretch):
        return 0.5e-3 * np.sqrt((gent(stretch) - gent(3.0)) / (4.5 * 8.8541878188e-12 * stretch**3))

    def beyond(stretch):  # Huang et al. 2012: 51 h^-0.25 l^0.63 MV/m with h in mm
        field = voltage(stretch) * stretch**2 / 0.5e-3
        return field - 51e6 * (0.5 / stretch**2) ** -0.25 * stretch**0.63

    at_rest = voltage(brentq(beyond, 5.0, 7.3)) / 800.0
    event = simulation.events[0]
    assert event.status is simulation.status is RunStatus.BREAKDOWN
    # The film is near its limit of stretch, so that it lags the ramp of 1.1 V/s by little strain.
    assert event.command == pytest.approx(at_rest, abs=0.1)

"""The measures of the story on signals whose answer is known, and on recordings that are made up."""

from typing import Any

import numpy as np
import pytest

from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording
from deatwin.scenarios.thesis_data.page import judge
from deatwin.scenarios.thesis_data.study import RATES, Bench, Loop, SmallVoltages, Study, cycle, side_bands

STEP = 0.02


def test_a_linear_plant_of_drifting_gain_makes_side_bands():
    found = side_bands()
    np.testing.assert_allclose(found.reached, found.expected, rtol=1e-6)
    assert found.superposition < 1e-13
    off = np.min(np.abs(found.frequencies[:, None] - found.line - found.drift * np.array([-1, 0, 1])), axis=1) > 1e-6
    assert found.outputs[off].max() < 1e-6
    assert side_bands(depth=0.0).outputs[off].max() < 1e-6


def test_triangles_of_a_loop_follow_each_other():
    pieces = cycle(0.01, STEP).recordings
    assert [p.start for p in pieces] == pytest.approx([0.0, 10.0, 20.0])
    assert pieces[-1].duration == pytest.approx(100.0)
    assert (pieces[-1].inputs.min(), pieces[-1].inputs.max()) == pytest.approx((1.1, 3.75))


def made_up(readings: Any) -> Study:
    """Six recordings of a static law, without drifts, and loops without area."""
    benches = []
    for actuator in fleet(0):
        u = actuator.excitation().recordings[0].inputs[0]
        y = readings(u) + 1e-6 * np.random.default_rng(actuator.seed).standard_normal(u.size)
        wave = cycle(0.01, STEP).recordings[-1].inputs[0]
        loop = Loop(commands=wave, displacements=readings(wave))
        benches.append(Bench(actuator=actuator, recording=Recording.from_arrays(u, y, STEP), loop=loop))
    # A trace of area, the same at each rate as hysteresis has it: there is none without hysteresis either.
    late = readings(np.roll(wave, 5))
    loops = tuple(Loop(commands=wave, displacements=late) for _ in RATES)
    return Study(benches=tuple(benches), loops=loops, elastic_loops=loops)


def test_actuators_that_do_nothing_of_it_do_not_pass():
    rows = {row.measure: row for row in judge(made_up(lambda u: 2e-4 * (u - 1.0)))}
    assert [row.passed for row in rows.values() if "straight line" in row.measure] == [True]
    others = [row for row in rows.values() if "straight line" not in row.measure]
    steady = [row for row in others if "steady" in row.demanded]
    assert len(others) > 15
    assert not any(row.passed for row in others if row not in steady), [row for row in others if row.passed]


def test_small_voltages_have_their_exponents():
    volts = np.array([40.0, 80.0, 160.0])
    rest = SmallVoltages(voltages=volts, displacements=1e-10 * volts**2, visible=140.0)
    np.testing.assert_allclose(rest.exponents, 2.0)

"""The steps of the story on systems whose answer is known, and its page on an actuator that is made up."""

from dataclasses import replace

import numpy as np
import pytest
from made_fleet import of_growing_gain
from pages import story_page

from deatwin.ident.narx import ThetaTrajectory, generate_terms
from deatwin.ident.narx.fleet import linear_in_output
from deatwin.ident.narx.varying_systems import MOVING_DC, SYSTEMS, drawn_walk
from deatwin.scenarios import time_varying
from deatwin.scenarios.time_varying import study
from deatwin.scenarios.time_varying.measures import judge
from deatwin.scenarios.time_varying.study import Driven, Study, analyse, covered, follow, frozen_run


def test_the_effect_of_a_moving_constant_in_closed_form(monkeypatch):
    monkeypatch.setattr(study, "TIMES", 20)
    # y = c + a y + q y² has the root below; about it the pole is a + 2 q ybar, so H_1 = b / (e^jw - a - 2 q ybar).
    found = study.known_systems((), (), [{1: np.ones((1, 1), bool), 2: np.ones((1, 1), bool)}])
    truth = MOVING_DC.truth()
    for time, output, value in zip(
        found.solved[1].timepts, found.solved[1].equilibria, found.solved[1].values[:, 0], strict=True
    ):
        c, a, b, q = truth.theta[:, int(np.argmin(np.abs(truth.timepts - time)))]
        root = ((1 - a) - np.sqrt((1 - a) ** 2 - 4 * q * c)) / (2 * q)
        assert output == pytest.approx(root, abs=1e-12)
        assert value == pytest.approx(b / (np.exp(2j * np.pi * 0.1 * 0.05) - a - 2 * q * root), rel=1e-12)
    assert np.ptp(found.held[3].gain) < 1e-12 < np.ptp(found.solved[3].gain)


def test_tones_measure_the_response_of_a_system_that_stands_still():
    # H_2(w, w) of y = a y1 + b u1 + q y1² is q H_1(w)² e^-2jw / (1 - a e^-2jw); what amplitude adds is 1e-5 of it.
    truth = MOVING_DC.truth(duration=60.0)
    still = replace(truth, theta=np.repeat(np.array([[0.0], [0.7], [0.5], [-0.15]]), truth.timepts.size, axis=1))
    omega = 2 * np.pi * 0.8
    z = np.exp(-1j * omega * 0.05)
    first = 0.5 * z / (1 - 0.7 * z)
    second = -0.15 * first**2 * z**2 / (1 - 0.7 * z**2)
    late = slice(800, None)
    np.testing.assert_allclose(study._probed(still, omega, 1)[late], first, rtol=1e-4)
    np.testing.assert_allclose(study._probed(still, omega, 2)[late], second, rtol=1e-4)


def test_walks_are_covered_or_not():
    rng = np.random.default_rng(1)
    walk = drawn_walk({"1": 2.0, "y(k-1)": 0.5}, (0.0, 0.3), 4000, rng)
    assert np.ptp(walk.theta[0]) == 0.0
    # The steps' variance, 0.3² over the samples, is known to 2.2 %; four times that is allowed.
    assert np.diff(walk.theta[1]).std() * np.sqrt(4000) == pytest.approx(0.3, rel=0.05)
    held = covered(rng, np.array([5.0, 15.0]), np.array([0.5, 2.0, 8.0]))
    assert {order: each.shape for order, each in held.items()} == {1: (2, 3), 2: (2, 3)}
    assert all(each.dtype == bool for each in held.values())


@pytest.fixture(scope="module")
def made():
    """A study of made-up actuators, drifting but for the last, and of known systems on coarse maps."""
    with pytest.MonkeyPatch.context() as patch:
        structure = tuple(generate_terms(1, (0, 1), 3, rule=linear_in_output))
        patch.setattr(study, "STRUCTURE", structure)
        patch.setattr(study, "MAP_TIMES", 12)
        patch.setattr(study, "TIMES", 12)
        falling, rising, still = (
            _analysed(name, drift, drawn)
            for name, drift, drawn in (("DEA 1", -0.3, True), ("DEA 2", 0.3, True), ("DEA 6", 0.0, False))
        )
        followed = tuple(follow(system, np.random.default_rng(5)) for system in SYSTEMS)
        frozen = tuple(run for system in SYSTEMS for speed in (2.0, 4.0) for run in frozen_run(system, speed))
        held = [covered(np.random.default_rng(k), study.COVERAGE_TIMES, study.COVERAGE_HZ) for k in range(4)]
        systems = study.known_systems(followed, frozen, held)
    plain = replace(rising, maps={}, whole=None, frozen={})
    driven = (falling, rising, *(replace(plain, track=replace(plain.track, name=f"DEA {n}")) for n in (3, 4, 5)), still)
    return Study(known=systems, driven=driven, stories=tuple(f"Story {n}." for n in range(1, 7)))


def _analysed(name: str, drift: float, drawn: bool) -> Driven:
    record = of_growing_gain(drift)
    return analyse(name, record, record, drawn=drawn)


def test_known_systems_are_followed(made):
    for one in made.known.followed:
        assert one.covered.min() > 0.85
        assert one.error("H1") < 0.05
    with pytest.raises(KeyError):
        made.known.followed[0].error("H2")


def test_what_does_not_hold_fails(made):
    rows = {row.measure: row.passed for row in judge(made)}
    assert len(rows) == len(judge(made))
    held_up = [passed for measure, passed in rows.items() if "last tenth" in measure or "G_1 U_1" in measure]
    assert held_up == [True, True]
    # Four and five rise where their histories fall for a while.
    assert [
        passed for measure, passed in rows.items() if measure.startswith("shifts of each actuator's equilibrium")
    ] == [False]
    swapped = replace(made, driven=(made.driven[1], made.driven[0], *made.driven[2:]))
    assert [row.passed for row in judge(swapped) if "last tenth" in row.measure] == [False]


def test_the_page_shows_all_of_it(made, setting, tmp_path, monkeypatch):
    monkeypatch.setattr(time_varying, "carry_out", lambda *_, **__: made)
    result = time_varying.run(setting)
    page = story_page(
        tmp_path,
        "parameters moving_dc frozen coverage sliding theta equilibria bands tv_gfrf tv_nofrf short_time".split(),
    )
    reached = sum(row["passed"] for row in result["measures"])
    assert f'<span class="verdict bad">{reached} of {len(result["measures"])}' in page
    for number, one in enumerate(made.driven, start=1):
        loaded = ThetaTrajectory.load(tmp_path / f"theta/dea{number}.json")
        np.testing.assert_allclose(loaded.theta[:, -1], one.track.trajectory.theta[:, -1])
    assert "We do not know what the other nine figures show" in page
    assert [one["actuator"] for one in result["actuators"]] == [f"DEA {n}" for n in range(1, 7)]

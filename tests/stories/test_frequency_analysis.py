"""The closed forms against simulation, the measures on made-up actuators, and the page of the story."""

from dataclasses import replace

import numpy as np
import pytest
from made_fleet import STEP, made_fleet
from pages import story_page

from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet import OPERATING_INPUT
from deatwin.scenarios import frequency_analysis
from deatwin.scenarios.frequency_analysis.actuators import actuators, anchor
from deatwin.scenarios.frequency_analysis.known import known_systems
from deatwin.scenarios.frequency_analysis.measures import judge, spread

made = pytest.fixture(scope="module")(made_fleet)


@pytest.fixture(scope="module")
def found(made):
    return actuators(made, np.random.default_rng(0), draws=100)


@pytest.fixture(scope="module")
def known():
    return known_systems(np.random.default_rng(0), recordings=20)


def test_measures_of_known_actuators(made, found):
    # Equal laws of three gains: |H_1| differs by these at all frequencies, within what 260 s of this noise tell.
    assert spread(found.each, 0.01) == pytest.approx(0.5, abs=0.05)
    assert spread(found.each, 1.0) == pytest.approx(0.5, abs=0.05)
    # Of the law itself: H_2 with a ridge. The truth's ratio, for the estimated models to be near.
    law = NarxModel.from_terms({"y(k-1)": 0.55, "u(k)^2": 1e-5, "u(k-1)^2": 1e-5, "u(k)u(k-1)": 1e-5}, sample_time=STEP)
    near = 2 * np.pi * np.array([0.1, 0.2, 0.3])
    second = [gfrf(law, 2, np.column_stack([near, s * near]), operating_input=OPERATING_INPUT).gain for s in (-1, 1)]
    for one in found.each:
        assert one.ridge == pytest.approx(float(np.mean(second[0] / second[1])), rel=0.05)
        assert one.removal.error < 1e-10 and one.nofrfs.sum_error < 1e-6
    assert found.side.by_random.status.name == "ERRATIC_EXCITATION" and found.side.designed.status.ok
    inputs = np.array([one.sections[0].inputs[0] for one in made.actuators]) - OPERATING_INPUT
    assert found.signal.amplitude == pytest.approx(min(-inputs.min(axis=1).max(), inputs.max(axis=1).min()))


def test_the_page_and_what_fails_on_it(made, found, known, setting, tmp_path, monkeypatch):
    monkeypatch.setattr(frequency_analysis, "identify_fleet", lambda *_, **__: made)
    monkeypatch.setattr(frequency_analysis, "known_systems", lambda *_: known)
    monkeypatch.setattr(frequency_analysis, "actuators", lambda *_, **__: found)
    monkeypatch.setattr(frequency_analysis, "anchor", lambda one, fleet: anchor(one, fleet, (0.2, 0.4, 1.0)))
    result = frequency_analysis.run(setting)
    page = story_page(
        tmp_path,
        "ranges benchmark_gfrfs benchmark_nofrfs identified removal gfrf1 gfrf2 test_signal nofrfs sampled".split(),
    )
    for number in (1, 2, 3):
        loaded = NarxModel.load(tmp_path / f"models/dea{number}.json")
        np.testing.assert_array_equal(loaded.theta, made.actuators[number - 1].model.theta)
    rows = {row["measure"]: row["passed"] for row in result["measures"]}
    # The recordings are not of these films, and the gains differ alike at all frequencies: both is told.
    missed = [measure for measure, passed in rows.items() if not passed]
    assert any(measure.startswith("relative spread of |H₁|") for measure in missed)
    assert any("the true response of the film" in measure for measure in missed)
    assert f'<span class="verdict bad">{sum(rows.values())} of {len(rows)}' in page
    assert "table 4.3" in page and "figure 4.12" in page


def test_verdicts_fail_where_they_should(found, known, made):
    truth = anchor(made.actuators[0], made, (0.5, 1.0))
    sound = {row.measure: row.passed for row in judge(known, found, truth)}
    first = found.each[0]
    moved = replace(first.removal, shifted_run=first.removal.run + 1e-9)
    spoilt = replace(
        found,
        each=(
            replace(first, nofrfs=replace(first.nofrfs, simulated=1.01 * first.nofrfs.simulated), removal=moved),
            *found.each[1:],
        ),
        side=replace(found.side, designed_inputs=found.side.random_inputs),
    )
    wrong = replace(known, errors={"S2": {1: 1e-9}})
    now = {row.measure: row.passed for row in judge(wrong, spoilt, truth)}
    lost = {measure for measure, passed in sound.items() if passed and not now[measure]}
    for words in (
        "closed forms",
        "rewritten in deviations",
        "can amplify",
        "error of the sum of all orders GₙUₙ, relative",
    ):
        assert sum(words in measure for measure in lost) == 1, words

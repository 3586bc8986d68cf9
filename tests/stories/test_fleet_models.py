"""The choices of `semp-fleet` and `svb-fleet` on made-up numbers, and their pages on a plant whose law is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_fleet import NOISE, of_second_degree, plan_of

from deatwin.app.stories import story
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.fleet import FILM, RECORDED, STEADY, VARIANTS, Prepared
from deatwin.ident.narx.preprocess import choose_sampling, choose_sections, inspect_recordings
from deatwin.plant.fleet import fleet
from deatwin.scenarios.fleet_models import semp_fleet, svb_fleet
from deatwin.scenarios.fleet_models.page import Choice, estimate_all, judge_semp, judge_svb, shares
from deatwin.scenarios.fleet_models.study import FREE, FROLS, LINEAR, SEMP, SVB, Bench, Programme, Study, identify

BOTH = Programme(methods=(SEMP, SVB), beside=(FROLS, FREE))


def test_numbers_of_terms_by_bound_and_by_threshold():
    choice = Choice(
        terms=np.array([5.0, 3.0, 2.0, 1.0]),
        bounds=np.array([7.0, 9.0, 8.0, 1.0]),
        bound_errors=np.ones(4),
        err=np.array([0.9, 0.05, 2e-3, 0.03, 1e-5]),
        err_errors=np.ones(5),
    )
    assert choice.by_bound == 3
    assert [choice.by_threshold(t) for t in (1e-2, 1e-3, 1e-6)] == [2, 4, 5]


@pytest.fixture(scope="module")
def sound():
    """A plant that does not drift, identified from candidates that hold its law."""
    record = of_second_degree(1500)
    sections = record.section(0, 1000), record.section(1000, 1500)
    return identify("DEA 1", RECORDED, sections, plan_of((1, 1), 2, count=6), BOTH)


@pytest.fixture(scope="module")
def drifting():
    """The same, with a drift of fifty times the noise."""
    record = of_second_degree(1500, drift=50 * NOISE)
    sections = record.section(0, 1000), record.section(1000, 1500)
    return identify("DEA 1", RECORDED, sections, plan_of((1, 1), 2, count=6), BOTH)


def test_a_plant_among_the_candidates_is_found(sound):
    truth = {"y(k-1)": 0.6, "u(k)^2": 1e-4, "u(k-1)^2": -2e-5, "y(k-1)u(k)": 0.02}
    for method in (SEMP, SVB):
        found = sound.models[method]
        assert float(found.held_out.free_run.rms[0]) < 2 * NOISE  # as above
        assert found.passed >= 4  # each fails with a chance of 1 %
        model = found.model
        assert set(truth) <= {str(term) for term in model.terms}
    estimated = {name: e.model for name, e in estimate_all(sound.models[SEMP].model.terms, sound.sections).items()}
    assert set(estimated) >= {"least squares", "least prediction error"}
    np.testing.assert_allclose(estimated["least squares"].theta, sound.models[SEMP].model.theta)
    assert set(sound.models) == {SEMP, SVB, LINEAR, FROLS, FREE}


def test_a_drift_makes_tests_fail(sound, drifting):
    for method in (SEMP, SVB):
        assert drifting.models[method].passed < sound.models[method].passed
        assert "ee" in {test.name for test in drifting.models[method].held_out.failed}
        assert drifting.models[method].fit < sound.models[method].fit


def test_only_what_a_programme_asks_for_is_identified():
    record = of_second_degree(700)
    sections = record.section(0, 500), record.section(500, 700)
    plan = plan_of((1, 0), 2, count=6)
    asked = {v: set(identify("DEA 1", v, sections, plan, semp_fleet.PROGRAMME).models) for v in (RECORDED, STEADY)}
    assert asked == {RECORDED: {LINEAR, SEMP, FROLS}, STEADY: {LINEAR, SEMP}}


@cache
def prepared() -> tuple[Prepared, ...]:
    record = of_second_degree(24_000)
    one = Prepared(
        actuator=fleet(0)[0],
        recordings=dict.fromkeys(VARIANTS, record),
        findings=inspect_recordings(record),
        sections=choose_sections(record, n_segments=40),
        sampling=choose_sampling(record, n_lags=100),
    )
    return tuple(replace(one, actuator=actuator) for actuator in fleet(0))


def whole(recorded: Bench, steady: Bench, methods: tuple[str, ...]) -> Study:
    of = {RECORDED: recorded, STEADY: steady, FILM: steady}
    benches = {v: tuple(replace(of[v], name=one.name) for one in fleet(0)) for v in VARIANTS}
    plan = plan_of((1, 1), 2, count=6)
    return Study(prepared=prepared(), plan=plan, benches=benches, methods=methods)


PAGES = {
    "semp-fleet": (
        semp_fleet,
        ("table B.1", "table 4.1", "table 4.2", "table 4.3"),
        ("orders", "semp", "tests_dea5", "tests_dea6"),
    ),
    "svb-fleet": (
        svb_fleet,
        ("table 6.4", "table D.1", "table D.2"),
        ("pruning", "posterior", "tests_dea5", "tests_dea6", "choice"),
    ),
}


@pytest.mark.parametrize("name", PAGES)
def test_the_page_shows_what_fails(name, sound, drifting, setting, tmp_path, monkeypatch):
    module, tables, figures = PAGES[name]
    study = whole(drifting, sound, module.PROGRAMME.methods)
    monkeypatch.setattr(module, "carry_out", lambda *_, **__: study)
    result = story(name).run(setting)
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert "fails, " in page and "passes" in page
    rows = {row["measure"]: row["passed"] for row in result["measures"]}
    assert not any(passed for measure, passed in rows.items() if "correlation tests" in measure)
    assert f"{sum(rows.values())} of {len(rows)} goals reached" in page
    method = module.PROGRAMME.methods[-1]
    for number in range(1, 7):
        loaded = NarxModel.load(tmp_path / f"models/dea{number}_{method.lower()}.json")
        np.testing.assert_array_equal(loaded.theta, drifting.models[method].model.theta)
    assert not [table for table in tables if table not in page]
    assert {file.stem for file in (tmp_path / "figures").glob("*.csv")} == set(figures)
    assert not [figure for figure in figures if f"figures/{figure}.csv" not in page]
    assert len(result["models"]) == 6 * 3 * len(sound.models) and (tmp_path / "run.json").is_file()


def test_the_posterior_s_share_is_the_parameter_times_its_term(sound):
    # The only term of degree 0 or of the past reading alone whose root mean square is plain: y(k-1).
    model, section = sound.models[SVB].model, sound.sections[0]
    place = [str(term) for term in model.terms].index("y(k-1)")
    size = np.sqrt(np.mean(section.outputs[0, model.table.max_lag - 1 : -1] ** 2))
    middle, low, high = shares(model, sound)[:, place]
    assert middle == pytest.approx(model.theta[place] * size) and low < middle < high


def test_a_sound_fleet_passes(sound):
    # There is no drift and no hysteresis to tell apart, and single tests fail by chance.
    left_out = ("without drift", "hysteresis", "correlation tests")
    study = whole(sound, sound, (SEMP, SVB))
    rows = [row for row in (*judge_semp(study), *judge_svb(study)) if not any(word in row.measure for word in left_out)]
    assert len(rows) == 9
    # Of a noise a thousandth of the readings the published priors make more: over 99 % of the readings are in the band.
    missed = [row for row in rows if not row.passed]
    assert ["one-step 95 % band" in row.measure and row.reached.startswith(("99", "100")) for row in missed] == [True]

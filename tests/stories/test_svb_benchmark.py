"""The parts of the benchmark against closed forms and brute force, and its page on few draws."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from pages import story_page

from deatwin.ident.narx import FitStatus, Frols
from deatwin.ident.narx.spike_slab import Margin
from deatwin.plant.errors import DataError
from deatwin.plant.records import plain
from deatwin.scenarios import svb_benchmark
from deatwin.scenarios.svb_benchmark import draws, study
from deatwin.scenarios.svb_benchmark.draws import METHODS, Contrast, Trial, consult, draw_of, system_of, try_out
from deatwin.scenarios.svb_benchmark.page import judge
from deatwin.scenarios.svb_benchmark.study import WHITE, Answer, Draws, Plan, Study, carry_out

SMALL = Plan(systems=("S2", "E1"), methods=("fro", "svb"), draws=1, swept_draws=1, sampled_draws=1, levels=(0.004,))


def test_the_oracle_takes_the_best_threshold():
    # Right for thresholds in [1, 3), [2, 5), [4, 6) and never: at best two at once, first by 2.
    pairs = ((3.0, 1.0), (5.0, 2.0), (6.0, 4.0), (1.5, np.inf))
    found = consult([Margin(true=true, false=false) for true, false in pairs])
    assert (found.threshold, found.exact.hits, found.kept.hits) == (2.0, 2, 3)


def test_draws_are_spawned_of_the_seed():
    child = np.random.SeedSequence(3).spawn(4)[3].spawn(3)[2]  # the third draw of S4
    expected = system_of("S4").draw(np.random.default_rng(child)).recording.outputs
    np.testing.assert_array_equal(draw_of(system_of("S4"), 3, 2).recording.outputs, expected)


def test_a_trial_counts_what_is_missed_and_what_is_false():
    told = try_out("S1", "fro-told", 0, 0)  # known: forward regression takes y(k-4) and u(k-4) on S1
    assert {"y(k-4)", "u(k-4)"} <= set(told.terms)
    assert (told.missed, told.false, told.exact, told.kept) == (2, 2, False, False)
    assert len(told.theta) == len(told.low) == len(told.high) == 4


def wrong(system: str, method: str, number: int) -> Trial:
    return Trial(
        system=system,
        method=method,
        number=number,
        redraws=0,
        terms=("1",),
        theta=(0.0,),
        low=(0.0,),
        high=(0.0,),
        missed=1,
        false=1,
        seconds=0.1,
    )


def test_methods_that_are_always_wrong_do_not_pass():
    plan = Plan()
    margin = Margin(true=5.0, false=1.0)
    contrast = Contrast(full=margin, near=margin, redraws=0, snr_db=20.0, condition=10.0)
    found = Study(
        plan=plan,
        trials=tuple(wrong(s, m, 0) for s in plan.systems for m in plan.methods),
        contrasts={system: (contrast,) for system in plan.systems},
        covered={(system, "least squares"): np.zeros((200, 4), dtype=bool) for system in WHITE},
        levels=(),
        comparisons=(),
    )
    rows = judge(found)
    assert len(rows) >= 1
    assert not any(row.passed for row in rows)


def test_the_page_is_whole(setting, tmp_path, monkeypatch):
    monkeypatch.setattr(svb_benchmark, "PLAN", SMALL)
    monkeypatch.setattr(draws, "FLIPS", 1000)
    shares: list[float] = []
    result = svb_benchmark.run(replace(setting, progress=lambda share, text: shares.append(share)))
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0)
    story_page(tmp_path, ("rates", "outcomes", "sweep"))
    titles = [table["title"] for table in result["tables"]]
    assert all(title.startswith(METHODS[method].label) for title, method in zip(titles, SMALL.methods, strict=False))
    assert [[row[0] for row in table["rows"]] for table in result["tables"][:3]] == [list(SMALL.systems)] * 3
    lines = (tmp_path / "trials.csv").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 1 + 2 * 2


def test_draws_of_another_seed_plan_or_code_are_refused(tmp_path, monkeypatch):
    plan = asdict(SMALL)
    Draws(tmp_path, 0, plan)
    with pytest.raises(DataError, match=r"another seal \(seed: 0 there, 1 now\)"):
        Draws(tmp_path, 1, plan)
    with pytest.raises(DataError, match=r"another seal \(plan: "):
        Draws(tmp_path, 0, asdict(Plan()))
    monkeypatch.setattr(study, "OWN", study.OWN[1:])
    with pytest.raises(DataError, match=r"another seal \(code: [0-9a-f]{12} there, [0-9a-f]{12} now\)"):
        Draws(tmp_path, 0, plan)


def test_a_malformed_case_is_told_of_before_any_is_run(tmp_path, monkeypatch):
    Draws(tmp_path, 0, asdict(SMALL)).put("S2-000", {"trials": [{"system": "S2"}]})
    monkeypatch.setattr(study, "_answered", lambda *_: pytest.fail("a case was run"))
    with pytest.raises(DataError, match=r"S2-000\.\w+: it must hold a case .*; delete it, and it is run again"):
        carry_out(tmp_path, 0, SMALL, jobs=1, tell=lambda *_: None)


def test_an_answer_comes_back_from_its_file_as_it_was(tmp_path):
    never = Contrast(
        full=Margin(true=5.0, false=math.inf),
        near=Margin(true=1 / 3, false=1.0),
        redraws=2,
        snr_db=20.0,
        condition=math.inf,
    )
    flags = np.array([[True, False], [True, True]])
    answer = Answer(trials=(wrong("S2", "fro", 7),), contrast=never, covered={"least squares": flags})
    store = Draws(tmp_path, 0, {})
    store.put("one", plain(answer))
    back = store.answer("one")
    assert (back.trials, back.contrast, back.comparison) == (answer.trials, never, None)
    np.testing.assert_array_equal(back.covered["least squares"], flags)


def test_an_interrupted_fit_is_no_trial(monkeypatch):
    # Identifiers keep their best when interrupted and return; the study must not take that for a result and go on.
    def fit(self: Frols, recordings: object) -> Frols:
        self.model_, self.status_ = system_of("S2").model, FitStatus.INTERRUPTED
        return self

    monkeypatch.setattr(Frols, "fit", fit)
    with pytest.raises(KeyboardInterrupt):
        try_out("S2", "fro", 0, 0)

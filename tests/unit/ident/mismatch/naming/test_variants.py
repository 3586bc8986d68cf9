"""Other forms of the plant, on residuals whose sizes are given: which is taken, and what is looked for there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming import sets, variants
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming, decide
from deatwin.ident.mismatch.naming.decisions import decided
from deatwin.ident.mismatch.naming.name import _best_variant, _with_more
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.variants import with_fewer
from deatwin.ident.mismatch.refit.base import _preferred


@pytest.fixture
def form(noise, is_adequate):
    """``form(*explanations, least=1.0)``: a search in one form of the rig, and what it decided."""

    def make(*explanations: Candidate, least: float = 1.0):
        search = SimpleNamespace(least=lambda stage: least, missing=lambda stage: 9.0 if stage == [()] else least)
        return search, [], decide(explanations, explanations, noise, is_adequate, is_adequate)

    return make


@pytest.fixture
def scripted(nothing, monkeypatch):
    """``scripted(stages, most=True)``: a search whose decisions over one effect, two and three are given."""

    def make(stages: list[Naming], most: bool = True):
        search = SimpleNamespace(
            with_one_more=lambda stage, told: [("a", "b")], one_takes_most=lambda stage: most, left=iter(stages[1:])
        )
        return search, [("a",)], stages[0]

    name = "deatwin.ident.mismatch.naming.name"
    monkeypatch.setattr(f"{name}.decided_surely", lambda search, stage: next(search.left))
    monkeypatch.setattr(f"{name}.settled", lambda search, stage: nothing)
    monkeypatch.setattr(f"{name}.nearly", lambda search: nothing)
    return make


@pytest.fixture
def elsewhere(search_over, monkeypatch):
    """What sets of effects leave in another form of the plant, instead of fits; the stages that are judged there."""

    def leave(*known: Candidate) -> list[list[tuple[str, ...]]]:
        judged: list[list[tuple[str, ...]]] = []

        def begun(search: Search, form: Candidate) -> Search:
            other = search_over(form)

            def attempt(sets, alternative):
                found = {c.effects: c for c in known if c.effects in sets}
                other.tried.update(found)
                return list(found)

            fakes = {
                "attempt": attempt,
                "judge_by_the_best": judged.append,
                "fit_from": lambda *_: None,
                "fit_subsets": lambda subsets: [attempt([rest], np.inf) for rest in subsets],
            }
            for name, does in fakes.items():
                monkeypatch.setattr(other, name, does)
            return other

        monkeypatch.setattr(variants, "_begun", begun)
        return judged

    monkeypatch.setattr(variants, "_trial", lambda search, full, form, names: names)
    return leave


@pytest.fixture
def pair_of_a_delay(candidate, search_over):
    pair = candidate("delay", "end_stop", rms=2.05)
    search = search_over(candidate(rms=5.7), candidate("end_stop", rms=4.9), candidate("delay", rms=4.5), pair)
    return search, decided(search, [pair.effects])


def test_another_form_replaces_the_nominal_one_only_where_that_leaves_a_mismatch(candidate):
    right, wrong = candidate(rms=2.1), candidate(rms=3.1)
    rough, calibration = np.random.default_rng(0).standard_normal(7000), right.calibration
    rough *= 2.36 / np.sqrt(np.mean(rough**2))
    nearly = replace(right, calibration=SimpleNamespace(**{**vars(calibration), "residuals": rough}))
    # 2.36² - 2² is 1.25², and the floor is 1.2²: too much by a hair, which no test calls a mismatch
    assert not nearly.adequate and not nearly.mismatch
    assert _preferred([nearly, right]) is nearly
    assert _preferred([wrong, nearly, right]) is right
    assert _preferred([wrong, nearly]) is nearly
    assert _preferred([wrong, wrong]) is wrong


def test_the_form_in_which_one_effect_explains_clearly_more_is_taken(candidate, form):
    nominal, other = form(candidate("delay", rms=2.3)), form(candidate("electrode_rc", rms=2.0))
    search, _, naming = _best_variant([nominal, other])
    assert search is other[0]
    assert naming.best.effects == ("electrode_rc",)
    assert naming.alternatives == ()


def test_what_suffices_in_another_form_stays_possible(candidate, form):
    nominal = form(candidate("delay", rms=2.101))
    other = form(candidate("delay", rms=2.1), candidate("sensor_lag", rms=2.102))
    search, _, naming = _best_variant([nominal, other])
    assert search is nominal[0]  # no form is taken for nothing
    assert [naming.best.effects, *(alternative.effects for alternative in naming.alternatives)] == [
        ("delay",),
        ("sensor_lag",),
    ]
    assert ("sensor_lag",) in [candidate.effects for candidate in naming.candidates]
    assert sum(naming.probabilities.values()) == pytest.approx(1.0)
    assert 0.3 < naming.probabilities["sensor_lag",] < 0.5  # the residuals are nearly equal


@pytest.mark.parametrize("effect, taken", [("delay", 0), ("sensor_drift", 1)])
def test_another_effect_in_another_form_leads_where_the_evidence_for_it_is_strong(candidate, form, effect, taken):
    # 2.15² - 2.1² is 0.46², less than half of the plant's error, but 100 ln(2.15/2.1)² are 4.7 nats: a hundred to one
    forms = [form(candidate("delay", rms=2.15)), form(candidate(effect, rms=2.1))]
    search, _, naming = _best_variant(forms)
    assert search is forms[taken][0]
    if taken:
        assert [alternative.effects for alternative in naming.alternatives] == [("delay",)]


@pytest.mark.parametrize("least, taken", [(0.79, 1), (0.81, 0)])
def test_where_nothing_suffices_a_form_must_leave_clearly_less(candidate, form, least, taken):
    forms = [form(candidate("delay", rms=9.0)), form(candidate("creep", rms=8.0), least=least)]
    assert _best_variant(forms)[0] is forms[taken][0]


@pytest.mark.parametrize("bare, taken", [(3.0, 1), (3.2, 0)])
def test_another_reading_of_the_rig_costs_less_than_an_effect_that_does_as_much(candidate, search_over, bare, taken):
    """A delay of a sample, where the readings were taken at the start of their rows, and something else is missing."""

    def of(base, single):
        search = search_over(base, single)
        return search, [single.effects], decided(search, [single.effects])

    delayed = candidate("delay", rms=2.9)  # 4.4 beyond the noise; 5.0 and 6.2 of the other form: 1.25 times are 5.5
    nominal = of(candidate(rms=18.0), delayed)
    jumped = candidate("sensor_jump", rms=2.8)
    other = of(candidate(rms=bare), jumped)
    search, _, naming = _best_variant([nominal, other])
    assert naming.best is None
    assert search is (nominal, other)[taken][0]


@pytest.mark.parametrize(
    "most, found, answer",
    [
        (True, ("end_stop", "delay"), ("end_stop", "delay")),
        (False, ("end_stop", "delay"), None),
        (True, ("delay",), None),  # that is what rows are that were read a sample early
    ],
)
def test_what_another_form_cannot_explain_is_looked_for_in_the_rig_files_own(
    candidate, nothing, scripted, most, found, answer
):
    """A sensor that lags by a sample, say, beside an end stop: rows read a sample early would be the lag."""
    both = replace(nothing, best=candidate(*found, rms=2.05))
    own, other = scripted([nothing, both], most), scripted([nothing, nothing, nothing])
    search, naming = _with_more(other, own, lambda number, share: None)
    assert (naming.best and naming.best.effects) == answer
    assert search is (own if answer else other)[0]


@pytest.mark.parametrize(
    "left, bare, read_otherwise",
    [
        (7.8, 8.6, False),  # neither the effect nor the other form takes much
        (5.0, 8.6, True),  # an effect does: with it the other form may leave nothing
        (7.8, 6.0, True),  # the other form does, and hides what the effect could do
    ],
)
def test_another_form_is_tried_where_it_or_an_effect_takes_much(candidate, search_over, left, bare, read_otherwise):
    delay = candidate("delay", rms=left)
    search = search_over(candidate(rms=8.7), delay)
    naming = decided(search, [])
    assert naming.best is None
    assert search.may_be_misread([delay.effects], naming, candidate(rms=bare)) is read_otherwise


def test_another_form_is_screened_by_its_own_plant_once_that_is_asked_for(candidate, monkeypatch):
    """Linearised responses in a plant that was calibrated in the rig file's form said nothing of a lag in another one."""
    screened = []
    effects = [SimpleNamespace(name="creep"), SimpleNamespace(name="mullins")]
    of_creep, of_mullins = (SimpleNamespace(effect=effect) for effect in effects)
    monkeypatch.setattr(
        sets, "linearised_responses", lambda _, base, __, fit: screened.append((base, fit)) or [of_mullins]
    )
    search = Search(SimpleNamespace(effects=effects, jobs=1), candidate(rms=6.0), [of_creep])
    assert search.known() == [of_creep]
    form = candidate(rms=5.0)
    other = search.in_variant_of(form)
    assert screened == []
    assert search.failed == other.failed == ["mullins"]  # with which the rig file's form could not be simulated
    other.lost.append("delay")
    other.tried["creep",] = candidate("creep", rms=4.0)
    assert other.known() == other.known() == [of_mullins]
    assert screened == [(form.calibration, form.calibration)]
    assert other.failed == ["delay"]  # of the others one was screened here and one fitted; what was lost stays so
    other.tried["delay",] = candidate("delay", rms=4.0)
    assert other.failed == []
    other.lost.append("creep+delay")
    assert other.failed == ["creep+delay"]
    assert other.in_variant_of(form).failed == []
    assert search.failed == ["mullins"]


@pytest.mark.parametrize("left, clearly", [(4.0, True), (5.9, False)])
def test_a_form_that_leaves_clearly_less_is_searched_as_the_first_one_was(
    candidate, search_over, monkeypatch, left, clearly
):
    """Events, too, and what acts like the best: the best of the other form alone could be what a wrong one needs."""

    def fitted(self, sets):
        self.tried |= {names: candidate(*names, rms=3.5) for names in sets}
        return list(sets)

    names, looked_for = ("creep", "delay", "lost"), [("creep",), ("mullins",)]
    stage = [(name,) for name in names]
    search = search_over(candidate(rms=6.0), *(candidate(name, rms=3.0 + k) for k, name in enumerate(names)))
    search.problem.nominal = SimpleNamespace(with_rig=lambda rig: None)
    search.leads = {n: Lead(effect=SimpleNamespace(name=n), share=0.5, estimate=None) for n in names}
    attempted = []
    monkeypatch.setattr(variants, "trials_of", lambda unbiased, fit, chosen: [(lead.effect.name,) for lead in chosen])
    monkeypatch.setattr(Search, "beside", lambda self, names: self.lost.append("lost") or fitted(self, looked_for))
    monkeypatch.setattr(Search, "attempt", lambda self, sets, alternative: attempted.extend(sets) or fitted(self, sets))
    monkeypatch.setattr(Search, "judge_by_the_best", lambda self, stage: None)
    other, found = variants.in_variant(search, candidate(rms=left), stage)
    assert sorted(found) == sorted({*stage[:2], *looked_for} if clearly else stage)
    assert attempted == (stage[1:2] if clearly else stage)  # nothing is fitted twice, nor what could not be
    assert set(other.leads) == {*names}


@pytest.mark.parametrize("alone, answer", [(2.06, ("end_stop",)), (2.4, ("delay", "end_stop"))])
def test_another_reading_of_the_rig_costs_less_than_one_effect_of_a_pair(
    candidate, pair_of_a_delay, elsewhere, alone, answer
):
    """Half of the plant's error is 0.6: 2.06² - 2.05² is 0.2², and 2.4² - 2.05² is 1.25²."""
    search, naming = pair_of_a_delay
    elsewhere(candidate("end_stop", rms=alone), candidate("delay", rms=4.4))
    taken, naming = with_fewer(search, naming, [candidate(rms=5.5)])
    assert naming.best.effects == answer
    assert (taken is search) is (len(answer) == 2)


def test_a_form_that_leaves_clearly_more_by_itself_may_need_one_effect_less(candidate, pair_of_a_delay, elsewhere):
    """A creep of rows that were read a sample early: without it the file's form is biased to imitate both, that one not.

    The same fit as of creep and a delay of a sample, beside which it leaves 8.8 of 6.6 µm without effects.
    """
    search, naming = pair_of_a_delay
    elsewhere(candidate("end_stop", rms=2.05))
    assert with_fewer(search, naming, [candidate(rms=8.0)])[1].best.effects == ("end_stop",)
    # 2.13² - 2.05² is 0.58², less than half of the plant's error, but 100 ln(2.13/2.05) = 3.8 nats are strong
    elsewhere(candidate("end_stop", rms=2.13))
    assert with_fewer(search, naming, [candidate(rms=8.0)]) == (search, naming)
    assert with_fewer(search, naming, [candidate(rms=6.0)])[1].best.effects == ("end_stop",)


def test_where_nothing_explains_a_form_that_leaves_clearly_more_by_itself_is_not_tried(
    candidate, search_over, elsewhere
):
    both = candidate("creep", "delay", rms=2.9)
    search = search_over(candidate(rms=5.7), candidate("creep", rms=4.0), candidate("delay", rms=4.2), both)
    nothing = decided(search, [both.effects])
    elsewhere(candidate("creep", rms=2.05))
    assert with_fewer(search, nothing, [candidate(rms=6.5)]) == (search, nothing)  # 0.8 (6.5² - 2²) > 5.7² - 2²
    assert with_fewer(search, nothing, [candidate(rms=6.0)])[1].best.effects == ("creep",)


def test_rivals_of_a_pair_are_rivals_in_the_other_form_too(candidate, pair_of_a_delay, elsewhere):
    """A relative of the truth must not stand alone for having been the better half of a pair by a hair."""
    search, naming = pair_of_a_delay
    for other in (candidate("delay", "hysteresis", rms=2.06), candidate("hysteresis", rms=4.9)):
        search.tried[other.effects] = other
    naming = decided(search, [("delay", "end_stop"), ("delay", "hysteresis")])
    elsewhere(candidate("end_stop", rms=2.06), candidate("hysteresis", rms=2.07))
    _, there = with_fewer(search, naming, [candidate(rms=5.5)])
    assert [there.best.effects, *(alternative.effects for alternative in there.alternatives)] == [
        ("end_stop",),
        ("hysteresis",),
    ]


@pytest.mark.parametrize(
    "single, pair, answer", [(4.0, 2.1, ("creep", "delay")), (2.1, 2.05, ("creep",)), (4.0, 2.9, None)]
)
def test_two_effects_may_explain_in_another_form_what_they_do_not_in_the_first(
    candidate, search_over, elsewhere, single, pair, answer
):
    both = candidate("creep", "delay", rms=2.9)
    search = search_over(candidate(rms=5.7), candidate("creep", rms=4.0), candidate("delay", rms=4.2), both)
    nothing = decided(search, [both.effects])
    assert nothing.best is None
    elsewhere(candidate("creep", rms=single), candidate("delay", rms=4.2), candidate("creep", "delay", rms=pair))
    taken, naming = with_fewer(search, nothing, [candidate(rms=5.5)])
    assert (naming.best and naming.best.effects) == answer
    assert (taken is search) is (answer is None)


@pytest.mark.parametrize(("there", "answer"), [(2.1, ("creep", "end_stop")), (2.9, None)])
def test_of_three_that_leave_too_much_one_may_be_all_that_another_form_is(
    candidate, search_over, elsewhere, there, answer
):
    """A reading that is taken a sample early hides two effects behind a lag, which is in every pair that is good."""
    three, lagged = candidate("creep", "end_stop", "sensor_lag", rms=2.8), candidate("end_stop", "sensor_lag", rms=3.4)
    alone = [candidate("sensor_lag", rms=4.2), candidate("end_stop", rms=4.6), candidate("creep", rms=4.9)]
    here = [lagged, candidate("creep", "sensor_lag", rms=3.6), candidate("creep", "end_stop", rms=4.4)]
    search = search_over(candidate(rms=5.7), *alone, *here, three)
    nothing = decided(search, [three.effects])
    assert nothing.best is None
    judged = elsewhere(
        candidate("creep", rms=3.9),
        candidate("end_stop", rms=4.0),
        candidate("sensor_lag", rms=5.4),
        candidate("end_stop", "sensor_lag", rms=3.4),
        candidate("creep", "sensor_lag", rms=3.8),
        candidate("creep", "end_stop", rms=there),
    )
    taken, naming = with_fewer(search, nothing, [candidate(rms=5.5)])
    assert (naming.best and naming.best.effects) == answer
    assert (taken is search) is (answer is None)
    # by the best of all, each time more are known: those that were tried before are judged by it again
    singles, pair = [("end_stop",), ("sensor_lag",)], ("end_stop", "sensor_lag")
    others = [("creep", "sensor_lag"), ("creep", "end_stop")]
    assert [sorted(stage) for stage in judged] == [
        sorted(singles),
        sorted([*singles, pair]),
        sorted([*singles, pair, *others]),
    ]


def test_one_effect_is_looked_for_in_no_further_form(candidate, search_over, elsewhere):
    single = candidate("delay", rms=2.05)
    search = search_over(candidate(rms=5.7), single)
    naming = decided(search, [single.effects])
    assert with_fewer(search, naming, [candidate(rms=5.5)]) == (search, naming)

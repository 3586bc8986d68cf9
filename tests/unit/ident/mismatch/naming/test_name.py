"""Decisions between explanations, on residuals whose sizes are given."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import FitStatus
from deatwin.ident.mismatch.naming import forms, sets
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import (
    Distance,
    Naming,
    cannot_rule_out,
    decide,
    is_as_likely,
    with_distances,
)
from deatwin.ident.mismatch.naming.forms import with_fewer
from deatwin.ident.mismatch.naming.name import _best_form, _with_more
from deatwin.ident.mismatch.naming.screen import Lead
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.ident.mismatch.naming.trial import _otherwise
from deatwin.ident.mismatch.naming.worth import suffices
from deatwin.ident.mismatch.refit.base import _preferred
from deatwin.plant import Creep, CubicStiffness, Diaphragm, Plant

NOISE, MODEL_ERROR = 2.0, 1.2
RIG = SimpleNamespace(model_error=MODEL_ERROR)
NOTHING = Naming(candidates=(), best=None, rivals=(), probabilities={}, noise=NOISE)


def is_adequate(explanation: Candidate) -> bool:
    return explanation.adequate


def candidate(*effects: str, rms: float, unseen: float | None = None, alone: float = np.inf) -> Candidate:
    """An explanation that leaves residuals of exactly these sizes, and whose effects do so much by themselves."""
    fitted, late = np.tile([rms, -rms], 3500), np.tile([unseen or rms, -(unseen or rms)], 1500)
    plant, names = SimpleNamespace(rig=RIG, effects=()), ("a",) * (7 + len(effects))
    calibration = SimpleNamespace(
        plant=plant, residuals=fitted, names=names, status=FitStatus.SETTLED, rms=float(np.sqrt(np.mean(fitted**2)))
    )
    does = np.full(fitted.size, alone)
    return Candidate(effects=effects, calibration=calibration, unseen=late, noise=NOISE, contribution=does)


def test_the_best_adequate_explanation_stands_alone():
    right, wrong = candidate("creep", rms=2.1), candidate("electrode_rc", rms=4.7)
    decided = decide((right, wrong), (wrong, right), NOISE, is_adequate, is_adequate)
    assert decided.best is right
    assert decided.rivals == ()
    assert decided.probabilities[("creep",)] == pytest.approx(1.0)


def test_equal_explanations_are_rivals():
    one, other = candidate("creep", rms=2.10), candidate("permittivity_drift", rms=2.11)
    decided = decide((one, other), (one, other), NOISE, is_adequate, is_adequate)
    assert decided.rivals == (other,)
    assert cannot_rule_out(other, one)


def test_many_that_are_unlikely_one_by_one_are_rivals_together():
    best = candidate("creep", rms=2.1)
    # each 25 times less likely, 200 blocks: 100 ln(x) = ln 25; five of them hold a sixth of the probability
    unlikely = 2.1 * 25 ** (1 / 200)
    others = [candidate(name, rms=unlikely) for name in ("delay", "end_stop", "hysteresis", "leakage", "mullins")]
    stage = (best, *others)
    alone = decide(stage, stage[:2], NOISE, lambda c: c is best, lambda c: True)
    assert alone.probabilities[best.effects] == pytest.approx(25 / 26, rel=1e-6)
    assert alone.rivals == ()
    together = decide(stage, stage, NOISE, lambda c: c is best, lambda c: True)
    assert together.probabilities[best.effects] == pytest.approx(25 / 30, rel=1e-6)
    held = together.probabilities[best.effects] + sum(together.probabilities[c.effects] for c in together.rivals)
    # 28/30 are too few, 29/30 enough
    assert len(together.rivals) == 4
    assert held > 0.95


def test_what_keeps_a_limit_by_luck_does_not_lead_what_is_likelier_by_far(monkeypatch):
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    base, lucky = candidate(rms=9.0), candidate("delay", rms=2.3)
    # leaves 1.25 µm of the fitted part, the floor is 1.2; less than the other one on both parts taken together
    likelier = candidate("sensor_drift", rms=2.36, unseen=1.9)
    assert lucky.adequate
    assert not likelier.adequate
    led = search_over(base, lucky, likelier).decided([("delay",), ("sensor_drift",)])
    assert led.best is likelier
    assert led.rivals == (lucky,)
    # of a small mismatch it leaves too much of the unseen part, 1.66 of 2.2 µm: that is no answer, however likely it is
    base, bad = candidate(rms=3.0), candidate("sensor_drift", rms=2.0, unseen=2.6)
    assert bad.evidence - lucky.evidence > np.log(20)
    assert not suffices(bad, base)
    naming = search_over(base, lucky, bad).decided([("delay",), ("sensor_drift",)])
    assert naming.best is lucky
    assert naming.rivals == (bad,)


def test_another_head_keeps_the_distances_that_are_known_from_it():
    one, other, third = (candidate(name, rms=2.1) for name in ("creep", "delay", "leakage"))
    distances = (Distance(effects=("creep", "delay"), d2=9.0), Distance(effects=("creep", "leakage"), d2=4.0))
    naming = Naming(
        candidates=(one, other, third), best=one, rivals=(other, third), probabilities={}, noise=NOISE,
        distances=distances,
    )  # fmt: skip
    assert naming.led_by(one) is naming
    led = naming.led_by(other)
    assert led.best is other
    assert led.rivals == (one, third)
    assert led.distances == (Distance(effects=("delay", "creep"), d2=9.0),)


def test_a_short_experiment_of_its_own_rules_out_what_a_long_one_cannot():
    best = candidate("creep", rms=2.1)
    # 9000 samples tell nothing; in the last 700 fitted and 300 unseen ones the rival leaves 1 more: 1 > (1.2 / 2)²
    mixed = np.where(np.arange(10_000) % 10 < 9, 2.1**2, 2.1**2 + 1.0)
    late = np.sqrt(np.sort(mixed))
    calibration = SimpleNamespace(**{**vars(best.calibration), "residuals": np.r_[late[:6300], late[-700:]]})
    rival = replace(best, effects=("delay",), calibration=calibration, unseen=np.r_[late[6300:9000], late[-300:]])
    sizes = ((6300, 2700), (700, 300))
    best, rival = replace(best, sizes=sizes), replace(rival, sizes=sizes)
    assert rival.mean_squares - best.mean_squares == pytest.approx([0.1, 0.0, 1.0])
    # 100 ln(1 + 0.1 / 2.1²) are 2.2 nats, with a parameter more 4.9: strong. 0.1 in the mean is less than 0.36
    clear = replace(best, calibration=SimpleNamespace(**{**vars(best.calibration), "names": ("a",) * 7}))
    assert not is_as_likely(rival, clear)
    assert not cannot_rule_out(rival, clear)
    assert cannot_rule_out(replace(rival, sizes=()), replace(clear, sizes=()))
    few = ((6800, 2960), (200, 40))  # too few samples to say anything by themselves
    assert cannot_rule_out(replace(rival, sizes=few), replace(clear, sizes=few))


def test_nothing_adequate_is_no_explanation():
    decided = decide((), (candidate("creep", rms=3.5),), NOISE, is_adequate, is_adequate)
    assert decided.best is None


def test_another_form_replaces_the_nominal_one_only_where_that_leaves_a_mismatch():
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


def test_good_on_the_fitted_part_alone_is_not_enough():
    assert not candidate("creep", rms=2.1, unseen=5.0).adequate


def search_over(*candidates: Candidate) -> Search:
    """A search in which these were tried, the base plant first."""
    search = Search(SimpleNamespace(effects=(), jobs=1), candidates[0], ())
    search.tried.update({c.effects: c for c in candidates})
    return search


def test_an_effect_of_a_pair_must_count_for_more_than_the_model_error():
    base = candidate(rms=5.7)
    drift, creep = candidate("permittivity_drift", rms=2.54), candidate("creep", rms=4.98)
    pair = candidate("creep", "permittivity_drift", rms=2.05)
    # taking creep out costs 2.54² - 2.05² = 2.25, more than 1.2² = 1.44
    assert search_over(base, drift, creep, pair).each_counts(pair.effects)
    near = candidate("permittivity_drift", rms=2.2)
    # taking creep out of this pair costs 2.2² - 2.05² = 0.64 only
    assert not search_over(base, near, creep, pair).each_counts(pair.effects)


def test_a_pair_gives_way_to_one_effect_whose_rough_fit_was_far_from_its_minimum(monkeypatch):
    base, drift, stuck = candidate(rms=5.7), candidate("permittivity_drift", rms=4.0), candidate("creep", rms=3.6)
    pair, settled = candidate("creep", "permittivity_drift", rms=2.05), candidate("creep", rms=2.07)
    search = search_over(base, drift, stuck, pair)
    assert search.decided([pair.effects]).best is pair

    def fit(full, rest):
        assert full == pair.effects
        if rest == ("creep",):
            search.tried[rest] = settled

    monkeypatch.setattr(search, "fit_from", fit)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    assert search.decided_surely([pair.effects]).best is settled
    search.tried[("creep",)], settled = stuck, stuck  # where the second look finds nothing better, both stay
    assert search.decided_surely([pair.effects]).best is pair


def test_an_idle_second_effect_does_not_become_a_cause():
    base, drift = candidate(rms=5.2), candidate("sensor_drift", rms=4.0)
    creep = candidate("creep", rms=2.2, unseen=3.1)
    pair = candidate("creep", "sensor_drift", rms=2.25)
    search = search_over(base, creep, drift, pair)
    # the second effect saves 6.27 - 5.06 = 1.21 of 5.2² - 2² = 23: less than 1.2²
    assert search.decided([pair.effects]).best is None
    # alone, creep leaves 2.37 on the unseen part, twice the model error, and takes away 81 % of the energy
    assert search.nearly().best is None
    better = candidate("creep", rms=2.3, unseen=2.6)
    # 2.6² - 2² = 1.66²: it takes away 94 % of the energy and leaves 1.4 times the model error
    assert search_over(base, better, drift).nearly().best is better


@pytest.mark.parametrize("alone, answer", [(2.34, [("creep", "delay"), ("delay",)]), (2.22, [])])
def test_a_pair_of_which_one_effect_counts_for_less_than_the_floor_is_doubted(monkeypatch, alone, answer):
    """Nothing else explains the recordings: it is better than no answer, and the other effect alone stays possible."""
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    base, creep, delay = candidate(rms=3.2), candidate("creep", rms=2.9), candidate("delay", rms=alone)
    # 1.2² is 1.44. Without creep 2.34² - 2.06² = 1.23 return, or 0.68 of 2.22²: less than half
    pair = candidate("creep", "delay", rms=2.06)
    search = search_over(base, creep, delay, pair)
    monkeypatch.setattr(Search, "fit_from", lambda *_: None)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.suffices", lambda *_: False)
    naming = search.nearly()
    found = [] if naming.best is None else [naming.best.effects, *(c.effects for c in naming.rivals)]
    assert found == answer
    assert [naming.probabilities[effects] for effects in answer] == [0.5] * len(answer)


def test_a_second_effect_that_is_a_trifle_of_the_mismatch_is_none_whatever_it_counts_for(monkeypatch):
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    monkeypatch.setattr(Search, "fit_from", lambda *_: None)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.suffices", lambda *_: False)
    # without creep 4.18² - 2.3² = 12.2 return, eight times 1.2², but of 22² - 2² a fortieth
    base, creep, delay = candidate(rms=22.0), candidate("creep", rms=20.0), candidate("delay", rms=4.18)
    search = search_over(base, creep, delay, candidate("creep", "delay", rms=2.3))
    assert search.nearly().best is None


def test_a_fit_that_cannot_be_had_is_tried_once(monkeypatch):
    search = search_over(candidate(rms=5.0), candidate("creep", rms=4.0), candidate("creep", "delay", rms=2.1))
    asked: list[tuple[str, ...]] = []

    def lost(full, rest):
        asked.append(rest)
        search.lost.append("+".join(rest))

    monkeypatch.setattr(search, "_fit_some", lost)
    assert search.each_counts(("creep", "delay"))  # as far as it is known: without delay much returns
    assert search.each_counts(("creep", "delay"))
    assert asked == [("delay",)]


@pytest.mark.parametrize("late, hope", [(4.3, True), (4.4, False)])
def test_what_may_settle_takes_most_of_the_unseen_part_too(monkeypatch, late, hope):
    """Of 5.7² - 2² - 1.2² = 27.1 beyond noise and floor, 4.3 µm leave 13.1 and 4.4 µm 13.9, where half is 13.5."""
    asked = []
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.settled_on_everything", lambda *given: asked.extend(given))
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    slow = candidate("dielectric_absorption", rms=2.1, unseen=late)
    search_over(candidate(rms=5.7), slow).settled([slow.effects])
    *_, hopeful, _ = asked
    assert hopeful(slow) is hope


@pytest.mark.parametrize("alone, answer", [(2.3, ("creep",)), (3.6, ("creep", "delay"))])
def test_of_two_that_settle_none_is_named_where_one_is_enough(monkeypatch, alone, answer):
    """A pair mends the tail of a slow law: 2.3² - 2² is 1.14², within 1.2²; of 3.6 µm 3.0 are left."""
    both = candidate("creep", "delay", rms=2.05, unseen=2.9)
    search = search_over(candidate(rms=5.7), candidate("creep", rms=4.0), candidate("delay", rms=5.0), both)

    def fit(full, rest):
        if rest == ("creep",):
            search.tried[rest] = candidate("creep", rms=alone)

    monkeypatch.setattr(search, "fit_from", fit)
    settled = replace(NOTHING, best=both)
    monkeypatch.setattr(search, "_settled", lambda stage: settled if both.effects in stage else NOTHING)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    assert search.settled([both.effects]).best.effects == answer


def test_what_suffices():
    base = candidate(rms=5.7)
    assert suffices(candidate("creep", rms=2.1), base)
    assert suffices(candidate("creep", rms=2.8), base)  # leaves 1.96, 1.6 times 1.2, of 5.34: 91 %
    assert not suffices(candidate("creep", rms=3.1), base)  # leaves 2.37, 2.0 times 1.2, of 5.34: 84 %
    loud = candidate(rms=12.0)
    assert suffices(candidate("creep", rms=3.2), loud)  # leaves 2.5, twice 1.2, but takes away 97 % of 11.8²
    assert not suffices(candidate("creep", rms=4.3), loud)  # leaves 3.8, more than three times 1.2
    weak = candidate(rms=3.0)
    assert not suffices(candidate("creep", rms=2.6), weak)  # of 2.24² it takes away 45 % only


def test_another_noise_changes_the_judgement_not_the_residuals():
    loud = candidate("hysteresis", rms=2.9)
    assert not loud.adequate
    again = replace(loud, noise=2.8)
    assert again.adequate
    assert again.losses.mean() == loud.losses.mean()


def test_an_effect_that_does_little_by_itself_is_no_cause():
    """The fit with it is better since the one without had not found its minimum; from there it had to do 3.6."""
    base = candidate(rms=5.7)
    there, idle = candidate("creep", rms=2.1, alone=3.7), candidate("creep", rms=2.1, alone=1.7)
    assert search_over(base, there).counts(there)
    assert not search_over(base, idle).counts(idle)


def test_what_is_as_likely_as_the_best_is_a_rival_though_it_misses_a_limit_by_a_hair():
    best, near, far = candidate("delay", rms=2.33), candidate("sensor_lag", rms=2.335), candidate("creep", rms=2.6)
    assert best.adequate and not near.adequate
    decided = decide((best, near, far), (best, near, far), NOISE, is_adequate, lambda c: True)
    assert decided.best is best
    assert decided.rivals == (near,)


@pytest.mark.parametrize(("rms", "kept"), [(2.59, True), (2.7, False)])
def test_what_is_worse_by_more_than_the_model_error_has_been_told_apart(monkeypatch, rms, kept):
    """2.3² + 1.2² = 2.59²; of the two the inputs are said to predict no difference."""
    best, other = candidate("creep", rms=2.3), candidate("mullins", rms=rms)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.decide.separation", lambda *given: 9.0)
    decided = decide((best, other), (best, other), NOISE, is_adequate, lambda c: True)
    assert decided.rivals == ()
    bench = SimpleNamespace(everything=(), jobs=1)
    found = with_distances(decided, (best, other), bench, lambda c: True)
    assert (found.rivals == (other,)) is kept
    assert [d.d2 for d in found.distances] == [9.0]


def test_between_two_shares_what_may_be_left_rises_evenly():
    base = candidate(rms=8.0)
    error = 1.2
    energy = 8.0**2 - NOISE**2 - error**2

    def leaving(share: float) -> Candidate:
        return candidate("creep", rms=float(np.sqrt(NOISE**2 + error**2 + (1 - share) * energy)))

    # 0.9 lies two thirds on the way from 0.8 to 0.95, so 2.5 times the error may be left, and 2.25 times are; 0.876
    # lies half way, so 2.26 times may be left, and 2.46 times are.
    assert suffices(leaving(0.876), base) is False
    assert suffices(leaving(0.9), base) is True


def test_what_takes_away_little_of_a_small_mismatch_is_no_explanation():
    base = candidate(rms=2.4)  # with a noise of 2, 1.76 is missing in square, and 1.44 would be adequate
    little, most = candidate("creep", rms=2.3), candidate("mullins", rms=2.1)
    assert little.adequate and most.adequate
    assert not search_over(base, little).counts(little)
    assert search_over(base, most).counts(most)


def form(*explanations: Candidate, least: float = 1.0):
    """A search in one form of the rig, and what it decided."""
    naming = decide(explanations, explanations, NOISE, is_adequate, is_adequate)
    return SimpleNamespace(
        decided=lambda stage: naming, least=lambda stage: least,
        missing=lambda stage: 9.0 if stage == [()] else least,
    ), []  # fmt: skip


def test_the_form_in_which_one_effect_explains_clearly_more_is_taken():
    nominal, other = form(candidate("delay", rms=2.3)), form(candidate("electrode_rc", rms=2.0))
    search, _, naming = _best_form([nominal, other])
    assert search is other[0]
    assert naming.best.effects == ("electrode_rc",)
    assert naming.rivals == ()


def test_what_suffices_in_another_form_stays_possible():
    nominal = form(candidate("delay", rms=2.101))
    other = form(candidate("delay", rms=2.1), candidate("sensor_lag", rms=2.102))
    search, _, naming = _best_form([nominal, other])
    assert search is nominal[0]  # no form is taken for nothing
    assert [naming.best.effects, *(rival.effects for rival in naming.rivals)] == [("delay",), ("sensor_lag",)]
    assert ("sensor_lag",) in [candidate.effects for candidate in naming.candidates]
    assert sum(naming.probabilities.values()) == pytest.approx(1.0)
    assert 0.3 < naming.probabilities["sensor_lag",] < 0.5  # the residuals are nearly equal


@pytest.mark.parametrize("effect, taken", [("delay", 0), ("sensor_drift", 1)])
def test_another_effect_in_another_form_leads_where_the_evidence_for_it_is_strong(effect, taken):
    # 2.15² - 2.1² is 0.46², less than half of the plant's error, but 100 ln(2.15/2.1)² are 4.7 nats: a hundred to one
    forms = [form(candidate("delay", rms=2.15)), form(candidate(effect, rms=2.1))]
    search, _, naming = _best_form(forms)
    assert search is forms[taken][0]
    if taken:
        assert [rival.effects for rival in naming.rivals] == [("delay",)]


@pytest.mark.parametrize("least, taken", [(0.79, 1), (0.81, 0)])
def test_where_nothing_suffices_a_form_must_leave_clearly_less(least, taken):
    forms = [form(candidate("delay", rms=9.0)), form(candidate("creep", rms=8.0), least=least)]
    assert _best_form(forms)[0] is forms[taken][0]


@pytest.mark.parametrize("bare, taken", [(3.0, 1), (3.2, 0)])
def test_another_reading_of_the_rig_costs_less_than_an_effect_that_does_as_much(bare, taken):
    """A delay of a sample, where the readings were taken at the start of their rows, and something else is missing."""
    delayed = candidate("delay", rms=2.9)  # 4.4 beyond the noise; 5.0 and 6.2 of the other form: 1.25 times are 5.5
    nominal = search_over(candidate(rms=18.0), delayed), [delayed.effects]
    jumped = candidate("sensor_jump", rms=2.8)
    other = search_over(candidate(rms=bare), jumped), [jumped.effects]
    search, _, naming = _best_form([nominal, other])
    assert naming.best is None
    assert search is (nominal, other)[taken][0]


def scripted(stages: list[Naming], most: bool = True):
    """A search whose decisions over one effect, two and three are given."""
    left = iter(stages[1:])
    search = SimpleNamespace(
        decided=lambda stage: stages[0], settled=lambda stage: NOTHING, with_one_more=lambda stage, told: [("a", "b")],
        decided_surely=lambda stage: next(left), nearly=lambda: NOTHING, one_takes_most=lambda stage: most,
    )  # fmt: skip
    return search, [("a",)]


@pytest.mark.parametrize("most, found, answer", [
    (True, ("end_stop", "delay"), ("end_stop", "delay")),
    (False, ("end_stop", "delay"), None),
    (True, ("delay",), None),  # that is what rows are that were read a sample early
])  # fmt: skip
def test_what_another_form_cannot_explain_is_looked_for_in_the_rig_files_own(most, found, answer):
    """A sensor that lags by a sample, say, beside an end stop: rows read a sample early would be the lag."""
    both = replace(NOTHING, best=candidate(*found, rms=2.05))
    own, other = scripted([NOTHING, both], most), scripted([NOTHING, NOTHING, NOTHING])
    search, naming = _with_more((*other, NOTHING), own, lambda number, share: None)
    assert (naming.best and naming.best.effects) == answer
    assert search is (own if answer else other)[0]


def test_three_effects_must_explain_to_the_plants_own_error():
    base, sizes = candidate(rms=9.0), {"creep": 8.0, "delay": 7.0, "mullins": 6.0}
    pairs = [candidate(*pair, rms=5.0) for pair in itertools.combinations(sizes, 2)]
    three = candidate(*sizes, rms=2.6)  # 1.7 beyond the noise, 1.4 times the plant's own error, of 8.8: 96 %
    assert suffices(three, base)
    tried = [candidate(name, rms=rms) for name, rms in sizes.items()]
    assert search_over(base, *tried, *pairs, three).nearly().best is None
    two = candidate("creep", "delay", rms=2.6)
    assert search_over(base, *tried, two).nearly().best is two


def test_a_fit_begins_with_an_effect_the_other_way_or_weaker_where_it_must():
    plant = Plant(rig=Diaphragm()).with_effects(Creep(), CubicStiffness(stiffness=-2e7))
    assert [p.parameters["cubic_stiffness.stiffness"].value for p in _otherwise(plant)] == [2e7, -2e6, -2e4]
    one_sided = Plant(rig=Diaphragm()).with_effects(Creep(modulus=1e5))  # negative moduli are out of range
    assert [p.parameters["creep.modulus"].value for p in _otherwise(one_sided)] == pytest.approx([1e4, 1e2])


def test_what_did_well_alone_is_tried_beside_another_whatever_its_score():
    sizes = {"delay": 3.0, "creep": 3.2, "mullins": 4.9, "leakage": 5.0}
    tried = [candidate(name, rms=rms) for name, rms in sizes.items()]
    search = search_over(candidate(rms=5.7), *tried, candidate("end_stop", rms=3.1))
    search.leads = {name: f"lead of {name}" for name in sizes}
    # of the three best beside delay, one has no lead: it was found elsewhere
    assert search._good_alone(("delay",)) == ["lead of creep", "lead of mullins"]


def test_a_further_effect_is_looked_for_beside_the_best_and_must_count():
    base, creep = candidate(rms=6.0), candidate("creep", rms=4.2)
    idle, pair = candidate("creep", "delay", rms=4.15), candidate("amplifier_slew", "creep", rms=2.2)
    slew, delay = candidate("amplifier_slew", rms=5.0), candidate("delay", rms=5.9)
    search = search_over(base, creep, slew, delay, idle, pair)
    search.replacing = lambda before, best: [("replaced", *before)]
    search.beside = lambda names, finished=None: [idle.effects, pair.effects]
    assert search.with_one_more([slew.effects, creep.effects]) == [idle.effects, pair.effects, ("replaced", "creep")]
    search.beside = lambda names, finished=None: [idle.effects]
    assert search.with_one_more([slew.effects, creep.effects]) == []
    search.beside = lambda names, finished=None: [pair.effects, idle.effects]
    search.tried["creep", "delay"] = candidate("creep", "delay", rms=2.1)  # more evidence, but beside 2.15 with delay
    search.tried["delay",] = candidate("delay", rms=2.15)
    assert search.with_one_more([slew.effects, creep.effects])[-1] == ("replaced", "creep")


def test_what_leaves_a_trifle_may_imitate_two_others():
    """Beside it nothing counts; beside the next best one something may, which together leave less."""
    base, near = candidate(rms=30.0), candidate("thermal_stiffness", rms=3.2)
    slow, fast = candidate("prestretch_relaxation", rms=9.0), candidate("charge_injection", rms=20.0)
    pair = candidate("charge_injection", "prestretch_relaxation", rms=2.0)
    search = search_over(base, near, slow, fast, pair)
    asked = []
    search.beside = lambda names, finished=None: asked.append(names) or [pair.effects]
    search.replacing = lambda before, best: []
    assert search.with_one_more([near.effects, slow.effects, fast.effects]) == [pair.effects]
    assert asked == [("prestretch_relaxation",)]
    assert search.with_one_more([near.effects]) == [] and len(asked) == 1


@pytest.mark.parametrize(
    "next_best, asked",
    [
        (12.0, [("creep",), ("sensor_jump",)]),
        (20.1, [("creep",)]),  # 20.1^2 is more than half of 28.3^2
    ],
)
def test_where_nothing_counts_beside_the_best_the_next_best_is_gone_on_with_if_it_takes_most(next_best, asked):
    """What is best alone may only imitate two others, of which the next best is one."""
    base, creep, jump = candidate(rms=28.3), candidate("creep", rms=11.5), candidate("sensor_jump", rms=next_best)
    idle, pair = candidate("creep", "delay", rms=11.4), candidate("charge_injection", "sensor_jump", rms=5.0)
    third = candidate("hysteresis", rms=next_best + 0.05)  # there is no third beginning
    others = candidate("delay", rms=28.0), candidate("charge_injection", rms=18.0), third
    search = search_over(base, creep, jump, idle, pair, *others)
    beside = {("creep",): [idle.effects], ("sensor_jump",): [pair.effects]}
    been, told = [], []
    search.beside = lambda names, finished: told.append(finished) or been.append(names) or beside[names]
    search.replacing = lambda before, best: [("replaced", *before)]
    stage = [others[0].effects, third.effects, jump.effects, creep.effects]
    found = search.with_one_more(stage, len)
    assert been == asked
    assert told == [len, None][: len(asked)]  # the share that is done does not go back
    assert found == ([idle.effects, pair.effects, ("replaced", "sensor_jump")] if len(asked) == 2 else [])


@pytest.mark.parametrize("left, goes_on", [(7.4, False), (5.0, True)])
def test_two_that_do_not_take_most_are_no_beginning_of_three(left, goes_on):
    """Of a mismatch of 8.7² - 2² µm² a pair that leaves 7.4 µm takes 29 %, one that leaves 5.0 µm 70 %."""
    base, pair = candidate(rms=8.7), candidate("amplifier_slew", "end_stop", rms=left)
    search = search_over(base, pair, candidate("amplifier_slew", rms=7.8), candidate("end_stop", rms=8.1))
    asked = []
    search.beside = lambda names, finished=None: asked.append(names) or []
    assert search.with_one_more([pair.effects]) == []
    assert asked == [pair.effects] * goes_on


@pytest.mark.parametrize(
    "left, bare, read_otherwise",
    [
        (7.8, 8.6, False),  # neither the effect nor the other form takes much
        (5.0, 8.6, True),  # an effect does: with it the other form may leave nothing
        (7.8, 6.0, True),  # the other form does, and hides what the effect could do
    ],
)
def test_another_form_is_tried_where_it_or_an_effect_takes_much(left, bare, read_otherwise):
    delay = candidate("delay", rms=left)
    search = search_over(candidate(rms=8.7), delay)
    naming = search.decided([])
    assert naming.best is None
    assert search.may_be_misread([delay.effects], naming, candidate(rms=bare)) is read_otherwise


def test_another_form_is_screened_by_its_own_plant_once_that_is_asked_for(monkeypatch):
    """Footprints in a plant that was calibrated in the rig file's form said nothing of a lag in another one."""
    screened = []
    effects = [SimpleNamespace(name="creep"), SimpleNamespace(name="mullins")]
    of_creep, of_mullins = (SimpleNamespace(effect=effect) for effect in effects)
    monkeypatch.setattr(sets, "footprints", lambda _, base, __, fit: screened.append((base, fit)) or [of_mullins])
    search = Search(SimpleNamespace(effects=effects, jobs=1), candidate(rms=6.0), [of_creep])
    assert search.known() == [of_creep]
    form = candidate(rms=5.0)
    other = search.in_form_of(form)
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
    assert other.in_form_of(form).failed == []
    assert search.failed == ["mullins"]


@pytest.mark.parametrize("left, tried", [(4.0, {"creep", "delay", "mullins"}), (5.9, {"creep", "delay"})])
def test_a_form_that_leaves_clearly_less_is_tried_with_what_promises_most_there(monkeypatch, left, tried):
    lead = {name: Lead(effect=SimpleNamespace(name=name), share=0.5, estimate=None) for name in tried | {"mullins"}}
    stage = [("creep",), ("delay",)]
    search = search_over(candidate(rms=6.0), candidate("creep", rms=3.0), candidate("delay", rms=4.0))
    search.bench.nominal = SimpleNamespace(with_rig=lambda rig: None)
    search.leads = {name: lead[name] for name in ("creep", "delay")}
    monkeypatch.setattr(
        sets, "footprints", lambda bench, base, effects, fit: [SimpleNamespace(effect=lead["mullins"].effect, of=base)]
    )
    monkeypatch.setattr(forms, "leads", lambda known, fit: [lead["mullins"]] if known[0].of is fit else [])
    monkeypatch.setattr(forms, "trials_of", lambda unbent, fit, chosen: list(chosen))
    monkeypatch.setattr(Search, "attempt", lambda self, trials, rival: [trial.effect.name for trial in trials])
    monkeypatch.setattr(Search, "judge_by_the_best", lambda self, stage: None)
    assert set(forms.in_form(search, candidate(rms=left), stage)[1]) == tried


@pytest.fixture
def elsewhere(monkeypatch):
    """What sets of effects leave in another form of the plant, instead of fits."""

    def leave(*known: Candidate) -> None:
        def begun(search: Search, form: Candidate) -> Search:
            other = search_over(form)

            def attempt(sets, rival):
                found = {c.effects: c for c in known if c.effects in sets}
                other.tried.update(found)
                return list(found)

            for name, does in (("attempt", attempt), ("judge_by_the_best", len), ("fit_from", lambda *_: None)):
                monkeypatch.setattr(other, name, does)
            return other

        monkeypatch.setattr(forms, "_begun", begun)

    monkeypatch.setattr(forms, "_trial", lambda search, full, form, names: names)
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.with_distances", lambda naming, *_: naming)
    return leave


def pair_of_a_delay() -> tuple[Search, Naming]:
    pair = candidate("delay", "end_stop", rms=2.05)
    search = search_over(candidate(rms=5.7), candidate("end_stop", rms=4.9), candidate("delay", rms=4.5), pair)
    return search, search.decided([pair.effects])


@pytest.mark.parametrize("alone, answer", [(2.06, ("end_stop",)), (2.4, ("delay", "end_stop"))])
def test_another_reading_of_the_rig_costs_less_than_one_effect_of_a_pair(elsewhere, alone, answer):
    """Half of the plant's error is 0.6: 2.06² - 2.05² is 0.2², and 2.4² - 2.05² is 1.25²."""
    search, naming = pair_of_a_delay()
    elsewhere(candidate("end_stop", rms=alone), candidate("delay", rms=4.4))
    taken, naming = with_fewer(search, naming, [candidate(rms=5.5)])
    assert naming.best.effects == answer
    assert (taken is search) is (len(answer) == 2)


def test_a_form_that_leaves_clearly_more_by_itself_is_not_tried(elsewhere):
    search, naming = pair_of_a_delay()
    elsewhere(candidate("end_stop", rms=2.05))
    assert with_fewer(search, naming, [candidate(rms=6.5)]) == (search, naming)  # 0.8 (6.5² - 2²) > 5.7² - 2²
    assert with_fewer(search, naming, [candidate(rms=6.0)])[1].best.effects == ("end_stop",)


def test_rivals_of_a_pair_are_rivals_in_the_other_form_too(elsewhere):
    """A relative of the truth must not stand alone for having been the better half of a pair by a hair."""
    search, naming = pair_of_a_delay()
    for other in (candidate("delay", "hysteresis", rms=2.06), candidate("hysteresis", rms=4.9)):
        search.tried[other.effects] = other
    naming = search.decided([("delay", "end_stop"), ("delay", "hysteresis")])
    elsewhere(candidate("end_stop", rms=2.06), candidate("hysteresis", rms=2.07))
    _, there = with_fewer(search, naming, [candidate(rms=5.5)])
    assert [there.best.effects, *(rival.effects for rival in there.rivals)] == [("end_stop",), ("hysteresis",)]


@pytest.mark.parametrize("single, pair, answer", [
    (4.0, 2.1, ("creep", "delay")), (2.1, 2.05, ("creep",)), (4.0, 2.9, None),
])  # fmt: skip
def test_two_effects_may_explain_in_another_form_what_they_do_not_in_the_first(elsewhere, single, pair, answer):
    both = candidate("creep", "delay", rms=2.9)
    search = search_over(candidate(rms=5.7), candidate("creep", rms=4.0), candidate("delay", rms=4.2), both)
    nothing = search.decided([both.effects])
    assert nothing.best is None
    elsewhere(candidate("creep", rms=single), candidate("delay", rms=4.2), candidate("creep", "delay", rms=pair))
    taken, naming = with_fewer(search, nothing, [candidate(rms=5.5)])
    assert (naming.best and naming.best.effects) == answer
    assert (taken is search) is (answer is None)


def test_one_effect_is_looked_for_in_no_further_form(elsewhere):
    single = candidate("delay", rms=2.05)
    search = search_over(candidate(rms=5.7), single)
    naming = search.decided([single.effects])
    assert with_fewer(search, naming, [candidate(rms=5.5)]) == (search, naming)

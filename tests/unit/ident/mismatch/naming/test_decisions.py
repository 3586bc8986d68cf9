"""What a search answers, where residuals of given sizes are left by what was tried."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import suffices
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.decisions import decided, decided_surely, nearly, on_everything, settled, shown_first
from deatwin.ident.mismatch.naming.evidence_ratio import advantage
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.plant import PeriodicDisturbance, ThermalStiffness
from deatwin.plant.effects.base import Effect


def test_what_keeps_a_limit_by_luck_does_not_lead_what_is_likelier_by_far(candidate, search_over):
    base, lucky = candidate(rms=9.0), candidate("delay", rms=2.3)
    # leaves 1.25 µm of the fitted part, the floor is 1.2; less than the other one on both parts taken together
    likelier = candidate("sensor_drift", rms=2.36, unseen=1.9)
    assert lucky.adequate
    assert not likelier.adequate
    led = decided(search_over(base, lucky, likelier), [("delay",), ("sensor_drift",)])
    assert led.best is likelier
    assert led.alternatives == (lucky,)
    # of a small mismatch it leaves too much of the held-out part, 1.66 of 2.2 µm: that is no answer, however likely it is
    base, bad = candidate(rms=3.0), candidate("sensor_drift", rms=2.0, unseen=2.6)
    assert bad.evidence - lucky.evidence > np.log(20)
    assert not suffices(bad, base)
    naming = decided(search_over(base, lucky, bad), [("delay",), ("sensor_drift",)])
    assert naming.best is lucky
    assert naming.alternatives == (bad,)


@pytest.mark.parametrize(("fast", "leads"), [(0.15, True), (0.0, False)])
def test_what_is_likelier_by_far_is_so_by_what_the_two_differ_in(candidate, search_over, differing_fast, fast, leads):
    """By blocks they have less than 1 nat between them; ln 20 = 3.0 are strong."""
    lucky = differing_fast(candidate("delay", rms=2.25), fast)
    likelier = differing_fast(candidate("sensor_drift", rms=2.36, unseen=1.95), 0.0)
    assert lucky.adequate and not likelier.adequate
    assert bool(advantage(likelier, lucky) > np.log(20)) is leads
    found = decided(search_over(candidate(rms=9.0), lucky, likelier), [("delay",), ("sensor_drift",)])
    assert (found.best is likelier) is leads


SEEN, UNSEEN = 1600.0, 1700.0
"""Periods, of which 420 s are more than a quarter, and less."""


def with_a_period(swing: Candidate, effect: Effect) -> Candidate:
    """The same, in whose plant the effect stands."""
    plant = swing.calibration.plant
    plant.effects, plant.effect_names = (effect,), swing.effects
    plant.parameters = {p.name: p for p in effect.parameters}
    return swing


@pytest.mark.parametrize(
    ("period", "tone", "left", "lead"),
    [
        (UNSEEN, SEEN, 2.2, "periodic_disturbance"),
        (SEEN, SEEN, 2.2, "thermal_stiffness"),  # its cycle was recorded
        (UNSEEN, UNSEEN, 2.2, "thermal_stiffness"),  # the other one's was not, either
        (UNSEEN, SEEN, 4.0, "thermal_stiffness"),  # the other one does not suffice
    ],
)
def test_a_cycle_that_was_hardly_recorded_does_not_lead(candidate, search_over, period, tone, left, lead):
    """As a rule it is the likeliest: with a period and a phase that are free it is any slow curve."""
    swing = with_a_period(candidate("thermal_stiffness", rms=2.05), ThermalStiffness(period=period))
    other = with_a_period(candidate("periodic_disturbance", rms=left), PeriodicDisturbance(frequency=1 / tone))
    likely, base = {swing.effects: 0.9, other.effects: 0.1}, candidate(rms=9.0)
    naming = Naming(candidates=(base, swing, other), best=swing, alternatives=(other,), probabilities=likely, noise=2.0)
    found = shown_first(search_over(base, swing, other), naming)
    assert found.best.effects == (lead,)
    assert {c.effects for c in (found.best, *found.alternatives)} == {swing.effects, other.effects}
    assert found.probabilities == likely


@pytest.fixture
def led_by_a_swing(candidate, search_over):
    """A search, and its decision: a swing, and a creep that a drift comes nearer to than to the swing."""
    base, creep = candidate(rms=9.0), candidate("creep", rms=2.1)
    swing = with_a_period(candidate("thermal_stiffness", rms=2.0), ThermalStiffness(period=UNSEEN))
    drift, delay = candidate("sensor_drift", rms=2.15), candidate("delay", rms=4.0)
    search = search_over(base, swing, creep, drift, delay)
    likely = {c.effects: p for c, p in ((swing, 0.9), (creep, 0.08), (drift, 0.02), (delay, 0.0))}
    tried = tuple(search.tried.values())
    return search, Naming(candidates=tried, best=swing, alternatives=(creep,), probabilities=likely, noise=2.0)


def test_what_leads_instead_brings_its_own_alternatives(led_by_a_swing):
    """Against the swing the drift has 100 ln(2.15/2.0) = 7.2 nats, against the creep 2.4: less than ln 20."""
    search, naming = led_by_a_swing
    found = shown_first(search, naming)
    assert found.best.effects == ("creep",)
    assert [c.effects for c in found.alternatives] == [("thermal_stiffness",), ("sensor_drift",)]


def test_what_was_fitted_in_another_form_does_not_lead(led_by_a_swing, candidate):
    """It would be judged against this form without effects, and its reading of the rig would count for it."""
    search, naming = led_by_a_swing
    elsewhere = replace(naming, alternatives=(candidate("creep", rms=2.1),))
    assert shown_first(search, elsewhere) is elsewhere


@pytest.mark.parametrize(
    ("period", "orders"), [(UNSEEN, [("creep",), ("thermal_stiffness",)]), (SEEN, [("thermal_stiffness",)])]
)
def test_what_the_evidence_has_first_comes_after_what_was_shown(led_by_a_swing, period, orders):
    """Were the one that leads refuted, nobody would have asked the likelier one."""
    search, naming = led_by_a_swing
    with_a_period(naming.best, ThermalStiffness(period=period))
    assert [answer.best.effects for answer in on_everything(search, naming)] == orders


def test_a_pair_gives_way_to_one_effect_whose_rough_fit_was_far_from_its_minimum(candidate, search_over, monkeypatch):
    base, drift, stuck = candidate(rms=5.7), candidate("permittivity_drift", rms=4.0), candidate("creep", rms=3.6)
    pair, settled = candidate("creep", "permittivity_drift", rms=2.05), candidate("creep", rms=2.07)
    search = search_over(base, drift, stuck, pair)
    assert decided(search, [pair.effects]).best is pair

    def fit(full, several):
        assert full == pair.effects
        assert ("creep",) in several
        search.tried["creep",] = settled

    monkeypatch.setattr(search, "fit_from", fit)
    assert decided_surely(search, [pair.effects]).best is settled
    search.tried[("creep",)], settled = stuck, stuck  # where the second look finds nothing better, both stay
    assert decided_surely(search, [pair.effects]).best is pair


def test_whatever_is_decided_for_is_fitted_without_each_of_its_effects_first(candidate, search_over, monkeypatch):
    """Better fits of single effects may leave nothing to one pair, and the next one's are as rough as those were."""
    alone = [candidate("creep", rms=4.0), candidate("delay", rms=4.0), candidate("mullins", rms=4.0)]
    first, second = candidate("creep", "delay", rms=2.05), candidate("delay", "mullins", rms=2.1)
    search = search_over(candidate(rms=9.0), *alone, first, second)
    better, asked = {first.effects: candidate("creep", rms=2.2), second.effects: candidate("mullins", rms=3.9)}, []

    def fit(full, several):
        asked.append(full)
        search.tried[better[full].effects] = better[full]

    monkeypatch.setattr(search, "fit_from", fit)
    monkeypatch.setattr(search, "is_possible", lambda c: len(c.effects) > 1)  # creep alone needs a film that is none
    assert decided_surely(search, [first.effects, second.effects]).best is second
    assert asked == [first.effects, second.effects]


def test_in_two_that_come_out_of_three_each_may_be_replaced_by_what_acts_as_it(candidate, search_over, monkeypatch):
    """A tone imitates a swing of temperature; beside a clip that was lost, too, the swing had not been fitted well."""
    names = "amplifier_saturation", "periodic_disturbance", "thermal_stiffness"
    alone = [candidate(name, rms=7.0) for name in names]
    three, tone, swing = candidate(*names, rms=2.05), candidate(*names[:2], rms=2.1), candidate(*names[::2], rms=2.0)
    pairs = candidate(*names[::2], rms=5.0), candidate(*names[:2], rms=6.0), candidate(*names[1:], rms=6.0)
    search, asked = search_over(candidate(rms=9.0), *alone, three, *pairs), []

    def fit(full, several):
        if full == names:
            search.tried[tone.effects] = tone

    def siblings(rest, full):
        asked.append((rest, full))
        search.tried[swing.effects] = swing
        return [swing.effects] * (rest == names[:1])

    monkeypatch.setattr(search, "fit_from", fit)
    monkeypatch.setattr(search, "_siblings", siblings)
    assert decided_surely(search, [three.effects]).best is swing
    rests = [(names[:1], tone.effects), (names[1:2], tone.effects)]
    rests += [(names[:1], swing.effects), (names[2:], swing.effects)]  # what came in the place of one is looked at, too
    assert sorted(asked) == sorted(rests)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("answered", [decided_surely, settled, lambda search, stage: nearly(search)])
def test_what_acts_as_one_of_two_is_tried_before_they_are_the_answer(
    candidate, search_over, monkeypatch, answered, known
):
    alone = [candidate(name, rms=7.0) for name in ("creep", "periodic_disturbance", "thermal_stiffness")]
    tone, swing = candidate("creep", "periodic_disturbance", rms=2.1), candidate("creep", "thermal_stiffness", rms=2.0)
    before = (candidate("creep", "thermal_stiffness", rms=5.0),) if known else ()
    search = search_over(candidate(rms=9.0), *alone, tone, *before)
    monkeypatch.setattr(search, "settled", search.decision)
    monkeypatch.setattr(search, "fit_from", lambda full, several: None)

    def siblings(rest, full):
        search.tried[swing.effects] = swing
        return [swing.effects]

    monkeypatch.setattr(search, "_siblings", siblings)
    naming = answered(search, [tone.effects, *(c.effects for c in before)])
    assert naming.best is swing
    named = [naming.best.effects, *(c.effects for c in naming.alternatives)]
    assert len(named) == len(set(named))


def test_an_idle_second_effect_does_not_become_a_cause(candidate, search_over):
    base, drift = candidate(rms=5.2), candidate("sensor_drift", rms=4.0)
    creep = candidate("creep", rms=2.2, unseen=3.1)
    pair = candidate("creep", "sensor_drift", rms=2.25)
    search = search_over(base, creep, drift, pair)
    # the second effect saves 6.27 - 5.06 = 1.21 of 5.2² - 2² = 23: less than 1.2²
    assert decided(search, [pair.effects]).best is None
    # alone, creep leaves 2.37 on the held-out part, twice the model error, and takes away 81 % of the energy
    assert nearly(search).best is None
    better = candidate("creep", rms=2.3, unseen=2.6)
    # 2.6² - 2² = 1.66²: it takes away 94 % of the energy and leaves 1.4 times the model error
    assert nearly(search_over(base, better, drift)).best is better


@pytest.mark.parametrize("alone, answer", [(2.3, [("creep", "delay"), ("delay",)]), (2.06, [])])
def test_a_pair_of_which_one_effect_counts_for_less_than_the_floor_is_doubted(
    candidate, search_over, monkeypatch, alone, answer
):
    """Nothing else explains the recordings: it is better than no answer, and the other effect alone stays possible."""
    base, creep, delay = candidate(rms=3.2), candidate("creep", rms=2.9), candidate("delay", rms=alone, unseen=2.6)
    # 1.2² is 1.44. Without creep 1.31 return, or 0.58: less than half
    pair = candidate("creep", "delay", rms=2.06, unseen=2.2)
    search = search_over(base, creep, delay, pair)
    monkeypatch.setattr(Search, "fit_from", lambda *_: None)
    naming = nearly(search)
    found = [] if naming.best is None else [naming.best.effects, *(c.effects for c in naming.alternatives)]
    assert found == answer
    assert [naming.probabilities[effects] for effects in answer] == [0.5] * len(answer)


def test_a_second_effect_that_is_a_trifle_of_the_mismatch_is_none_whatever_it_counts_for(
    candidate, search_over, monkeypatch
):
    monkeypatch.setattr(Search, "fit_from", lambda *_: None)
    # without creep 4.18² - 2.3² = 12.2 return, eight times 1.2², but of 22² - 2² a fortieth
    base, creep, delay = candidate(rms=22.0), candidate("creep", rms=20.0), candidate("delay", rms=4.18)
    search = search_over(base, creep, delay, candidate("creep", "delay", rms=2.3))
    assert nearly(search).best is None


def test_two_that_suffice_are_fitted_without_each_of_them_first(candidate, search_over, monkeypatch):
    """2.6 µm are 1.7 beyond the noise: more than 1.2, but of 8.8 hardly anything. A creep of 2.5 alone does as well."""
    alone, pair = [candidate("creep", rms=8.0), candidate("delay", rms=7.0)], candidate("creep", "delay", rms=2.6)
    search, asked = search_over(candidate(rms=9.0), *alone, pair), []
    monkeypatch.setattr(search, "fit_from", lambda full, several: asked.append(full))
    assert nearly(search).best is pair
    assert asked == [pair.effects]

    def fit(full, several):
        search.tried["creep",] = candidate("creep", rms=2.5)

    monkeypatch.setattr(search, "fit_from", fit)
    assert nearly(search).best.effects == ("creep",)


@pytest.mark.parametrize("late, hope", [(4.3, True), (4.4, False)])
def test_what_may_settle_takes_most_of_the_unseen_part_too(candidate, search_over, late, hope):
    """Of 5.7² - 2² - 1.2² = 27.1 beyond noise and floor, 4.3 µm leave 13.1 and 4.4 µm 13.9, where half is 13.5."""
    slow = candidate("dielectric_absorption", rms=2.1, unseen=late)
    search = search_over(candidate(rms=5.7), slow)
    search.settled = lambda competing, hopeful: [hopeful(c) for c in competing]
    assert settled(search, [slow.effects]) == [hope]


@pytest.mark.parametrize("alone, answer", [(2.3, ("creep",)), (3.6, ("creep", "delay"))])
def test_of_two_that_settle_none_is_named_where_one_is_enough(
    candidate, search_over, nothing, monkeypatch, alone, answer
):
    """A pair mends the tail of a slow law: 2.3² - 2² is 1.14², within 1.2²; of 3.6 µm 3.0 are left."""
    both = candidate("creep", "delay", rms=2.05, unseen=2.9)
    search = search_over(candidate(rms=5.7), candidate("creep", rms=4.0), candidate("delay", rms=5.0), both)

    def fit(full, several):
        assert ("creep",) in several
        search.tried["creep",] = candidate("creep", rms=alone)

    monkeypatch.setattr(search, "fit_from", fit)
    found = replace(nothing, best=both)
    monkeypatch.setattr(search, "settled", lambda competing, hopeful: found if both in competing else nothing)
    assert settled(search, [both.effects]).best.effects == answer


def test_three_effects_must_explain_to_the_plants_own_error(candidate, search_over, monkeypatch):
    monkeypatch.setattr(Search, "fit_from", lambda *_: None)
    base, sizes = candidate(rms=9.0), {"creep": 8.0, "delay": 7.0, "mullins": 6.0}
    pairs = [candidate(*pair, rms=5.0) for pair in itertools.combinations(sizes, 2)]
    three = candidate(*sizes, rms=2.6)  # 1.7 beyond the noise, 1.4 times the plant's own error, of 8.8: 96 %
    assert suffices(three, base)
    tried = [candidate(name, rms=rms) for name, rms in sizes.items()]
    assert nearly(search_over(base, *tried, *pairs, three)).best is None
    two = candidate("creep", "delay", rms=2.6)
    assert nearly(search_over(base, *tried, two)).best is two

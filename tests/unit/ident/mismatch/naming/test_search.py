"""What a search tries next, on residuals whose sizes are given."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from deatwin.ident.mismatch.naming import name
from deatwin.plant import Creep, Delay, ElectrodeLoss, SensorJump, ThermalStiffness


def test_what_did_well_alone_is_tried_beside_another_whatever_its_score(candidate, search_over):
    sizes = {"delay": 3.0, "creep": 3.2, "mullins": 4.9, "leakage": 5.0}
    tried = [candidate(name, rms=rms) for name, rms in sizes.items()]
    search = search_over(candidate(rms=5.7), *tried, candidate("end_stop", rms=3.1))
    search.leads = {name: f"lead of {name}" for name in sizes}
    # of the three best beside delay, one has no lead: it was found elsewhere
    assert search._good_alone(("delay",)) == ["lead of creep", "lead of mullins"]


def test_a_further_effect_is_looked_for_beside_the_best_and_must_count(candidate, search_over):
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


def test_what_leaves_a_trifle_may_imitate_two_others(candidate, search_over):
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
def test_where_nothing_counts_beside_the_best_the_next_best_is_gone_on_with_if_it_takes_most(
    candidate, search_over, next_best, asked
):
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


@pytest.mark.parametrize(
    ("sizes", "found"),
    [
        ((2.2, 9.0), [("creep", "sensor_drift"), ("in its place",)]),  # it becomes the best: are there others like it?
        ((8.0, 5.0), [("creep", "sensor_drift")]),  # another pair, which was tried, leaves less
        ((26.5, 26.9), []),  # 27² - 26.5² is less than a twentieth of the mismatch
    ],
)
def test_pairs_that_promise_most_together_are_tried_if_one_counts(candidate, search_over, monkeypatch, sizes, found):
    base, swing = candidate(rms=28.3), candidate("thermal_stiffness", rms=20.0)
    alone = candidate("creep", rms=27.0), candidate("sensor_drift", rms=27.0)
    search = search_over(base, swing, *alone, candidate("creep", "delay", rms=sizes[1]), candidate("delay", rms=28.0))
    pair = candidate("creep", "sensor_drift", rms=sizes[0])
    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.joint_trials", lambda of: ["the most promising"])
    search._new = lambda trials: search.tried.update({pair.effects: pair}) or [pair.effects] * len(trials)
    search.replacing = lambda before, best: [("in its place",)] if before == best == pair.effects else []
    search.beside = lambda names, finished: []
    del search._together  # the real one
    assert search.with_one_more([swing.effects, *(c.effects for c in alone)]) == found
    assert search.with_one_more([pair.effects]) == []  # beside two there are no pairs


def test_a_cycle_of_which_little_was_recorded_is_the_last_beginning(candidate, search_over):
    """420 s are a quarter of 1680 s: of a longer swing they show a drift."""
    base, creep, jump = candidate(rms=28.3), candidate("creep", rms=12.0), candidate("sensor_jump", rms=12.5)
    drift = candidate("sensor_drift", rms=10.0)

    def asked_for(swing, period):
        plant = swing.calibration.plant
        plant.effects, plant.effect_names = (ThermalStiffness(),), ("thermal_stiffness",)
        plant.parameters = {p.name: p for p in ThermalStiffness(period=period).parameters}
        tried = [c for c in (creep, jump, drift) if len(c.effects) == len(swing.effects)]
        search = search_over(base, creep, jump, drift, swing)
        search.beside = lambda names, finished: asked.append(names) or []
        asked = []
        search.with_one_more([swing.effects, *(c.effects for c in tried)])
        return asked

    alone = candidate("thermal_stiffness", rms=11.0)
    assert asked_for(alone, 1600.0) == [("sensor_drift",), ("thermal_stiffness",)]
    assert asked_for(alone, 1700.0) == [("sensor_drift",), ("creep",)]
    best = candidate("thermal_stiffness", rms=9.0)
    assert asked_for(best, 1600.0)[0] == ("thermal_stiffness",)
    assert asked_for(best, 1700.0) == [("sensor_drift",), ("creep",)]
    assert asked_for(candidate("sensor_lag", "thermal_stiffness", rms=9.0), 1700.0)  # there is no other one


@pytest.mark.parametrize("left, goes_on", [(7.4, False), (5.0, True)])
def test_two_that_do_not_take_most_are_no_beginning_of_three(candidate, search_over, left, goes_on):
    """Of a mismatch of 8.7² - 2² µm² a pair that leaves 7.4 µm takes 29 %, one that leaves 5.0 µm 70 %."""
    base, pair = candidate(rms=8.7), candidate("amplifier_slew", "end_stop", rms=left)
    search = search_over(base, pair, candidate("amplifier_slew", rms=7.8), candidate("end_stop", rms=8.1))
    asked = []
    search.beside = lambda names, finished=None: asked.append(names) or []
    assert search.with_one_more([pair.effects]) == []
    assert asked == [pair.effects] * goes_on


@pytest.fixture
def replaced(candidate, search_over):
    """``replaced(rms)``: in the place of the delay beside a creep an electrode that loses area leaves so much."""
    singles = [candidate(name, rms=8.0) for name in ("creep", "delay", "electrode_loss")]
    for one in singles:
        one.calibration.given_up = False
    before = candidate("creep", "delay", rms=4.0)

    def make(rms):
        after = candidate("creep", "electrode_loss", rms=rms)
        last = candidate("electrode_loss", "sensor_drift", rms=2.1)
        search = search_over(candidate(rms=9.0), *singles, before)
        beside = {("creep",): [after], ("electrode_loss",): [last], ("delay",): []}
        asked, again = [], []

        def try_beside(names, finished=None):
            asked.append(names)
            search._gone_on.add(names)
            search.tried.update({c.effects: c for c in beside[names]})
            return [c.effects for c in beside[names]]

        search.beside = try_beside
        search._siblings = lambda names, best: again.append((names, best)) or [best]
        return search, asked, again

    return make


@pytest.mark.parametrize(("rms", "further"), [(3.0, [("electrode_loss",)]), (5.0, [])])
def test_what_is_better_in_the_place_of_one_effect_has_its_own_replaced(replaced, rms, further):
    search, asked, again = replaced(rms)
    search._gone_on.add(("delay",))  # that was done
    found = search.replacing(("delay", "creep"), ("creep", "delay"))
    assert asked == [("creep",), *further]  # nothing is looked for beside the same set twice
    assert (("electrode_loss", "sensor_drift") in found) is bool(further)
    first = [(("creep",), ("creep", "delay")), (("delay",), ("creep", "delay"))]
    later = [(("electrode_loss",), ("creep", "electrode_loss")), (("creep",), ("creep", "electrode_loss"))]
    assert [*map(set, (again[:2], again[2:]))] == [set(first), set(later) if further else set()]  # also what was done
    assert ("creep", "delay") in found


def test_beside_what_was_gone_on_with_nothing_is_looked_for_again(candidate, search_over):
    alone = candidate("creep", rms=8.0)
    alone.calibration.given_up = False
    search = search_over(candidate(rms=9.0), alone, candidate("creep", "delay", rms=4.0))
    search._siblings = lambda names, best: []
    looked = []
    search._leads = lambda names, _: looked.append(names) or ()
    for _ in range(2):
        search.replacing(("delay",), ("creep", "delay"))
    assert looked == [("creep",)]
    alone.calibration.given_up = True  # it is fitted first: then more may be beside it
    search.fit_some = lambda full, rest: setattr(alone.calibration, "given_up", False)
    search.replacing(("delay",), ("creep", "delay"))
    assert looked == [("creep",), ("creep",)]


def test_what_comes_at_a_time_or_with_a_period_is_tried_again_where_another_effect_does_better(candidate, search_over):
    """Beyond a noise of 2 and a model error of 1.2 µm the jump and the tone leave 1.5² µm², the swing 3² µm²."""
    best = candidate("periodic_disturbance", "sensor_jump", rms=2.5)
    best.calibration.plant.effect_names = best.effects
    tried = {"thermal_stiffness": 3.6, "creep": 3.6, "electrode_loss": 2.7}
    pairs = [candidate(*sorted(("sensor_jump", name)), rms=rms) for name, rms in tried.items()]
    search = search_over(candidate(rms=9.0), candidate("sensor_jump", rms=6.0), best, *pairs)
    search.problem.everywhere = [ThermalStiffness(), Creep(), ElectrodeLoss(), Delay(), SensorJump()]
    # the creep has neither; with a lost electrode 1.81² µm² is left, and (1.5² + 1.2²) / (1.81² + 1.2²) is 0.78
    open_beside = [e.name for e in search._open_beside(("sensor_jump",), best.effects)]
    assert open_beside == ["thermal_stiffness", "electrode_loss", "delay"]
    search.tried["electrode_loss", "sensor_jump"] = candidate("electrode_loss", "sensor_jump", rms=2.65)  # 0.82
    assert "electrode_loss" not in [e.name for e in search._open_beside(("sensor_jump",), best.effects)]


def test_beside_a_set_what_acts_as_the_best_there_is_tried_too(candidate, search_over):
    creep = candidate("creep", rms=4.0)
    pairs = [candidate("creep", "delay", rms=3.0), candidate("creep", "mullins", rms=2.5)]
    search, asked = search_over(candidate(rms=9.0), creep, *pairs), []
    search._leads, search._good_alone = lambda names, _: (), lambda names: []
    # one of them was tried again
    search._siblings = lambda names, best: asked.append((names, best)) or [found[0], "what acts so"]
    found = []
    search._new = lambda trials, finished: list(found)
    assert search.beside(creep.effects) == [] and asked == []  # there is no best
    found += [pair.effects for pair in pairs]
    assert search.beside(creep.effects) == [*found, "what acts so"]
    assert asked == [(("creep",), ("creep", "mullins"))]


@dataclass(frozen=True)
class _Typical:
    name: str

    def __str__(self):
        return f"typical {self.name}"


def test_what_acts_as_the_best_is_new_or_a_better_fit_of_what_is_known(candidate, search_over, monkeypatch):
    best, jump = candidate("periodic_disturbance", "sensor_jump", rms=2.5), candidate("sensor_jump", rms=6.0)
    swing, creep = ("sensor_jump", "thermal_stiffness"), ("creep", "sensor_jump")
    search = search_over(candidate(rms=9.0), jump, best, candidate(*swing, rms=3.6))
    jump.calibration.plant.with_effects = lambda effect: f"unbiased, {effect}"
    best.calibration.plant.without_effects = lambda *added: SimpleNamespace(with_effects=lambda e: f"bare, {e}")
    asked, alike = [], ("thermal_stiffness", "creep")

    def siblings(problem, fit, added, effects, known):
        asked.append((fit, added, effects))
        return [SimpleNamespace(effect=_Typical(n), estimate=n) for n in alike]

    def attempt(trials, alternative):
        # from the best set's plant without the effect, or else from that without both
        assert [(t.start, t.biased) for t in trials] == [(f"bare, {n}", f"unbiased, typical {n}") for n in alike]
        assert alternative == asked[-1][0].rms and {id(t.without) for t in trials} == {id(jump.calibration)}
        return search._know([candidate(*swing, rms=2.2), candidate(*creep, rms=5.0)])

    monkeypatch.setattr("deatwin.ident.mismatch.naming.sets.siblings", siblings)
    search.attempt = attempt
    del search._siblings  # the real one
    search.names_of, search._open_beside = lambda trial: (), lambda names, best: [names, best]
    old = SimpleNamespace()
    search.leads = {"thermal_stiffness": old}
    assert search._siblings(jump.effects, best.effects) == [swing, creep]
    assert list(search.leads) == ["thermal_stiffness", "creep"] and search.leads["thermal_stiffness"] is not old
    assert asked == [(best.calibration, ("periodic_disturbance",), [jump.effects, best.effects])]
    assert search.tried[swing].calibration.rms == pytest.approx(2.2)
    assert search._siblings(jump.effects, best.effects) == []  # another is the best by now
    search.tried[swing] = candidate(*swing, rms=3.6)
    assert search._siblings(jump.effects, best.effects) == [] and len(asked) == 1  # it is the best again, and done
    better = candidate(*best.effects, rms=2.4)
    better.calibration.plant.without_effects = best.calibration.plant.without_effects
    search.tried[best.effects] = replace(better, unseen=search.tried[()].unseen)
    assert search._siblings(jump.effects, best.effects) == [] and len(asked) == 1  # it does not take most
    search.tried[best.effects] = better
    assert search._siblings(jump.effects, best.effects) == [swing] and len(asked) == 2  # what else acts as a better fit


@pytest.fixture
def looked_for(candidate, search_over, monkeypatch):
    """A search with two single effects, and the plants and fits for which events were looked for."""
    asked = []
    monkeypatch.setattr(
        "deatwin.ident.mismatch.naming.sets.event_leads",
        lambda unbiased, fit, effects, parts: asked.append((unbiased, fit)) or ((fit, effects, parts),),
    )
    return search_over(candidate(rms=9.0), candidate("creep", rms=5.0), candidate("delay", rms=7.0)), asked


def test_events_are_looked_for_once_in_each_fit(looked_for, candidate):
    search, asked = looked_for
    creep, delay = (search.tried[(name,)].calibration for name in ("creep", "delay"))
    assert [found[0][0] for found in search.event_leads(("delay",), ("creep",))] == [delay, creep]
    ((lead,),) = search.event_leads(("creep",))
    assert lead == (creep, search.problem.effects, search.problem.fitted)
    assert asked == [(search.problem.nominal, fit) for fit in (delay, creep)]
    better = candidate("creep", rms=4.0)
    search.tried[("creep",)] = replace(better, noise=1.9)  # another noise is no other fit
    search.tried[("creep",)] = replace(search.tried[("creep",)], noise=1.8)
    assert search.event_leads(("creep",), ("creep",))[0][0][0] is better.calibration
    assert [fit for _, fit in asked] == [delay, creep, better.calibration]


def test_what_promises_more_from_before_an_event_is_what_an_effect_promises(candidate, search_over):
    jump, creep = SimpleNamespace(name="sensor_jump", event="at"), SimpleNamespace(name="creep", event="")
    biased, seen, slow = (
        SimpleNamespace(effect=effect, share=share) for effect, share in ((jump, 0.1), (jump, 0.6), (creep, 0.3))
    )
    search = search_over(candidate(rms=9.0), candidate("delay", rms=5.0))
    search._screened = lambda names, further: (slow, biased)
    asked = []
    search.event_leads = lambda *several: asked.append(several) or [(seen,)]
    for names in ((), ("delay",)):
        assert search._leads(names, [jump, creep]) == (seen, slow)
        assert search._leads(names, [creep]) == (slow,)  # no event is looked for where none is asked for
    assert asked == [((),), (("delay",),)]


def test_the_share_that_is_told_does_not_fall_if_a_search_begins_again_with_more_steps(monkeypatch):
    begun, told = [], []

    class Begun:
        def __init__(self, problem, base, known, fitted):
            begun.append((problem.nominal.steps, base))

        def beside(self, names, finished):
            for share in (0.5, 1.0):
                finished(share)
            return [("creep",)]

        def more_finely(self, stage):
            return Nominal(steps=8)

        def judge_by_the_best(self, stage):
            raise LookupError  # the rest of the search is not of interest

    @dataclass
    class Nominal:
        stages: int = 4
        steps: int = 1

    @dataclass
    class Problem:
        nominal: Nominal

    monkeypatch.setattr(name, "Search", Begun)
    base = SimpleNamespace(solved_like=lambda other: f"base in {other.steps}")
    with pytest.raises(LookupError):
        next(name.explanations(Problem(Nominal()), base, [], finished=told.append))
    assert begun == [(1, base), (8, "base in 8")]
    assert told == sorted(told) and told[1] == pytest.approx(1 / 3)

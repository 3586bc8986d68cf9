"""What counts as a cause among the sets that were tried, and which fits are kept, on residuals of given sizes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming import tried
from deatwin.ident.mismatch.naming.candidate import Distance
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.plant import Experiment, Plant, Recording, Stack


def test_an_effect_of_a_pair_must_count_for_more_than_the_model_error(candidate, search_over):
    base = candidate(rms=5.7)
    drift, creep = candidate("permittivity_drift", rms=2.54), candidate("creep", rms=4.98)
    pair = candidate("creep", "permittivity_drift", rms=2.05)
    # taking creep out costs 2.54² - 2.05² = 2.25, more than 1.2² = 1.44
    assert search_over(base, drift, creep, pair).each_counts(pair.effects)
    near = candidate("permittivity_drift", rms=2.2)
    # taking creep out of this pair costs 2.2² - 2.05² = 0.64 only
    assert not search_over(base, near, creep, pair).each_counts(pair.effects)


def test_a_fit_that_cannot_be_had_is_tried_once(candidate, search_over, monkeypatch):
    search = search_over(candidate(rms=5.0), candidate("creep", rms=4.0), candidate("creep", "delay", rms=2.1))
    asked: list[tuple[str, ...]] = []

    def lost(subsets):
        asked.extend(subsets)
        search.lost.extend("+".join(rest) for rest in subsets)

    monkeypatch.setattr(search, "fit_subsets", lost)
    assert search.each_counts(("creep", "delay"))  # as far as it is known: without delay much returns
    assert search.each_counts(("creep", "delay"))
    assert asked == [("delay",)]


def test_all_unknown_subsets_are_fitted_even_if_one_shows_that_an_effect_does_not_count(
    candidate, search_over, monkeypatch
):
    """Creep led to mullins, which with delay leaves less than with creep: so creep does not count, but the others do."""
    known = [candidate("creep", rms=6.0), candidate("creep", "delay", rms=4.0)]
    search = search_over(candidate(rms=9.0), *known, candidate("creep", "delay", "mullins", rms=3.0))

    def fit(subsets):
        for rest, rms in ((("creep", "mullins"), 3.0), (("delay", "mullins"), 2.0)):
            assert rest in subsets
            search.tried[rest] = candidate(*rest, rms=rms)

    monkeypatch.setattr(search, "fit_subsets", fit)
    assert not search.each_counts(("creep", "delay", "mullins"))
    assert ("delay", "mullins") in search.tried


def test_what_padding_asks_of_several_sets_is_fitted_at_once(candidate, search_over, monkeypatch):
    """Each pair lacks a fit of one of its effects; delay alone leaves as little as the pair with creep."""
    base, creep = candidate(rms=5.0), candidate("creep", rms=4.0)
    pairs = [candidate("creep", "delay", rms=2.1), candidate("creep", "mullins", rms=2.1)]
    search = search_over(base, creep, *pairs)
    asked: list[dict] = []

    def fit(subsets):
        asked.append(dict(subsets))
        for alone in (candidate("delay", rms=2.1), candidate("mullins", rms=4.0)):
            search.tried[alone.effects] = alone

    monkeypatch.setattr(search, "fit_subsets", fit)
    assert search.unpadded([pair.effects for pair in pairs]) == [("creep", "mullins")]
    assert asked == [{("delay",): ("creep", "delay"), ("mullins",): ("creep", "mullins")}]


def test_an_effect_that_does_little_by_itself_is_no_cause(candidate, search_over):
    """The fit with it is better since the one without had not found its minimum; from there it had to do 3.6."""
    base = candidate(rms=5.7)
    there, idle = candidate("creep", rms=2.1, alone=3.7), candidate("creep", rms=2.1, alone=1.7)
    assert search_over(base, there).counts(there)
    assert not search_over(base, idle).counts(idle)


def test_what_takes_away_little_of_a_small_mismatch_is_no_explanation(candidate, search_over):
    base = candidate(rms=2.4)  # with a noise of 2, 1.76 is missing in square, and 1.44 would be adequate
    little, most = candidate("creep", rms=2.3), candidate("mullins", rms=2.1)
    assert little.adequate and most.adequate
    assert not search_over(base, little).counts(little)
    assert search_over(base, most).counts(most)


# Beyond a noise of 2.0 µm the power of 3.0 µm is 5.0; half of it must go, and 2.6 µm leave 2.8 of it.
@pytest.mark.parametrize(("fitted", "unseen", "returns"), [(2.1, 4.0, True), (2.6, 4.0, False), (2.6, 2.1, True)])
def test_what_fails_only_where_it_is_extrapolated_may_return(candidate, search_over, fitted, unseen, returns):
    base, best = candidate(rms=3.0), candidate("creep", rms=2.1)
    strayed = candidate("dielectric_absorption", rms=fitted, unseen=unseen)
    search = search_over(base, best, strayed)
    assert search.is_possible(strayed) is (unseen < 3.0)
    naming = Naming(candidates=(base, best, strayed), best=best, alternatives=(), probabilities={}, noise=2.0)
    assert search.may_return(naming, strayed) is returns
    search.is_refuted = lambda candidate, by: candidate is strayed and by is best
    near, far = (
        replace(naming, distances=(Distance(effects=("creep", "dielectric_absorption"), d2=d2),)) for d2 in (15.9, 16.1)
    )
    assert search.may_return(near, strayed) is returns  # what the inputs cannot tell apart is not refuted
    assert not search.may_return(far, strayed)


@pytest.mark.parametrize(("odds", "rms", "refuted"), [(3.1, 2.2, True), (2.9, 2.2, False), (3.1, 2.05, False)])
def test_a_likelihood_refutes_by_strong_evidence_that_held_out_data_do_not_contradict(
    candidate, search_over, monkeypatch, odds, rms, refuted
):
    """Log 20 is 3.0; the best explanation leaves 2.1 µm."""
    best, other = candidate("creep", rms=2.1), candidate("delay", rms=rms)
    search = search_over(candidate(rms=9.0), best, other)
    monkeypatch.delattr(search, "is_refuted")
    monkeypatch.setattr(type(search), "scale", SimpleNamespace(over=lambda one, two: odds if one is best else -odds))
    assert search.is_refuted(other, best) is refuted


def test_some_effects_of_a_set_are_fitted_from_its_values_and_the_better_fits_stay(candidate, search_over, monkeypatch):
    """That of the creep ends worse than before, that of the delay better, and that of the tone cannot be had."""
    full = ("creep", "delay", "periodic_disturbance")
    known = [candidate("creep", "delay", rms=3.0), candidate("delay", "periodic_disturbance", rms=4.0)]
    search, asked = search_over(candidate(rms=9.0), *known, candidate(*full, rms=2.1)), []
    found = {("creep", "delay"): 3.1, ("delay", "periodic_disturbance"): 2.5}
    monkeypatch.setattr(search, "plant_of", lambda full, rest: rest)

    def refitted(problem, plants, noise, fitted):
        asked.append(plants)
        fitted = [candidate(*names, rms=rms) for names, rms in found.items()]
        fitted[0].calibration.plant.rig = SimpleNamespace(model_error=1.2, sample_time=0.02, noise=1.9)
        return fitted

    monkeypatch.setattr("deatwin.ident.mismatch.naming.tried.refitted", refitted)
    fewer = search.fit_fewer(full)
    assert len(asked) == 1 and set(asked[0]) == {*found, ("creep", "periodic_disturbance")}  # all at once
    assert set(fewer) == set(found)
    assert search.lost == []  # it may yet begin from elsewhere
    left = {names: search.tried[names].calibration.rms for names in found}
    assert left == {("creep", "delay"): pytest.approx(3.0), ("delay", "periodic_disturbance"): pytest.approx(2.5)}
    assert {c.noise for c in search.tried.values()} == {1.9}  # whichever fit it is, it is judged by the same


def test_a_decision_keeps_what_the_inputs_cannot_distinguish(candidate, search_over):
    best, near = candidate("creep", rms=2.1), candidate("delay", rms=2.3)
    search = search_over(candidate(rms=9.0), best, near)
    assert search.decision([best, near], lambda c: c is best).alternatives == ()
    search.with_distances = lambda naming, competing: replace(naming, alternatives=tuple(competing[1:]))
    assert search.decision([best, near], lambda c: c is best).alternatives == (near,)
    assert search.settled([best, near], lambda c: False).alternatives == (near,)


@pytest.mark.parametrize("pair, again", [(3.0, True), (2.4, False)], ids=["lost its way", "found its minimum"])
def test_a_pair_that_leaves_more_than_one_of_its_effects_begins_again_from_that_effect(
    candidate, search_over, monkeypatch, pair, again
):
    """Creep, beside which delay was tried, leaves 4.0; delay alone leaves 2.5, so both leave no more than 2.5."""
    alone = [candidate("creep", rms=4.0), candidate("delay", rms=2.5)]
    search = search_over(candidate(rms=5.0), *alone)
    fits: list[object] = []
    monkeypatch.setattr(tried, "run_trials", lambda *_: [candidate("creep", "delay", rms=pair)])
    monkeypatch.setattr(tried, "with_little", lambda plant, best: best)
    monkeypatch.setattr(search, "refit", fits.extend)
    search.attempt([])
    assert fits == ([alone[1].calibration] if again else [])


def test_a_rig_that_friction_seemed_to_damp_gets_the_steps_that_its_ringing_needs():
    """Where friction is missing, damping imitates it: at 300 N s/m a stack follows slowly, at 3 N s/m it rings at 38 Hz."""
    rig = Stack(sample_time=0.01, noise=1e-7)
    friction = next(effect for effect in rig.effects() if effect.name == "coulomb_friction")
    damped, ringing = Plant(rig=rig, stages=4), Plant(rig=rig, effects=(friction,), stages=4)
    commands = np.repeat(np.random.default_rng(5).uniform(0.0, 1.0, 10), 10)
    recording = Recording(inputs=commands[None], outputs=np.zeros((1, 100)), sample_time=0.01)
    part = SimpleNamespace(experiment=Experiment(recordings=(recording,)))
    problem = SimpleNamespace(nominal=damped, of_first=SimpleNamespace(fitted=(part,)))

    def made(plant, damping, evidence):
        fit = SimpleNamespace(plant=plant.with_values({"damping": damping}))
        return SimpleNamespace(effects=plant.effect_names, calibration=fit, evidence=evidence)

    search = tried.Tried(problem, made(damped, 300.0, 0.0))
    search.tried[friction.name,] = made(ringing, 3.0, 1.0)
    assert search.more_finely([()]) is None
    # A mode of 3.4 rad a sample has a relative error of 7e-3 in one step of four stages, and of 1e-4 in two.
    finer = search.more_finely([(friction.name,)])
    assert finer is not None and finer.steps > 1 and not finer.effects
    assert search.more_finely([]) is None

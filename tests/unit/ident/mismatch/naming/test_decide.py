"""Decisions between explanations, on residuals whose sizes are given: which leads, and which stay its alternatives."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import suffices
from deatwin.ident.mismatch.naming.decide import (
    Distance,
    Naming,
    cannot_rule_out,
    decide,
    is_as_likely,
    with_all_distances,
    with_distances,
)

PROBLEM = SimpleNamespace(everything=(), jobs=1)


def test_the_best_adequate_explanation_stands_alone(candidate, is_adequate, noise):
    right, wrong = candidate("creep", rms=2.1), candidate("electrode_rc", rms=4.7)
    decided = decide((right, wrong), (wrong, right), noise, is_adequate, is_adequate)
    assert decided.best is right
    assert decided.alternatives == ()
    assert decided.probabilities[("creep",)] == pytest.approx(1.0)


def test_equal_explanations_are_alternatives(candidate, is_adequate, noise):
    one, other = candidate("creep", rms=2.10), candidate("permittivity_drift", rms=2.11)
    decided = decide((one, other), (one, other), noise, is_adequate, is_adequate)
    assert decided.alternatives == (other,)
    assert cannot_rule_out(other, one)


def test_many_that_are_unlikely_one_by_one_are_rivals_together(candidate, noise):
    best = candidate("creep", rms=2.1)
    # each 25 times less likely, 200 blocks: 100 ln(x) = ln 25; five of them hold a sixth of the probability
    unlikely = 2.1 * 25 ** (1 / 200)
    others = [candidate(name, rms=unlikely) for name in ("delay", "end_stop", "hysteresis", "leakage", "mullins")]
    stage = (best, *others)
    alone = decide(stage, stage[:2], noise, lambda c: c is best, lambda c: True)
    assert alone.probabilities[best.effects] == pytest.approx(25 / 26, rel=1e-6)
    assert alone.alternatives == ()
    together = decide(stage, stage, noise, lambda c: c is best, lambda c: True)
    assert together.probabilities[best.effects] == pytest.approx(25 / 30, rel=1e-6)
    held = together.probabilities[best.effects] + sum(together.probabilities[c.effects] for c in together.alternatives)
    # 28/30 are too few, 29/30 enough
    assert len(together.alternatives) == 4
    assert held > 0.95


def test_another_head_keeps_the_distances_that_are_known_from_it(candidate, noise):
    one, other, third = (candidate(name, rms=2.1) for name in ("creep", "delay", "leakage"))
    distances = (Distance(effects=("creep", "delay"), d2=9.0), Distance(effects=("creep", "leakage"), d2=4.0))
    naming = Naming(
        candidates=(one, other, third),
        best=one,
        alternatives=(other, third),
        probabilities={},
        noise=noise,
        distances=distances,
    )
    assert naming.with_best(one) is naming
    led = naming.with_best(other)
    assert led.best is other
    assert led.alternatives == (one, third)
    assert led.distances == (Distance(effects=("delay", "creep"), d2=9.0),)


def test_the_distance_to_a_rival_is_not_that_of_the_same_effects_in_another_form(candidate, noise):
    best, near, twin = candidate("creep", rms=2.1), candidate("leakage", rms=2.1), candidate("delay", rms=9.0)
    distances = (Distance(effects=("creep", "leakage"), d2=4.0), Distance(effects=("creep", "delay"), d2=147.0))
    naming = Naming(
        candidates=(best, near, twin),
        best=best,
        alternatives=(near,),
        probabilities={("creep",): 1.0, ("leakage",): 0.5},
        noise=noise,
        distances=distances,
    )
    alternative = candidate("delay", rms=2.1)
    asked = []

    def apart(one, other, parts, level):
        asked.append((one, other, level))
        return 2.0

    told = with_all_distances(naming.beside([alternative]), PROBLEM, apart)
    assert asked == [(best.calibration, alternative.calibration, noise)]  # of what is known nothing is asked again
    assert {d.effects: d.d2 for d in told.distances} == {("creep", "leakage"): 4.0, ("creep", "delay"): 2.0}
    led = with_all_distances(told.with_best(alternative), PROBLEM, apart)  # from which only one distance is known
    assert {d.effects: d.d2 for d in led.distances} == {("delay", "creep"): 2.0, ("delay", "leakage"): 2.0}
    assert {d.effects[1] for d in led.distances} == {"+".join(r.effects) for r in led.alternatives}


def test_a_short_experiment_of_its_own_rules_out_what_a_long_one_cannot(candidate):
    best = candidate("creep", rms=2.1)
    # 9000 samples tell nothing; in the last 700 fitted and 300 unseen ones the alternative leaves 1 more: 1 > (1.2 / 2)²
    mixed = np.where(np.arange(10_000) % 10 < 9, 2.1**2, 2.1**2 + 1.0)
    late = np.sqrt(np.sort(mixed))
    calibration = SimpleNamespace(**{**vars(best.calibration), "residuals": np.r_[late[:6300], late[-700:]]})
    alternative = replace(best, effects=("delay",), calibration=calibration, unseen=np.r_[late[6300:9000], late[-300:]])
    sizes = ((6300, 2700), (700, 300))
    best, alternative = replace(best, sizes=sizes), replace(alternative, sizes=sizes)
    assert alternative.mean_squares - best.mean_squares == pytest.approx([0.1, 0.0, 1.0])
    # 100 ln(1 + 0.1 / 2.1²) are 2.2 nats, with a parameter more 4.9: strong. 0.1 in the mean is less than 0.36
    clear = replace(best, calibration=SimpleNamespace(**{**vars(best.calibration), "names": ("a",) * 7}))
    assert not is_as_likely(alternative, clear)
    assert not cannot_rule_out(alternative, clear)
    assert cannot_rule_out(replace(alternative, sizes=()), replace(clear, sizes=()))
    few = ((6800, 2960), (200, 40))  # too few samples to say anything by themselves
    assert cannot_rule_out(replace(alternative, sizes=few), replace(clear, sizes=few))


def test_nothing_adequate_is_no_explanation(candidate, is_adequate, noise):
    decided = decide((), (candidate("creep", rms=3.5),), noise, is_adequate, is_adequate)
    assert decided.best is None


def test_good_on_the_fitted_part_alone_is_not_enough(candidate):
    assert not candidate("creep", rms=2.1, unseen=5.0).adequate


def test_what_suffices(candidate):
    base = candidate(rms=5.7)
    assert suffices(candidate("creep", rms=2.1), base)
    assert suffices(candidate("creep", rms=2.8), base)  # leaves 1.96, 1.6 times 1.2, of 5.34: 91 %
    assert not suffices(candidate("creep", rms=3.1), base)  # leaves 2.37, 2.0 times 1.2, of 5.34: 84 %
    loud = candidate(rms=12.0)
    assert suffices(candidate("creep", rms=3.2), loud)  # leaves 2.5, twice 1.2, but takes away 97 % of 11.8²
    assert not suffices(candidate("creep", rms=4.3), loud)  # leaves 3.8, more than three times 1.2
    weak = candidate(rms=3.0)
    assert not suffices(candidate("creep", rms=2.6), weak)  # of 2.24² it takes away 45 % only


def test_another_noise_changes_the_judgement_not_the_residuals(candidate):
    loud = candidate("hysteresis", rms=2.9)
    assert not loud.adequate
    again = replace(loud, noise=2.8)
    assert again.adequate
    assert again.losses.mean() == loud.losses.mean()


def test_what_is_as_likely_as_the_best_is_a_rival_though_it_misses_a_limit_by_a_hair(candidate, is_adequate, noise):
    best, near, far = candidate("delay", rms=2.33), candidate("sensor_lag", rms=2.335), candidate("creep", rms=2.6)
    assert best.adequate and not near.adequate
    decided = decide((best, near, far), (best, near, far), noise, is_adequate, lambda c: True)
    assert decided.best is best
    assert decided.alternatives == (near,)


@pytest.mark.parametrize(("rms", "kept"), [(2.59, True), (2.7, False)])
def test_what_is_worse_by_more_than_the_model_error_has_been_told_apart(candidate, is_adequate, noise, rms, kept):
    """2.3² + 1.2² = 2.59²; of the two the inputs are said to predict no difference."""
    best, other = candidate("creep", rms=2.3), candidate("mullins", rms=rms)
    decided = decide((best, other), (best, other), noise, is_adequate, lambda c: True)
    assert decided.alternatives == ()
    found = with_distances(decided, (best, other), PROBLEM, lambda c: True, lambda *given: 9.0)
    assert (found.alternatives == (other,)) is kept
    assert [d.d2 for d in found.distances] == [9.0]


@pytest.mark.parametrize(("d2", "more", "kept"), [(17.0, 1, False), (15.0, 1, True), (17.0, 0, True)])
def test_what_differs_by_little_is_no_rival_where_it_is_told_apart_and_unlikely(
    candidate, is_adequate, noise, d2, more, kept
):
    """200 ln(2.125 / 2.1) are 2.4 nats, with a parameter more 5.0: strong."""
    best, other = candidate("creep", rms=2.1), candidate("mullins", rms=2.125)
    names = ("a",) * (len(best.calibration.names) + more)
    other = replace(other, calibration=SimpleNamespace(**{**vars(other.calibration), "names": names}))
    decided = decide((best, other), (best, other), noise, is_adequate, lambda c: True)
    assert decided.alternatives == (() if more else (other,))
    found = with_distances(decided, (best, other), PROBLEM, lambda c: True, lambda *given: d2)
    assert (found.alternatives == (other,)) is kept


@pytest.mark.parametrize(("d2", "kept"), [(9.0, True), (15.9, True), (16.1, False)])
def test_the_likelihood_refutes_what_is_near_or_what_the_inputs_distinguish(candidate, is_adequate, noise, d2, kept):
    best, near, likely = candidate("creep", rms=2.1), candidate("mullins", rms=2.15), candidate("delay", rms=2.11)
    stage = (best, near, likely)
    decided = decide(stage, stage, noise, is_adequate, lambda c: True)
    assert decided.alternatives == (likely,)

    def apart(best: object, other: object, *given: object) -> float:
        return d2 if other is likely.calibration else 9.0

    def found(*refuted: Candidate) -> tuple[Candidate, ...]:
        def is_refuted(other: Candidate, by: Candidate) -> bool:
            assert by is best
            return other in refuted

        naming = with_distances(decided, stage, PROBLEM, lambda c: True, apart, refuted=is_refuted)
        assert len(naming.distances) == 2
        return naming.alternatives

    assert found() == (likely, near)
    assert found(near) == (likely,)
    assert found(likely) == ((likely, near) if kept else (near,))


@pytest.mark.parametrize(("unlikely", "kept"), [(2.9, True), (3.1, False)])
def test_of_what_reads_alike_a_rival_is_left_that_is_not_20_times_less_likely_beforehand(
    candidate, is_adequate, noise, unlikely, kept
):
    """Log 20 is 3.0."""
    best, other = candidate("permittivity_drift", rms=2.1), candidate("sensor_drift_at_command_gain", rms=2.1)
    other = replace(other, log_share=-1.4, log_size=1.4 - unlikely)
    decided = decide((best, other), (best, other), noise, is_adequate, lambda c: True)
    found = with_distances(decided, (best, other), PROBLEM, lambda c: True, lambda *given: 0.03)
    assert (found.alternatives == (other,)) is kept
    assert cannot_rule_out(other, best) is kept


def test_distances_need_no_probabilities_and_take_no_rival_away(candidate, noise):
    """A decision by other fits may know more of an alternative, or nothing of one that could not be fitted there."""
    # 200 ln(2.2 / 2.1) are 9 nats, and the two differ by half of the model error
    best, alternative, lost = candidate("creep", rms=2.1), candidate("delay", rms=2.2), candidate("mullins", rms=3.0)
    known = {best.effects: 0.6, alternative.effects: 0.4}
    naming = Naming(
        candidates=(best, alternative, lost), best=best, alternatives=(alternative,), probabilities=known, noise=noise
    )
    found = with_distances(naming, (best, alternative, lost), PROBLEM, lambda c: True, lambda *given: 100.0)
    assert found.alternatives == (alternative,)
    assert found.probabilities == known


def test_the_distance_of_the_same_two_fits_is_reckoned_once(candidate, noise):
    best, alternative, better = candidate("creep", rms=2.1), candidate("delay", rms=2.2), candidate("delay", rms=2.15)
    naming = Naming(candidates=(best, alternative), best=best, alternatives=(), probabilities={}, noise=noise)
    known, asked = {}, []

    def reckoned(*stage: Candidate) -> list[float]:
        found = with_distances(naming, stage, PROBLEM, lambda c: True, lambda *given: asked.append(given) or 9.0, known)
        return [distance.d2 for distance in found.distances]

    assert (
        reckoned(best, alternative) == reckoned(best, replace(alternative, noise=noise)) == [9.0]
    )  # judged anew, not fitted
    assert len(asked) == 1
    assert reckoned(best, better) == [9.0]
    assert len(asked) == 2


def test_what_differs_fast_from_the_likelier_one_does_not_lead_for_its_fewer_parameters(
    candidate, differing_fast, is_adequate, noise
):
    """10,000 samples that differ by 0.1 µm at half the sample rate: d² = 25, so 1 / 2(1/25 + 1/9) = 3.31 nats.

    Blocks see 100 ln(1 + 0.1²/2.1²) = 0.23, a parameter costs half of ln 200 = 2.65.
    """
    short, right = candidate("leakage", rms=2.1), candidate("delay", "creep", rms=2.1)
    wrong, right = differing_fast(short, 0.1), differing_fast(right, 0.0)
    assert wrong.evidence > right.evidence
    decided = decide((wrong, right), (wrong, right), noise, is_adequate, lambda c: True)
    assert decided.best is right
    assert decided.alternatives == (wrong,)
    odds = np.exp(1 / (2 * (1 / 25 + 1 / 9)) - np.log(200) / 2)
    assert decided.probabilities[right.effects] == pytest.approx(odds / (1 + odds), rel=1e-2)


def test_between_two_shares_what_may_be_left_rises_evenly(candidate, noise):
    base = candidate(rms=8.0)
    error = 1.2
    energy = 8.0**2 - noise**2 - error**2

    def leaving(share: float) -> Candidate:
        return candidate("creep", rms=float(np.sqrt(noise**2 + error**2 + (1 - share) * energy)))

    # 0.9 lies two thirds on the way from 0.8 to 0.95, so 2.5 times the error may be left, and 2.25 times are; 0.876
    # lies half way, so 2.26 times may be left, and 2.46 times are.
    assert suffices(leaving(0.876), base) is False
    assert suffices(leaving(0.9), base) is True

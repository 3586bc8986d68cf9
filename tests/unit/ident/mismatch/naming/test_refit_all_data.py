"""What all recordings together bring back, or settle; residuals are of given sizes, in blocks of fifty samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming, decide
from deatwin.ident.mismatch.naming.refit_all_data import (
    _holds,
    fitted_to_all,
    judged_on_everything,
    settled_on_everything,
)
from deatwin.plant import Diaphragm, Plant

NOISE = 2.0
FAILS = -1.0
"""In place of a size: no fit to everything is found."""


def wave(rms: float, samples: int) -> np.ndarray:
    return np.tile([rms, -rms], samples // 2)


def candidate(name: str, fitted: float, unseen: float) -> Candidate:
    plant = SimpleNamespace(rig=SimpleNamespace(model_error=1.0), name=name)
    calibration = SimpleNamespace(plant=plant, residuals=wave(fitted, 7000), names=("a",) * 8, at_bound=(), rms=fitted)
    return Candidate(effects=(name,), calibration=calibration, unseen=wave(unseen, 3000), noise=NOISE)


def together(sizes: dict[str, float]):
    """Fits to everything that leave these sizes."""

    def refit(one, parts):
        (name,) = one.effects
        return None if sizes[name] == FAILS else of_everything(candidate(name, sizes[name], sizes[name]))

    return refit


def of_everything(one: Candidate) -> Candidate:
    return replace(one, sizes=((10_000, 0),), measured=np.zeros(10_000))


@pytest.fixture
def together_fast(differing_fast):
    """Fits to everything of which so much is fast, 2.2 µm of it slower; the base plant leaves 9.0 µm."""

    def leaving(fast: dict[str, float]):
        def refit(one, parts):
            (name,) = one.effects
            rms = 9.0 if name == "base" else 2.2
            return differing_fast(candidate(name, rms, rms), fast.get(name, 0.0))

        return refit

    return leaving


PROBLEM = SimpleNamespace(everything=(), jobs=1)


def judged(*candidates: Candidate, sizes: dict[str, float]) -> Naming:
    """The best of the candidates by both parts, and alternatives, where fits to everything leave these sizes."""
    tried = (candidate("base", 9.0, 9.0), *candidates)
    naming = decide(tried, candidates, NOISE, lambda c: True, lambda c: True)
    return judged_on_everything(naming, PROBLEM, lambda c: c.effects != ("idle",), together(sizes))


SHORT, LONG = candidate("creep", 2.2, 2.4), candidate("dielectric_absorption", 2.1, 3.6)


# 200 blocks: 100 ln(b²/a²) nats lie between sizes of a and b; ln 20 = 3.0 are strong. The odds are the ratio of the
# evidences; what may not lead is at most as likely as what does. Noise of 2.0 and a model error of 1.0 leave 2.24.
@pytest.mark.parametrize(
    ("short", "long", "best", "probability"),
    [
        (2.2, 2.2, SHORT, 0.5),
        (2.2, 2.2 * np.exp(2.9 / 200), SHORT, 1 / (1 + np.exp(2.9))),
        (2.2, 2.2 * np.exp(3.1 / 200), SHORT, None),
        (2.2, 2.15, LONG, 1 / (1 + (2.15 / 2.2) ** 200)),
        (2.35, 2.3, SHORT, 0.5),
        (600.0, 2.2, LONG, 1.0),
        (FAILS, 2.6, SHORT, 0.5),
    ],
    ids=[
        "as likely", "unlikely", "ruled out by strong evidence", "likelier", "likelier, but it explains too little",
        "a thousand nats likelier: no division by zero", "a fit that failed is no evidence against the best",
    ],
)  # fmt: skip
def test_what_errs_only_where_it_is_extrapolated_is_judged_by_what_it_leaves_of_everything(
    short, long, best, probability
):
    naming = judged(SHORT, LONG, sizes={"creep": short, "dielectric_absorption": long})
    assert naming.best is best
    assert naming.alternatives == (() if probability is None else (SHORT if best is LONG else LONG,))
    if probability is not None:
        expected = {SHORT.effects: pytest.approx(1 - probability), LONG.effects: pytest.approx(probability)}
        assert naming.probabilities == expected


# Of 9.0² - 2.0² - 1.0² the half is 6.16²; beside noise and model error that is 6.56.
@pytest.mark.parametrize(("unseen", "leads"), [(6.5, True), (6.6, False)])
def test_the_likelier_one_does_not_lead_where_the_unseen_part_would_refute_it(unseen, leads):
    wild = candidate("dielectric_absorption", 2.1, unseen)
    naming = judged(SHORT, wild, sizes={"creep": 2.2, "dielectric_absorption": 2.15})
    assert (naming.best is wild) is leads
    assert {naming.best, *naming.alternatives} == {SHORT, wild}


# 10,000 samples that differ fast by 0.2 µm from others of 2.2 µm: d² = 100, 1 / 2(1/100 + 1/9) = 4.1 nats, of which blocks see 0.8.
def test_how_much_likelier_what_leads_is_counts_what_differs_fast(together_fast, differing_fast):
    best, alternative = (
        differing_fast(c, 0.0) for c in (candidate("delay", 2.2, 2.4), candidate("sensor_lag", 2.2, 3.6))
    )

    refit = together_fast({"delay": 0.2})
    naming = decide(
        (candidate("base", 9.0, 9.0), best, alternative), (best, alternative), NOISE, lambda c: True, lambda c: True
    )
    judged = judged_on_everything(naming, PROBLEM, lambda c: True, refit)
    assert judged.best is alternative
    odds = np.exp(1 / (2 * (1 / 100 + 1 / 9)))
    assert judged.probabilities[alternative.effects] == pytest.approx(odds / (1 + odds), rel=1e-2)


def test_of_the_fitted_part_all_is_left_out_that_was_not_fitted():
    explained = replace(LONG, sizes=((4000, 2000), (3000, 1000)), measured=np.arange(10_000.0))
    part = explained.fitted_part
    assert part.pieces == (4000, 3000)
    np.testing.assert_array_equal(part.measured, np.arange(7000.0))
    assert part.residuals.size == part.measured.size


def test_what_loses_on_the_fitted_part_has_lost():
    # 140 blocks: 70 ln(2.25²/2.2²) = 3.1 nats worse where it was fitted.
    worse = candidate("mullins", 2.25, 3.6)
    assert judged(SHORT, worse, sizes={}).alternatives == ()


def test_what_could_be_no_rival_and_what_cannot_be_fitted_stay_out():
    idle = candidate("idle", 2.1, 3.6)
    naming = judged(SHORT, LONG, idle, sizes={"creep": 2.2, "dielectric_absorption": FAILS})
    assert naming.alternatives == ()
    assert sum(naming.probabilities.values()) == pytest.approx(1.0)


def test_without_an_explanation_there_is_nothing_to_bring_back():
    nothing = Naming(candidates=(SHORT,), best=None, alternatives=(), probabilities={}, noise=NOISE)
    assert judged_on_everything(nothing, SimpleNamespace(everything=(), jobs=1), lambda c: True) is nothing


def settled(*stage: Candidate, sizes: dict[str, float], base: float = 9.0) -> Naming:
    """The decision over the stage by fits to everything; a law that errs on the fitted part has no hope."""
    tried = (candidate("base", base, base), *stage)
    refit = together({"base": base, **sizes})
    return settled_on_everything(stage, tried, PROBLEM, lambda c: c.fitted_test.within_error, lambda c: True, refit)


# Beside a noise of 2.0 one and a half times the model error of 1.0 are 2.5; of 2.6² - 2² - 1² a fifth is 0.6², and
# with it 2.31 are left. Without a fit of the base plant there is nothing to compare with.
@pytest.mark.parametrize(
    ("base", "rms", "answer"),
    [(9.0, 2.49, LONG), (9.0, 2.51, None), (9.0, FAILS, None), (2.6, 2.3, LONG), (2.6, 2.33, None), (FAILS, 2.3, None)],
)
def test_what_errs_only_where_it_is_extrapolated_is_the_answer_if_it_holds_for_everything(base, rms, answer):
    found = settled(LONG, sizes={"dielectric_absorption": rms}, base=base)
    assert found.best is answer
    assert found.alternatives == ()


# 100 ln(2.45²/2.3²) = 12.6 nats; the squares differ by 0.84², more than half of the model error, or by 0.3².
@pytest.mark.parametrize(("other", "kept"), [(2.45, False), (2.32, True)])
def test_what_leaves_as_little_of_everything_is_a_rival_though_it_errs_on_the_fitted_part(other, kept):
    rough = candidate("creep", 2.3, 3.6)
    assert not rough.fitted_test.within_error
    found = settled(LONG, rough, sizes={"dielectric_absorption": 2.3, "creep": other})
    assert found.best is LONG
    assert (rough in found.alternatives) is kept


# They differ by 0.1 µm at half the sample rate, d² = 25: 1 / 2(1/25 + 1/9) = 3.3 nats, of which blocks see 0.2. By 0.08
# they are 2.9: less than is strong.
@pytest.mark.parametrize(("apart", "leads"), [(0.1, True), (0.08, False)])
def test_what_leaves_less_that_is_fast_leads_on_everything(together_fast, apart, leads):
    rough = candidate("creep", 2.6, 3.6)

    refit = together_fast({"dielectric_absorption": apart})
    tried = (candidate("base", 9.0, 9.0), LONG, rough)
    found = settled_on_everything(
        tried[1:], tried, PROBLEM, lambda c: c.fitted_test.within_error, lambda c: True, refit
    )
    assert (found.best is rough) is leads
    assert {found.best, *found.alternatives} == {LONG, rough}
    d2 = 10_000 * apart**2 / 4
    odds = np.exp(1 / (2 * (1 / d2 + 1 / 9)))
    assert found.probabilities[rough.effects] == pytest.approx(odds / (1 + odds), rel=1e-2)


# 100 ln(2.34²/2.3²) = 3.4 nats are strong; by the squares the two differ by 0.43², of all recordings; by the split
# fits, which err where they are extrapolated, by 1.5². Of 2.36² - 2.3² it is 0.53², more than half of the error.
@pytest.mark.parametrize(("rms", "kept"), [(2.34, True), (2.36, False)])
def test_how_far_two_are_apart_is_judged_by_all_recordings(rms, kept):
    worse = candidate("creep", 2.1, 4.5)
    found = settled(LONG, worse, sizes={"dielectric_absorption": 2.3, "creep": rms})
    assert found.best is LONG
    assert (worse in found.alternatives) is kept


def test_nothing_is_fitted_to_everything_where_nothing_explains_the_fitted_part():
    assert settled(candidate("creep", 2.6, 3.6), sizes={}).best is None


# 100 ln(2.45²/2.4²) = 4.1 nats are strong, 100 ln(2.43²/2.4²) = 2.5 are not.
@pytest.mark.parametrize(("rms", "leads"), [(2.45, True), (2.43, False)])
def test_what_is_likelier_by_far_on_everything_leads_if_it_leaves_as_little(rms, leads):
    rough = candidate("creep", 2.6, 3.6)
    found = settled(LONG, rough, sizes={"dielectric_absorption": rms, "creep": 2.4})
    assert (found.best is rough) is leads
    assert {found.best, *found.alternatives} == {LONG, rough}


# Of 9.0² - 2.0² - 1.0² the half is 6.16²; beside noise and model error that is 6.56.
@pytest.mark.parametrize(("unseen", "leads"), [(6.5, True), (6.6, False)])
def test_what_the_unseen_part_would_refute_does_not_lead(unseen, leads):
    rough = candidate("creep", 2.6, unseen)
    found = settled(LONG, rough, sizes={"dielectric_absorption": 2.45, "creep": 2.4})
    assert (found.best is rough) is leads
    assert {found.best, *found.alternatives} == {LONG, rough}
    # 100 ln(2.45²/2.4²) = 4.1 nats; without that part it is at most as likely.
    assert found.probabilities[rough.effects] == pytest.approx(1 / (1 + (2.4 / 2.45) ** 200) if leads else 0.5)


def settled_beside_what_strays(strayed: Candidate, everything: float) -> Naming:
    """The same, where one that errs on most of the held-out part leaves so much of all."""
    refit = together({"base": 9.0, "dielectric_absorption": 2.3, "creep": everything})
    tried = (candidate("base", 9.0, 9.0), LONG, strayed)
    return settled_on_everything(
        tried[1:], tried, PROBLEM, lambda c: c.fitted_test.within_error, lambda c: c is not strayed, refit
    )


# 100 ln(2.33²/2.3²) = 2.6 nats are not strong, 100 ln(2.34²/2.3²) = 3.4 are; 70 ln(2.14²/2.1²) = 2.6, and of 2.15² 3.3.
# Beside a noise of 2.0 one and a half times the model error of 1.0 are 2.5.
@pytest.mark.parametrize(
    ("fitted", "everything", "kept"),
    [
        (2.1, 2.2, True),
        (2.1, 2.33, True),
        (2.1, 2.34, False),
        (2.1, FAILS, False),
        (2.14, 2.3, True),
        (2.15, 2.3, False),
        (2.6, 2.2, False),
    ],
)
def test_what_strays_on_the_unseen_part_is_a_rival_if_it_describes_the_rest_as_well(fitted, everything, kept):
    found = settled_beside_what_strays(candidate("creep", fitted, 12.0), everything)
    assert found.best is LONG
    assert [alternative.effects for alternative in found.alternatives] == ([("creep",)] if kept else [])


# 100 ln(2.33²/2.3²) = 2.6 nats for the answer.
@pytest.mark.parametrize(("everything", "odds"), [(2.1, 1.0), (2.33, (2.3 / 2.33) ** 200)])
def test_what_strays_is_at_most_as_likely_as_the_answer_and_does_not_lead(everything, odds):
    found, sure = settled_beside_what_strays(candidate("creep", 2.1, 12.0), everything), 1 / (1 + odds)
    assert found.best is LONG
    assert found.probabilities == {LONG.effects: pytest.approx(sure), ("creep",): pytest.approx(1 - sure)}


def test_what_the_ranges_of_the_plant_hold_back_does_not_come_back_as_one_that_strayed(held):
    strayed = held(candidate("creep", 2.1, 12.0), 1.1, "damping")  # more than 1.0², the model error
    assert settled_beside_what_strays(strayed, 2.2).alternatives == ()


@pytest.mark.parametrize(
    ("unseen", "left", "holds"),
    [
        (9.0, 3.0, True),
        (9.0, 8.9, False),
        (2.1, 2.15, True),  # nothing is missing there: there is nothing to take away
        (2.1, 4.5, False),  # but what goes wrong there with it does not hold
    ],
)
def test_what_holds_takes_most_of_what_is_missing_in_the_unseen_part(unseen, left, holds):
    assert _holds(candidate("creep", 2.1, left), candidate("base", 9.0, unseen)) is holds


def test_a_fit_to_everything_leaves_nothing_unseen(oscillator, experiment):
    plant, rng = Plant(rig=oscillator(noise=1e-4)), np.random.default_rng(0)
    first, second = (Part.whole(plant.record(experiment(rng.standard_normal(n)), rng)) for n in (300, 200))
    fit = calibrate(plant, [first], starts=1)
    one = Candidate(effects=("creep",), calibration=fit, unseen=np.ones(200), noise=1e-4)
    whole = fitted_to_all(one, (first, second))
    assert whole.sizes == ((300, 0), (200, 0)) and whole.unseen.size == 0
    np.testing.assert_array_equal(whole.measured, np.concatenate([first.measured, second.measured]))
    np.testing.assert_allclose(whole.calibration.rms, 1e-4, rtol=0.15)  # three of 500 degrees of freedom; 5 sigma


def test_a_plant_that_pulls_in_has_no_fit_to_everything(experiment):
    soft = Plant(rig=Diaphragm()).with_values({"shear_modulus": 6e3, "stretch_limit": 1e4})
    part = Part.whole(experiment(np.repeat([3.5, 3.7], 100)))
    assert fitted_to_all(SimpleNamespace(calibration=SimpleNamespace(plant=soft)), (part,)) is None

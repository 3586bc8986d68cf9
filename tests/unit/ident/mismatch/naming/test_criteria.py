"""What an explanation is worth whose plant was biased to the ends of its ranges."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import pytest

from deatwin.ident.mismatch.naming.criteria import explained, held_back_by, suffices
from deatwin.plant.parameters import Scale


@pytest.fixture
def ended(candidate, held):
    """``ended(cost, *at_bound)``: a creep of which 3 µm are left, as `held` has it."""
    return partial(held, candidate("creep", rms=3.0))


@pytest.mark.parametrize(("cost", "is_held"), [(1.5, True), (1.4, False), (0.0, False)])  # the floor is 1.2² = 1.44
def test_a_bound_that_costs_more_than_the_floor_holds_an_explanation_back(ended, cost, is_held):
    assert held_back_by(ended(cost, "damping")) == ("damping",) * is_held


@pytest.mark.parametrize("scale", Scale)
def test_a_bound_from_which_the_fit_would_come_back_is_none(ended, scale):
    """It is on its way: more damping leaves less."""
    assert held_back_by(ended(5.0, "damping", value=2.0, scale=scale)) == ("damping",)
    assert held_back_by(ended(5.0, "damping", value=1.0, scale=scale)) == ()


def test_what_the_plant_may_still_do_is_no_bound(ended):
    assert held_back_by(ended(5.0)) == ()
    assert held_back_by(ended(5.0, "shear_modulus")) == ()
    assert held_back_by(ended(5.0, "shear_modulus", "damping")) == ("damping",)


def test_an_effect_at_the_end_of_its_own_range_has_become_another_one_and_bends_nothing(ended):
    one = ended(5.0, "creep.time")
    names = vars(one.calibration) | {"names": ("shear_modulus", "creep.time")}
    assert held_back_by(replace(one, calibration=SimpleNamespace(**names))) == ()


@pytest.mark.parametrize(("cost", "possible"), [(1.5, False), (1.4, True)])
def test_what_is_held_back_is_neither_an_answer_nor_a_rival_though_it_would_suffice(
    ended, candidate, search_over, cost, possible
):
    base, alike, one = candidate(rms=9.0), candidate("delay", rms=2.999), ended(cost, "damping")
    search = search_over(base, alike, one)
    assert suffices(one, base)
    assert search.counts(one) is possible
    naming = search.decision([alike, one], lambda c: c is alike)
    assert naming.best is alike
    assert naming.alternatives == (one,) * possible


def test_a_part_in_which_nothing_is_missing_has_nothing_to_explain(candidate):
    """A clip that only the fitted part reaches: 2.2² - 2² of the unseen one is less than 1.2², with and without it."""
    base, clip = candidate(rms=5.0, unseen=2.2), candidate("amplifier_saturation", rms=2.6, unseen=2.2)
    # of 5² - 2² - 1.2² = 19.56 it leaves 2.6² - 2² - 1.2² = 1.32
    assert explained(clip, base) == pytest.approx(1.0 - 1.32 / 19.56, rel=1e-6)
    late_base, late = candidate(rms=2.2, unseen=5.0), candidate("amplifier_saturation", rms=2.2, unseen=2.6)
    assert explained(late, late_base) == pytest.approx(explained(clip, base))
    both = candidate(rms=5.0, unseen=5.0)  # where it is missing in both, the part counts that is explained less
    assert explained(candidate("creep", rms=2.1, unseen=2.6), both) == pytest.approx(explained(clip, base))
    assert explained(candidate("creep", rms=5.0, unseen=2.1), both) < 0.1
    astray = candidate("creep", rms=2.1, unseen=4.5)  # what goes wrong there by the effect is no explanation
    assert astray.unseen_test.mismatch and explained(astray, base) == 0.0
    small = candidate(rms=2.2)  # of what is certain nowhere all counts
    assert explained(candidate("creep", rms=2.1), small) == 0.0

"""What an explanation is worth whose plant was bent to the ends of its ranges."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.worth import is_held_back, suffices


@pytest.fixture
def ended(candidate):
    """``ended(cost, *at_bound)``: a creep whose residuals the damping could lessen by ``cost``, in mean square."""

    def make(cost: float, *at_bound: str) -> Candidate:
        whole = candidate("creep", rms=3.0)
        residuals = whole.calibration.residuals
        other = np.tile([1.0, 1.0, -1.0, -1.0], residuals.size // 4)  # at right angles to the residuals
        # of 9 µm² a direction takes the square of the cosine
        share = cost / float(np.mean(residuals**2))
        damping = np.sqrt(share) * residuals / 3.0 + np.sqrt(1.0 - share) * other
        jacobian = np.column_stack([np.ones_like(residuals), damping])
        known = vars(whole.calibration) | {
            "names": ("shear_modulus", "damping"), "jacobian": jacobian, "at_bound": at_bound
        }  # fmt: skip
        return replace(whole, calibration=SimpleNamespace(**known))

    return make


@pytest.mark.parametrize(("cost", "held"), [(1.5, True), (1.4, False), (0.0, False)])  # the floor is 1.2² = 1.44
def test_a_bound_that_costs_more_than_the_floor_holds_an_explanation_back(ended, cost, held):
    assert is_held_back(ended(cost, "damping")) is held


def test_what_the_plant_may_still_do_is_no_bound(ended):
    assert not is_held_back(ended(5.0))
    assert not is_held_back(ended(5.0, "shear_modulus"))


def test_an_effect_at_the_end_of_its_own_range_has_become_another_one_and_bends_nothing(ended):
    one = ended(5.0, "creep.time")
    names = vars(one.calibration) | {"names": ("shear_modulus", "creep.time")}
    assert not is_held_back(replace(one, calibration=SimpleNamespace(**names)))


def test_what_is_held_back_does_not_count_though_it_would_suffice(ended, candidate, search_over):
    base, held, free = candidate(rms=9.0), ended(1.5, "damping"), ended(1.5)
    for one, counts in ((held, False), (free, True)):
        search = search_over(base, one)
        assert suffices(one, base) and search.counts(one) is counts

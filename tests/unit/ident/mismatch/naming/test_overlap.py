"""Two effects of which either does nearly all may stand for a third one."""

from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.overlap import with_overlap


def candidate(*effects: str, left: float, rough: bool = False) -> Candidate:
    """An explanation that leaves this mean square everywhere."""
    residuals = np.full(1000, np.sqrt(left))
    calibration = SimpleNamespace(residuals=residuals, names=("a",) * (3 + len(effects)), given_up=rough)
    return Candidate(effects=effects, calibration=calibration, unseen=residuals, noise=1.0)


BASE, PAIR = candidate(left=11.0), candidate("creep", "permittivity_drift", left=1.0)


def decided(*singles: Candidate, best: Candidate = PAIR) -> Naming:
    return Naming(candidates=(BASE, *singles, best), best=best, rivals=(), probabilities={best.effects: 1.0}, noise=1.0)


def rivals(naming: Naming, possible=lambda c: True) -> list[tuple[str, ...]]:
    return [rival.effects for rival in with_overlap(naming, possible).rivals]


def test_what_does_all_that_two_have_in_common_is_possible():
    # alone they take 9 and 8 of the 10 that both take: 7 in common, which leaves 4
    creep, drift = candidate("creep", left=2.0), candidate("permittivity_drift", left=3.0)
    spread, weak = candidate("dielectric_absorption", left=2.5), candidate("delay", left=4.5)
    naming = decided(creep, drift, spread, weak)
    assert rivals(naming) == [("creep",), ("permittivity_drift",), ("dielectric_absorption",)]
    assert rivals(naming, possible=lambda c: c is spread) == [("dielectric_absorption",)]
    assert rivals(with_overlap(naming, lambda c: True)) == rivals(naming)  # nobody is brought back twice
    after = with_overlap(naming, lambda c: True).probabilities
    assert after == pytest.approx(dict.fromkeys([PAIR.effects, *rivals(naming)], 0.25))


def test_a_rough_fit_is_no_rival():
    creep, drift = candidate("creep", left=2.0), candidate("permittivity_drift", left=3.0)
    assert rivals(decided(creep, drift, candidate("delay", left=2.5, rough=True))) == [creep.effects, drift.effects]


def test_two_that_do_different_things_stand():
    # 8 and 3 of 10: 1 in common
    assert rivals(decided(candidate("creep", left=3.0), candidate("permittivity_drift", left=8.0))) == []


def test_a_pair_whose_single_effects_were_not_fitted_stands():
    assert rivals(decided(candidate("creep", left=2.0))) == []


def test_one_effect_and_none_are_left_alone():
    creep = candidate("creep", left=2.0)
    assert rivals(decided(candidate("permittivity_drift", left=2.0), best=creep)) == []
    assert rivals(Naming(candidates=(BASE,), best=None, rivals=(), probabilities={}, noise=1.0)) == []

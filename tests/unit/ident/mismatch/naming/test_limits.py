"""What an explanation has become at a bound of its range stays possible."""

from dataclasses import replace

import numpy as np
import pytest
from made_fits import made_fit

from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.limits import with_limits
from deatwin.plant import Diaphragm, Plant
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import catalogue, effect_named

LOWEST, HIGHEST = 1e-6, 1e-3
"""Of the distance of hysteresis, m."""


def candidate(*effects: Effect, deviation: float = 0.01, at_bound: tuple[str, ...] = (), there: int = 0) -> Candidate:
    """With a standard deviation of the distance's logarithm; the first `there` effects were in the plant before."""
    plant = Plant(rig=Diaphragm(), effects=effects)
    names = tuple(plant.parameters.free)
    known = {"covariance": deviation**2 * np.eye(len(names)), "jacobian": np.eye(100, len(names))}
    calibration = made_fit(plant, np.ones(100), *names, at_bound=at_bound, **known)
    added = tuple(effect.name for effect in effects[there:])
    return Candidate(effects=added, calibration=calibration, unseen=np.ones(50), noise=1.0)


def hysteresis(distance: float) -> Effect:
    return replace(effect_named("hysteresis"), distance=distance)


FRICTION, CREEP = effect_named("coulomb_friction"), effect_named("creep")


def alternatives(*candidates: Candidate, possible=lambda c: True, before=()) -> list[tuple[str, ...]]:
    """Names of the alternatives where the first candidate is the best, and some were alternatives `before`."""
    probabilities = {c.effects: float(c is candidates[0]) for c in candidates}
    naming = Naming(
        candidates=candidates, best=candidates[0], alternatives=before, probabilities=probabilities, noise=1.0
    )
    found = with_limits(naming, possible)
    assert found.probabilities[found.best.effects] == pytest.approx(1 / (1 + len(found.alternatives)))
    return [alternative.effects for alternative in found.alternatives]


def test_hysteresis_over_the_smallest_distance_may_be_dry_friction():
    best, friction, creep = candidate(hysteresis(LOWEST)), candidate(FRICTION), candidate(CREEP)
    assert alternatives(best, friction, creep) == [("coulomb_friction",)]
    assert alternatives(best, friction, creep, possible=lambda c: c is creep) == []


def test_each_effect_of_a_pair_may_have_become_another():
    best = candidate(CREEP, hysteresis(LOWEST))
    pair, single = candidate(FRICTION, CREEP), candidate(FRICTION)
    assert alternatives(best, single, pair) == [pair.effects]


@pytest.mark.parametrize(
    ("distance", "deviation", "at_bound", "friction"),
    [
        (1.2 * LOWEST, 0.11, (), True),  # the logarithm of 1.2 is 1.96 times 0.093
        (1.2 * LOWEST, 0.09, (), False),
        (1.0004 * LOWEST, 1e-5, ("hysteresis.distance",), True),  # it ended there, however narrow its interval
        (30e-6, 0.01, (), False),
        (HIGHEST, 0.01, (), False),
    ],
)
def test_nearly_the_smallest_distance_may_be_dry_friction_unless_it_is_surely_more(
    distance, deviation, at_bound, friction
):
    best = candidate(hysteresis(distance), deviation=deviation, at_bound=at_bound)
    assert alternatives(best, candidate(FRICTION)) == ([("coulomb_friction",)] if friction else [])


def test_without_an_answer_nothing_is_added():
    nothing = Naming(candidates=(candidate(),), best=None, alternatives=(), probabilities={}, noise=1.0)
    assert with_limits(nothing, lambda c: True) is nothing


def test_what_an_effect_becomes_is_in_the_catalogue_and_at_a_parameter_of_its_own():
    known = {effect.name for effect in catalogue()}
    for effect in catalogue():
        for parameter, other in effect.becomes.items():
            assert parameter in {p.name for p in effect.describe()} and other in known - {effect.name}


def test_what_was_a_rival_before_is_as_likely_too():
    best, friction = candidate(hysteresis(LOWEST)), candidate(FRICTION)
    assert alternatives(best, friction, before=(friction,)) == [("coulomb_friction",)]


def test_what_was_in_the_plant_before_is_no_explanation():
    assert alternatives(candidate(hysteresis(LOWEST), CREEP, there=1), candidate(FRICTION)) == []

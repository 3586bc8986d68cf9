"""A model that was written elsewhere is diagnosed as the same equations in deatwin are."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_models import SIZES, commands, experiment, plants

from deatwin.ident.mismatch import Diagnosis, diagnose
from deatwin.plant import (
    AmplifierOffset,
    AmplifierSlew,
    Backlash,
    DeadZone,
    Delay,
    Effect,
    PeriodicDisturbance,
    SensorCurvature,
    SensorLag,
)
from deatwin.plant.foreign import ParameterDrift


def both(concealed: Effect, effects: list[Effect] | None = None, count: int = 1200) -> tuple[Diagnosis, Diagnosis]:
    native, foreign = plants()
    real = native.with_values({"inertia": 1.2e-4, "drag": 2e-5}).with_effects(concealed)
    made = real.record(experiment(commands(count, seed=1)), np.random.default_rng(2))
    one, other = (diagnose(plant, made, effects=effects) for plant in (native, foreign))
    return one, other


STRAIGHT = {"sensor_lag": 0.01}
"""What shapes lose, as a share, by the readings of a model being straight between samples: a lag of a sample and a half
behind a motor of nine samples, about a twelfth of the product of both in samples squared."""


def require_the_same(one: Diagnosis, other: Diagnosis, effect: Effect) -> None:
    assert other.verdict is one.verdict and [c.effect for c in one.causes] == [effect.name]
    assert [c.effect for c in other.causes] == [effect.name]
    for name, interval in one.causes[0].parameters.items():
        width = interval.high - interval.low
        # Central differences: the interval is the same to a few per cent, and its middle to a tenth of it.
        found = other.causes[0].parameters[name]
        assert found.value == pytest.approx(interval.value, abs=0.1 * width, rel=STRAIGHT.get(effect.name, 0.0))
        assert found.high - found.low == pytest.approx(width, rel=0.1)


def test_the_diagnosis_is_that_of_the_same_equations():
    few = [SIZES.of(effect) for effect in (DeadZone(width=0.1), SensorCurvature(), AmplifierOffset())]
    one, other = both(few[0], few, 600)
    require_the_same(one, other, few[0])


CONCEALED = [
    SIZES.of(effect)
    for effect in (
        AmplifierSlew(),
        Backlash(width=0.15),
        DeadZone(width=0.1),
        Delay(time=0.03),
        SensorCurvature(),
        SensorLag(time=0.01),
    )
] + [replace(SIZES.of(PeriodicDisturbance()), frequency=2.0)]


@pytest.mark.study
@pytest.mark.parametrize("effect", CONCEALED, ids=lambda e: e.name)
def test_each_effect_is_found_alike_among_all(effect):
    require_the_same(*both(effect), effect)


@pytest.mark.study
def test_a_parameter_that_drifts_is_named():
    drift = ParameterDrift(parameter="constant", relative_change=-0.2, time=20.0)
    _, plant = plants(drift, varying=("constant",))
    made = plant.with_values({"inertia": 1.2e-4}).record(experiment(commands(3000, seed=1)), np.random.default_rng(2))
    _, nominal = plants(varying=("constant",))
    found = diagnose(nominal, made)
    assert [cause.effect for cause in found.causes] == [drift.name]
    assert "The parameter constant drifts towards a final change of" in found.sentence

"""Effects whose strength may be zero."""

from collections.abc import Collection
from types import SimpleNamespace

import pytest

from deatwin.ident.mismatch.intervals import perhaps_absent
from deatwin.plant import Creep, Hysteresis, SensorDrift

STRENGTHS = {"sensor_drift.change": (1.0, 2.0), "creep.modulus": (1.0, 2.0)}


def fitted(low: float, high: float, undetermined: Collection[str] = ()) -> SimpleNamespace:
    """Return a fit with a certain creep and a drift whose strength has an interval."""
    ends = STRENGTHS | {"sensor_drift.change": (low, high)}
    return SimpleNamespace(
        plant=SimpleNamespace(effects=(SensorDrift(), Creep(), Hysteresis())),  # a hysteresis of known strength
        names=tuple(ends),
        interval=ends.__getitem__,
        undetermined=frozenset(undetermined),
    )


@pytest.mark.parametrize(
    ("low", "high", "absent"), [(1.0, 2.0, False), (-2.0, -1.0, False), (-1.0, 2.0, True), (0.0, 1.0, True)]
)
def test_an_effect_may_be_absent_if_its_strength_may_be_zero(low: float, high: float, absent: bool) -> None:
    found = perhaps_absent(fitted(low, high), ("creep", "sensor_drift"))
    assert found == (("sensor_drift",) if absent else ())


def test_a_strength_that_only_others_tell_is_left_to_the_ablation() -> None:
    assert not perhaps_absent(fitted(0.0, 1.0, undetermined=["sensor_drift.change"]), ("creep", "sensor_drift"))


def test_a_strength_that_is_not_fitted_is_certain() -> None:
    assert not perhaps_absent(fitted(1.0, 2.0), ("creep", "hysteresis", "sensor_drift"))


def test_an_effect_that_the_plant_had_before_is_not_asked_for() -> None:
    assert not perhaps_absent(fitted(-1.0, 2.0), ("creep",))

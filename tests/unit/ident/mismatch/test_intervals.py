"""Effects whose strength may be zero."""

import numpy as np
import pytest

from deatwin.ident.greybox.fit import Calibration, FitStatus
from deatwin.ident.mismatch.model_error import perhaps_absent
from deatwin.plant import Creep, Diaphragm, Hysteresis, Plant, SensorDrift

NAMES = ("sensor_drift.change", "sensor_drift.time", "creep.modulus")
BOTH = ("creep", "sensor_drift")


def fitted(change: float, deviation: float, correlation: float = 0.0, determined: bool = True) -> Calibration:
    """Return a fit with a certain creep, a hysteresis of known strength, and a drift of a size, m, with its deviation,
    which is correlated with the drift's time.
    """
    plant = Plant(rig=Diaphragm()).with_effects(SensorDrift(change=change), Creep(), Hysteresis())
    spread = np.diag([deviation**2, 0.5**2, 1e3**2])
    spread[0, 1] = spread[1, 0] = correlation * deviation * 0.5
    return Calibration(
        plant=plant,
        names=NAMES,
        covariance=spread,
        residuals=np.zeros(3),
        jacobian=np.diag([1.0 if determined else 0.0, 1e-5, 1e-9]),
        status=FitStatus.SETTLED,
        at_bound=(),
        evaluations=1,
    )


@pytest.mark.parametrize(
    ("change", "deviations", "absent"), [(2e-5, 3.0, False), (-2e-5, 3.0, False), (2e-5, 1.5, True), (-2e-5, 1.5, True)]
)
def test_an_effect_may_be_absent_if_its_strength_may_be_zero(change, deviations, absent):
    found = perhaps_absent(fitted(change, abs(change) / deviations), BOTH)
    assert found == (("sensor_drift",) if absent else ())


def test_a_drift_that_may_be_large_and_slow_together_is_not_absent():
    """With a correlation of 0.9, the deviation at the fitted time is sqrt(1 - 0.81) = 0.44 of the whole one."""
    for deviations, absent in ((1.5, False), (0.8, True)):
        found = perhaps_absent(fitted(2e-5, 2e-5 / deviations, correlation=0.9), BOTH)
        assert found == (("sensor_drift",) if absent else ())


def test_a_strength_that_only_others_tell_or_that_is_not_fitted_is_left_to_the_ablation():
    known = fitted(2e-5, 2e-5, determined=False)
    assert NAMES[0] in known.undetermined and not perhaps_absent(known, BOTH)
    assert not perhaps_absent(fitted(2e-5, 1e-6), ("creep", "hysteresis", "sensor_drift"))
    assert not perhaps_absent(fitted(2e-5, 2e-5), ("creep",))  # the drift was in the plant before

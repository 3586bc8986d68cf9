"""Whether recordings last long enough to show the cycle of an explanation."""

from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.plant import Creep, PeriodicDisturbance, ThermalStiffness


def part(seconds: float, start: float = 0.0, **extras: np.ndarray) -> SimpleNamespace:
    record = SimpleNamespace(extras=extras)
    return SimpleNamespace(experiment=SimpleNamespace(recordings=(record,)), timepts=start + np.array([0.0, seconds]))


def explained_by(*effects) -> SimpleNamespace:
    """A candidate whose plant has an effect of its own besides."""
    values = {p.name: p for effect in effects for p in effect.parameters}
    usual = tuple(type(effect)() for effect in effects)  # the plant knows where the fit began
    plant = SimpleNamespace(effects=usual, effect_names=("end_stop", *(e.name for e in usual)), parameters=values)
    return SimpleNamespace(effects=tuple(e.name for e in usual), calibration=SimpleNamespace(plant=plant))


@pytest.mark.parametrize(("period", "shown"), [(399.0, True), (401.0, False)])
def test_a_quarter_of_a_swing_shows_it(period, shown):
    found = explained_by(Creep(), ThermalStiffness(period=period))
    assert shows_its_cycles(found, [part(100.0)]) is shown
    assert shows_its_cycles(found, [part(20.0), part(100.0, start=900.0)]) is shown  # the longest one counts
    assert shows_its_cycles(explained_by(PeriodicDisturbance(frequency=1 / period)), [part(100.0)]) is shown


def test_what_has_no_cycle_is_never_too_slow():
    assert shows_its_cycles(explained_by(Creep(time=2e3)), [part(1.0)])
    assert shows_its_cycles(explained_by(), [part(1.0)])


def test_a_measured_temperature_shows_the_swing_itself():
    swing, warm = explained_by(ThermalStiffness(period=1e4)), {"temperature": np.full(5, 293.0)}
    assert shows_its_cycles(swing, [part(10.0, **warm)])
    assert not shows_its_cycles(swing, [part(10.0, **warm), part(10.0)])  # of one experiment nobody knows it
    later = part(10.0, **warm)
    later.experiment.recordings += part(10.0).experiment.recordings  # on the same clock: the last value is held
    assert shows_its_cycles(swing, [later])
    assert not shows_its_cycles(explained_by(PeriodicDisturbance(frequency=1e-4)), [part(10.0, **warm)])

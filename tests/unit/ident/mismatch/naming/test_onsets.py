"""When an event came: to first order for all times at once, and where a fit without it was bent to meet it halfway."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.mismatch.naming.onsets import event_leads, explained_from, most_promising
from deatwin.ident.mismatch.naming.screen import Lead, footprints, leads
from deatwin.plant import Creep, Diaphragm, ElectrodeLoss, Experiment, Plant, Recording, SensorDrift, SensorJump
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.integrator.compiled import compiler

PLANT = Plant(rig=Diaphragm())
SAMPLE_TIME, SECONDS = 0.02, 120.0
SHARE, AT = 0.35, 100.0
DRIFT = SensorDrift(change=-100e-6, time=60.0)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_change_explains_from_each_sample_on_is_least_squares(seed):
    rng = np.random.default_rng(seed)
    m = 60
    jacobian, change, residual = rng.normal(size=(m, 4)), 1e-3 * rng.normal(size=m), rng.normal(size=m)
    explained, strength = explained_from(change, residual, np.linalg.qr(jacobian)[0])

    def left(columns: np.ndarray) -> tuple[float, np.ndarray]:
        values, *_ = np.linalg.lstsq(columns, residual, rcond=None)
        return float(np.sum((residual - columns @ values) ** 2)), values

    without = left(jacobian)[0]
    for k in range(m):
        late = np.where(np.arange(m) >= k, change, 0.0)
        squares, values = left(np.column_stack([1e3 * late, jacobian]))
        assert explained[k] == pytest.approx(without - squares, rel=1e-6, abs=1e-9)
        assert strength[k] == pytest.approx(1e3 * values[0], rel=1e-6)


def test_a_change_that_the_parameters_take_up_wherever_it_begins_explains_nothing():
    change, residual = np.ones(50), np.random.default_rng(0).normal(size=50)
    steps = np.tril(np.ones((50, 50)))
    explained, strength = explained_from(change, residual, np.linalg.qr(steps)[0])
    assert not explained.any()
    assert not strength.any()


@pytest.fixture(scope="module")
def part() -> Part:
    """Of a film that loses a third of its electrode late, on a sensor that drifts the same way all the time."""
    commands = band_limited_noise(np.random.default_rng(0), SECONDS, SAMPLE_TIME)
    blank = Recording.from_arrays(commands, np.zeros_like(commands), SAMPLE_TIME)
    film = PLANT.with_effects(ElectrodeLoss(share=SHARE, at=AT), DRIFT)
    return Part.whole(film.record(Experiment(recordings=(blank,)), np.random.default_rng(1)))


@pytest.mark.skipif(compiler() is None, reason="fits: without a C compiler they take ten times as long")
def test_an_event_is_seen_from_before_it_came(part):
    fit = calibrate(PLANT, [part], evaluations=10)
    bench = SimpleNamespace(fitted=[part], jobs=1)
    (bent,) = leads(footprints(bench, fit, [ElectrodeLoss()], fit), fit)
    assert abs(bent.effect.at - AT) > 0.3 * SECONDS  # what the fit leaves does not tell when
    (lead,) = event_leads(PLANT, fit, [ElectrodeLoss(), Creep()], [part])
    assert lead.effect.at == lead.estimate.at == pytest.approx(AT, abs=0.01 * SECONDS)
    assert lead.share > bent.share
    assert lead.effect.share == ElectrodeLoss().share  # the typical one, from where a fit begins
    # with the drift in the plant nothing bends it, but what comes is large for a first order
    beside = calibrate(PLANT.with_effects(DRIFT), [part], evaluations=10)
    (lead,) = event_leads(PLANT.with_effects(DRIFT), beside, [ElectrodeLoss()], [part])
    assert lead.effect.at == pytest.approx(AT, abs=SAMPLE_TIME)
    assert lead.estimate.share == pytest.approx(SHARE, rel=0.25)
    assert lead.share > 0.9


@pytest.mark.skipif(compiler() is None, reason="fits: without a C compiler they take ten times as long")
def test_what_is_no_event_or_in_the_plant_has_no_lead_here(part):
    plant = PLANT.with_effects(SensorJump(at=AT))
    fit = calibrate(plant, [part], evaluations=3)
    assert event_leads(plant, fit, [Creep(), SensorJump()], [part]) == ()


def test_of_each_effect_the_better_lead_is_kept():
    weak, strong, other = (
        Lead(effect=effect, share=share, estimate=effect)
        for effect, share in ((SensorJump(at=3.0), 0.2), (SensorJump(at=9.0), 0.7), (Creep(), 0.4))
    )
    assert most_promising([other, weak], [strong]) == most_promising([strong], [weak, other]) == (strong, other)
    assert most_promising([weak], [replace(strong, share=0.1)]) == (weak,)

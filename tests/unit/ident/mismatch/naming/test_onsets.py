"""When an event came: to first order for all times at once, and where a fit without it was biased to meet it halfway."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from made_fits import made_problem
from needs import COMPILED

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch.naming import onsets
from deatwin.ident.mismatch.naming.onsets import beginning_at_each, event_lead, event_leads
from deatwin.ident.mismatch.naming.screen import Lead, LinearisedResponse, leads, linearised_responses, most_promising
from deatwin.ident.mismatch.refit import search
from deatwin.plant import Creep, Diaphragm, ElectrodeLoss, Experiment, Plant, Recording, SensorDrift, SensorJump
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.parameters import Parameter

PLANT = Plant(rig=Diaphragm())
SAMPLE_TIME, SECONDS = 0.02, 120.0
SHARE, AT = 0.35, 100.01  # between two readings
DRIFT = SensorDrift(change=-100e-6, time=60.0)


def brute_force(change, residual, jacobian, k) -> tuple[float, float]:
    """Squared residual that is left with the change from sample k on, and its strength: by least squares."""
    size = np.linalg.norm(change)
    late = np.where(np.arange(change.size) >= k, change / size, 0.0)
    columns = np.column_stack([late, jacobian])
    values = np.linalg.lstsq(columns, residual, rcond=None)[0]
    return float(np.sum((residual - columns @ values) ** 2)), float(values[0] / size)


@pytest.mark.parametrize("seed", range(3))
def test_what_a_change_explains_from_each_sample_on_is_least_squares(seed):
    rng = np.random.default_rng(seed)
    m = 60
    jacobian, change, residual = rng.normal(size=(m, 4)), 1e-3 * rng.normal(size=m), rng.normal(size=m)
    along, own = beginning_at_each(change, residual, np.linalg.qr(jacobian)[0])
    without = np.sum((residual - jacobian @ np.linalg.lstsq(jacobian, residual, rcond=None)[0]) ** 2)
    for k in range(m):
        squares, strength = brute_force(change, residual, jacobian, k)
        assert along[k] / own[k] == pytest.approx(strength, rel=1e-6)
        assert along[k] ** 2 / own[k] == pytest.approx(without - squares, rel=1e-6, abs=1e-9)


def test_what_the_parameters_take_up_wherever_it_begins_has_nothing_of_its_own():
    steps = np.tril(np.ones((50, 50)))
    residual = np.random.default_rng(0).normal(size=50)
    assert not beginning_at_each(np.ones(50), residual, np.linalg.qr(steps)[0])[1].any()


M = 400
CLOCK = 10.0 + 0.1 * np.arange(M)
WAVE = 2.0 + np.sin(CLOCK)
OWN = np.column_stack([np.ones(M), CLOCK])
"""What the parameters of a linear plant do."""


def lead_at(at: float, size: float, effect, *, clock=CLOCK, noise=0.0, rms=None) -> Lead:
    """Of an event that is there from `at` on in a linear problem, where parameters are off, too."""
    rng = np.random.default_rng(4)
    residual = size * WAVE * (CLOCK > at) + OWN @ [0.3, -0.02] + noise * rng.normal(size=M)
    order = np.argsort(np.argsort(clock, kind="stable"), kind="stable")  # the samples in the order of `clock`
    fit = float(np.sqrt(np.mean(residual**2))) if rms is None else rms
    known = LinearisedResponse(effect=effect, change=WAVE[order])
    return event_lead(known, clock, residual[order], OWN[order], fit)


@pytest.mark.parametrize("at", [12.57, 30.0 + 0.05, 47.33])
@pytest.mark.parametrize("size", [5e-5, -2e-5])
def test_an_event_is_found_between_the_two_samples_at_which_it_comes(at, size):
    lead = lead_at(at, size, SensorJump(), rms=1.0)
    assert np.count_nonzero(CLOCK < lead.effect.at) == np.count_nonzero(CLOCK < at)
    assert lead.estimate.at == lead.effect.at
    assert lead.estimate.change == pytest.approx(size, rel=1e-6)
    assert lead.effect.change == np.copysign(SensorJump().change, size)  # as usual, but its own way
    assert lead.left == pytest.approx(0.0, abs=1e-18)


def test_samples_of_several_recordings_may_come_in_any_order():
    shuffled = np.random.default_rng(1).permutation(CLOCK)
    one, other = (lead_at(33.3, 5e-5, SensorJump(), clock=clock) for clock in (CLOCK, shuffled))
    assert other.effect.at == pytest.approx(one.effect.at, rel=1e-12)
    assert other.left == pytest.approx(one.left, abs=1e-18)


def test_two_samples_at_one_time_see_an_event_both_or_neither():
    twice = np.repeat(CLOCK[::2], 2)
    jump = 5e-5 * (np.arange(M) > 200)  # between two of the same time
    lead = event_lead(LinearisedResponse(effect=SensorJump(), change=np.ones(M)), twice, jump, OWN[:, 1:], 1.0)
    assert lead.effect.at not in twice
    assert np.count_nonzero(twice < lead.effect.at) in (200, 202)


def test_an_event_is_no_larger_than_it_can_be():
    loss = lead_at(30.03, 3.0, ElectrodeLoss())  # three times the area
    assert loss.estimate.share == 0.9
    late = np.arange(M) >= np.count_nonzero(CLOCK < loss.effect.at)
    residual = 3.0 * WAVE * (CLOCK > 30.03) - 0.9 * WAVE * late
    rest = residual - OWN @ np.linalg.lstsq(OWN, residual, rcond=None)[0]
    assert loss.left == pytest.approx(np.mean(rest**2), rel=1e-6)


def test_what_explains_the_other_way_only_explains_nothing():
    wave, nobody = LinearisedResponse(effect=ElectrodeLoss(), change=np.ones(M)), np.zeros((M, 1))
    up = np.where(CLOCK > 30.0, -1.0, 0.0)
    assert event_lead(wave, CLOCK, up, nobody, 1.0) is None
    assert event_lead(wave, CLOCK, -up, nobody, 1.0).share > 0.0


@pytest.mark.parametrize("start", [-500.0, 3e4, 1.7e9])
def test_on_a_clock_that_no_event_has_nothing_is_found(start):
    clock = CLOCK - CLOCK[0] + start
    known = LinearisedResponse(effect=ElectrodeLoss(), change=np.ones(M))
    assert event_lead(known, clock, np.where(clock > clock[100], 0.3, 0.0), np.ones((M, 1)), 1.0) is None
    assert event_lead(known, clock, np.where(clock > clock[100], -0.3, 0.0), np.zeros((M, 1)), 1.0) is None
    late = event_lead(known, CLOCK - 30.0, np.where(CLOCK > 40.0, 0.3, 0.0), np.ones((M, 1)), 1.0)
    assert late.effect.at == pytest.approx(10.0, abs=0.1)  # part of the clock will do


def test_an_event_has_samples_before_it_and_after_it():
    """A share of the area that is lost before all is a smaller area, and no event."""
    constant = LinearisedResponse(effect=ElectrodeLoss(), change=np.ones(M))
    lead = event_lead(constant, CLOCK, np.full(M, 0.3), CLOCK[:, None] - CLOCK.mean(), 1.0)
    assert CLOCK[0] + 0.1 < lead.effect.at < CLOCK[-1] - 0.1


def test_nothing_is_explained_that_the_fit_does_without():
    """What is left where the plant is not biased may be more than the fit leaves, and what an event takes of that."""
    much = lead_at(30.0, 5e-5, SensorJump(), noise=4e-5)
    free = np.sqrt(much.left)
    assert lead_at(30.0, 5e-5, SensorJump(), noise=4e-5, rms=0.99 * free) is None
    beyond = lead_at(30.0, 5e-5, SensorJump(), noise=4e-5, rms=1.1 * free).share
    assert beyond == pytest.approx(1.0 - 1.1**-2)
    # of a fit that was given up, only what the event takes of what is left to first order
    given_up = lead_at(30.0, 5e-5, SensorJump(), noise=4e-5, rms=10.0).share
    assert given_up * 10.0**2 < 2 * 5e-5**2 * np.mean(WAVE**2)


@pytest.fixture(scope="module")
def part():
    """Of a film that loses a third of its electrode late, on a sensor that drifts the same way all the time."""
    commands = band_limited_noise(np.random.default_rng(0), SECONDS, SAMPLE_TIME)
    blank = Recording.from_arrays(commands, np.zeros_like(commands), SAMPLE_TIME)
    film = PLANT.with_effects(ElectrodeLoss(share=SHARE, at=AT), DRIFT)
    return Part.whole(film.record(Experiment(recordings=(blank,)), np.random.default_rng(1)))


@COMPILED
def test_an_event_is_seen_from_before_it_came(part):
    fit = calibrate(PLANT, [part], evaluations=10, starts=1)
    problem = made_problem(fitted=(part,))
    (biased,) = leads(linearised_responses(problem, fit, [ElectrodeLoss()], fit), fit)
    assert abs(biased.effect.at - AT) > 0.3 * SECONDS  # what the fit leaves does not tell when
    (lead,) = event_leads(PLANT, fit, [ElectrodeLoss(), Creep()], [part])
    assert lead.effect.at == lead.estimate.at == pytest.approx(AT, abs=0.01 * SECONDS)
    assert lead.share > biased.share
    assert lead.effect.share == ElectrodeLoss().share  # the typical one, from where a fit begins
    # with the drift in the plant nothing bends it, but what comes is large for a first order
    beside = calibrate(PLANT.with_effects(DRIFT), [part], evaluations=10, starts=1)
    (lead,) = event_leads(PLANT.with_effects(DRIFT), beside, [ElectrodeLoss()], [part])
    assert lead.effect.at == pytest.approx(AT, abs=SAMPLE_TIME / 2)
    assert lead.estimate.share == pytest.approx(SHARE, rel=0.25)
    assert lead.share > 0.9


@COMPILED
def test_where_it_begins_is_not_the_bent_plant(part, monkeypatch):
    begun = []
    monkeypatch.setattr(
        "deatwin.ident.mismatch.naming.onsets.approach",
        lambda start, parts: begun.append(start) or search.approach(start, parts),
    )
    fit = calibrate(PLANT, [part], evaluations=3, starts=1)
    event_leads(PLANT, fit, [SensorJump()], [part])
    assert begun == [PLANT]


@COMPILED
def test_what_is_no_event_or_in_the_plant_has_no_lead_here(part):
    plant = PLANT.with_effects(SensorJump(at=AT))
    fit = calibrate(plant, [part], evaluations=3, starts=1)
    assert event_leads(plant, fit, [Creep(), SensorJump()], [part]) == ()


@COMPILED
@pytest.mark.parametrize("place", ["response", "Problem.evaluate"])
def test_a_plant_that_cannot_be_simulated_has_no_lead(part, monkeypatch, place):
    fit = calibrate(PLANT, [part], evaluations=3, starts=1)
    monkeypatch.setattr(f"deatwin.ident.mismatch.naming.onsets.{place}", lambda *_: None)
    assert event_leads(PLANT, fit, [SensorJump()], [part]) == ()


@COMPILED
def test_events_are_sought_in_the_unbiased_plant_if_the_opening_leads_to_one_that_pulls_in(part, monkeypatch):
    fit = calibrate(PLANT, [part], evaluations=3, starts=1)
    ends = fit.plant.parameters
    soft = fit.plant.with_values(
        {"permittivity": ends["permittivity"].upper, "stretch_limit": ends["stretch_limit"].upper}
    )
    assert free_run_residuals(soft, [part]) is None
    monkeypatch.setattr(onsets, "approach", lambda *_: replace(fit, plant=soft))
    (lead,) = event_leads(PLANT, fit, [ElectrodeLoss()], [part])
    assert lead.effect.at == pytest.approx(AT, abs=1.0)  # to first order; a fit places it exactly


@dataclass(frozen=True)
class Unbearable(ElectrodeLoss):
    """The electrode grows; no film bears its typical strength, but a little of it."""

    share: float = -40.0

    name: ClassVar[str] = "unbearable"

    def describe(self) -> tuple[Parameter, ...]:
        at = ElectrodeLoss(at=self.at).describe()[1]
        return Parameter(name="share", value=self.share, unit="1", lower=-1e3, upper=1e3), at


@COMPILED
def test_a_fit_starts_with_a_strength_at_which_the_plant_was_simulated(part):
    fit = calibrate(PLANT, [part], evaluations=3, starts=1)
    problem = made_problem(fitted=(part,))
    (known, *_) = linearised_responses(problem, fit, [Unbearable()], fit)
    assert abs(known.effect.share) < abs(Unbearable().share)
    (lead,) = event_leads(PLANT, fit, [Unbearable()], [part])
    assert abs(lead.effect.share) == pytest.approx(abs(known.effect.share))


def test_of_each_effect_the_better_lead_is_kept():
    weak, strong, other = (
        Lead(effect=effect, share=share, estimate=effect)
        for effect, share in ((SensorJump(at=3.0), 0.2), (SensorJump(at=9.0), 0.7), (Creep(), 0.4))
    )
    assert most_promising([other, weak], [strong]) == most_promising([strong], [weak, other]) == (strong, other)
    assert most_promising([weak], [replace(strong, share=0.1)]) == (weak,)

"""Where the screen looks for an effect."""

from dataclasses import replace

import numpy as np
import pytest
from made_fits import made_problem
from made_rigs import Wire
from needs import COMPILED
from runs import blank

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.parts import simulated
from deatwin.ident.greybox.tangent import linearised_rms
from deatwin.ident.mismatch.naming.screen import (
    LEVELS,
    SEEN,
    LinearisedResponse,
    _of_a_size,
    leads,
    linearised_responses,
    response,
    shapes_of,
)
from deatwin.plant import (
    AmplifierSaturation,
    Creep,
    Delay,
    Diaphragm,
    EndStop,
    Experiment,
    PeriodicDisturbance,
    Plant,
    Reading,
    ReadingTime,
    Recording,
    SensorLag,
    SensorSaturation,
)
from deatwin.plant.excitation import band_limited_noise

pytestmark = COMPILED
PLANT = Plant(rig=Diaphragm())


@pytest.fixture(scope="module")
def fitted():
    commands = band_limited_noise(np.random.default_rng(0), 20.0, 0.02)
    blank = Recording.from_arrays(commands, np.zeros_like(commands), 0.02)
    part = Part.whole(PLANT.record(Experiment(recordings=(blank,)), np.random.default_rng(1)))
    return calibrate(PLANT, [part], evaluations=3, starts=1), part


@pytest.mark.parametrize("effect, name", [(EndStop(), "position"), (SensorSaturation(), "limit")])
def test_a_threshold_is_looked_for_among_the_readings(fitted, effect, name):
    fit, part = fitted
    places = [getattr(shape, name) for shape in shapes_of(effect, fit.plant, [part])]
    assert len(set(places)) == len(LEVELS)
    # each has readings on both sides: elsewhere the effect would do nothing, or what the zero does
    assert part.measured.min() < min(places)
    assert max(places) < part.measured.max()


def test_a_voltage_is_looked_for_among_the_voltages(fitted):
    fit, part = fitted
    limits = [shape.limit for shape in shapes_of(AmplifierSaturation(), fit.plant, [part])]
    assert 800 * part.commands.min() < min(limits) < max(limits) < 800 * part.commands.max()


def test_a_time_is_looked_for_around_the_typical_one(fitted):
    fit, part = fitted
    times = [shape.time for shape in shapes_of(Creep(), fit.plant, [part])]
    assert times == pytest.approx([60 / 8, 60, 480])


def test_what_a_parameter_at_its_bound_would_hide_is_seen(fitted):
    """The damping of the film imitates a lag; at the end of its range it can do no more of that."""
    fit, _ = fitted
    k = fit.names.index("damping")
    lag = LinearisedResponse(effect=SensorLag(), change=fit.jacobian[:, k])  # the very same
    missing = replace(fit, residuals=2.0 * fit.jacobian[:, k])
    assert [lead.share for lead in leads([lag], missing)] == pytest.approx([0.0], abs=1e-12)
    (lead,) = leads([lag], replace(missing, at_bound=("damping",)))
    rest = np.delete(fit.jacobian, k, axis=1)
    own = linearised_rms(missing.residuals, rest) ** 2 / np.mean(missing.residuals**2)
    assert lead.share == pytest.approx(own, rel=1e-9)
    assert own > 0.01


def test_an_effect_is_seen_at_the_strength_at_which_it_does_what_is_missing(fitted):
    """A stop of 300 N/m is a wall to a film of 30 N/m; a little of one is proportional to its stiffness.

    A tenth of the film's stiffness changes the motion by a tenth at most, and what is linear to a tenth by a hundredth.
    """
    fit, part = fitted
    without = simulated(fit.plant, [part])
    stop = EndStop(position=float(np.quantile(part.measured, 0.75)))

    def change(strength):
        return simulated(fit.plant.with_effects(replace(stop, stiffness=strength)), [part]) - without

    def rms(values):
        return float(np.sqrt(np.mean(values**2)))

    little = 0.5
    known = response(fit.plant, [part], without, stop, missing=rms(change(little)))
    assert known.effect == stop  # a fit begins where it did
    assert rms(known.change - change(little) / little) < 0.1 * rms(known.change)
    wall = response(fit.plant, [part], without, stop, missing=rms(change(stop.stiffness)))
    assert wall.change == pytest.approx(change(stop.stiffness) / stop.stiffness)
    assert rms(wall.change) < 0.5 * rms(known.change)  # much of it does less for its stiffness


def test_the_screen_looks_for_as_much_as_the_fit_leaves(fitted):
    fit, part = fitted
    problem, without = made_problem(fitted=(part,)), simulated(fit.plant, [part])
    much = replace(fit, residuals=100.0 * fit.residuals)
    for left in (fit, much):
        found = linearised_responses(problem, fit, [EndStop()], left)
        assert len(found) > 1
        for known in found:
            alone = response(fit.plant, [part], without, known.effect, missing=left.rms)
            np.testing.assert_allclose(known.change, alone.change, atol=1e-12)


def test_an_effect_that_does_less_than_wanted_at_a_part_of_its_strength_is_looked_at_in_between():
    """What grows with the cube: at a tenth of the strength it does a thousandth."""
    looked = []

    def does(strength):
        looked.append(strength)
        return np.full(4, strength**3)

    change = _of_a_size(does, 10.0, np.full(4, 1000.0), wanted=100.0)
    # 10 does ten times too much; 1 a hundredth of what is wanted, 3.2 does 32, 5.6 178
    assert looked == pytest.approx([1.0, 10**0.5, 10**0.75])
    assert change == pytest.approx(np.full(4, 10**1.5))  # of the last one, within a factor of two
    looked.clear()
    assert _of_a_size(does, 10.0, np.full(4, 1000.0), wanted=600.0) == pytest.approx(np.full(4, 100.0))
    assert looked == []


def test_an_effect_that_cannot_be_simulated_weaker_keeps_what_it_does(fitted):
    change = np.full(4, 1000.0)
    assert _of_a_size(lambda strength: None, 10.0, change, wanted=1.0) == pytest.approx(change / 10.0)
    assert np.isfinite(_of_a_size(lambda strength: 0.0 * change, 10.0, change, wanted=0.0)).all()


def test_less_of_an_effect_than_a_simulation_is_accurate_to_is_not_looked_at(fitted):
    fit, part = fitted
    without = simulated(fit.plant, [part])
    least = SEEN * float(np.std(without))
    nothing, something = (response(fit.plant, [part], without, Creep(), missing=m) for m in (0.0, least))
    np.testing.assert_array_equal(nothing.change, something.change)


@pytest.mark.parametrize("reading", ReadingTime)
@pytest.mark.parametrize("frequency", [6.1, 19.1])
def test_a_tone_is_looked_for_with_its_phase_at_the_readings(reading, frequency):
    """From one row's reading to the next a fast tone turns by much: a fit that begins so far off ends elsewhere."""
    plant = Plant(rig=Diaphragm(reading=reading))
    tone = PeriodicDisturbance(amplitude=20e-6, frequency=frequency, phase=0.4)
    commands = band_limited_noise(np.random.default_rng(0), 20.0, 0.02)
    part = Part.whole(plant.with_effects(tone).record(blank(commands), np.random.default_rng(1)))
    fit = calibrate(plant, [part], evaluations=3, starts=1)
    problem = made_problem(fitted=(part,))
    (lead,) = leads(linearised_responses(problem, fit, [PeriodicDisturbance()], fit), fit)
    assert lead.share > 0.95  # noise has a hundredth of its power
    # four standard deviations, at a noise of a tenth of the amplitude in 1000 samples (Rife & Boorstyn, 1974)
    cycles, turned = frequency * 20.0, 4 * 0.1 * np.sqrt(2 / 1000)
    assert lead.estimate.frequency * 20.0 == pytest.approx(cycles, abs=np.sqrt(12) * turned / (2 * np.pi))
    assert lead.estimate.phase == pytest.approx(tone.phase, abs=2 * turned)


def test_the_zero_of_a_further_reading_does_not_change_how_strongly_an_effect_is_tried():
    """A capacitance that never changes, in units in which it is a thousand times the motion, is no motion."""
    commands = np.repeat(np.random.default_rng(2).uniform(0.0, 2.0, 60), 5)
    plant = Plant(rig=Wire(further=(Reading(name="capacitance", noise=1e-15),)))
    blank = Recording.from_arrays(
        commands, np.zeros_like(commands), 0.02, extras={"capacitance": np.zeros(300)}, extra_units={"capacitance": "F"}
    )
    first = Part.whole(Experiment(recordings=(blank,)))
    both = (first, replace(first, reading="capacitance", weight=1e8))
    alone, beside = (simulated(plant, parts) for parts in ((first,), both))
    assert beside[300:] == pytest.approx(0.1)  # 1 nF
    found = response(plant, (first,), alone, Delay(time=0.05), missing=2e-6)
    again = response(plant, both, beside, Delay(time=0.05), missing=2e-6 / np.sqrt(2.0))
    assert again.change[:300] == pytest.approx(found.change)
    typical = response(plant, (first,), alone, Delay(time=0.05), missing=1.0)
    assert np.std(typical.change - found.change) > 0.1 * np.std(found.change)

"""What is known of parameters before a recording."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import cauchy, norm

from deatwin.ident.mismatch.likelihood.beforehand import (
    AMPLITUDE,
    DATA_SHEET,
    RATE,
    WRONG,
    Coordinate,
    coordinate,
    nominal_odds,
    pair_odds,
    touching,
)
from deatwin.plant import Disc, Plant
from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.parameters import Parameter, Scale

CREEP, LAG, CEILING, SUPPLY, TONE = (
    effect_named(name)
    for name in ("creep", "sensor_lag", "sensor_saturation", "amplifier_saturation", "periodic_disturbance")
)
EFFECTS = {effect.name: effect for effect in (CREEP, LAG, CEILING, SUPPLY, TONE)}
MASS = Parameter(name="mass", value=2.0, unit="kg", lower=0.1, upper=10.0, scale=Scale.LOGARITHMIC)
PLANT = SimpleNamespace(parameters={"mass": MASS})


def before(parameter):
    return coordinate(parameter, PLANT, EFFECTS, 1e-3)


def own(effect, name):
    return next(p for p in effect.parameters if p.name == f"{effect.name}.{name}")


def test_a_parameter_of_the_plant_is_about_its_nominal_value():
    known = before(MASS)
    assert (known.mean, known.deviation, known.one_sided) == (pytest.approx(np.log(2.0)), DATA_SHEET, False)


def test_a_strength_is_about_none_and_of_one_sign_where_its_range_is():
    strength = own(CREEP, CREEP.strength)
    known = before(strength)
    assert known.mean == 0.0
    assert known.deviation == touching(AMPLITUDE * abs(strength.value), strength.value)[0]
    assert known.one_sided == (strength.lower >= 0.0)


@pytest.mark.parametrize("value", [0.0, -0.3, 1.0, 40.0])
def test_a_normal_law_touches_that_of_strengths_from_below(value):
    """The Cauchy law is scipy's; the scaled normal law meets it, with its slope, at the value."""
    width, at = 2.0, np.linspace(-100.0, 100.0, 20001)
    deviation, factor = touching(width, value)

    def gap(x):
        return cauchy.logpdf(x, scale=width) - factor - norm.logpdf(x, scale=deviation)

    assert gap(value) == pytest.approx(0.0, abs=1e-12)
    assert (gap(at) > -1e-12).all()


def test_a_time_is_known_to_a_factor_of_e():
    times = [p for p in CREEP.parameters if p.scale is Scale.LOGARITHMIC and not p.name.endswith(CREEP.strength)]
    assert times
    for time in times:
        known = before(replace(time, value=3.0 * time.value))
        assert (known.mean, known.deviation) == pytest.approx((np.log(time.value), touching(RATE, np.log(3.0))[0]))


def test_a_threshold_lies_where_readings_reach():
    threshold = own(CEILING, CEILING.threshold)
    known = before(threshold)
    assert known.mean == pytest.approx(0.75 * min(threshold.upper, 1e-3))
    assert 0.0 < known.deviation < known.mean
    limit = own(SUPPLY, SUPPLY.threshold)  # the reading says nothing of volts
    assert (before(limit).mean, before(limit).deviation) == (pytest.approx(limit.value), pytest.approx(limit.value / 3))


@pytest.mark.parametrize("phase", [-6.0, 0.0, 0.5])
def test_every_phase_is_as_likely(phase):
    """A uniform law over a period has the density 1/(2 pi); the normal one has its largest value at the phase."""
    known = before(replace(own(TONE, "phase"), value=phase))
    assert norm(known.mean, known.deviation).pdf(phase) == pytest.approx(1.0 / (2.0 * np.pi))
    assert known.log_factor == 0.0


def test_a_parameter_of_another_form_of_the_plant_only_is_about_its_value():
    other = Parameter(name="slip", value=3.0, unit="m", lower=0.0, upper=10.0)
    known = before(other)
    assert (known.mean, known.deviation) == (3.0, pytest.approx(3.0 * DATA_SHEET))


def test_an_unknown_start_of_a_memory_may_lie_anywhere_in_its_range():
    plant = Plant(rig=Disc(start_is_known=False), effects=(CREEP,))
    start = plant.with_values({"creep.at_start": 0.2}).parameters["creep.at_start"]
    assert before(start) == Coordinate(mean=0.0, deviation=pytest.approx((start.upper - start.lower) / 12**0.5))


def test_a_pair_of_many_is_less_likely_than_one_of_many():
    """1/10 over 378 pairs against 3/8 over 28 single effects; where there is one effect there are no more pairs."""
    assert pair_odds(28) == pytest.approx(np.log(0.1 / 378) - np.log(0.375 / 28))
    assert pair_odds(1) == pytest.approx(np.log(0.1 / 0.375))


def mass(value):
    return replace(MASS, value=value)


@pytest.mark.parametrize("deviations", [-1.0, 0.5, 1.5])
def test_a_usual_departure_costs_what_a_data_sheet_says(deviations):
    """Within two deviations the normal law rules: a wrong nominal value has at most a twentieth of the probability."""
    found = nominal_odds(mass(2.0 * np.exp(deviations * DATA_SHEET)), MASS)
    assert found == pytest.approx(-(deviations**2) / 2, abs=WRONG)


@pytest.mark.parametrize("value", [0.1, 0.5, 10.0])
def test_a_nominal_value_that_is_wrong_costs_the_same_everywhere(value):
    """Far off, the value is one of an even law over the range, log(100) wide, and the nominal value need not be right."""
    even, peak = WRONG / np.log(100.0), (1.0 - WRONG) / (DATA_SHEET * np.sqrt(2.0 * np.pi))
    assert nominal_odds(mass(value), MASS) == pytest.approx(np.log(even / (peak + even)), abs=0.01)


@pytest.mark.parametrize("value", [0.1, 2.0, 10.0])
def test_every_value_is_as_likely_if_the_nominal_one_is_a_guess(value):
    """The even law over the range, ln(100) wide, has a standard deviation of ln(100)/sqrt(12)."""
    guess = replace(MASS, guessed=True)
    known = coordinate(replace(guess, value=value), SimpleNamespace(parameters={"mass": guess}), EFFECTS, 1e-3)
    assert nominal_odds(replace(guess, value=value), guess) == 0.0
    assert known.deviation == pytest.approx(np.log(100.0) / np.sqrt(12.0))


def test_the_damping_of_a_film_rig_is_a_guess_and_its_material_is_not():
    """The data sheet of an elastomer says nothing about damping."""
    parameters = Plant(rig=Disc()).parameters
    assert [name for name in parameters.free if parameters[name].guessed] == ["damping"]

"""Effects on rigs that read a force: sizes of what enters reading and command are newtons and stretches."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import runs

from deatwin.plant import Creep, Effect, Parameter, Plant, Rig, catalogue
from deatwin.plant.effects.base import Place
from deatwin.plant.rigs.coupon import Coupon
from deatwin.plant.rigs.planar import BlockedPlanar

TIMES = 0.02 * np.arange(60)
COMMANDS = {"coupon": 3.0 - 2.0 * np.cos(5.0 * TIMES), "blocked_planar": 2.0 - 2.0 * np.cos(5.0 * TIMES)}
"""Pulls to a stretch of 5, and voltages up to 3.2 kV."""
START = 99.4
"""On the clock, s: the events of the catalogue happen at 100 s, within the recording."""
RIGS: tuple[Rig, ...] = (Coupon(), BlockedPlanar())
ACCEPTED = [(rig, effect) for rig in RIGS for effect in rig.effects() if Plant(rig=rig).accepts(effect)]


pytestmark = pytest.mark.usefixtures("uncompiled")


def readings(plant: Plant) -> np.ndarray:
    return runs.readings(plant, COMMANDS[plant.rig.kind], start=START)


@cache
def bare_readings(rig: Rig) -> np.ndarray:
    return readings(Plant(rig=rig))


def offered(rig: Rig, name: str) -> Effect:
    return next(effect for effect in rig.effects() if effect.name == name)


def parameter(effect: Effect, name: str) -> Parameter:
    return next(p for p in effect.describe() if p.name == name)


@pytest.mark.parametrize(("rig", "effect"), ACCEPTED, ids=lambda x: getattr(x, "kind", getattr(x, "name", "")))
def test_every_effect_can_be_simulated_at_its_typical_size(rig: Rig, effect: Effect) -> None:
    bare, reading = bare_readings(rig), readings(Plant(rig=rig).with_effects(effect))
    assert np.isfinite(reading).all()
    if effect.signal in ("reading", "command"):
        # Typical is more than the load cell's noise and less than what it reads.
        assert rig.noise < np.abs(reading - bare).max() < np.abs(bare).max()


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_sensor_and_drive_have_effects(rig: Rig) -> None:
    names = {effect.name for accepting, effect in ACCEPTED if accepting is rig}
    assert {"amplifier_offset", "delay", "sensor_curvature", "sensor_drift", "sensor_jump", "sensor_lag"} <= names


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_a_load_cell_may_jump_by_tenths_of_a_newton(rig: Rig) -> None:
    jump = parameter(offered(rig, "sensor_jump"), "change")
    assert jump.unit == "N"
    assert jump.lower < -0.3 < 0.3 < jump.upper
    assert rig.noise < jump.value < np.abs(bare_readings(rig)).max()


def test_a_jump_is_added_in_newtons() -> None:
    rig = Coupon()
    jump = replace(offered(rig, "sensor_jump"), change=0.3, at=100.0)  # type: ignore[call-arg]
    change = readings(Plant(rig=rig).with_effects(jump)) - bare_readings(rig)
    assert change[0] == pytest.approx(0.0, abs=1e-12)
    assert change[-1] == pytest.approx(0.3, rel=1e-12)  # 0.6 s after a step of some milliseconds


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_times_are_those_of_the_catalogue(rig: Rig) -> None:
    usual = {e.name: e.describe() for e in catalogue()}
    for effect in (effect for accepting, effect in ACCEPTED if accepting is rig):
        assert [p for p in effect.describe() if p.unit == "s"] == [p for p in usual[effect.name] if p.unit == "s"]


def test_an_offset_of_the_stretch_is_a_stretch() -> None:
    assert parameter(offered(Coupon(), "amplifier_offset"), "offset").unit == "1"


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_no_offset_in_range_takes_the_strip_away(end: str) -> None:
    offset = offered(Coupon(), "amplifier_offset")
    bound = replace(offset, offset=getattr(parameter(offset, "offset"), end))  # type: ignore[call-arg]
    assert np.isfinite(readings(Plant(rig=Coupon()).with_effects(bound))).all()


@pytest.mark.parametrize("rig", RIGS, ids=lambda rig: rig.kind)
def test_what_acts_on_a_film_stays_in_its_own_units(rig: Rig) -> None:
    creep = offered(rig, "creep")
    assert creep == Creep()
    assert [(p.name, p.unit) for p in creep.describe()] == [("modulus", "Pa"), ("time", "s")]
    films = [e for e in catalogue() if e.place in (Place.FILM, Place.PARAMETER)]
    assert films
    assert all(effect in rig.effects() for effect in films)


def test_the_drive_of_a_blocked_film_is_that_of_the_diaphragm() -> None:
    # Command and gain are the same, so that a limit of 2.8 kV does not become one of the command's few volts.
    for effect in catalogue():
        if effect.place is Place.DRIVE:
            assert offered(BlockedPlanar(), effect.name).describe() == effect.describe()


@pytest.mark.parametrize("name", ["amplifier_saturation", "amplifier_slew", "amplifier_offset", "delay"])
def test_effects_of_that_drive_act_as_they_are_written(name: str) -> None:
    rig = BlockedPlanar()
    written = next(effect for effect in catalogue() if effect.name == name)
    here, there = (readings(Plant(rig=rig).with_effects(effect)) for effect in (offered(rig, name), written))
    np.testing.assert_allclose(here, there, rtol=1e-12)  # all ratios are 1

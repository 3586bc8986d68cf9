"""What holds for every effect of the catalogue, alone and beside others. Plants are run without a compiler."""

import importlib
import itertools
import pkgutil
import re
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from runs import readings

from deatwin.plant import Diaphragm, Effect, Plant, effects
from deatwin.plant.builder import Builder
from deatwin.plant.effects.places import everywhere

SAMPLE = 0.02
RIG = Diaphragm(start_ramp=0.4, start_hold=0.2)
"""Its usual start would be six times as many samples as what is asked."""


def every():
    """An effect of each kind in the package, also those that are not registered."""
    for info in pkgutil.iter_modules(effects.__path__):
        for kind in vars(importlib.import_module(f"{effects.__name__}.{info.name}")).values():
            if isinstance(kind, type) and issubclass(kind, Effect) and kind.__module__.endswith(info.name):
                if "name" in vars(kind):
                    yield kind()


EFFECTS = sorted(every(), key=lambda e: e.name)
NAMED = {e.name: e for e in EFFECTS}
EVERYWHERE = [e for e in everywhere(EFFECTS) if e.signal != "pressure"]
each = pytest.mark.parametrize("effect", EVERYWHERE, ids=lambda e: e.name)


def off(effect):
    return replace(effect, **{effect.strength: 0.0})


read = partial(readings, start=5.0)
pytestmark = pytest.mark.usefixtures("uncompiled")


def commands(count=40, seed=4):
    """Slow enough to follow, with a rest in the middle; positive."""
    rng = np.random.default_rng(seed)
    held = rng.uniform(1.0, 3.0, -(-count // 8)).repeat(8)[:count]
    held[count // 2 : count // 2 + 4] = 0.0
    return held


@cache
def read_with(*kinds):
    """What the diaphragm with these effects reads under these commands."""
    return read(Plant(rig=RIG, effects=kinds), commands())


BESIDE = ("creep", "electrode_rc", "hysteresis", "mullins", "sensor_lag")


@pytest.mark.parametrize("part", range(5))
def test_effects_that_are_off_are_nothing_beside_others(part):
    """Eight of them at a time, so that each is beside the others that are on and those that are off."""
    assert set(BESIDE) <= set(NAMED)
    tried = EVERYWHERE[part::5]
    others = [NAMED[name] for name in BESIDE if name not in {effect.name for effect in tried}]
    with_off = read(Plant(rig=RIG, effects=(*others, *map(off, tried))), commands())
    # Newton ends when an update is below 1e-5 of the scale, 1 mm; what is left is of the order of its square.
    np.testing.assert_allclose(with_off, read_with(*others), rtol=0, atol=1e-12)


NOT_EVEN = {"amplifier_offset", "amplifier_slew", "periodic_disturbance_at_command", "sensor_drift_at_command"}
"""Under a whole experiment of opposite polarity: what adds a voltage, or treats rise and fall differently."""
NOT_BLIND_TO_REVERSALS = {
    *NOT_EVEN,
    "sensor_lag_at_command",
    "backlash",
    "charge_injection",
    "delay",
    "dielectric_absorption",
    "electrode_rc",
    "leakage",
}
"""Under a change of polarity between samples: what remembers a voltage with its sign, or lets it pass through 0 V."""


@each
def test_polarity_does_not_matter(effect):
    plant = Plant(rig=RIG, effects=(effect,))
    change = np.abs(read_with(effect) - read(plant, -commands())).max()
    assert change > 1e-8 if effect.name in NOT_EVEN else change < 1e-12


@pytest.mark.parametrize(
    "effect", [e for e in EVERYWHERE if e.name not in NOT_BLIND_TO_REVERSALS], ids=lambda e: e.name
)
def test_reversals_do_not_matter_but_to_a_memory_of_the_voltage(effect):
    signs = np.array([1, -1, -1, 1, -1]).repeat(8)
    plant = Plant(rig=RIG, effects=(effect,))
    assert np.abs(read_with(effect) - read(plant, signs * commands())).max() < 1e-12


@pytest.mark.skipif("charge_injection" not in NAMED, reason="not in this installation")
def test_injected_charge_is_seen_after_a_reversal():
    plant = Plant(rig=RIG, effects=(NAMED["charge_injection"],))
    held, signs = np.full(600, 2.4), np.r_[np.ones(500), -np.ones(100)]
    change = read(plant, signs * held) - read(plant, held)
    assert np.abs(change[:500]).max() < 1e-12
    assert np.abs(change[500:]).max() > 1e-7


EXPONENTS = {
    unit: power
    for power, units in {1: "kg A N Pa J F S C W", -1: "ohm Ohm", 0: "V m m2 m3 s s2 Hz K rad 1"}.items()
    for unit in units.split()
}
"""Powers of k when each kilogram and each ampere become k of them, so that a volt (kg m²/(s³ A)) stays a volt."""


def exponent(parameter):
    """How a quantity scales; the relative permittivity multiplies a constant in F/m that does not change."""
    above, *below = parameter.unit.split("/")
    parts = [(u, 1) for u in re.findall(r"[A-Za-z0-9]+", above)]
    parts += [(u, -1) for u in re.findall(r"[A-Za-z0-9]+", "/".join(below))]
    total = sum(sign * EXPONENTS[unit] for unit, sign in parts)
    return total + (parameter.name == "permittivity")


UNSCALED = {"leakage"}
"""Its conductivity is a constant of VHB and not a parameter, so scaling leaves it behind."""


@each
def test_a_rig_of_twice_the_substance_moves_the_same(effect):
    # Moduli, permittivity, masses, damping and friction times k, resistances over k (A7).
    plant = Plant(rig=RIG, effects=(effect,))
    scaled = {n: p.value * 1.7 ** exponent(p) for n, p in plant.parameters.items()}
    changed = {n for n, p in plant.parameters.items() if scaled[n] != p.value}
    assert {"shear_modulus", "branch_modulus", "permittivity", "mass", "damping"} <= changed
    difference = np.abs(read_with(effect) - read(plant.with_values(scaled), commands())).max()
    # The equations' unknowns are the same numbers; only rounding differs, where Newton stops, and the rounded
    # corner of dry friction.
    assert difference < 1e-9 or effect.name in UNSCALED


BASE = Plant(rig=RIG)


def brought(*kinds):
    """States and coordinates that effects bring."""
    made = Plant(rig=RIG, effects=kinds).equations
    return [
        n for n in (*made.states, *made.coordinates) if n not in (*BASE.equations.states, *BASE.equations.coordinates)
    ]


def test_all_effects_at_all_their_places_make_one_plant_in_any_order():
    one, other = (Plant(rig=RIG, effects=tuple(order)) for order in (EVERYWHERE, EVERYWHERE[::-1]))
    assert one.equations is other.equations
    # Nothing of one overwrites what another brings.
    assert sorted(brought(*EVERYWHERE)) == sorted(itertools.chain.from_iterable(map(brought, EVERYWHERE)))


SAME_NODE = [
    pair
    for pair in itertools.combinations(EFFECTS, 2)
    if (pair[0].place, pair[0].signal) == (pair[1].place, pair[1].signal)
]


@pytest.mark.parametrize("pair", SAME_NODE, ids=lambda p: f"{p[0].name}-{p[1].name}")
def test_effects_at_one_signal_act_in_one_order(pair):
    plant = Plant(rig=RIG, effects=pair)
    written = []
    for order in (pair, pair[::-1]):
        build = Builder(plant.parameters, order)
        build.share("sample_time", SAMPLE)
        written.append(build.finish(plant.rig.write(build)))
    first, second = written
    assert (first.states, first.coordinates) == (second.states, second.coordinates)
    rng = np.random.default_rng(0)
    point = [rng.uniform(0.9, 1.1, first.dynamics.numel_in(k)) for k in range(5)] + [plant.free_values, first.constants]
    for name in ("dynamics", "output"):
        values = [np.asarray(getattr(made, name)(*point)) for made in written]
        np.testing.assert_array_equal(*values)

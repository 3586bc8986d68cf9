"""Each effect: that it is visible and described, its signature, and the catalogue."""

from dataclasses import fields

import numpy as np
import pytest

from deatwin.plant import Hysteresis, RigError, catalogue, effect_named
from deatwin.plant.excitation import band_limited_noise

NOISE = band_limited_noise(np.random.default_rng(8), 4.0, 0.02)
EFFECTS = catalogue()

pytestmark = pytest.mark.usefixtures("uncompiled")


def reading(plant, experiment, inputs=NOISE):
    return plant.simulate(experiment(inputs)).require().outputs[0][0]


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.name)
def test_an_effect_says_what_it_is(effect):
    assert {p.name for p in effect.describe()} == {f.name for f in fields(effect)}
    assert {p.name for p in effect.parameters} == {f"{effect.name}.{f.name}" for f in fields(effect)}
    assert effect.strength not in effect.shapes
    assert effect.wording.format(**{f.name: "x" for f in fields(effect)})
    strength = next(p for p in effect.describe() if p.name == effect.strength)
    assert strength.lower <= 0.0 <= strength.upper
    assert effect_named(effect.name) == effect


def test_an_unknown_effect_gets_the_near_one():
    with pytest.raises(RigError, match='did you mean "hysteresis"'):
        effect_named("hysteresys")


def test_a_loop_of_hysteresis_stays_as_the_frequency_falls(base, experiment):
    plant = base.with_values({"branch_modulus": 1.0})

    def width(period, *effects):
        times = np.arange(0, 2 * period, 0.02)
        wave = 2.4 + 0.6 * np.sin(2 * np.pi * times / period)
        y = reading(plant.with_effects(*effects), experiment, wave)[-round(period / 0.02) :]
        quarter = len(y) // 4
        return abs(y[2 * quarter] - y[0])  # the same command, going down and up

    widths = [width(period, Hysteresis()) for period in (8.0, 32.0)]
    without = [width(period) for period in (8.0, 32.0)]
    assert widths[1] > 5e-6
    assert (widths[1] - without[1]) / (widths[0] - without[0]) == pytest.approx(1.0, abs=0.1)

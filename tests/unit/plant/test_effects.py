"""Each effect: that it is visible and described, its signature, and the catalogue."""

from dataclasses import fields

import pytest

from deatwin.plant import RigError, catalogue, effect_named

EFFECTS = catalogue()


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

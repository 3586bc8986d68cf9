"""The pictures of the effects on their page: all are there, and show what their equations say."""

import json
from pathlib import Path

import numpy as np
import pytest

from deatwin.plant import Diaphragm, SensorJump, catalogue
from deatwin.plant.effects.places import everywhere

DATA = json.loads((Path(__file__).parents[3] / "docs/data/signatures.json").read_text(encoding="utf-8"))


def test_every_effect_of_the_catalogue_has_a_signature_at_each_place():
    plant = Diaphragm().with_effects()
    seen = {effect.name for effect in everywhere(catalogue()) if plant.accepts(effect)}
    assert set(DATA["added_um"]) == seen, "run: python tests/tools/signatures.py docs"


def test_a_jump_is_its_height_from_its_time_on():
    jump, added = SensorJump(), np.array(DATA["added_um"]["sensor_jump"])
    times = DATA["seconds"] * (np.arange(len(added)) + 0.5) / len(added)
    np.testing.assert_allclose(added[times > jump.at + 2.0], 1e6 * jump.change, rtol=1e-2)
    np.testing.assert_allclose(added[times < jump.at - 2.0], 0.0, atol=1e-3)


@pytest.mark.parametrize("name", ["creep", "dielectric_absorption", "charge_injection"])
def test_what_relaxes_under_a_held_voltage_goes_on_changing(name):
    """The step is held from 30 to 130 s; an effect without memory adds the same all that time."""
    added = np.array(DATA["added_um"][name]).mean(axis=1)
    times = DATA["seconds"] * (np.arange(len(added)) + 0.5) / len(added)
    early, late = added[np.argmin(np.abs(times - 40.0))], added[np.argmin(np.abs(times - 125.0))]
    assert abs(late - early) > 0.2 * max(abs(early), abs(late))

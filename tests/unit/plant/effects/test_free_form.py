"""The free form: its off value, its derivatives, its functions against their textbook forms, and its file."""

import json
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from made_rigs import Pushed
from slopes import slope_errors

from deatwin.plant import (
    CalibratedPlant,
    CubicStiffness,
    Diaphragm,
    ModelError,
    Plant,
    RigError,
    catalogue,
    effect_named,
)
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.primitives import (
    PRIMITIVES,
    DeadBand,
    Largest,
    LowPass,
    Magnitude,
    Play,
    Power,
    SignedSquare,
    Smallest,
)

X, V, U = ({"variable": n, "scale": s} for n, s in (("displacement", 1e-3), ("velocity", 0.02), ("command", 2.0)))
TERMS = (
    Power(order=3, **X),
    DeadBand(width=0.5, **X),
    Play(width=0.3, **X),
    Largest(**X),
    Smallest(**X),
    LowPass(time=0.5, order=2, **U),
    SignedSquare(**V),
    Magnitude(**V),
    Power(variable="command_rate", scale=50.0),
    Power(variable="time", scale=3.0),
)
FORM = FreeForm(size=0.1, terms=TERMS, coefficients=(-1.0, 0.2, -0.2, 0.1, 0.1, 0.3, -0.1, 0.1, 0.05, 0.2))
CORNER = 0.01
"""Rounding of corners in units of the scale: p(x) = x²/(x + 0.01) is at most 0.01 below x."""
NOISE = np.random.default_rng(3).uniform(-3, 3, 25).repeat(6)

pytestmark = pytest.mark.usefixtures("uncompiled")


@pytest.fixture
def mass() -> Plant:
    """1 kg between a spring of 400 N/m, a damper and the command, 1 N a volt."""
    return Plant(rig=Pushed(mass=1.0, damping=4.0, stiffness=400.0, push=1.0))


def read(plant, experiment):
    return plant.simulate(experiment(NOISE)).require().outputs[0][0]


def test_every_kind_is_tried_here():
    assert {term.kind for term in TERMS} == set(PRIMITIVES)


def test_off_it_is_not_there(mass, experiment):
    plant = mass.with_effects(FORM)
    off = read(plant.with_values({"free_form.size": 0.0}), experiment)
    # Newton ends with an error below 1e-10 of each unknown's scale, 1 cm; what is on is a million times that.
    np.testing.assert_allclose(off, read(mass, experiment), rtol=0, atol=1e-11)
    assert np.std(read(plant, experiment) - off) > 1e-6


def test_slopes_are_those_of_small_steps(mass):
    # A step over a corner, rounded to a hundredth of the scale, leaves more than the 1e-6 of smooth functions.
    errors = slope_errors(mass.with_effects(FORM), NOISE, 1e-4, names=[f"free_form.{name}" for name in FORM.shapes])
    assert max(errors.values()) < 1e-3, errors


def entering(chain, term, commands):
    """What a term makes of the command, at the end of each sample, added to the reading of the bare chain."""
    form = FreeForm(size=1.0, terms=(term,), coefficients=(1.0,), enters=Place.SENSOR, node="reading", unit="m")
    return chain(commands, form)["reading"] - chain(commands)["reading"]


ZIGZAG = np.concatenate([np.linspace(0, 3, 16), np.linspace(3, -2, 26), np.linspace(-2, 1, 16)])


@pytest.mark.parametrize(
    ("term", "exact"),
    [
        (Power(order=3, **U), (ZIGZAG / 2) ** 3),
        (SignedSquare(**U), (ZIGZAG / 2) * np.abs(ZIGZAG / 2)),
        (Magnitude(**U), np.hypot(ZIGZAG / 2, 0.001) - 0.001),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_functions_without_corners_are_exact(chain, term, exact):
    # the reading is of order 1, so that rounding is all that differs
    np.testing.assert_allclose(entering(chain, term, ZIGZAG), exact, rtol=0, atol=1e-12)


def played(inputs, width):
    """The play operator by its recursion."""
    states, now = [], 0.0
    for value in inputs:
        now = min(max(now, value - width), value + width)
        states.append(now)
    return np.array(states)


@pytest.mark.parametrize(
    ("term", "exact"),
    [
        (DeadBand(width=0.4, **U), np.sign(ZIGZAG) * np.maximum(np.abs(ZIGZAG / 2) - 0.4, 0.0)),
        (Play(width=0.4, **U), played(ZIGZAG / 2, 0.4)),
        (Largest(**U), np.maximum.accumulate(ZIGZAG / 2)),
        (Smallest(**U), np.minimum.accumulate(ZIGZAG / 2)),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_corners_are_rounded_to_a_hundredth(chain, term, exact):
    # A memory that is pursued for ten of its times comes as near as its corner lets it: within x of the solution of
    # 0.002 s * dx/dt = -x²/(x + 0.01), which from 0.1 is below 0.003 after 0.02 s; the corner itself is below 0.01.
    assert np.abs(entering(chain, term, ZIGZAG) - exact).max() < CORNER


def test_a_low_pass_answers_a_step_as_an_exponential(chain):
    commands = np.concatenate([np.zeros(5), np.full(60, 3.0)])
    after = np.maximum(0.02 * (np.arange(65) - 4), 0.0)
    exact = (3.0 / 2.0) ** 2 * (1 - np.exp(-after / 0.3))
    # five stages: the first coefficient of the error of exp(-0.07) is far below rounding
    np.testing.assert_allclose(entering(chain, LowPass(time=0.3, order=2, **U), commands), exact, rtol=0, atol=1e-9)


def test_a_cubic_term_holds_the_mass_as_a_cubic_spring_does(mass, experiment):
    form = FreeForm(size=0.1, terms=(Power(order=3, **X),), coefficients=(-2.0,))
    spring = CubicStiffness(stiffness=0.2 / 1e-9)
    difference = read(mass.with_effects(form), experiment) - read(mass.with_effects(spring), experiment)
    assert np.abs(difference).max() < 1e-11  # as above


def test_a_file_keeps_it_as_data(base, experiment, tmp_path):
    plant = base.with_effects(FORM)
    CalibratedPlant.nominal(plant).save(tmp_path / "model.json")
    document = json.loads((tmp_path / "model.json").read_text())
    jsonschema.validate(document, json.loads((files("deatwin.plant") / "schemas/plant.schema.json").read_text()))
    again = CalibratedPlant.load(tmp_path / "model.json").plant
    assert again.to_dict() == plant.to_dict()
    # The same structure and the same numbers are the same simulation.
    assert again.equations is plant.equations
    np.testing.assert_array_equal(again.free_values, plant.free_values)


def test_plants_with_other_terms_do_not_share_equations(mass):
    square, again, cube = (mass.with_effects(FreeForm(terms=(Power(order=n, **X),))) for n in (2, 2, 3))
    assert square.equations is again.equations
    assert square.equations is not cube.equations


def test_it_is_not_in_the_catalogue():
    assert "free_form" not in [effect.name for effect in catalogue()]
    with pytest.raises(RigError, match="there is no effect 'free_form'"):
        effect_named("free_form")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "plai", "variable": "command", "scale": 1.0}, 'did you mean "play"'),
        ({"kind": "play", "variable": "command", "scale": 0.0}, "must be above 0"),
        ({"kind": "play", "variable": "command"}, "malformed play"),
    ],
)
def test_a_malformed_term_is_refused(change, message, tmp_path):
    document = CalibratedPlant.nominal(Plant(rig=Diaphragm(), effects=(FORM,))).to_dict()
    document["effects"][0]["terms"][0] = change
    (tmp_path / "model.json").write_text(json.dumps(document))
    with pytest.raises(ModelError, match=message):
        CalibratedPlant.load(tmp_path / "model.json")


def test_as_many_coefficients_as_terms_are_needed():
    with pytest.raises(RigError, match="1 terms has 2 coefficients"):
        FreeForm(coefficients=(1.0, 2.0))

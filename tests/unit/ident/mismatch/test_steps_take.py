"""Every public step of a diagnosis says what it takes, and which call returns it."""

import inspect
import re
from collections import deque
from types import FunctionType
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from deatwin.ident import mismatch
from deatwin.ident.mismatch.steps_take import RETURNED_BY, checks_its_arguments
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.errors import DeatwinError

STEPS = [step for name in mismatch.__all__ if isinstance(step := getattr(mismatch, name), FunctionType)]
REQUIRED = [
    (step, name)
    for step in STEPS
    for name, one in inspect.signature(step).parameters.items()
    if one.default is inspect.Parameter.empty
    and (step.__name__, name) not in (("diagnose", "experiments"), ("check_quality", "experiments"))  # need a plant
]
PASSES: Any = type("Passes", tuple(type(name, (), {"__module__": "deatwin"}) for name in RETURNED_BY), {})()
"""Object of all classes in the table."""


@pytest.mark.parametrize(("step", "wrong"), REQUIRED, ids=[f"{step.__name__}-{name}" for step, name in REQUIRED])
def test_an_argument_of_another_kind_is_one_clear_error(step, wrong):
    given = {}
    for name, one in inspect.signature(step).parameters.items():
        if one.default is inspect.Parameter.empty:
            given[name] = None if name == wrong else () if one.annotation.startswith("Sequence") else PASSES
    with pytest.raises(DeatwinError) as raised:
        step(**given)
    said = str(raised.value)
    if step.__name__ in ("diagnose", "check_quality", "plan_experiment"):
        assert re.search("needs a Plant, not a NoneType: make one of a rig with Plant", said)
    elif wrong == "effects":
        assert said == "effects is None: give a tuple of effects, as (Creep(),)"
    else:
        assert re.match(rf"{wrong} must be .*; got None: .*(returns?|makes?|make one) ?", said)


def test_what_a_diagnosis_is_said_from_is_named():
    with pytest.raises(DeatwinError) as raised:
        mismatch.say(None)
    assert str(raised.value) == (
        "diagnosis must be a Diagnosis; got None: diagnose returns one, and Diagnosis.load reads one from a file"
    )


def test_a_stand_in_passes_and_a_stranger_of_the_same_name_does_not():
    """What `isinstance` takes for a Diagnosis goes on to the step; a class of that name from elsewhere does not."""
    checked = checks_its_arguments(how_sure_of)
    assert checked(Mock(spec=mismatch.Diagnosis)) == "taken"
    with pytest.raises(DeatwinError, match="diagnosis must be a Diagnosis; got a Diagnosis"):
        checked(type("Diagnosis", (), {})())


def how_sure_of(diagnosis: "mismatch.Diagnosis") -> str:
    return "taken"


@pytest.mark.parametrize("kind", [list, tuple, iter, deque, lambda one: dict.fromkeys(one).keys()])
def test_readings_takes_any_iterable_of_experiments(kind):
    plant = Plant(rig=Diaphragm())
    command = np.full((1, 20), 1.0)
    given = Experiment(recordings=(Recording.from_arrays(command[0], np.zeros(20), 0.02),))
    ((found,),) = mismatch.readings(plant, kind([given]))
    np.testing.assert_array_equal(found, mismatch.readings(plant, [given])[0][0])


def test_every_source_is_public():
    names = {*dir(mismatch), "Plant", "Experiment", "Creep", "effect_named", "numpy", "Base", "Naming"}
    for source in RETURNED_BY.values():
        called = re.findall(r"\b([a-z_]+)(?: returns| makes|\()", source) + re.findall(r"\b([A-Z]\w+)[.(]", source)
        assert called and set(called) - {"default_rng", "load"} <= names, source


def test_what_a_list_holds_is_checked_too():
    with pytest.raises(DeatwinError, match=r"alternatives\[1\] must be a Candidate; got text: prepare returns one"):
        mismatch.advise(PASSES, [PASSES, "creep"], np.random.default_rng(0))

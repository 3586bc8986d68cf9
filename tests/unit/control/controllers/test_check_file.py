"""The file of a check with controllers of every kind: written, valid, loaded and exported."""

import json
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from made_controllers import KINDS
from made_models import linear_model
from typer.testing import CliRunner

from deatwin.app.cli import app
from deatwin.control import Check, ControlError, InverseFilter, LinearStatus, Verdict, with_dynamics
from deatwin.control.checking.rows import OperatingPoint
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.document import controller_to_dict
from deatwin.control.design.inverse import with_inverse

SCHEMA = json.loads((files("deatwin.control") / "schemas" / "check.schema.json").read_text(encoding="utf-8"))
FILTER = InverseFilter(a=np.diag([0.5, 0.8]), b=np.ones(2), c=np.array([0.1, -0.2]), d=1.8, band_Hz=2.0, error=0.1)
POINT = OperatingPoint(
    input=2.0, output=1.0, static_gain=1.0, status=LinearStatus.OK, sample_time=0.02, input_unit="V", output_unit="um"
)
FINDING = Finding(subject="gain margin", value=3.0, verdict=Verdict.PASS, text="the gain margin is 3")


@pytest.fixture(scope="module", params=(*KINDS, "inverse with dynamics"))
def controller(request, made):
    if request.param == "inverse with dynamics":
        return with_dynamics(made.inverse, FILTER)
    return made[request.param]


def test_a_check_of_any_kind_of_controller_is_valid_comes_back_and_is_exported(controller, tmp_path):
    path, source = tmp_path / "check.json", tmp_path / "controller.c"
    Check(findings=(FINDING,), operating=POINT, controller=controller).save(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.validate(document, SCHEMA)
    assert document["controller"] == controller_to_dict(controller)
    again = Check.load(path)
    assert type(again.controller) is type(controller)
    assert controller_to_dict(again.controller) == controller_to_dict(controller)
    ran = CliRunner().invoke(app, ["export", str(path), "--to", "c", "--out", str(source)])
    assert ran.exit_code == 0, ran.output
    assert f"controller ({controller.kind})" in source.read_text(encoding="utf-8")


@pytest.mark.parametrize("windup", [[0.1, 0.1, 0.1], [[0.1]], [["0.1"], [0.1], [0.1]]], ids=["flat", "one", "text"])
def test_the_schema_refuses_an_anti_windup_that_is_not_one_a_law(made, windup, tmp_path):
    path = tmp_path / "check.json"
    Check(findings=(FINDING,), operating=POINT, controller=made.scheduled).save(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    document["controller"]["windup"] = windup
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, SCHEMA)


def test_a_schedule_behind_an_inverse_is_refused_by_name(made):
    linear = linear_model(np.array([0.0, 0.1]), np.array([1.0, -0.9]), operating_input=2.0, operating_output=1.0)
    with pytest.raises(ControlError, match="a ScheduledController cannot be the feedback of an inverse"):
        with_inverse(linear, made.inverse.curve, lambda model, **_: made.scheduled, command_limits=(1.0, 4.0))

"""The check: verdicts, bad input, and its file."""

import json
from dataclasses import replace
from importlib.resources import files

import jsonschema
import numpy as np
import pytest

from deatwin.control import Check, ControlError, Verdict, check
from deatwin.ident.frequency import remove_dc
from deatwin.plant import ModelError

SCHEMA = json.loads((files("deatwin.control") / "schemas" / "check.schema.json").read_text(encoding="utf-8"))


def checked(model, plant, **details) -> Check:
    return check(model, plant, rng=np.random.default_rng(5), samples=100, **details)


@pytest.fixture(scope="module")
def passed(model, plant, recording) -> Check:
    return checked(model, plant, recording=recording)


def test_a_dataset_holds_findings_margins_runs_and_the_whole_file(passed, kept):
    back = kept(passed.to_xarray())
    assert back.attrs["verdict"] == "pass" and set(back["finding_verdict"].values) == {"pass"}
    np.testing.assert_array_equal(back["margin_phase_deg"], [row.phase_deg for row in passed.table])
    assert back["margin_phase_deg"].attrs["units"] == "deg"
    error = back["steps_reference"] - back["steps_output"]
    assert float(np.sqrt((error**2).mean())) == pytest.approx(passed.steps.rms_error, rel=1e-12)
    assert back["steps_command"].attrs["units"] == "V" and back["steps_output"].attrs["units"] == "m"
    away = abs(back["steps_output"].values - back["predicted_middle"].values)
    assert np.mean(away <= back["predicted_half_width"].values) > 0.95
    document = json.loads(str(back["document"].values))
    jsonschema.validate(document, SCHEMA)
    assert document["sentence"] == passed.sentence
    alone = kept(passed.steps.to_xarray())
    np.testing.assert_array_equal(alone["measured"], passed.steps.measured)
    draws = kept(passed.predicted.to_xarray())
    np.testing.assert_allclose(draws["output"].mean("draw"), passed.predicted.middle, rtol=1e-12)


def test_what_pulls_in_fails_with_the_reason(model, plant):
    weak = plant.with_values({"shear_modulus": plant.parameters["shear_modulus"].value / 3})
    judged = checked(model, weak)
    assert judged.verdict is Verdict.FAIL
    assert "plant model" in judged.reason
    assert json.dumps(judged.steps.to_dict(), allow_nan=False)


def test_bad_input_is_one_clear_error(model, plant):
    other_rate = replace(model, sample_time=0.01)
    with pytest.raises(ModelError, match=r"every 0\.01 s, the rig every 0\.02 s"):
        checked(other_rate, plant)
    with pytest.raises(ModelError, match="outside the range of the training data"):
        checked(model, plant, operating_input=5.0)
    with pytest.raises(ModelError, match="deviations"):
        checked(remove_dc(model), plant)
    with pytest.raises(ModelError, match="the model's input is in A"):
        checked(replace(model, input_units=("A",)), plant)
    with pytest.raises(ModelError, match="command_limits"):
        checked(replace(model, operating=None), plant, operating_input=2.4)
    with pytest.raises(ControlError, match="between the limits"):
        checked(model, plant, command_limits=(3.0, 3.5))


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "deatwin/narx/1"}', '{"schema": "deatwin/check/1"}'])
def test_other_files_are_refused(text, tmp_path):
    path = tmp_path / "check.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ModelError, match=r"check\.json"):
        Check.load(path)
    with pytest.raises(ModelError, match="no such file"):
        Check.load(tmp_path / "missing.json")

"""Files of models, trajectories and validations: every field comes back, each file follows its schema."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib.resources import files

import numpy as np
import pytest
from made_narx import bilinear, full_linear, full_narx

from deatwin.ident.narx import NarxModel, Rls, ThetaSmoother, validate
from deatwin.plant.errors import ModelError

FULL = full_narx(input_origin=[40.0], output_origin=[300.0])
PLAIN = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=0.1)
COUPLED = {"y1": {"y1(k-1)": 0.5, "y2(k-2)": 0.2}, "y2": {"y2(k-1)": -0.3, "y1(k-1)u(k-1)": 0.4}}
LINEAR = full_linear()
RUNAWAY = NarxModel.from_terms({"y(k-1)": 1.0, "y(k-1)^3": 1.0, "u(k-1)": 1.0}, sample_time=0.1)
UNSTABLE = NarxModel.from_terms({"y(k-1)": 1.1, "u(k-1)": 1.0}, sample_time=0.1)
MADE = {
    "narx": lambda: FULL,
    "narx, plain": lambda: PLAIN,
    "narx, two outputs": lambda: NarxModel.from_terms(COUPLED, sample_time=1.0, noise_variance=[1e-3, 2e-3]),
    "narx, noise terms": lambda: NarxModel.from_terms({"y(k-1)": 0.6, "u(k-1)e(k-2)": -0.3}, sample_time=1.0),
    "linear": lambda: LINEAR,
    "theta": lambda: ThetaSmoother(terms=PLAIN).fit(bilinear(90)).trajectory_,
    "theta, no likelihood": lambda: Rls(terms=PLAIN).fit(bilinear(90)).trajectory_,
    "validation": lambda: validate(PLAIN, bilinear()),
    "validation, diverged": lambda: validate(RUNAWAY, bilinear()),
    "validation, unstable": lambda: validate(UNSTABLE, bilinear()),
}


def require_equal(one, other):
    assert type(one) is type(other)
    if is_dataclass(one):
        for field in fields(one):
            require_equal(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, Mapping):
        assert dict(one) == dict(other)
    elif isinstance(one, tuple) and not all(isinstance(part, str | float | int | None) for part in one):
        for pair in zip(one, other, strict=True):
            require_equal(*pair)
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", MADE)
def test_a_file_keeps_every_field_and_follows_its_schema(name, tmp_path):
    made, path, kind = MADE[name](), tmp_path / "one.json", name.split(",")[0]
    made.save(path)
    require_equal(type(made).load(path), made)
    assert [file.name for file in tmp_path.iterdir()] == ["one.json"]
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((files("deatwin.ident") / "schemas" / f"{kind}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(schema).validate(json.loads(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("made", "change", "says"),
    [
        (FULL, lambda d: d["terms"].pop(), "theta_cov"),
        (FULL, lambda d: d["terms"][0].update(term="z(k-1)"), "cannot read the term"),
        (FULL, lambda d: d.update(sample_time_s=-1), "sample_time"),
        (LINEAR, lambda d: d.pop("b"), "key 'b' is missing"),
        (LINEAR, lambda d: d.update(a=[2.0]), "must begin with 1"),
        (LINEAR, lambda d: d.update(b="x"), "b\\[0\\] must be real numbers"),
        (LINEAR, lambda d: d.update(theta_cov=[[1.0]]), "theta_cov"),
        (LINEAR, lambda d: d.update(schema="deatwin/narx/1"), "schema"),
    ],
)
def test_a_malformed_file_is_one_error_that_names_it(tmp_path, made, change, says):
    path = tmp_path / "spoilt.json"
    made.save(path)
    document = json.loads(path.read_text(encoding="utf-8"))
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ModelError, match=says) as caught:
        type(made).load(path)
    assert "spoilt.json" in str(caught.value)

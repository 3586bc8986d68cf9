"""A ``model.json`` of which one value was changed: it is refused by name, or the plant runs; nothing else."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deatwin.plant import Diaphragm, Experiment, ModelError, Plant, Recording
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DeatwinError

Place = tuple[str | int, ...]
WRONG = ([], {}, "x", None, True, -1, 0, 1e300)
SHORT = Experiment(recordings=(Recording.from_arrays(np.linspace(1.0, 2.0, 5), np.zeros(5), 0.02),))


pytestmark = pytest.mark.usefixtures("uncompiled")


def sound() -> dict[str, Any]:
    """A plant with two fitted parameters, as its file has it."""
    names, covariance = ("shear_modulus", "permittivity"), np.array([[4e-4, 1e-4], [1e-4, 1e-4]])
    rig = Diaphragm(command_range=(0.0, 3.5), start_ramp=0.2, start_hold=0.2)
    return CalibratedPlant(
        plant=Plant(rig=rig), noise=2e-6, model_error=1e-6, names=names, covariance=covariance
    ).to_dict()


def places(value: Any, at: Place = ()) -> Iterator[Place]:
    """Of all values; of a list the first two."""
    inner: Iterator[tuple[str | int, Any]] = iter(
        value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    )
    if not isinstance(value, dict):
        yield at
    for key, entry in inner:
        yield from places(entry, (*at, key))


def spoilt(document: dict[str, Any], at: Place, value: Any) -> dict[str, Any]:
    changed = copy.deepcopy(document)
    owner: Any = changed
    for key in at[:-1]:
        owner = owner[key]
    owner[at[-1]] = value
    return changed


@pytest.mark.parametrize("section", sorted(sound()))
@pytest.mark.filterwarnings("error")
def test_any_changed_value_is_refused_or_harmless(section: str, tmp_path: Path) -> None:
    document, path, refused = sound(), tmp_path / "model.json", 0
    for at in [place for place in places(document) if place[0] == section]:
        for value in WRONG:
            path.write_text(json.dumps(spoilt(document, at, value)), encoding="utf-8")
            try:
                prediction = CalibratedPlant.load(path).predict(SHORT)
            except DeatwinError:
                refused += 1
            else:
                assert prediction.mean[0].shape == prediction.deviation[0].shape == (5,), (at, value)
    assert refused or section == "provenance"


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (("rig", "sample_time"), 0, r"rig.sample_time is 0; it must be from 1e-06 to 1000"),
        (("rig", "start_hold"), 1e12, r"rig.start_hold is 1e\+12; it must be from 0 to 86400"),
        (("rig", "start_ramp"), -1, r"rig.start_ramp is -1"),
        (("rig", "prestretch"), "x", r"rig.prestretch is 'x'; it must be a number"),
        (("rig", "ball_is_known"), 1, r"rig.ball_is_known is 1; it must be true or false"),
        (("rig", "command_range"), [3, 1], r"rig.command_range is \[3, 1\]; it must be the lowest and the highest"),
        (("parameters", "shear_modulus", "unit"), "kPa", "shear_modulus is in 'kPa'; it must be in 'Pa'"),
        (("calibration", "names", 0), "permittivity", "a parameter is listed twice"),
        (("calibration", "covariance", 0, 0), -4e-4, "symmetric, without a negative eigenvalue"),
        (("calibration", "covariance", 0, 1), 1e-3, "symmetric, without a negative eigenvalue"),
        (("calibration", "covariance", 0, 0), 1e300, "no variance is larger"),
    ],
)
def test_the_error_names_file_and_value(at: Place, value: Any, said: str, tmp_path: Path) -> None:
    path = tmp_path / "model.json"
    path.write_text(json.dumps(spoilt(sound(), at, value)), encoding="utf-8")
    with pytest.raises(ModelError, match=f"model.json: .*{said}"):
        CalibratedPlant.load(path)


def test_a_parameter_that_is_left_out_is_no_published_value(tmp_path: Path) -> None:
    document, path = sound(), tmp_path / "model.json"
    del document["parameters"]["shear_modulus"]
    path.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(ModelError, match="the parameter shear_modulus is missing"):
        CalibratedPlant.load(path)


def test_recordings_that_are_ages_apart_are_not_run() -> None:
    late = Recording.from_arrays(np.ones(5), np.zeros(5), 0.02, start=1e9)
    with pytest.raises(DeatwinError, match=r"there are 5e\+10 samples of 0.02 s; at most 2e\+07 can be run"):
        Plant(rig=Diaphragm()).timeline(Experiment(recordings=(*SHORT.recordings, late)))

"""The rigs of docs/how-to/machines.md, diagnosed on recordings that other equations and another integrator made.

One is diagnosed in the gate; all four, and each without anything concealed, have the mark `study`.
"""

import numpy as np
import pytest
from machines import Hidden, machine_record
from needs import COMPILED

from deatwin.ident.mismatch import Diagnosis, diagnose
from deatwin.plant import Experiment

pytestmark = COMPILED

HIDDEN = {
    "motor": Hidden(name="coulomb_friction", values={"force": 6e-3, "stiction": 0.4, "unevenness": 0.15}),
    "cylinder": Hidden(name="dead_zone", values={"width": 0.3}),
    "room": Hidden(name="relaxation", values={"stiffness": 120.0, "time": 360.0}),
    "battery": Hidden(name="relaxation", values={"resistance": 0.015, "time": 120.0}),
}
# Two resistors with capacitors in series are one with a slow branch beside it, of the time at which the sum of both
# impedances is zero: (R1 T2 + R2 T1)/(R1 + R2).
FOUND = {name: hidden.values for name, hidden in HIDDEN.items()} | {
    "battery": {"time": (18.0 * 120.0 + 15.0 * 9.0) / 33.0}
}


def diagnosis(name: str, hidden: Hidden, seed: int) -> Diagnosis:
    beside = (-0.5, 0.5, 4, 1200) if name == "motor" else None
    plant, recording = machine_record(name, hidden, np.random.default_rng(seed), beside)
    return diagnose(plant, Experiment(recordings=(recording,)))


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n == "room" else [pytest.mark.study]) for n in HIDDEN])
def test_what_is_concealed_is_named(name):
    found = diagnosis(name, HIDDEN[name], 1)
    assert found.verdict.value == "named"
    assert [cause.effect for cause in found.causes] == [HIDDEN[name].name]
    for parameter, value in FOUND[name].items():
        interval = found.causes[0].parameters[parameter]
        assert interval.value == pytest.approx(value, rel=0.1), parameter


@pytest.mark.study
@pytest.mark.parametrize("seed", [1, 2])
def test_plain_friction_is_found_plain(seed):
    (cause,) = diagnosis("motor", Hidden(name="coulomb_friction", values={"force": 6e-3}), seed).causes
    assert cause.effect == "coulomb_friction"
    assert cause.parameters["force"].value == pytest.approx(6e-3, rel=0.02)
    for shape in ("stiction", "unevenness"):
        assert cause.parameters[shape].value == pytest.approx(0.0, abs=0.05)


@pytest.mark.study
@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("name", HIDDEN)
def test_nothing_is_named_where_nothing_is_concealed(name, seed):
    assert not diagnosis(name, Hidden(), seed).causes

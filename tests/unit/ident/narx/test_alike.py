"""Recordings that one model is identified from measure the same signals."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import Frols
from deatwin.ident.narx.preprocess import estimate_dead_time
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def record(unit: str, sample_time: float = 0.1) -> Recording:
    rng = np.random.default_rng(0)
    command = rng.standard_normal(400)
    made = Recording.from_arrays(command, np.convolve(command, [0.0, 0.5, 0.2])[:400], sample_time)
    return replace(made, output_units=(unit,), provenance={"file": f"in_{unit}_{sample_time:g}.csv"})


@pytest.mark.parametrize("find", [Frols().fit, estimate_dead_time], ids=["fit", "dead time"])
@pytest.mark.parametrize(
    ("other", "said"),
    [
        (record("rad/s"), r"in_m_0\.1\.csv and in_rad/s_0\.1\.csv: .* in m and in rad/s"),
        (record("m", 0.2), r"in_m_0\.1\.csv and in_m_0\.2\.csv: sample times of 0\.1 s and 0\.2 s"),
    ],
)
def test_recordings_that_differ_are_refused_by_name(find, other, said) -> None:
    with pytest.raises(ModelError, match=said):
        find([record("m"), other])


def test_a_unit_that_nobody_stated_contradicts_none() -> None:
    assert Frols().fit([record("m"), record("1")]).model_.terms

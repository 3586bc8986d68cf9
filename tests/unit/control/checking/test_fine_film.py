"""The check of a good controller on the fine film: twenty-six states, which polynomials do not hold."""

import numpy as np
import pytest

from deatwin.control import Check, Verdict, check
from deatwin.ident.narx import Frols
from deatwin.plant import Diaphragm, Experiment, Plant, Recording

FINE = Plant(rig=Diaphragm(resolution="fine"), values={"shear_modulus": 25e3})
LIMITS = (1.7, 3.1)


@pytest.mark.study
def test_a_good_controller_passes_on_it(tmp_path):
    """On 2 cores 38 s; at worst a gain margin of 2.8 and a phase margin of 88°."""
    rng, h = np.random.default_rng(0), FINE.rig.sample_time
    command = np.repeat(rng.uniform(1.6, 3.2, 80), 15)
    signals = {
        "input_names": ("command",),
        "output_names": ("displacement",),
        "input_units": ("V",),
        "output_units": ("m",),
    }
    asked = Recording.from_arrays(command, np.zeros(command.size), h, **signals)
    reading = FINE.simulate(Experiment(recordings=(asked,))).require().outputs[0][0]
    recording = Recording.from_arrays(command, reading + 1e-6 * rng.normal(size=command.size), h, **signals)
    model = Frols(output_lags=2, input_lags=(0, 1, 2), degree=3).fit(recording).model_
    found = check(
        model,
        FINE,
        rng=np.random.default_rng(0),
        operating_input=2.4,
        command_limits=LIMITS,
        recording=recording,
        samples=50,
    )
    assert found.verdict is Verdict.PASS, found.sentence
    found.save(tmp_path / "check.json")
    assert Check.load(tmp_path / "check.json").table == found.table

"""The check of a good controller on the fine film: twenty-six states, which polynomials do not hold."""

import numpy as np
import pytest

from deatwin.control import Check, Verdict, check, lambda_tuning, linearise_plant
from deatwin.control.checking.rows import rows_of_family
from deatwin.control.linear.plant import linearise_plants
from deatwin.ident.narx import Frols
from deatwin.plant import Diaphragm, Experiment, Plant, Recording

COARSE = Plant(rig=Diaphragm(), values={"shear_modulus": 25e3})
FINE = Plant(rig=Diaphragm(resolution="fine"), values={"shear_modulus": 25e3})
LIMITS = (1.7, 3.1)


def test_its_margins_are_near_those_of_the_reduced_film(uncompiled):
    """The reduced film has the fine one's gain to some per cent, and so have loops with one controller."""
    controller = lambda_tuning(
        linearise_plant(FINE, 2.4).in_loop(FINE.rig.reading), command_limits=LIMITS, closed_loop_time=0.2
    )
    rows = []
    for plant in (FINE, COARSE):
        family = linearise_plants((plant,), [2.2, 2.4, 2.6]).in_loop(plant.rig.reading)
        rows.append(rows_of_family("plant", family, controller))
    for fine, coarse in zip(*rows, strict=True):
        assert fine.stable_share == 1.0
        assert fine.gain == pytest.approx(coarse.gain, rel=0.05)
        assert fine.phase_deg == pytest.approx(coarse.phase_deg, abs=2.0)
        assert fine.disk == pytest.approx(coarse.disk, rel=0.05)
        assert fine.crossover_Hz == pytest.approx(coarse.crossover_Hz, rel=0.05)


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

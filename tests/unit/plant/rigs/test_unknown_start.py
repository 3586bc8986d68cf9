"""A start that nobody knows: each memory has a free start, and one number stands for all that went before."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from deatwin.plant import (
    ChargeInjection,
    Creep,
    Diaphragm,
    DielectricAbsorption,
    Disc,
    Experiment,
    Planar,
    Plant,
    Recording,
)

MEMORIES = (Creep(), DielectricAbsorption(), ChargeInjection())
SAMPLE = 0.1

pytestmark = pytest.mark.usefixtures("uncompiled")


def recorded(*steps: tuple[float, float], start: float = 0.0) -> Experiment:
    """Commands held for some seconds each."""
    commands = np.concatenate([np.full(round(seconds / SAMPLE), volts) for volts, seconds in steps])[None]
    recording = Recording(inputs=commands, outputs=np.zeros_like(commands), sample_time=SAMPLE, start=start)
    return Experiment(recordings=(recording,))


@pytest.mark.parametrize("rig", [Disc(), Planar(), Diaphragm()], ids=lambda rig: rig.kind)
def test_each_memory_gets_a_start_of_its_own(rig):
    known = Plant(rig=rig, effects=MEMORIES)
    unknown = known.with_rig(replace(rig, start_is_known=False))
    more = set(unknown.parameters) - set(known.parameters)
    branches = {name.replace("_modulus", "_at_start") for name in known.parameters if name.startswith("branch")}
    branches = {name for name in branches if name.endswith("_at_start")}
    assert more == branches | {f"{effect.name}.at_start" for effect in MEMORIES}
    assert all(unknown.parameters[name].value == 0.0 for name in more)
    assert set(unknown.without_effects().parameters) == set(Plant(rig=rig).parameters) | branches


STRONG = (Creep(modulus=50e3, time=8.0), DielectricAbsorption(share=0.1, time=8.0))


@pytest.mark.parametrize("strong", STRONG, ids=lambda effect: effect.name)
def test_one_number_stands_for_all_that_went_before(strong):
    rig = Disc(sample_time=SAMPLE, noise=1e-9, thickness=50e-6)
    known = Plant(rig=rig, effects=(strong,))
    before, after = ((4.0, 20.0), (2.0, 30.0)), (2.5, 1.5, 3.0)
    later = tuple((volts, 10.0) for volts in after)
    whole = known.simulate(recorded(*before, *later)).require().outputs[0][0]
    cut = round(50.0 / SAMPLE)
    unknown = known.with_rig(replace(rig, start_is_known=False))

    def readings(start: float) -> np.ndarray:
        return (
            unknown.with_values({f"{strong.name}.at_start": start}).simulate(recorded(*later)).require().outputs[0][0]
        )

    def missed(start: float) -> float:
        return float((readings(start) - readings(start)[-1] - whole[cut:] + whole[-1])[:50].mean())

    reach = 0.05 if strong.remembers == "1" else 3e3
    found = brentq(missed, -reach, reach, xtol=1e-4 * reach)
    difference = readings(found) - whole[cut:]
    # The zero differs, for the displacement counts from rest with the memory as it began.
    assert np.std(difference) < 0.01 * np.std(readings(0.0) - whole[cut:])
    assert np.std(readings(0.0) - whole[cut:]) > 0.01 * np.std(whole[cut:])


def test_an_arbitrary_zero_may_be_anywhere():
    assert Plant(rig=Planar(zero_is_known=False)).with_values({"zero": -1.2}).parameters["zero"].value == -1.2
    assert (
        Plant(rig=Diaphragm(zero_is_known=False)).parameters["zero"].upper
        == Plant(rig=Disc(zero_is_known=False)).parameters["zero"].upper
    )


def test_readings_of_a_sensor_on_the_other_side_fall() -> None:
    held = Experiment(recordings=(Recording.from_arrays([0.0, 1.0, 2.0], np.zeros(3), 0.02),))
    for rig in (Diaphragm, Disc):
        along, against = (Plant(rig=rig(direction=d)).simulate(held).require().outputs[0] for d in (1.0, -1.0))
        np.testing.assert_allclose(against, -along, rtol=1e-9)

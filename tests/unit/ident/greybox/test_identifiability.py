"""Profile likelihoods against the parabola that they are for a plant that is linear in its parameters."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.identifiability import profile
from deatwin.plant import Experiment, Parameter, Plant, Recording, Rig, StartProcedure
from deatwin.plant.builder import Builder
from deatwin.plant.errors import ModelError


@dataclass(frozen=True, kw_only=True)
class Scales(Rig):
    """Reading = gain times the low-passed command, plus offset."""

    sample_time: float = 0.02
    noise: float = 0.1

    kind: ClassVar[str] = "scales"
    input_name: ClassVar[str] = "load"
    input_unit: ClassVar[str] = "N"
    output_name: ClassVar[str] = "reading"
    output_unit: ClassVar[str] = "V"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="gain", value=1.0, unit="V/N", lower=-10.0, upper=10.0),
            Parameter(name="offset", value=0.0, unit="V", lower=-10.0, upper=10.0),
        )

    @property
    def start(self) -> StartProcedure:
        return StartProcedure(rest_command=0.0, ramp=0.0, hold=0.0)

    def write(self, build: Builder) -> Any:
        lagged = build.state("lagged", scale=1.0)
        build.rate(lagged, (build.command - lagged) / 0.1)
        return build.parameter("gain") * lagged + build.parameter("offset")


def fitted(commands: np.ndarray):
    rng = np.random.default_rng(3)
    blank = Experiment(recordings=(Recording.from_arrays(commands, np.zeros_like(commands), 0.02),))
    part = Part.whole(Plant(rig=Scales()).with_values({"gain": 2.0, "offset": 0.5}).record(blank, rng))
    return calibrate(Plant(rig=Scales()), [part], tolerance=1e-10), [part]


def test_the_profile_of_a_linear_plant_is_the_parabola_of_least_squares():
    calibration, parts = fitted(np.random.default_rng(4).standard_normal(600))
    found = profile(calibration, parts, "gain")
    low, high = calibration.interval("gain")
    # an end counts as found when the deviance misses its limit by 2 %, 1 % of the width
    assert found.low == pytest.approx(low, abs=0.01 * (high - low))
    assert found.high == pytest.approx(high, abs=0.01 * (high - low))
    assert found.identifiable
    deviation = (high - low) / (2 * 1.959964)
    parabola = ((found.values - calibration.plant.parameters["gain"].value) / deviation) ** 2
    # the refits of the other parameter settle to 1e-6 of the squared residual: 600 samples, 6e-4 of deviance
    np.testing.assert_allclose(found.deviances, parabola, atol=2e-2)


def test_what_the_recordings_do_not_part_is_not_bounded():
    calibration, parts = fitted(np.full(300, 1.0))
    # under a constant load, all but the first half second, gain and offset do the same
    masked = Part(experiment=parts[0].experiment, masks=(np.arange(300) > 200,))
    calibration = calibrate(Plant(rig=Scales()), [masked])
    found = profile(calibration, [masked], "gain")
    assert not found.identifiable


def test_only_fitted_parameters_have_a_profile():
    calibration, parts = fitted(np.random.default_rng(4).standard_normal(60))
    with pytest.raises(ModelError, match="'gian' was not fitted"):
        profile(calibration, parts, "gian")

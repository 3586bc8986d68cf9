"""Profile likelihoods against the parabola that they are for a plant that is linear in its parameters."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from made_rigs import Bare

from deatwin.ident.greybox import Part, calibrate, survey
from deatwin.ident.greybox.identifiability import profile
from deatwin.ident.greybox.minimum import minimise
from deatwin.plant import Experiment, Parameter, Plant, Recording
from deatwin.plant.builder import Builder
from deatwin.plant.errors import DataError, ModelError


@dataclass(frozen=True, kw_only=True)
class Scales(Bare):
    """Reading = gain times the low-passed command, plus offset."""

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

    def write(self, build: Builder) -> Any:
        lagged = build.state("lagged", scale=1.0)
        build.rate(lagged, (build.command - lagged) / 0.1)
        return build.parameter("gain") * lagged + build.parameter("offset")


@dataclass(frozen=True, kw_only=True)
class Limited(Scales):
    """The same with a largest gain."""

    top: float

    kind: ClassVar[str] = "limited scales"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        gain, offset = super().parameters
        return replace(gain, upper=self.top), offset


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
    with pytest.raises(DataError, match="a float is not a recording"):
        profile(calibration, 2.5, "gain")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="a NoneType is not a recording"):
        calibrate(calibration.plant, None)  # type: ignore[arg-type]


def test_a_profile_takes_the_data_of_the_calibration():
    calibration, [part] = fitted(np.random.default_rng(4).standard_normal(60))
    (recording,) = part.experiment.recordings
    of_parts = profile(calibration, [part], "gain")
    for records in (part, part.experiment, recording, [recording]):
        found = profile(calibration, records, "gain")
        assert (found.low, found.high) == (of_parts.low, of_parts.high)
    other = replace(recording, outputs=recording.outputs + 0.1)
    for wrong in (other, [recording, recording], recording.section(0, 50)):
        with pytest.raises(DataError, match="not the data that were calibrated"):
            profile(calibration, wrong, "gain")
    for wrong, message in (
        (replace(recording, output_names=("read",), output_units=("mV",)), "is in mV, but the model needs it in V"),
        (replace(recording, outputs=np.empty((0, 60)), output_names=(), output_units=()), "it has no output"),
    ):
        with pytest.raises(DataError, match=message):
            profile(calibration, wrong, "gain")


def test_a_parameter_that_others_can_stand_in_for_is_followed_along_their_valley(monkeypatch):
    """Gain and offset under a load that hardly changes: one of them moved alone is far from any good fit."""
    _, whole = fitted(5.0 + 0.2 * np.random.default_rng(4).standard_normal(800))
    parts = [Part(experiment=whole[0].experiment, masks=(np.arange(800) >= 200,))]  # the load has come through
    calibration = calibrate(Plant(rig=Scales()), parts, tolerance=1e-10)
    begun = []

    def noted(problem, **options):
        begun.append(np.sqrt(np.mean(problem.evaluate(problem.start())[0] ** 2)))
        return minimise(problem, **options)

    monkeypatch.setattr(survey, "minimise", noted)
    found = profile(calibration, parts, "gain")
    low, high = calibration.interval("gain")
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.01 * (high - low))
    assert 5.0 * (high - low) / 2 > 1.5 * calibration.rms  # what the readings would be off by, were it moved alone
    assert max(begun) < 1.01 * calibration.rms  # at the limit the squared residual has grown by 3.84 of 600


@pytest.mark.parametrize("nearest", [0.4, 0.8, 1.5])
def test_where_the_plant_has_no_fit_the_interval_ends_at_the_last_value_that_has_one(monkeypatch, nearest):
    calibration, parts = fitted(np.random.default_rng(4).standard_normal(600))
    gain = calibration.plant.parameters["gain"].value
    low, high = calibration.interval("gain")
    wall = gain + nearest * (high - gain)

    def stopped(problem, **options):
        return minimise(problem, **options) if problem.plant.parameters["gain"].value < wall else None

    monkeypatch.setattr(survey, "minimise", stopped)
    found = profile(calibration, parts, "gain")
    assert np.all(np.isfinite(found.deviances))
    assert found.deviances[found.values == gain] == 0.0
    assert found.low == pytest.approx(low, abs=0.01 * (high - low))
    if nearest > 1.1:
        assert found.bounded == (True, True)
        assert found.high == pytest.approx(high, abs=0.01 * (high - low))
    else:
        assert found.bounded == (True, False)
        # six points, of which each halves what lies between the last value with a fit and the first without one
        assert wall - (high - gain) / 2**5 < found.high < wall


def test_at_a_bound_the_interval_ends_there():
    calibration, parts = fitted(np.random.default_rng(4).standard_normal(600))
    gain = calibration.plant.parameters["gain"]
    held = replace(calibration, plant=Plant(rig=Limited(top=gain.value), values=calibration.plant.values))
    found = profile(held, parts, "gain")
    assert (found.high, found.bounded) == (gain.value, (True, False))
    assert found.low < gain.value

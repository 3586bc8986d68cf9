"""Two first-order lags in series: any order of them gives the same readings, so each interval must hold both constants."""

from collections.abc import Callable, Mapping

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.greybox import calibrate
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.refit.exchange import exchanged_lags, with_exchanged_lags
from deatwin.plant import Experiment, Parameter, Plant, Recording, Scale, SensorLag, Sizes
from deatwin.plant.foreign import ForeignRig

STEP, FINE, NOISE = 5.0, 50, 0.2
LAG = "sensor_lag_at_command.time"


def lagged(signal: np.ndarray, time: float, step: float) -> np.ndarray:
    pole = np.exp(-step / time)
    return np.asarray(lfilter([1 - pole], [1.0, -pole], signal))


def plate(p: Mapping[str, float], inputs: Mapping[str, np.ndarray], times: np.ndarray) -> np.ndarray:
    return p["gain"] * lagged(inputs["power"], p["slow"], STEP)


def bulb(p: Mapping[str, float], inputs: Mapping[str, np.ndarray], times: np.ndarray) -> np.ndarray:
    return p["gain"] * lagged(inputs["power"] ** 2, p["slow"], STEP)


def fitted(model: Callable[..., np.ndarray], first: float, second: float) -> tuple[Calibration, list[Part]]:
    """A fit that begins and ends with the time constants of drive and plant as they are."""
    rng = np.random.default_rng(4)
    power = np.repeat(rng.uniform(0.0, 300.0, 50), 12)
    drive, gain, exponent = (
        lagged(np.repeat(power, FINE), first, STEP / FINE),
        *((0.25, 1) if model is plate else (1e-3, 2)),
    )
    readings = gain * lagged(drive**exponent, second, STEP / FINE)[FINE - 1 :: FINE]
    log = Scale.LOGARITHMIC
    rig = ForeignRig(
        model=lambda p, inputs, times: model(p, inputs, times),  # no worker process has to begin
        parameters=(
            Parameter(name="gain", value=gain, unit="1", lower=1e-5, upper=10.0, scale=log),
            Parameter(name="slow", value=second, unit="s", lower=5.0, upper=2000.0, scale=log),
        ),
        input_name="power",
        input_unit="W",
        output_name="warmth",
        output_unit="K",
        sample_time=STEP,
        noise=NOISE,
        sizes=Sizes(command=200.0, command_unit="W", motion=60.0, motion_unit="K", period=300.0),
    )
    plant = Plant(rig=rig, effects=(rig.sizes.of(SensorLag()).placed("command"),)).with_values({LAG: first})
    readings = readings + NOISE * rng.standard_normal(power.size)
    record = Recording.from_arrays(power, readings, STEP, input_units=["W"], output_units=["K"])
    parts = [Part.whole(Experiment(recordings=(record,)))]
    return calibrate(plant, parts, starts=1), parts


@pytest.mark.parametrize(("first", "second"), [(60.0, 74.0), (74.0, 60.0), (40.0, 120.0)])
def test_exchanged_time_constants_are_in_the_intervals_and_said(first, second):
    fit, parts = fitted(plate, first, second)
    assert not fit.interval(LAG)[0] <= second <= fit.interval(LAG)[1] and not list(exchanged_lags(fit))
    both = with_exchanged_lags(fit, parts)
    for name in (LAG, "slow"):
        low, high = both.interval(name)
        assert low < min(first, second) and max(first, second) < high
    (said,) = exchanged_lags(both)
    assert LAG in said and "slow" in said


def test_a_square_between_them_tells_which_lag_is_whose():
    fit, parts = fitted(bulb, 40.0, 120.0)
    assert with_exchanged_lags(fit, parts) is fit

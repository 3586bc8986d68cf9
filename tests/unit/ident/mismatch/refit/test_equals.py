"""Fits that explain the readings as well: two lags in series in any order, and products of stated numbers."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.ident.greybox import calibrate
from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.likelihood.beforehand import DATA_SHEET
from deatwin.ident.mismatch.refit.equals import exchanged_lags, with_exchanged_lags, with_nominal_start
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


def heater(
    model: Callable[..., np.ndarray], stated: Mapping[str, tuple[float, str, float, float]], sizes: Sizes
) -> ForeignRig:
    """A rig with such a model; each stated parameter has a value, a unit, and the ends of its range."""
    return ForeignRig(
        model=lambda p, inputs, times: model(p, inputs, times),  # no worker process has to begin
        parameters=tuple(
            Parameter(name=name, value=value, unit=unit, lower=lower, upper=upper, scale=Scale.LOGARITHMIC)
            for name, (value, unit, lower, upper) in stated.items()
        ),
        input_name="power",
        input_unit="W",
        output_name="warmth",
        output_unit="K",
        sample_time=STEP,
        noise=NOISE,
        sizes=sizes,
    )


def recorded(power: np.ndarray, readings: np.ndarray, rng: np.random.Generator) -> list[Part]:
    """The readings with noise, as the whole of one experiment."""
    noisy = readings + NOISE * rng.standard_normal(power.size)
    record = Recording.from_arrays(power, noisy, STEP, input_units=["W"], output_units=["K"])
    return [Part.whole(Experiment(recordings=(record,)))]


def fitted(model: Callable[..., np.ndarray], first: float, second: float) -> tuple[Calibration, list[Part]]:
    """A fit that begins and ends with the time constants of drive and plant as they are."""
    rng = np.random.default_rng(4)
    power = np.repeat(rng.uniform(0.0, 300.0, 50), 12)
    drive, gain, exponent = (
        lagged(np.repeat(power, FINE), first, STEP / FINE),
        *((0.25, 1) if model is plate else (1e-3, 2)),
    )
    readings = gain * lagged(drive**exponent, second, STEP / FINE)[FINE - 1 :: FINE]
    rig = heater(
        model,
        {"gain": (gain, "1", 1e-5, 10.0), "slow": (second, "s", 5.0, 2000.0)},
        Sizes(command=200.0, command_unit="W", motion=60.0, motion_unit="K", period=300.0),
    )
    plant = Plant(rig=rig, effects=(rig.sizes.of(SensorLag()).placed("command"),)).with_values({LAG: first})
    parts = recorded(power, readings, rng)
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


def rough(p: Mapping[str, float], inputs: Mapping[str, np.ndarray], times: np.ndarray) -> np.ndarray:
    """The product of gain and load acts, but a ripple, zero at each 5 % of the gain, makes many minima."""
    ripple = 0.5 * np.sin(60.0 * np.log(p["gain"] / 2.0))
    return p["gain"] * p["load"] * inputs["power"] + ripple * inputs["power"] ** 2


def ends_elsewhere() -> tuple[Calibration, Plant, list[Part]]:
    """A fit at a gain of four, whose nominal value is two; the true product is 6."""
    rng = np.random.default_rng(5)
    power = rng.uniform(0.0, 1.0, 400)
    rig = heater(
        rough,
        {"gain": (2.0, "1", 0.1, 50.0), "load": (3.0, "1", 0.1, 50.0)},
        Sizes(command=1.0, command_unit="W", motion=6.0, motion_unit="K", period=300.0),
    )
    parts, nominal = recorded(power, 6.0 * power, rng), Plant(rig=rig)
    return calibrate(nominal.with_values({"gain": 4.0, "load": 1.5}), parts, starts=1), nominal, parts


def test_a_direction_that_the_readings_leave_open_has_the_variance_of_the_nominal_values():
    """Of two stated numbers whose product is known, each logarithm has the deviation 0.3 / sqrt(2)."""
    fit, nominal, parts = ends_elsewhere()
    assert not fit.interval("gain")[0] <= 2.0 <= fit.interval("gain")[1]  # an interval of one of many minima
    found = with_nominal_start(fit, nominal, parts, error=0.05 * NOISE)
    low, high = found.interval("gain")
    assert low < 2.0 < high
    assert np.log(high / low) == pytest.approx(2 * 1.96 * DATA_SHEET / np.sqrt(2.0), rel=0.05)
    assert found.interval("load")[0] < 3.0 < found.interval("load")[1]


def test_a_fit_that_is_better_by_more_than_the_error_stays_or_wins():
    """A start at the nominal values that ends lower by more than the error wins; a second one finds nothing else."""
    fit, nominal, parts = ends_elsewhere()
    worse = replace(fit, residuals=fit.residuals + 0.5 * NOISE)
    found = with_nominal_start(worse, nominal, parts, error=0.05 * NOISE)
    assert found.rms < fit.rms + 0.05 * NOISE and found.plant.parameters["gain"].value == pytest.approx(2.0, rel=0.1)
    assert found.interval("gain")[1] / found.interval("gain")[0] < 1.2  # no direction is left open
    same = with_nominal_start(found, nominal, parts, error=0.05 * NOISE)
    assert same is found

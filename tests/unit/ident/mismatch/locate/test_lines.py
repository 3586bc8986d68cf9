"""Residuals whose course in time, operating region or lines of a periodic input is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.locate.frequency import locate_frequency, locate_lines
from deatwin.ident.mismatch.locate.location import Location
from deatwin.ident.mismatch.locate.region import locate_region
from deatwin.ident.mismatch.locate.time import locate_time
from deatwin.ident.mismatch.locate.track import Track
from deatwin.plant.amplitudes import amplitude_unit

STEP, NOISE = 0.02, 1.0


def track(residual: np.ndarray, **signals: np.ndarray) -> Track:
    return Track(timepts=STEP * np.arange(residual.size), residual=residual, signals=signals, sample_time=STEP)


def odd_multisine(periods: int) -> np.ndarray:
    """Lines 1, 3, 7, 9, 13, 15 and so on of a period of 500 samples: 5, 11, 17... are left out."""
    times, rng = np.arange(500) / 500, np.random.default_rng(0)
    lines = [k for k in range(1, 40, 2) if k % 6 != 5]
    one = sum(np.cos(2 * np.pi * (k * times + rng.uniform())) for k in lines)
    return np.tile(one / np.std(one), periods)


@pytest.mark.parametrize(("power", "group", "silent"), [(2, "even", "odd"), (3, "odd", "even")])
def test_lines_tell_even_from_odd(power, group, silent):
    command = odd_multisine(6)
    rng = np.random.default_rng(1)
    residual = 0.3 * command**power + NOISE * rng.standard_normal(command.size)
    found = locate_lines([track(residual, command=command)], NOISE)
    assert found.period_s == pytest.approx(10.0)
    groups = {g.kind: g for g in found.groups}
    assert groups[group].p_value < 1e-6
    assert groups[silent].p_value > 1e-3
    # noise of the sensor is all that varies; of its mean square one line of 250 and the mean are not counted
    assert groups["varying"].rms == pytest.approx(NOISE, rel=0.06)
    assert groups["varying"].p_value > 1e-3
    assert found.plot().get_ylabel()


def test_the_rms_of_lines_is_that_of_the_response():
    command = odd_multisine(4)
    residual = 2.0 * (command**2 - np.mean(command**2))
    found = locate_lines([track(residual + 1e-6 * np.random.default_rng(2).standard_normal(2000), u=command)], 1e-6)
    even = next(g for g in found.groups if g.kind == "even")
    assert even.rms == pytest.approx(residual.std(), rel=1e-3)  # only the Nyquist line is left out


def test_what_changes_from_period_to_period_is_seen():
    command = odd_multisine(6)
    rng = np.random.default_rng(3)
    drifting = np.cumsum(0.1 * rng.standard_normal(command.size)) + NOISE * rng.standard_normal(command.size)
    varying = locate_lines([track(drifting, u=command)], NOISE).groups[-1]
    assert varying.p_value < 1e-6


def test_noise_has_no_lines():
    assert locate_lines([track(np.zeros(500), u=np.random.default_rng(4).standard_normal(500))], NOISE) is None
    assert locate_lines([track(np.zeros(500), u=np.ones(500))], NOISE) is None


@pytest.mark.parametrize(
    "command", [np.repeat([0.0, 1.0], [100, 400]), np.r_[1.0, 2.0, np.zeros(300)], np.tile([0.0, 1.0], 2)]
)
def test_a_command_that_ends_at_rest_or_is_too_short_has_no_lines(command):
    assert locate_lines([track(np.zeros(command.size), u=command)], NOISE) is None


def test_a_ramp_has_a_slope_and_a_repeated_burst_a_period():
    rng = np.random.default_rng(5)
    times = STEP * np.arange(6000)
    ramp = locate_time([track(np.where(times > 60, 0.2 * (times - 60), 0.0) + NOISE * rng.standard_normal(6000))], 1.0)
    last = max(ramp, key=lambda w: w.to_s)
    # one percent: of 30 seconds or more, each with a deviation of 1/sqrt(50)
    assert last.slope == pytest.approx(0.2, rel=0.1)
    burst = 4.0 * np.sin(2 * np.pi * times / 7.5) + NOISE * rng.standard_normal(6000)
    found = locate_time([track(burst)], 1.0)
    assert found.period_s == pytest.approx(7.5, abs=0.1)
    assert locate_time([track(NOISE * rng.standard_normal(6000))], 0.9).period_s is None
    assert found.plot().get_xlabel() == "time (s)"


def test_the_branch_and_the_time_since_rest_are_operating_regions():
    rng = np.random.default_rng(6)
    times = STEP * np.arange(6000)
    reading = np.sin(2 * np.pi * times / 5) + 0.3 * np.sin(2 * np.pi * times / 1.7)
    rate = np.gradient(reading, STEP)
    residual = 0.5 * np.sign(rate) + NOISE * rng.standard_normal(6000)
    signals = {"u": rng.standard_normal(6000), "y": reading, "y_rate": rate}
    regions = locate_region([track(residual, **signals)], 1.0)
    branches = {r.low: r for r in regions if r.signal == "branch"}
    assert branches[-1.0].mean_residual == pytest.approx(-0.5, abs=0.1)
    assert branches[0.0].mean_residual == pytest.approx(0.5, abs=0.1)
    command = np.where(times < 60, 0.0, rng.standard_normal(6000))
    fading = np.where(times >= 60, 3 * np.exp(-(times - 60) / 10), 0.0) + NOISE * rng.standard_normal(6000)
    late = locate_region([track(fading, u=command, y=reading, y_rate=rate)], 1.0)
    assert any(r.signal == "time_since_rest" and r.mean_residual > 0.5 for r in late)
    assert late.plot().get_ylabel() == "mean residual"


def test_spectra_draw_themselves():
    found = locate_frequency([track(NOISE * np.random.default_rng(7).standard_normal(3000))], NOISE)
    assert found.plot().get_xscale() == "log"
    assert found.bands == ()


def test_a_location_writes_its_unit_as_a_person_does():
    rng = np.random.default_rng(7)
    noisy = [track(NOISE * rng.standard_normal(3000), stretch=rng.uniform(1.0, 2.0, 3000))]
    silent = SimpleNamespace(plot=lambda ax: ax)
    drawn = Location(
        time=locate_time(noisy, NOISE**2),
        frequency=locate_frequency(noisy, NOISE),
        lines=None,
        region=locate_region(noisy, 1e-6),
        place=silent,
        response=None,
        unit=amplitude_unit("m"),
    ).plot()
    labels = [axes.get_ylabel() for axes in drawn]
    assert labels[0] == "residual (µm)" and labels[2] == "mean residual (µm)"
    assert np.abs(drawn[0].lines[0].get_ydata()).max() == pytest.approx(1e6 * np.abs(noisy[0].residual).max())


def test_the_operating_region_is_drawn_with_units_and_a_marker_for_each_signal():
    rng = np.random.default_rng(8)
    reading = rng.uniform(-12000.0, 5000.0, 6000)
    signals = {"command": rng.uniform(1.0, 2.0, 6000), "y": reading, "y_rate": np.gradient(reading, STEP)}
    axes = locate_region([track(NOISE * rng.standard_normal(6000), **signals)], 1.0).plot(units={"command": "V"})
    drawn = {bars.get_label().split(":")[0]: bars for bars in axes.containers}
    assert drawn["command"].get_label() == "command: 1 to 2 V"
    assert drawn["y"].get_label() == "y: -12000 to 5000"
    assert drawn["reading"].get_label() == "reading: falling (left) or rising (right)"
    assert drawn["time since the command was constant"].get_label().endswith(" s")
    assert len({bars[0].get_marker() for bars in drawn.values()}) == len(drawn) == 5

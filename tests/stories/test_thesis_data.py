"""The measures of the story on signals whose answer is known, and its page on recordings that are made up."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deatwin.app.stories import story
from deatwin.ident.curves import linear_share, local_gain, loop_area, mean_curve, straight_line
from deatwin.ident.drifts import (
    at_same_input,
    fast_part,
    gain_change,
    mean_shift,
    moving_mean,
    roughness,
)
from deatwin.plant.errors import DataError
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording
from deatwin.scenarios import thesis_data
from deatwin.scenarios.thesis_data.counterevidence import SmallVoltages, side_bands
from deatwin.scenarios.thesis_data.measures import judge
from deatwin.scenarios.thesis_data.study import RATES, Bench, Loop, Study, cycle
from deatwin.studies.folder import ResultFolder
from deatwin.studies.stories import Setting

STEP = 0.02


def noise(seed: int, duration: float = 300.0) -> np.ndarray:
    return band_limited_noise(np.random.default_rng(seed), duration, STEP)


def test_a_line_through_the_lower_half_of_a_parabola() -> None:
    # Least squares through x² from 0 to 1 is x - 1/6: it misses by 1/6 at the ends, of a stroke of 4.
    x = np.linspace(0.0, 2.0, 20_001)
    line = straight_line(x, x**2, below=1.0)
    assert line.gain == pytest.approx(1.0, abs=1e-3)
    assert line.offset == pytest.approx(-1 / 6, abs=1e-3)
    assert line.misfit == pytest.approx(1 / 24, rel=1e-3)
    with pytest.raises(DataError, match="at least three"):
        straight_line(x, x, below=0.0)


def test_local_gain_is_the_slope_of_a_parabola() -> None:
    x = np.linspace(1.0, 4.0, 500)
    assert local_gain(x, 3 * x**2 - x, 2.0) == pytest.approx(11.0, rel=1e-9)
    with pytest.raises(DataError, match="samples within"):
        local_gain(x, x, 9.0)


def test_mean_curve_averages_what_one_command_gave() -> None:
    levels = np.repeat([1.0, 2.0, 3.0], [100, 100, 10])
    readings = 2 * levels + np.tile([-0.5, 0.5], 105)
    found = mean_curve(levels, readings)
    np.testing.assert_allclose(found, [[1.0, 2.0], [2.0, 4.0]])  # ten samples are too few for a point


@pytest.mark.parametrize("cycles", [1, 3])
def test_area_of_a_loop_of_two_sines(cycles: int) -> None:
    phase = 2 * np.pi * np.arange(1000 * cycles) / 1000 - np.pi / 2
    for lag in (0.3, 0.0, -0.3):
        found = loop_area(2.4 + np.sin(phase), 5e-4 * np.sin(phase - lag))
        assert found == pytest.approx(np.pi / 4 * np.sin(lag), abs=1e-4)


def test_a_linear_plant_has_no_power_beyond_the_linear_model() -> None:
    u = noise(0)
    y = np.convolve(u - u.mean(), np.exp(-np.arange(200) / 10.0))[: u.size]
    _, output, explained = linear_share(u, y, STEP, width=0.1).above(1.0)
    assert explained == pytest.approx(output, rel=0.05)


def test_powers_above_a_frequency_are_those_of_parseval() -> None:
    u = noise(1)
    of_input = linear_share(u, u, STEP).above(0.0)[0]
    assert of_input == pytest.approx(u.var(), rel=1e-3)  # but for the line at half the sample rate


def test_a_square_has_power_that_no_linear_model_makes() -> None:
    # The reference is another estimate: a response of 401 taps by least squares, in the time domain.
    u = noise(2)
    y = (u - 1.0) ** 2
    share = linear_share(u, y, STEP)
    _, output, explained = share.above(1.0)
    assert output > 5 * explained
    taps = 200
    rows = np.lib.stride_tricks.sliding_window_view(np.pad(u - u.mean(), taps, mode="wrap"), 2 * taps + 1)
    gram = rows.T @ rows + 1e-6 * u.size * np.eye(2 * taps + 1)
    made = rows @ np.linalg.solve(gram, rows.T @ (y - y.mean()))
    _, by_taps, _ = linear_share(u, made, STEP).above(1.0)
    assert output > 5 * by_taps


def test_a_short_record_is_refused() -> None:
    with pytest.raises(DataError, match="need at least 80 s"):
        linear_share(noise(0, 20.0), noise(1, 20.0), STEP)


def test_moving_mean_is_a_convolution() -> None:
    values = np.random.default_rng(0).standard_normal(101)
    mean = moving_mean(values, 11)
    np.testing.assert_allclose(mean[5:-5], np.convolve(values, np.full(11, 1 / 11), "valid"))
    assert np.isnan(mean[:5]).all() and np.isnan(mean[-5:]).all()


def test_a_shift_is_found_with_its_error() -> None:
    u = noise(3)
    curve, sensor = 1e-4 * u**3, 1e-5 * np.random.default_rng(103).standard_normal(u.size)
    moved = curve + sensor + np.where(STEP * np.arange(u.size) < 150, 0.0, -2e-5)
    shift = mean_shift(u, moved, STEP, (0, 100), (200, 300))
    assert shift.size == pytest.approx(-2e-5, abs=4 * shift.error)
    assert shift.significance < -3
    # White noise of 10 µm leaves 10 / sqrt(5000) µm in each mean; 20 blocks tell that to 16 %, three times allowed.
    assert shift.error == pytest.approx(1e-5 * np.sqrt(2 / 5000), rel=0.5)
    still = mean_shift(u, curve + sensor, STEP, (0, 100), (200, 300))
    assert abs(still.significance) < 4


def test_what_command_and_rate_explain_is_taken_off() -> None:
    u = noise(4)
    y = 1e-4 * u**2 + 2e-6 * np.gradient(u, STEP)
    assert at_same_input(u, y, STEP).std() < 1e-3 * y.std()


def test_changes_of_gain_and_of_nonlinearity_are_told_apart() -> None:
    u = noise(5)
    late = STEP * np.arange(u.size) >= 150
    sensor = 1e-6 * np.random.default_rng(105).standard_normal(u.size)
    rest = 1e-4 * u**2
    windows: Any = ((0, 150), (150, 300))
    scaled = gain_change(u, rest * np.where(late, 0.8, 1.0) + sensor, STEP, *windows)
    assert scaled.gain == pytest.approx(-0.2, abs=0.01)
    assert abs(scaled.bend) < max(4 * scaled.bend_error, 0.01)
    # Another law: 2 c u at each command becomes 3 d u², so the ratio of slopes at 3 V and 2 V goes from 1.5 to 2.25.
    bent = gain_change(u, np.where(late, 0.25e-4 * u**3, rest) + sensor, STEP, *windows)
    assert bent.bend == pytest.approx(0.5, abs=0.1)


def test_roughness_is_the_rms_of_what_is_fast_there() -> None:
    timepts = STEP * np.arange(3000)
    slow = 0.45e-3 + 1e-4 * np.sin(2 * np.pi * 0.5 * timepts)
    buzz = 1e-5 * np.sin(2 * np.pi * 12.0 * timepts) * (timepts > 20) * (timepts < 40)
    here, later = (roughness(slow + buzz, STEP, w, (0.4e-3, 0.5e-3)) for w in ((22, 38), (45, 58)))
    assert here == pytest.approx(1e-5 / np.sqrt(2), rel=0.05)
    assert later < 1e-7
    assert np.abs(fast_part(slow, STEP)[100:-100]).max() < 1e-8
    with pytest.raises(DataError, match="no reading"):
        roughness(slow, STEP, (0, 10), (1e-3, 2e-3))


def test_a_linear_plant_of_drifting_gain_makes_side_bands() -> None:
    found = side_bands()
    np.testing.assert_allclose(found.reached, found.expected, rtol=1e-6)
    assert found.superposition < 1e-13
    off = np.min(np.abs(found.frequencies[:, None] - found.line - found.drift * np.array([-1, 0, 1])), axis=1) > 1e-6
    assert found.outputs[off].max() < 1e-6
    assert side_bands(depth=0.0).outputs[off].max() < 1e-6


def test_triangles_of_a_loop_follow_each_other() -> None:
    pieces = cycle(0.01, STEP).recordings
    assert [p.start for p in pieces] == pytest.approx([0.0, 10.0, 20.0])
    assert pieces[-1].duration == pytest.approx(100.0)
    assert (pieces[-1].inputs.min(), pieces[-1].inputs.max()) == pytest.approx((1.1, 3.75))


def made_up(readings: Any) -> Study:
    """Six recordings of a static law, without drifts, and loops without area."""
    benches = []
    for actuator in fleet(0):
        u = actuator.excitation().recordings[0].inputs[0]
        y = readings(u) + 1e-6 * np.random.default_rng(actuator.seed).standard_normal(u.size)
        wave = cycle(0.01, STEP).recordings[-1].inputs[0]
        loop = Loop(rate=0.01, commands=wave, displacements=readings(wave))
        benches.append(Bench(actuator=actuator, recording=Recording.from_arrays(u, y, STEP), loop=loop))
    # A trace of area, the same at each rate as hysteresis has it: there is none without hysteresis either.
    late = readings(np.roll(wave, 5))
    loops = tuple(Loop(rate=rate, commands=wave, displacements=late) for rate in RATES)
    return Study(benches=tuple(benches), loops=loops, elastic_loops=loops)


@pytest.fixture(scope="module")
def straight() -> Study:
    return made_up(lambda u: 2e-4 * (u - 1.0))


def test_actuators_that_do_nothing_of_it_do_not_pass(straight: Study) -> None:
    rows = {row.measure: row for row in judge(straight)}
    assert [row.passed for row in rows.values() if "straight line" in row.measure] == [True]
    others = [row for row in rows.values() if "straight line" not in row.measure]
    steady = [row for row in others if "steady" in row.demanded]
    assert len(others) > 15
    assert not any(row.passed for row in others if row not in steady), [row for row in others if row.passed]


def test_the_page_says_what_was_demanded_and_what_not_reached(
    straight: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volts = np.array([40.0, 80.0, 160.0])
    rest = SmallVoltages(voltages=volts, displacements=1e-10 * volts**2, visible=140.0)
    np.testing.assert_allclose(rest.exponents, 2.0)
    monkeypatch.setattr(thesis_data, "carry_out", lambda *_, **__: straight)
    monkeypatch.setattr(thesis_data, "small_voltages", lambda *_: rest)
    setting = Setting(
        folder=ResultFolder(tmp_path), data=None, command=["test"], jobs=1, seed=0, progress=lambda share, text: None
    )
    result = story("thesis-data").run(setting)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == page.count("<svg ") == 10
    assert f'<span class="verdict bad">{sum(m["passed"] for m in result["measures"])} of' in page
    for number in range(1, 7):
        assert (tmp_path / f"recordings/dea{number}.csv").is_file()
    for name in ("excitation", "curve", "recordings", "drifts", "spectra", "loops", "small", "side_bands"):
        header = (tmp_path / f"figures/{name}.csv").read_text(encoding="utf-8").splitlines()[0]
        assert f"figures/{name}.csv" in page and "_" in header
    assert (tmp_path / "run.json").is_file() and "140 V" in page

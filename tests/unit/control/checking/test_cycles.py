"""Predicted limit cycles against simulated ones."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import controller_of

from deatwin.control import LinearController, Specification, Verdict, closed_loop, margins
from deatwin.control.checking import cycles
from deatwin.control.checking.cycles import judge_cycles
from deatwin.control.design.pid import PidGains
from deatwin.control.linear.model import LinearModel
from deatwin.control.linear.plant import linearise_plant
from deatwin.control.stability.polynomials import in_series
from deatwin.plant import MeasuringChain, Plant

H = 0.02


def integral(plant: Plant, share: float, room: float = 1.0) -> LinearController:
    """An integral controller at a share of its largest stable gain, that hardly unloads at its limits."""
    linear = linearise_plant(plant, 0.0).in_loop(plant.rig.reading)
    gains = PidGains(proportional=0.0, integral=1.0 / linear.static_gain)
    top, bottom = gains.law(H).feedback
    loop = in_series(linear.numerator, top), in_series(linear.denominator, bottom)
    most = float(margins(*loop, H).gain[0])
    law = gains.law(H).scaled(share * most)
    # Describing functions know of no anti-windup: with next to none the loop is the one that they describe.
    return controller_of(
        law,
        np.array([1e-4]),
        name="I",
        operating_output=linear.operating_output,
        command_min=-room,
        command_max=room,
        closed_loop_time=0.06,
    )


def sustained(plant, controller, count=3000, kick=0.5, seed=1):
    """Amplitude and frequency, Hz, of the output's strongest line late after a kick."""
    reference = np.zeros(count)
    reference[:10] = kick
    run = closed_loop(plant, controller, reference, rng=np.random.default_rng(seed))
    late = run.output[count // 2 :] - run.output[count // 2 :].mean()
    window = np.hanning(late.size)
    lines = np.abs(np.fft.rfft(late * window)) / window.sum() * 2
    return lines.max(), np.fft.rfftfreq(late.size, H)[lines.argmax()]


def parts(text: str) -> tuple[float, float]:
    """Frequency in Hz and share of a step, as the text has them."""
    words = text.replace(",", "").split()
    return float(words[words.index("Hz") - 1]), float(words[words.index("%") - 1]) / 100


@pytest.fixture(scope="module")
def slow(lags) -> Plant:
    """Three lags, so that an integral loop turns by half a period where the third harmonic hardly passes."""
    return lags(count=2, time=0.2, noise=1e-6)


def test_beyond_its_gain_margin_a_limited_command_sustains_a_cycle(slow):
    controller = integral(slow, 1.5)
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    found = judge_cycles(slow, controller, linear, 1.0, Specification())
    assert found.verdict is Verdict.FAIL
    assert "the limits of the command" in found.text
    assert "a limit cycle" in found.text
    amplitude, frequency = sustained(slow, controller)
    # A clipped sine at 1.5 times the margin has a ninth of its size as third harmonic, of which 1/27 passes.
    assert found.value == pytest.approx(amplitude, rel=0.05)
    assert parts(found.text)[0] == pytest.approx(frequency, rel=0.05)


def test_a_sound_loop_has_none(slow):
    controller = integral(slow, 1 / 3)
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    found = judge_cycles(slow, controller, linear, 1.0, Specification())
    assert (found.verdict, found.value) == (Verdict.PASS, 0.0)
    assert "no limit cycle" in found.text
    assert sustained(slow, controller)[0] < 1e-4


def test_a_gain_that_grows_with_the_amplitude_uses_the_margin_up(lags):
    """u + c u³ has the gain 1 + 3 c A²/4 for a sine: twice that of a small one at A = sqrt(4/3/c)."""
    plant = lags(count=2, time=0.2, noise=1e-6, cubic=4.0)
    controller = integral(plant, 1 / 2)
    linear = linearise_plant(plant, 0.0).in_loop(plant.rig.reading)
    found = judge_cycles(plant, controller, linear, 1.0, Specification())
    assert "an unstable limit cycle" in found.text
    assert found.subject == "unstable limit cycle"
    assert "the plant's own nonlinearity" in found.text
    at_edge = integral(plant, 1.0)  # whose loop gain is one where it turns by half a period
    omega = np.geomspace(0.5, 50.0, 20_000)
    loop = at_edge.local(0.0).feedback_response(omega, H) * linear.response(omega)
    turn = omega[np.argmin(np.abs(loop + 1.0))]
    expected = np.sqrt(1 / (0.75 * 4.0)) * 2.0 * np.abs(linear.response([turn])[0])
    # The plant is measured at ten frequencies, each 1.6 times the one before.
    assert found.value == pytest.approx(expected, rel=0.1)
    assert parts(found.text)[0] == pytest.approx(turn / (2 * np.pi), rel=0.1)


def coarse(slow: Plant, bits: int) -> Plant:
    """A sensor without noise whose codes are coarse: 80 mm over 2 ** bits."""
    chain = MeasuringChain()
    laser = replace(chain.laser, noise=0.0, resolution=0.0, scan_time=0.0, reach=40.0)
    chain = replace(
        chain,
        laser=laser,
        analogue_input=replace(chain.analogue_input, bits=bits),
        analogue_output=replace(chain.analogue_output, bits=24),
    )
    return slow.with_rig(replace(slow.rig, chain=chain, noise=chain.noise))


def test_codes_sustain_a_cycle_where_the_gain_margin_is_below_four_by_pi(slow):
    """Rounding has a gain of up to 4/pi = 1.27, at 0.71 of a step, and of 1.08 about two steps."""
    plant = coarse(slow, 10)
    step = plant.rig.chain.reading_step
    controller = integral(plant, 1 / 1.18, room=10.0)
    linear = linearise_plant(plant, 0.0).in_loop(plant.rig.reading)
    found = judge_cycles(plant, controller, linear, 1.0, Specification())
    assert "the resolution" in found.text
    amplitude, frequency = sustained(plant, controller, count=3000, kick=10 * step)
    assert found.value == pytest.approx(amplitude, rel=0.15)
    assert parts(found.text)[0] == pytest.approx(frequency, rel=0.05)
    quiet = judge_cycles(plant, integral(plant, 1 / 1.4, room=10.0), linear, 1.0, Specification())
    assert quiet.verdict is Verdict.PASS


def test_a_cycle_is_judged_by_the_step_it_disturbs(slow):
    controller = integral(slow, 1.2)
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    small, large = (judge_cycles(slow, controller, linear, step, Specification()) for step in (1.0, -1e3))
    assert small.value == pytest.approx(1e3 * large.value, rel=1e-9)
    assert (small.verdict, large.verdict) == (Verdict.FAIL, Verdict.PASS)


def about(plant: Plant, voltage: float, share: float = 0.05) -> tuple[LinearController, LinearModel]:
    """A weak integral controller about a voltage, with limits at 0 V and as far above, and the plant there."""
    linear = linearise_plant(plant, voltage).in_loop(plant.rig.reading)
    gains = PidGains(proportional=0.0, integral=share / linear.static_gain)
    controller = controller_of(
        gains.law(H),
        gains.windup(H),
        name="I",
        operating_input=voltage,
        operating_output=linear.operating_output,
        command_min=0.0,
        command_max=2 * voltage,
        closed_loop_time=0.06,
    )
    return controller, linear


def test_a_plant_that_does_not_live_through_the_sines_is_not_measured(gap):
    """The plate pulls in at 0.385 V: of a room of 0.37 V about 0.37 V it bears 2 %, to 0.377 V; 6 % are 0.392 V."""
    controller, linear = about(gap, 0.37)
    found = judge_cycles(gap, controller, linear, 0.1, Specification())
    assert found.verdict is Verdict.MARGINAL
    assert found.value is None
    assert (
        "no limit cycle is predicted (by describing functions of the command limits and the sensor's resolution)"
        in found.text
    )
    assert "was not tested, because its simulation fails even under sines of 6 % of the distance" in found.text


def test_the_sizes_of_the_sines_that_a_plant_lived_through_are_told(brittle):
    """Of a room of 0.8 V about 0.8 V 20 % reach 0.96 V, and 60 % go beyond 1 V, which it does not bear."""
    controller, linear = about(brittle, 0.8)
    found = judge_cycles(brittle, controller, linear, 0.1, Specification())
    assert found.verdict is Verdict.PASS
    assert "tested only with sines of 2, 6 and 20 % of the distance to the command's limits" in found.text
    controller, linear = about(brittle, 0.5)
    found = judge_cycles(brittle, controller, linear, 0.1, Specification())
    assert (found.verdict, found.value) == (Verdict.PASS, 0.0)
    assert found.text == (
        "no limit cycle is predicted (by describing functions of the plant, the command limits and the sensor's resolution)"
    )


def test_a_cycle_of_the_limits_is_told_where_the_plant_is_not_measured(slow, monkeypatch):
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    controller = integral(slow, 1.2)
    small, large = (judge_cycles(slow, controller, linear, step, Specification()) for step in (1e3, 1.0))
    monkeypatch.setattr(cycles, "sine_response", lambda *_, **__: None)
    for measured, verdict, step in ((small, Verdict.MARGINAL, 1e3), (large, Verdict.FAIL, 1.0)):
        found = judge_cycles(slow, controller, linear, step, Specification())
        assert (found.verdict, found.value) == (verdict, measured.value)
        assert found.text.startswith(measured.text)
        assert "was not tested, because" in found.text and "was not tested, because" not in measured.text


def test_progress_is_told(slow):
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    shares = []
    judge_cycles(slow, integral(slow, 1 / 3), linear, 1.0, Specification(), progress=shares.append)
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < 0.5
    assert shares[-1] == pytest.approx(1.0, abs=1e-12)


def test_a_loop_that_hardly_acts_is_not_looked_at_for_days(slow, monkeypatch):
    """An integrator of a ten-thousandth of the gain crosses over at a period of days: 300 million samples."""
    asked: list[np.ndarray] = []

    def measured(plant, operating_input, amplitudes, omega, *, progress):
        asked.append(omega)

    monkeypatch.setattr(cycles, "sine_response", measured)
    linear = linearise_plant(slow, 0.0).in_loop(slow.rig.reading)
    controller = integral(slow, 1e-4)
    judge_cycles(slow, controller, linear, 1.0, Specification())
    longest = 2 * np.pi / asked[0][0]
    assert longest < 500 * controller.closed_loop_time

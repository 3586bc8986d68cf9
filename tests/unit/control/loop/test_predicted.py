"""The predicted loop against a loop that is written down sample by sample, against python-control, and by counting."""

from dataclasses import replace

import numpy as np
import pytest
from made_models import controller_of, finished
from made_narx import trained_on
from scipy.stats import binom, norm

from deatwin.control import (
    ClosedLoop,
    ControlError,
    LinearController,
    PredictedLoop,
    lambda_tuning,
    linearise,
    predict_loop,
    step_reference,
)
from deatwin.control.design.pid import PidGains
from deatwin.ident.narx import NarxModel, Residual
from deatwin.plant import ModelError, ReadingTime

H = 0.02
NOTHING = Residual(rms=0.0, correlation_time=1.0)
AT_END, AT_START, MEAN = ReadingTime.END_OF_HOLD, ReadingTime.START_OF_HOLD, ReadingTime.MEAN_OVER_HOLD
RANGE = trained_on((-1.0, 1.0), (-2.0, 2.0), input_centre=0.1, output_centre=0.2)


def pi(low=-5.0, high=5.0) -> LinearController:
    gains = PidGains(proportional=0.2, integral=1.5)
    return controller_of(
        gains.law(H),
        gains.windup(H),
        operating_input=0.1,
        operating_output=0.2,
        command_min=low,
        command_max=high,
        closed_loop_time=0.5,
    )


def predicted(model, reading, reference, controller=None, *, residual=NOTHING, noise=0.0, draws=1, seed=0):
    return predict_loop(
        model,
        controller or pi(),
        reference,
        reading=reading,
        residual=residual,
        noise=noise,
        rng=np.random.default_rng(seed),
        draws=draws,
    )


AFTER = {"y(k-1)": 0.5, "y(k-2)^2": -0.2, "u(k)": 0.6, "u(k-1)*u(k-2)": 0.3}
"""The reading of row k is complete at its end."""
BEFORE = {"y(k-1)": 0.5, "u(k-1)": 0.6, "u(k-1)*y(k-2)": 0.3}
"""The reading of row k cannot know u(k)."""


@pytest.mark.parametrize(
    ("reading", "terms", "following"),
    [
        (AT_END, AFTER, lambda y, u: 0.5 * y[-1] - 0.2 * y[-2] ** 2 + 0.6 * u[-1] + 0.3 * u[-2] * u[-3]),
        (MEAN, AFTER, lambda y, u: 0.5 * y[-1] - 0.2 * y[-2] ** 2 + 0.6 * u[-1] + 0.3 * u[-2] * u[-3]),
        (AT_START, BEFORE, lambda y, u: 0.5 * y[-1] + 0.6 * u[-1] + 0.3 * u[-1] * y[-2]),
    ],
)
def test_rows_equal_a_loop_written_down(reading, terms, following):
    model = NarxModel.from_terms(terms, sample_time=H)
    reference = step_reference(0.2, 0.15, 60, rise=7)
    controller = pi(high=0.22)  # which saturates
    got = predicted(model, reading, reference, controller)
    u, y = [0.1] * 3, [0.0, 0.0]
    for _ in range(2000):  # at rest at the operating input
        y.append(following(y, u))
    integral, outputs, commands = 0.0, [], []
    for wanted in reference:
        error = wanted - y[-1]  # the reading of the row before
        outputs.append(y[-1])
        free = 0.1 + integral + (0.2 + 1.5 * H) * error
        command = min(max(free, -5.0), 0.22)
        integral += 1.5 * H * error + 1.5 * H / 0.2 * (command - free)
        commands.append(command)
        u.append(command)
        y.append(following(y, u))
    assert max(commands) == 0.22
    np.testing.assert_allclose(got.outputs[0], outputs, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.commands[0], commands, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.timepts, H * np.arange(300), atol=1e-12)


def test_a_reading_at_the_start_that_answers_to_its_own_command_is_refused():
    # The linear part does not show it: the product is zero to first order at u = 0.
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 0.6, "u(k)*u(k-1)": 0.3}, sample_time=H)
    with pytest.raises(ModelError, match="input lags from 1 on"):
        predicted(model, AT_START, np.zeros(20))


def test_residual_and_noise_enter_where_they_do_in_the_actuator():
    """y = u of the hold before + residual; the controller sees the noise as well, the output does not."""
    model = NarxModel.from_terms({"u(k)": 1.0}, sample_time=H)
    controller = replace(pi(), operating_output=0.1)
    reference = np.full(400, 0.1)
    quiet = predicted(model, AT_END, reference, controller, draws=400)
    assert np.ptp(quiet.outputs) < 1e-12
    assert np.all(quiet.half_width < 1e-12)
    left = predicted(model, AT_END, reference, controller, residual=Residual(rms=0.3, correlation_time=0.01), draws=400)
    # The controller cannot answer yet to the first reading: there is the residual alone.
    assert left.outputs[:, 0].std() == pytest.approx(0.3, rel=4 / np.sqrt(800))
    noisy = predicted(model, AT_END, reference, controller, noise=0.3, draws=400)
    assert np.ptp(noisy.outputs[:, 0]) < 1e-12
    # u(0) = u_0 - (K_p + K_i h) e(0), and y(1) = u(0)
    assert noisy.outputs[:, 1].std() == pytest.approx(0.23 * 0.3, rel=4 / np.sqrt(800))


def test_draws_differ_by_the_posterior():
    model = NarxModel.from_terms({"u(k)": 1.0, "1": 0.0}, sample_time=H, theta_cov=np.diag([0.0, 0.04]))
    controller = replace(pi(), operating_output=0.1)
    got = predicted(model, AT_END, np.full(10, 0.1), controller, draws=600)
    assert got.outputs[:, 0].std() == pytest.approx(0.2, rel=4 / np.sqrt(1200))


@pytest.mark.parametrize("draws", [100, 300])
def test_the_band_holds_95_percent_of_fresh_draws_at_all_samples(draws):
    """Several bands, each with fresh draws: the share of those inside as a whole is 95 % on the average."""
    model = NarxModel.from_terms({"y(k-1)": 0.7, "u(k)": 0.3}, sample_time=H, theta_cov=1e-4 * np.eye(2))
    reference, residual = step_reference(0.2, 0.3, 20, rise=5), Residual(rms=0.02, correlation_time=0.1)
    bands, fresh, held = 40, 200, []
    for seed in range(bands):
        band = predicted(model, AT_END, reference, residual=residual, noise=0.01, draws=draws, seed=seed)
        others = predicted(model, AT_END, reference, residual=residual, noise=0.01, draws=fresh, seed=1000 + seed)
        held.append(np.mean(np.all(np.abs(others.outputs - band.middle) <= band.half_width, axis=1)))
    # A band of n draws holds a share with a deviation of sqrt(0.05 * 0.95 / n) about 0.95, fresh draws count besides.
    deviation = np.sqrt(0.05 * 0.95 * (1 / draws + 1 / fresh) / bands)
    assert np.mean(held) == pytest.approx(0.95, abs=3.5 * deviation)


def run_of(band: PredictedLoop, output) -> ClosedLoop:
    n = len(output)
    return finished(
        band.reference[:n],
        output,
        timepts=band.timepts[:n],
        command_limits=band.command_limits,
        input_unit="",
        output_unit="",
    )


def test_a_run_that_leaves_the_band_for_some_samples_is_inside_by_the_rest():
    model = NarxModel.from_terms({"y(k-1)": 0.7, "u(k)": 0.3}, sample_time=H)
    band = predicted(model, AT_END, np.full(100, 0.2), residual=Residual(rms=0.1, correlation_time=0.1), draws=50)
    output = np.array(band.middle)
    assert band.inside(run_of(band, output)) == 1.0
    output[30:40] += 1.01 * band.half_width[30:40]
    assert band.inside(run_of(band, output)) == pytest.approx(0.9)
    # What was not lived through is not inside.
    assert band.inside(run_of(band, output[:20])) == pytest.approx(0.2)


def test_intervals_are_quantiles_of_a_measure_of_each_draw():
    model = NarxModel.from_terms({"y(k-1)": 0.7, "u(k)": 0.3}, sample_time=H)
    band = predicted(
        model, AT_END, step_reference(0.2, 0.3, 40), residual=Residual(rms=0.05, correlation_time=0.2), draws=101
    )
    worst = np.sort(np.abs(band.outputs - band.reference).max(axis=1))
    got = band.interval(lambda run: float(np.abs(run.error).max()))
    assert got[0] == pytest.approx(worst[50])
    assert worst[2] <= got[1] <= worst[3]
    assert worst[97] <= got[2] <= worst[98]


@pytest.mark.parametrize("known", [True, False])
def test_draws_that_diverge_are_counted(known):
    """y(k) = a y(k-1) + u(k) without a controller to speak of diverges where a > 1."""
    spread = 0.2
    model = NarxModel.from_terms(
        {"y(k-1)": 0.9, "u(k)": 1.0},
        sample_time=H,
        theta_cov=np.diag([spread**2, 0.0]),
        operating=RANGE if known else None,
    )
    weak = replace(pi(low=0.0999, high=0.1001), operating_output=1.0)
    got = predicted(model, AT_END, np.ones(1500), weak, draws=400)
    share = got.diverged
    # With a > 1.01 it goes beyond 1e9 in the 2000 samples, with a > 1 in the end.
    low, high = (binom.interval(0.999, 400, norm.sf(a, 0.9, spread))[end] / 400 for end, a in ((0, 1.012), (1, 1.0)))
    assert low <= share <= high
    assert got.outputs.shape[0] == got.commands.shape[0] == round(400 * (1 - share))
    if known:
        assert np.abs(got.outputs).max() < 1.1e2 * 4.0
    assert np.all(np.isfinite(got.half_width))


def test_where_all_draws_diverge_none_is_left():
    model = NarxModel.from_terms({"y(k-1)": 0.5, "y(k-1)^3": 2.0, "u(k)": 1.0}, sample_time=H)
    wild = replace(pi().scaled(200.0), operating_output=0.2)
    got = predicted(model, AT_END, step_reference(0.2, 1.0, 30), wild, draws=5)
    assert got.diverged == 1.0
    assert got.outputs.shape == (0, 150)
    assert got.runs == ()
    assert np.isnan(got.middle).all()
    assert np.isnan(got.half_width).all()
    assert np.isnan(got.interval(lambda run: run.overshoot)).all()
    assert got.inside(run_of(got, got.reference)) == 0.0
    assert np.isnan(got.to_xarray()["half_width"]).all()
    got.plot()


def test_a_controller_of_another_sample_time_is_refused():
    model = NarxModel.from_terms({"y(k-1)": 0.7, "u(k)": 0.3}, sample_time=2 * H)
    with pytest.raises(ControlError, match=r"the controller runs every 0\.02 s, the model every 0\.04 s"):
        predicted(model, AT_END, np.full(10, 0.2))


def test_the_generator_alone_decides(model, plant):
    linear = linearise(model).in_loop(plant.rig.reading)
    controller = lambda_tuning(linear, command_limits=(1.1, 3.75), band_Hz=1.0)
    reference, shares = step_reference(linear.operating_output, 20e-6, 60), []
    first, second = (
        predict_loop(
            model,
            controller,
            reference,
            reading=plant.rig.reading,
            residual=Residual(rms=1e-6, correlation_time=0.3),
            noise=2e-6,
            rng=np.random.default_rng(4),
            draws=7,
            progress=shares.append,
        )
        for _ in range(2)
    )
    np.testing.assert_array_equal(first.outputs, second.outputs)
    half = len(shares) // 2
    assert shares[:half] == sorted(shares[:half]) == shares[half:]
    assert shares[-1] <= 1.0

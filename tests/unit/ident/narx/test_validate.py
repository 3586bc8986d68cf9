"""Validation: formulas against direct sums, levels and power of the tests against theory, the verdict and its file."""

import math

import numpy as np
import pytest
from nile import NILE
from scipy.signal import lfilter
from scipy.stats import binom

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.residual_tests import correlation, correlation_tests, whiteness_of
from deatwin.ident.narx.validate import ValidationStatus, validate
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

NAMES = ("ee", "ue", "e(eu)", "(u2)'e", "(u2)'e2")
TRUE = {"y(k-1)": 0.5, "u(k-1)": 1.0}


def record(seed, n=1000, extra=None, noise=None, start=0.0):
    """y(k) = 0.5 y(k-1) + u(k-1) + extra(u, k) + noise(e, u, k), u uniform in ±1, e normal with std 0.1."""
    rng = np.random.default_rng(seed)
    u, e, k = rng.uniform(-1, 1, n + 1), 0.1 * rng.normal(size=n + 1), np.arange(2, n + 1)
    drive = u[k - 1] + (extra(u, k) if extra else 0.0) + (noise(e, u, k) if noise else e[k])
    return Recording.from_arrays(u[1:], np.append(0.0, lfilter([1.0], [1.0, -0.5], drive)), 0.1, start=start)


def coloured(rng, n, pole):
    """A first-order process of unit variance, past its start."""
    return lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], rng.normal(size=n + 200))[200:]


def model():
    return NarxModel.from_terms(TRUE, sample_time=0.1, noise_variance=0.01)


def test_correlations_are_the_sums_of_their_definition_within_each_recording():
    rng = np.random.default_rng(0)
    a, b = ([rng.normal(size=n) for n in (40, 3, 25)] for _ in range(2))
    lags = np.arange(-6, 7)
    power = math.sqrt(sum(x @ x for x in a) * sum(x @ x for x in b))
    sums = [
        sum(x[k - lag] * z[k] for x, z in zip(a, b, strict=True) for k in range(x.size) if 0 <= k - lag < x.size)
        for lag in lags
    ]
    np.testing.assert_allclose(correlation(a, b, lags), np.array(sums) / power, rtol=1e-12, atol=1e-15)


def test_ljung_box_is_that_of_statsmodels():
    # statsmodels 0.15.0, acorr_ljungbox(x, lags=[5, 10, 20]), on the Nile's flow 1871 to 1970 less its mean.
    residuals = [(NILE - NILE.mean())[None]]
    for lags, statistic, p_value in (
        (5, 63.97171234813319, 1.8311453543503457e-12),
        (10, 88.12687155129986, 1.2586327670205598e-14),
        (20, 128.6620895385426, 6.944351349754721e-18),
    ):
        found = whiteness_of(residuals, 0, max_lag=lags)
        assert found.statistic == pytest.approx(statistic, rel=1e-10) and found.dof == lags
        assert found.p_value == pytest.approx(p_value, rel=1e-8)
        assert found.share_outside > found.usual_outside[1]


def test_the_five_tests_are_those_of_their_definition():
    recording = record(2, n=120)
    found = validate(model(), recording, max_lag=5)
    u, y = recording.inputs[0], recording.outputs[0]
    e = np.array([y[k] - 0.5 * y[k - 1] - u[k - 1] for k in range(1, 120)])
    u = u[1:] - u[1:].mean()
    u2, e2, eu = u**2 - np.mean(u**2), e**2 - np.mean(e**2), e * u

    def direct(a, b, lag):
        return sum(a[k - lag] * b[k] for k in range(119) if 0 <= k - lag < 119) / math.sqrt(np.sum(a**2) * np.sum(b**2))

    both = range(-5, 6)
    for name, values, lags in (
        ("ee", [direct(e, e, lag) for lag in range(1, 6)], range(1, 6)),
        ("ue", [direct(u, e, lag) for lag in both], both),
        ("e(eu)", [direct(eu, e, lag + 1) for lag in range(5)], range(5)),  # e(k) with e(k-1-lag) u(k-1-lag)
        ("(u2)'e", [direct(u2, e, lag) for lag in both], both),
        ("(u2)'e2", [direct(u2, e2, lag) for lag in both], both),
    ):
        test = found.test(name)
        np.testing.assert_array_equal(test.lags, lags)
        np.testing.assert_allclose(test.values, values, rtol=1e-9, atol=1e-12, err_msg=name)
        assert test.band == pytest.approx(1.96 / math.sqrt(119), rel=1e-4)
        assert test.share_outside == np.mean(np.abs(values) > test.band)


@pytest.mark.parametrize(
    ("pole_u", "pole_e", "names"),
    [(0.95, 0.0, NAMES), (0.95, 0.6, ("ue", "(u2)'e", "(u2)'e2"))],
    ids=["slow input", "slow input, coloured residual"],
)
def test_level_when_nothing_is_left(pole_u, pole_e, names):
    # Each test rejects by the sum of squares or by the largest correlation, each at half the level: between 2.5 %,
    # where one of the two never does, and 5 %. 400 draws, with the 0.1 % points of the binomial law of the two ends.
    rng, rejected, outside = np.random.default_rng(7), dict.fromkeys(NAMES, 0), dict.fromkeys(NAMES, 0.0)
    for _ in range(400):
        u, e = coloured(rng, 500, pole_u), coloured(rng, 500, pole_e)
        for test in correlation_tests([e[None]], [u[None]], max_lag=25, level=0.05):
            rejected[test.name] += not test.passed
            outside[test.name] += test.share_outside / 400
    least, most = binom.ppf(0.001, 400, 0.025), binom.ppf(0.999, 400, 0.05)
    assert all(least <= rejected[name] <= most for name in names), rejected
    if pole_e == 0.0:
        # A single correlation leaves the band 5 % of the time, a little less at lags of 25 of 500 samples; correlated
        # lags of a slow input give a mean over 400 draws a standard deviation of up to 0.7 %.
        assert all(abs(outside[name] - 0.048) < 0.02 for name in names), outside


@pytest.mark.parametrize(("law", "of_input"), [("bursts", False), ("bursts", True), ("t5", True)])
def test_the_level_of_the_squares_holds_with_outliers(law, of_input):
    # Independent signals, so each test may fail in at most 5 % of 400 draws; 0.1 % point of the binomial law.
    def heavy(rng):
        if law == "bursts":  # one sample in twenty is ten times larger
            return rng.normal(size=300) * np.where(rng.random(300) < 0.05, 10.0, 1.0)
        return rng.standard_t(5, size=300)

    rng, rejected = np.random.default_rng(21), 0
    for _ in range(400):
        e, u = heavy(rng), heavy(rng) if of_input else rng.normal(size=300)
        found = correlation_tests([e[None]], [u[None]], max_lag=25, level=0.05)
        rejected += not next(test for test in found if test.name == "(u2)'e2").passed
    assert rejected <= binom.ppf(0.999, 400, 0.05)


def test_the_verdict_on_a_right_model():
    # The chance that no test fails at 0.05 / 5 is at least 95 %; 100 draws, 0.1 % point.
    found = [validate(model(), record(seed, n=400)).status for seed in range(100)]
    assert found.count(ValidationStatus.PASSED) >= binom.ppf(0.001, 100, 0.95)


@pytest.mark.parametrize(
    ("defect", "reveals", "silent", "status"),
    [
        ({"extra": lambda u, k: 0.05 * u[k - 2]}, "ue", ("ee", "(u2)'e"), "STRUCTURE"),
        ({"extra": lambda u, k: 0.1 * u[k - 2] ** 2 - 0.1 / 3}, "(u2)'e", ("ue", "ee"), "STRUCTURE"),
        ({"noise": lambda e, u, k: e[k] + 0.5 * e[k - 1]}, "ee", ("ue", "(u2)'e", "(u2)'e2"), "NOISE"),
        ({"noise": lambda e, u, k: e[k] + 0.4 * u[k - 1] * e[k - 1]}, "e(eu)", ("ee", "ue", "(u2)'e"), "NOISE"),
        ({"extra": lambda u, k: 0.3 * u[k - 1] * u[k - 2]}, "(u2)'e2", ("ue", "ee", "(u2)'e"), "STRUCTURE"),
    ],
    ids=["linear term missing", "even term missing", "coloured noise", "noise times input", "product missing"],
)
def test_each_test_reveals_its_defect(defect, reveals, silent, status):
    # The correlation that each defect makes is at least 0.2 by its moments, 6.3 standard deviations at 1000 samples:
    # each of 20 draws is found with a chance above 99.8 %. Tests to which it is orthogonal keep their level; 0.1 %
    # point.
    found = [validate(model(), record(100 + seed, **defect)) for seed in range(20)]
    assert all(not one.test(reveals).passed for one in found)
    for name in silent:
        assert sum(not one.test(name).passed for one in found) <= binom.ppf(0.999, 20, 0.05), name
    assert sum(one.status is ValidationStatus[status] for one in found) >= binom.ppf(0.001, 20, 0.95)


def test_fit_measures_over_several_recordings():
    parts = [record(3, n=80), record(4, n=50, start=20.0)]
    found = validate(model(), parts, max_lag=10)
    for fit, run in ((found.one_step, model().predict), (found.free_run, model().simulate)):
        errors = np.concatenate([p.outputs[0, 1:] - run(p).outputs[0, 1:] for p in parts])
        measured = np.concatenate([p.outputs[0, 1:] for p in parts])
        assert fit.mean_square[0] == pytest.approx(np.mean(errors**2), rel=1e-12)
        assert fit.rms[0] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)
        nrmse = np.sqrt(np.mean(errors**2)) / np.std(measured)
        assert fit.nrmse[0] == pytest.approx(nrmse, rel=1e-12)
        assert fit.percent[0] == pytest.approx(100 * (1 - nrmse), rel=1e-12)
    assert found.n_samples == 79 + 49


def test_a_mean_that_is_left_shows():
    shifted = record(5)
    shifted = Recording.from_arrays(shifted.inputs, shifted.outputs + 0.2, 0.1)  # (1 - 0.5) 0.2 = one std of e
    assert not validate(model(), shifted).test("ee").passed


def test_a_free_run_that_diverges_is_a_status_with_its_time():
    unstable = NarxModel.from_terms({"y(k-1)": 1.0, "y(k-1)^3": 1.0, "u(k-1)": 1.0}, sample_time=0.1)
    found = validate(unstable, [record(6, n=100), record(7, n=100, start=50.0)])
    assert found.status is ValidationStatus.DIVERGED and not found.status.ok
    assert [i for i, _ in found.diverged] == [0, 1] and 50.0 < found.diverged[1][1] < 60.0
    assert found.free_run.mean_square[0] == math.inf and math.isfinite(found.one_step.mean_square[0])
    assert f"recording 2 diverged at {found.diverged[1][1]:g} s" in str(found)


def test_no_residual_and_no_input():
    exact = validate(model(), record(8, noise=lambda e, u, k: 0.0))
    assert exact.status is ValidationStatus.EXACT and exact.status.ok and exact.tests == ()
    rng = np.random.default_rng(9)
    still = Recording.from_arrays(np.full(300, 0.1), coloured(rng, 300, 0.5), 0.1)
    found = validate(NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=0.1), still)
    assert [test.name for test in found.tests] == ["ee"]
    with pytest.raises(ModelError, match="none with an input that is constant"):
        found.test("ue")
    levels = Recording.from_arrays(np.tile([1.0, -1.0, -1.0, 1.0], 100), coloured(rng, 400, 0.0), 0.1)
    found = validate(NarxModel.from_terms({"y(k-1)": 1e-6}, sample_time=0.1), levels.section(1, 400))
    assert [test.name for test in found.tests][:3] == ["ee", "ue", "e(eu)"]


def test_several_inputs_and_outputs():
    rng = np.random.default_rng(10)
    n = 800
    u, e, y = rng.uniform(-1, 1, (2, n)), 0.1 * rng.normal(size=(2, n)), np.zeros((2, n))
    e[1, 1:] += 0.8 * e[0, :-1]  # the second output's noise follows the first's
    for k in range(1, n):
        y[0, k] = 0.5 * y[0, k - 1] + u[0, k - 1] + 0.3 * u[1, k - 1] + e[0, k]
        y[1, k] = 0.3 * y[0, k - 1] + u[1, k - 1] + e[1, k]
    recording = Recording.from_arrays(u, y, 0.1)
    lacking = NarxModel.from_terms(
        {"y1": {"y1(k-1)": 0.5, "u1(k-1)": 1.0}, "y2": {"y1(k-1)": 0.3, "u2(k-1)": 1.0}}, sample_time=0.1
    )
    found = validate(lacking, recording)
    assert len(found.tests) == 2 * (1 + 2 * 4) + 1 and len(found.whiteness) == 2
    assert found.test("ue", output=0, other=0).passed and not found.test("ue", output=0, other=1).passed
    cross = found.test("ee'", output=0, other=1)
    assert not cross.passed and cross.lags[np.argmax(np.abs(cross.values))] == -1  # e2 leads: e1(k) with e2(k + 1)
    assert found.one_step.nrmse.shape == (2,)
    assert "phi ue (output1, input2)" in str(found)


def test_the_plot_shows_five_panels_with_bands():
    found = validate(model(), record(13))
    axes = found.plot()
    assert len(axes) == 5
    for ax, test in zip(axes, found.tests, strict=True):
        band = ax.patches[0].get_extents().transformed(ax.transData.inverted())
        assert band.y1 == pytest.approx(test.band) and band.y0 == pytest.approx(-test.band)
        drawn = np.sort(np.concatenate([line.get_xdata() for line in ax.lines if line.get_marker() == "o"]))
        np.testing.assert_array_equal(drawn, test.lags)
        assert ax.get_ylabel().startswith(r"$\phi") and f"p = {test.p_value:.2g}" in ax.get_title(loc="right")
    with pytest.raises(ModelError, match="5 panels need as many axes"):
        found.plot(list(axes[:3]))

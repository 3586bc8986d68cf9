"""The size of the plant's own error after a fit."""

from dataclasses import replace

import numpy as np
import pytest
from foreign_models import SAMPLE, SIZES, Motor
from scipy.stats import multivariate_normal

from deatwin.ident.greybox.parts import Part, simulated
from deatwin.ident.mismatch.likelihood.beforehand import TIMING, OwnError
from deatwin.ident.mismatch.likelihood.model import LogNormal, Prior
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.several import OwnErrors, later, own_errors
from deatwin.plant import Delay, Experiment, Plant, Recording

N, DT, NOISE = 2000, 0.02, 1e-6
TIMES = DT * np.arange(N)
READINGS = 1e-4 * np.sin(2 * np.pi * 3.0 * TIMES)
OWN = OwnError(
    readings=READINGS,
    late=-TIMING * DT * np.gradient(READINGS, DT),
    times=TIMES,
    records=np.zeros(N, dtype=int),
    sample_time=DT,
    noise=NOISE,
    stated=1e-6,
)


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_timing_keeps_the_size_that_residuals_show_and_bends_that_of_the_rig(late):
    errors = OwnErrors(of=(OWN,), at=(np.arange(N),))
    noise = NOISE * np.random.default_rng(0).standard_normal(N)
    residuals = np.gradient(READINGS, DT) * late * DT + noise
    # The fit's own gain and level; neither does what a shift in time does.
    columns = errors.columns_after(residuals, np.column_stack([READINGS, np.ones(N)]))
    sizes = np.linalg.norm(columns, axis=0) / np.linalg.norm(errors.columns, axis=0)
    timing = OWN.of_timing
    assert timing.sum() == 1 and sizes[~timing] == pytest.approx(1.0)
    # Known from so many samples to 0.001 of a sample: noise / (largest velocity * sample time * sqrt(n / 2)).
    assert sizes[timing] == pytest.approx(late / TIMING, abs=4 * 0.001 / TIMING)


def test_a_further_reading_has_no_sample_times_of_its_own():
    both = OwnErrors(of=(OWN, replace(OWN, records=np.ones(N, dtype=int))), at=(np.arange(N), N + np.arange(N)))
    assert both.moments == N


def test_noise_whose_level_varies_is_that_of_a_dense_covariance():
    """Of readings, not residuals over the level: the densities differ by the product of all levels."""
    rng, n = np.random.default_rng(1), 60
    level, slope = 1.0 + 3.0 * rng.uniform(size=n), rng.standard_normal((n, 1)) * 1e-6
    own = replace(
        OWN,
        readings=READINGS[:n],
        late=OWN.late[:n],
        times=TIMES[:n],
        records=(np.arange(n) >= 40).astype(int),
        level=level,
    )
    left = 2e-6 * rng.standard_normal(n)
    (reading,) = OwnErrors(of=(own,), at=(np.arange(n),)).likelihood(left / level, slope / level[:, None])
    reading = replace(reading, columns=np.column_stack([reading.columns, own.columns]))
    kappa, sigma = 0.4e-6, 1.1e-6
    known = replace(reading, kappa=LogNormal(median=kappa), sigma=LogNormal(median=sigma))
    found = evidence([known], Prior.of((known.columns.shape[1], None))).log
    lags, together = np.abs(TIMES[:n, None] - TIMES[:n]), own.records[:, None] == own.records
    process = sum(w * np.exp(-lags / tau) for w, tau in zip(own.process.weights, own.process.times, strict=True))
    constant = replace(own, level=1.0).columns
    cov = kappa**2 * process * together * np.outer(level, level) + np.diag((sigma * level) ** 2)
    cov += slope @ slope.T + constant @ constant.T
    # in micrometres, where a covariance is no smaller than what SciPy takes for 0
    dense = multivariate_normal.logpdf(1e6 * left, np.zeros(n), 1e12 * cov) + n * np.log(1e6)
    assert found - np.log(level).sum() == pytest.approx(dense, abs=1e-8)


@pytest.mark.parametrize("known", [0.0, 0.3, 2.5], ids=["a delay not in the plant", "short", "long"])
def test_a_late_command_changes_a_held_motion_as_its_equation_says(known):
    """In samples; each delay of the motor is computed with steps of a tenth of a sample."""
    volts = np.random.default_rng(0).uniform(0.0, 12.0, 400)
    plant = Plant(rig=Motor())
    values = {p.name: p.value for p in plant.rig.parameters}
    parts = (Part.whole(Experiment(recordings=(Recording.from_arrays(volts, 0.0 * volts, SAMPLE),))),)
    if known:
        plant = plant.with_effects(Delay(time=known * SAMPLE))
    readings = simulated(plant, parts)

    def speed(delay: float) -> np.ndarray:
        rate = (values["constant"] ** 2 / values["resistance"] + values["drag"]) / values["inertia"]
        gain = values["constant"] / values["resistance"] / values["inertia"] / rate
        fine = np.concatenate([np.zeros(round(10 * delay)), np.repeat(volts, 10)])[: 10 * volts.size]
        kept, now, found = np.exp(-rate * SAMPLE / 10), 0.0, []
        for volt in fine:
            now = kept * now + (1.0 - kept) * gain * volt
            found.append(now)
        return np.array(found)[9::10]

    step = 0.1 if known < 0.1 else -0.1
    np.testing.assert_allclose(readings, speed(known), atol=1e-6 * readings.max())
    expected = (speed(known + step) - readings) * np.sign(step)
    change = 0.1 * SAMPLE * later(plant, parts, readings, 0.1 * SAMPLE)
    np.testing.assert_allclose(change, expected, atol=1e-6 * readings.max())


def test_no_timing_error_is_simulated_beyond_the_range_of_delays():
    """A step of the derivative is at most half of a motor's largest delay."""
    volts = np.random.default_rng(0).uniform(0.0, 12.0, 50)
    plant = Plant(rig=Motor(sample_time=2.0))
    parts = (Part.whole(Experiment(recordings=(Recording.from_arrays(volts, 0.0 * volts, 2.0),))),)
    readings = simulated(plant, parts)
    upper = SIZES.of(Delay()).described("time").upper
    short, long = (later(plant, parts, readings, shift) for shift in (0.5 * upper, 5.0 * upper))
    np.testing.assert_array_equal(long, short)
    assert np.abs(short).max() > 0.0


def test_a_rig_that_admits_no_delay_is_late_by_the_slope_of_its_reading(oscillator, experiment):
    plant = Plant(rig=oscillator())
    parts = (Part.whole(experiment(np.sin(0.5 * TIMES))),)
    readings = simulated(plant, parts)
    earlier = simulated(plant, (Part.whole(experiment(np.sin(0.5 * (TIMES - 0.1 * DT)))),))
    settled = (TIMES > 10.0) & (TIMES < TIMES[-1])
    (own,) = own_errors(plant.rig, parts, readings, NOISE, 0.0, later(plant, parts, readings, 0.1 * DT)).of
    change = own.late * 0.1 / TIMING
    np.testing.assert_allclose(change[settled], (earlier - readings)[settled], atol=1e-3 * np.abs(change).max())

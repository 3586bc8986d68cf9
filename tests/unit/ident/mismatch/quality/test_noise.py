"""The sensor's noise is the stated one, unless the top of the spectrum says more."""

import numpy as np
import pytest

from deatwin.ident.mismatch.quality.noise import NoiseSource, noise_level, noise_levels, rests
from deatwin.ident.mismatch.quality.repeats import find_repeats

NOISE = 2e-6


def residual(seed: int, slow: float, n: int = 6000) -> np.ndarray:
    """White noise of the sensor and a slow sine of that rms."""
    timepts = 0.02 * np.arange(n)
    noise = NOISE * np.random.default_rng(seed).standard_normal(n)
    return noise + slow * np.sqrt(2) * np.sin(2 * np.pi * 0.031 * timepts)


def test_noise_floor_keeps_the_data_sheet_where_it_is_right():
    assert noise_level([residual(0, 3e-6)], 0.02, NOISE).level == NOISE


def test_noise_floor_sees_a_noisier_sensor():
    seen = noise_level([1.8 * residual(0, 3e-6)], 0.02, NOISE).level
    # the median of 5 Hz of a Welch spectrum of 6000 samples scatters by about 5 %
    assert seen == pytest.approx(1.8 * NOISE, rel=0.15)


def test_repeats_show_the_noise_under_any_model_error():
    """What the plant lacks comes back with the command, up to the highest frequencies, and cancels."""
    rng = np.random.default_rng(2)
    one = 2.4 + np.cumsum(rng.standard_normal(1500)) / 30
    commands, missing = np.tile(one, 4), np.tile(9e-6 * rng.standard_normal(1500), 4)
    found = noise_level(
        [missing + 3e-6 * rng.standard_normal(6000)], 0.02, NOISE, [commands], find_repeats([commands], 0.02)
    )
    assert found.source is NoiseSource.REPEATS
    # the median over 127 lines of 17 segments scatters by about 3 %
    assert found.level == pytest.approx(3e-6, rel=0.1)
    assert found.estimates[NoiseSource.TOP_OF_SPECTRUM] > 8e-6


def test_rests_show_the_noise_where_motion_hides_it():
    rng = np.random.default_rng(3)
    commands = np.r_[2.4 + rng.standard_normal(2000), np.full(3000, 2.4)]
    residual = np.r_[9e-6 * rng.standard_normal(2000), 3e-6 * rng.standard_normal(3000)]
    found = noise_level([residual], 0.02, NOISE, [commands])
    assert found.source is NoiseSource.RESTS
    assert found.level == pytest.approx(3e-6, rel=0.1)
    np.testing.assert_array_equal(np.flatnonzero(rests(commands, 0.02))[[0, -1]], [2201, 4999])


def test_a_rest_in_which_coarse_readings_stand_still_says_nothing():
    rng = np.random.default_rng(5)
    commands = np.r_[2.4 + rng.standard_normal(2000), np.full(3000, 2.4)]
    coarse = np.r_[3e-6 * rng.standard_normal(2000), np.zeros(3000)]
    found = noise_level([coarse[:2000], coarse[2000:] + 1e-5], 0.02, 0.0, [commands[:2000], commands[2000:]])
    assert found.source is NoiseSource.TOP_OF_SPECTRUM
    assert found.level > 0.0


def test_the_stated_noise_is_said_to_be_the_source():
    found = noise_level([residual(4, 3e-6)], 0.02, NOISE)
    assert found.source is NoiseSource.SHEET
    assert "the value stated for the sensor" in found.sentence
    louder = noise_level([1.25 * residual(4, 0.0)], 0.02, NOISE)  # 56 % more power: no rig is said to be clean with it
    assert louder.source is NoiseSource.TOP_OF_SPECTRUM
    assert louder.level == pytest.approx(1.25 * NOISE, rel=0.1)
    # without a stated value the recordings alone speak
    assert noise_level([residual(4, 3e-6)], 0.02, 0.0).level == pytest.approx(NOISE, rel=0.15)


def test_a_piece_of_a_few_samples_says_nothing():
    whole = residual(6, 0.0)
    alone = noise_level([whole], 0.02, 0.0).level
    assert noise_level([whole, whole[:1], whole[:5]], 0.02, 0.0).level == alone
    assert np.isfinite(noise_level([whole[:3], whole[:5]], 0.02, 0.0).level)


@pytest.mark.parametrize("samples", [30, 64, 100, 300])
def test_many_short_records_show_the_noise_as_well_as_a_long_one(samples):
    """Of 6000 samples in all, six lines scatter by 4 % of the noise; the median line of one segment is 17 % lower."""
    rng = np.random.default_rng(7)
    levels = [noise_level(list(rng.standard_normal((6000 // samples, samples))), 0.02, 0.0).level for _ in range(20)]
    assert np.mean(levels) == pytest.approx(1.0, abs=0.025)


@pytest.mark.parametrize(("samples", "median"), [(16, 1.0), (17, 1.0)])
def test_the_line_at_half_the_sample_rate_pulls_nothing_down(samples, median):
    """Its density is half of the others' in a one-sided spectrum; an odd number of samples has none there.

    Of sixteen samples 7/8 and 8/8 are above four fifths, of which 7/8 counts; of seventeen 14/17 and 16/17. The density
    of one line scatters by itself, over 2000 records by 2 %.
    """
    pieces = list(NOISE * np.random.default_rng(6).standard_normal((2000, samples)))
    assert (noise_level(pieces, 0.02, 0.0).level / NOISE) ** 2 == pytest.approx(median, abs=0.06)


# --- noise whose level varies ---------------------------------------------------------------------------------------


def motion(n: int) -> np.ndarray:
    """A reading between 0 and 1."""
    t = 0.02 * np.arange(n)
    return 0.5 + 0.3 * np.sin(2 * np.pi * 0.3 * t) + 0.2 * np.sin(2 * np.pi * 0.83 * t + 1.0)


@pytest.mark.parametrize("n", [600, 6000])
def test_noise_of_one_level_has_none_that_varies(n):
    """None of 100, beside a slow mismatch that is six times as large and grows with the motion, too."""
    moves, command = motion(n), np.random.default_rng(0).uniform(size=n)
    for seed in range(100):
        rest = residual(seed, 0.0, n) + 6 * NOISE * moves * np.sin(2 * np.pi * 0.4 * 0.02 * np.arange(n))
        assert noise_levels([rest], ([moves], [command]), 0.0) is None


def test_a_level_that_grows_with_one_of_two_signals_is_found():
    """20 of 20, to 15 % rms: 15 levels are known to sqrt(15 * 9.1 / 6000) / 2 = 8 % each; white commands smear them."""
    n = 6000
    moves, command = motion(n), np.random.default_rng(0).uniform(size=n)
    for seed in range(20):
        for signal in (moves, command):
            true = 1.0 + 3.0 * signal
            (found,) = noise_levels([true * residual(seed, 0.0, n)], ([moves], [command]), 0.0)
            assert np.std(np.log(found / true)) < 0.15
            assert np.mean(found**-2.0) == pytest.approx(1.0)


def test_what_varies_below_the_level_that_matters_is_left():
    n = 6000
    true = 1.0 + 3.0 * motion(n)
    assert noise_levels([true * residual(0, 0.0, n)], ([motion(n)],), 5.0 * NOISE) is None


def test_fast_motion_that_varies_is_no_noise():
    """A mode that rings at an eighth of the sample rate where the film is thin."""
    n = 6000
    rings = np.sin(2 * np.pi * 6.25 * 0.02 * np.arange(n)) * motion(n) ** 2
    rest = residual(0, 0.0, n) + 10 * NOISE * rings
    assert noise_levels([rest], ([motion(n)],), 0.0) is None

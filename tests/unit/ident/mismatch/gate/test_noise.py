"""The sensor's noise is the data sheet's, unless the top of the spectrum says more."""

import numpy as np
import pytest

from deatwin.ident.mismatch.gate.noise import NoiseSource, noise_level, rests
from deatwin.ident.mismatch.gate.repeats import find_repeats

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


def test_the_data_sheet_is_said_to_be_the_source():
    found = noise_level([residual(4, 3e-6)], 0.02, NOISE)
    assert found.source is NoiseSource.SHEET
    assert "data sheet" in found.sentence
    louder = noise_level([1.25 * residual(4, 0.0)], 0.02, NOISE)  # 56 % more power: no rig is said to be clean with it
    assert louder.source is NoiseSource.TOP_OF_SPECTRUM
    assert louder.level == pytest.approx(1.25 * NOISE, rel=0.1)
    # without a data sheet the recordings alone speak
    assert noise_level([residual(4, 3e-6)], 0.02, 0.0).level == pytest.approx(NOISE, rel=0.15)


def test_a_piece_of_a_few_samples_says_nothing():
    whole = residual(6, 0.0)
    alone = noise_level([whole], 0.02, 0.0).level
    assert noise_level([whole, whole[:1], whole[:5]], 0.02, 0.0).level == alone
    assert np.isfinite(noise_level([whole[:3], whole[:5]], 0.02, 0.0).level)


@pytest.mark.parametrize(("samples", "median"), [(16, 1.0), (17, 1.0)])
def test_the_line_at_half_the_sample_rate_pulls_nothing_down(samples, median):
    """Its density is half of the others' in a one-sided spectrum; an odd number of samples has none there.

    Of sixteen samples 7/8 and 8/8 are above four fifths, of which 7/8 counts; of seventeen 14/17 and 16/17. The density
    of one line scatters by itself, over 2000 records by 2 %.
    """
    pieces = list(NOISE * np.random.default_rng(6).standard_normal((2000, samples)))
    assert (noise_level(pieces, 0.02, 0.0).level / NOISE) ** 2 == pytest.approx(median, abs=0.06)

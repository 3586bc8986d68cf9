"""Excitation signals."""

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.excitation import band_limited_noise, random_holds

SAMPLE_TIME = 0.02


class TestBandLimitedNoise:
    def test_before_the_limits_mean_and_variance_are_exact(self) -> None:
        command = band_limited_noise(np.random.default_rng(1), 240.0, SAMPLE_TIME, lower=-50.0, upper=50.0)
        assert command.shape == (12000,)
        assert command.mean() == pytest.approx(2.4, abs=1e-12)
        assert command.var() == pytest.approx(0.36, rel=1e-12)

    def test_before_the_limits_nothing_is_above_the_band(self) -> None:
        command = band_limited_noise(np.random.default_rng(2), 240.0, SAMPLE_TIME, lower=-50.0, upper=50.0)
        spectrum = np.abs(np.fft.rfft(command - command.mean()))
        frequency = np.fft.rfftfreq(len(command), SAMPLE_TIME)
        assert spectrum[frequency > 1.0 + 1e-9].max() < 1e-9 * spectrum.max()
        assert spectrum[(frequency > 0.9) & (frequency <= 1.0)].mean() > 0.3 * spectrum[1:].max() / 3.0

    def test_limits_hold_and_are_reached_by_the_thesis_values(self) -> None:
        command = band_limited_noise(np.random.default_rng(3), 240.0, SAMPLE_TIME)
        assert command.min() == 1.1 and command.max() == 3.75
        assert 0.30 < command.var() < 0.36

    def test_depends_on_the_generator_only(self) -> None:
        first, again, other = (
            band_limited_noise(np.random.default_rng(seed), 20.0, SAMPLE_TIME) for seed in (4, 4, 5)
        )
        np.testing.assert_array_equal(first, again)
        assert np.abs(first - other).max() > 0.1

    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"band": 26.0}, r"at most half the sample rate, 25 Hz"),
            ({"band": 0.0}, r"band 0 Hz"),
            ({"mean": 0.5}, r"lower < mean < upper"),
            ({"variance": -1.0}, r"variance >= 0"),
            ({"duration": 0.5}, r"needs at least 1 s"),
            ({"duration": 0.0}, r"at least one sample"),
            ({"sample_time": 0.0}, r"at least one sample"),
        ],
    )
    def test_faults(self, options: dict[str, float], message: str) -> None:
        given = {"duration": 10.0, "sample_time": SAMPLE_TIME} | options
        with pytest.raises(DataError, match=message):
            band_limited_noise(np.random.default_rng(6), **given)


class TestRandomHolds:
    def test_holds_and_levels_are_in_range(self) -> None:
        command = random_holds(np.random.default_rng(7), 400.0, SAMPLE_TIME, 1.1, 3.75)
        assert command.shape == (20000,)
        assert 1.1 <= command.min() < 1.6 and 3.2 < command.max() <= 3.75
        holds = np.diff(np.flatnonzero(np.diff(command, prepend=np.nan))) * SAMPLE_TIME
        assert holds.min() >= 2.0 - 1e-9 and holds.max() <= 25.0 + 1e-9

    def test_faults(self) -> None:
        with pytest.raises(DataError, match="need lower < upper"):
            random_holds(np.random.default_rng(8), 10.0, SAMPLE_TIME, 3.0, 1.0)
        with pytest.raises(DataError, match="shortest <= longest"):
            random_holds(np.random.default_rng(8), 10.0, SAMPLE_TIME, 1.0, 3.0, shortest=5.0, longest=2.0)

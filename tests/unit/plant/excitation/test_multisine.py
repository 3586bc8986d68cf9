"""Multisines: power on chosen lines and none on the others."""

import numpy as np
import pytest

from deatwin.plant.errors import DataError
from deatwin.plant.excitation import odd_harmonics, random_odd_harmonics, random_phase_multisine

PERIOD, SAMPLE_TIME, BAND = 40.0, 0.02, 2.0
ODD = np.arange(1, 81, 2)


def multisine(seed: int = 1, harmonics: object = ODD, rms: float = 0.25, **options: object) -> np.ndarray:
    return random_phase_multisine(np.random.default_rng(seed), PERIOD, SAMPLE_TIME, harmonics, rms, **options)


def amplitudes(command: np.ndarray) -> np.ndarray:
    """Amplitude of each line of a signal about its mean, V."""
    return 2.0 * np.abs(np.fft.rfft(command - command.mean())) / command.size


class TestLines:
    def test_odd_up_to_the_band(self) -> None:
        np.testing.assert_array_equal(odd_harmonics(PERIOD, BAND), ODD)
        np.testing.assert_array_equal(odd_harmonics(1.0, 1.0), [1])
        np.testing.assert_array_equal(odd_harmonics(10.0, 0.3), [1, 3])  # 10 times 0.3 is a little below three
        with pytest.raises(DataError, match="at least 1/band"):
            odd_harmonics(1.0, 0.5)

    def test_one_in_each_group_is_left_out(self) -> None:
        excited, detection = random_odd_harmonics(np.random.default_rng(2), PERIOD, BAND, group=4)
        np.testing.assert_array_equal(np.sort(np.r_[excited, detection]), ODD)
        np.testing.assert_array_equal((detection // 2) // 4, np.arange(10))  # 40 odd harmonics in ten groups
        again = random_odd_harmonics(np.random.default_rng(2), PERIOD, BAND, group=4)
        np.testing.assert_array_equal(detection, again[1])

    def test_every_member_of_a_group_is_left_out_at_times(self) -> None:
        seen = {int(random_odd_harmonics(np.random.default_rng(s), 5.0, 1.0, group=3)[1][0]) for s in range(50)}
        assert seen == {1, 3, 5}  # by chance one is missed with a probability of 3 (2/3)^50 = 5e-9


class TestMultisine:
    def test_amplitudes_are_in_the_given_proportion(self) -> None:
        given = 1.0 / np.arange(1.0, 41.0)
        lines = amplitudes(multisine(amplitudes=given))
        np.testing.assert_allclose(lines[ODD] / lines[1], given, rtol=1e-11)

    def test_limits_hold_without_clipping(self) -> None:
        # 40 sines are nearly Gaussian: a bound of 2.5 standard deviations needs some draws, of which the
        # antisymmetry asks half as many to be lucky.
        command = multisine(rms=0.48, lower=1.2, upper=3.6)
        assert command.min() >= 1.2 and command.max() <= 3.6
        lines = amplitudes(command)
        lines[ODD] = 0.0
        assert lines.max() < 1e-14

    def test_the_rms_that_the_error_offers_is_kept(self) -> None:
        with pytest.raises(DataError, match="kept to them") as error:
            multisine(rms=0.6)
        offered = float(str(error.value).split("an rms of ")[1].split(" V")[0])
        assert 0.3 < offered < 0.6
        command = multisine(rms=offered)
        assert command.std() == pytest.approx(offered, rel=1e-12)

    def test_phases_are_uniform_and_the_generators(self) -> None:
        np.testing.assert_array_equal(multisine(seed=5), multisine(seed=5))
        free = [multisine(seed=s, lower=-np.inf, upper=np.inf) for s in range(50)]
        phases = np.exp(1j * np.angle([np.fft.rfft(u)[ODD] for u in free])).ravel()
        # the mean of 2000 random points on the circle has a modulus of rms 1/sqrt(2000)
        assert abs(phases.mean()) < 4.0 / np.sqrt(phases.size)
        assert abs((phases**2).mean()) < 4.0 / np.sqrt(phases.size)

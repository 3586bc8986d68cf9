"""Band-limited Gaussian noise, and the effect of limits on its spectrum."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import require_generator
from deatwin.plant.errors import DataError
from deatwin.plant.excitation.samples import command_array, sample_count, with_numbers


@with_numbers
def band_limited_noise(
    rng: np.random.Generator,
    duration: float,
    sample_time: float,
    mean: float = 2.4,
    variance: float = 0.36,
    band: float = 1.0,
    lower: float = 1.1,
    upper: float = 3.75,
) -> NDArray[np.float64]:
    """Return band-limited Gaussian noise about an operating point.

    In the spectrum of white Gaussian noise, the line at 0 Hz and every line above `band` are set to zero. The noise is
    then scaled to `variance`, added to `mean`, and clipped to `lower` and `upper`.

    The defaults are those of the excitation in W. R. Jacobs' thesis. There the limits lie only 2.2 standard deviations
    from the mean, so that clipping reduces the variance from 0.36 to 0.343 V² and puts 0.22 % of the power above the
    band. `share_above_band` returns this share for a given signal.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator for the noise.
    duration : float
        Length, s; rounded to whole samples.
    sample_time : float
        Time between two samples, s.
    mean : float
        Operating point, V.
    variance : float
        Variance before clipping, V².
    band : float
        Highest frequency of the noise before clipping, Hz; at most half the sample rate.
    lower, upper : float
        Limits of the command, V; infinite for none.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If the duration is shorter than ``1 / band``, the band is not above 0 or exceeds half the sample rate, the
        variance is negative, or the mean does not lie between the limits.

    References
    ----------
    W. R. Jacobs, "Identification and Frequency Response Analysis with Application to Soft Smart Actuators",
    University of Sheffield, chapter 2.
    """
    if not variance >= 0.0 or not lower < mean < upper:
        raise DataError(
            f"variance {variance:g}, mean {mean:g}, limits {lower:g} and {upper:g}: need variance >= 0 "
            "and lower < mean < upper"
        )
    noise = _noise(rng, sample_count("duration", duration, sample_time), sample_time, band, variance)
    return np.clip(mean + noise, lower, upper)


@with_numbers
def share_above_band(commands: ArrayLike, sample_time: float, band: float) -> float:
    """Return the power of a signal above a frequency, divided by the power at all frequencies except 0 Hz.

    The signal is treated as one period of a periodic signal. If its last value differs from its first value, the jump
    between them adds power above the frequency. Noise from `band_limited_noise` is periodic, and has power above its
    band only if it was clipped.

    Parameters
    ----------
    commands : (n,) array_like
        Commands, V.
    sample_time : float
        Time between two samples, s.
    band : float
        Frequency above which the power is summed, Hz.

    Returns
    -------
    float
        Share of the power, 0 to 1.

    Raises
    ------
    DataError
        If the commands are constant or not a one-dimensional array of finite numbers, or sample time or band is not
        positive.

    Examples
    --------
    >>> sampled = np.arange(1000) * 0.02
    >>> share = share_above_band(np.sin(2 * np.pi * sampled) + np.sin(6 * np.pi * sampled), 0.02, 2.0)
    >>> print(f"{share:.3f}")
    0.500
    """
    if not sample_time > 0.0 or not band > 0.0:
        raise DataError(f"sample time {sample_time:g} s, band {band:g} Hz: both must be above 0")
    array = command_array(commands)
    if array.max() == array.min():
        raise DataError("constant commands: they have no power to share out")
    # The full transform counts each line at its positive and at its negative frequency.
    power = np.abs(np.fft.fft(array - array.mean())) ** 2
    above = np.abs(np.fft.fftfreq(array.size, sample_time)) > band * (1.0 + 1e-12)
    return float(power[above].sum() / power.sum())


def _noise(rng: np.random.Generator, n: int, sample_time: float, band: float, variance: float) -> NDArray[np.float64]:
    """Return noise of zero mean and a given variance without a line above the band."""
    if not 0.0 < band <= 0.5 / sample_time:
        raise DataError(
            f"band {band:g} Hz: it must be above 0 and at most half the sample rate, {0.5 / sample_time:g} Hz"
        )
    require_generator(rng)
    frequency = np.fft.rfftfreq(n, sample_time)
    inside = (frequency > 0.0) & (frequency <= band * (1.0 + 1e-12))
    if not inside.any():
        raise DataError(f"duration {n * sample_time:g} s: noise up to {band:g} Hz needs at least {1.0 / band:g} s")
    noise = np.fft.irfft(np.where(inside, np.fft.rfft(rng.standard_normal(n)), 0.0), n)
    return noise * (np.sqrt(variance) / noise.std())

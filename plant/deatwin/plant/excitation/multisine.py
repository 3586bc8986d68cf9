"""Periodic sums of sines with power on chosen lines, which separate odd from even nonlinearities."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import real_numbers, require_generator
from deatwin.plant.errors import DataError
from deatwin.plant.excitation.samples import sample_count, with_numbers

ATTEMPTS = 100  # Number of draws of the phases before the limits count as too narrow


@with_numbers
def odd_harmonics(period: float, band: float) -> NDArray[np.int64]:
    """Return the odd harmonics of the frequency ``1 / period`` up to the frequency `band`.

    Parameters
    ----------
    period : float
        Period, s.
    band : float
        Highest frequency, Hz.

    Returns
    -------
    (m,) array of int
        Orders of the harmonics, 1, 3, 5, ...: their frequencies in units of ``1 / period``.

    Raises
    ------
    DataError
        If `band` is below ``1 / period``, so that there is no harmonic.

    Examples
    --------
    >>> odd_harmonics(10.0, 0.8)
    array([1, 3, 5, 7])
    """
    if not 1.0 <= period * band * (1.0 + 1e-12) < np.inf:
        raise DataError(f"period {period:g} s, band {band:g} Hz: need a period of at least 1/band")
    return np.arange(1, int(period * band * (1.0 + 1e-12)) + 1, 2)


@with_numbers
def random_odd_harmonics(
    rng: np.random.Generator, period: float, band: float, group: int = 3
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return odd harmonics of a multisine, with one harmonic omitted at random from each group of neighbours.

    The omitted harmonics are detection lines: power of the response at these lines comes from odd nonlinearities of the
    plant.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator that chooses the omitted harmonics.
    period : float
        Period of the multisine, s.
    band : float
        Highest frequency, Hz.
    group : int
        Number of neighbouring odd harmonics in a group, at least two. If the last group is incomplete, none of its
        harmonics is omitted.

    Returns
    -------
    excited : (m,) array of int
        Harmonics for `random_phase_multisine`, in units of ``1 / period``.
    detection : (k,) array of int
        Omitted harmonics, in units of ``1 / period``.

    Raises
    ------
    DataError
        If `group` is less than two, or if there are fewer odd harmonics up to `band` than in one group.

    References
    ----------
    Pintelon & Schoukens, System Identification: A Frequency Domain Approach (2nd ed. 2012), chapter 4.
    """
    require_generator(rng)
    lines = odd_harmonics(period, band)
    if group < 2 or lines.size < group:
        raise DataError(f"groups of {group} among {lines.size} odd harmonics: need at least two a group and one group")
    groups = lines.size // group
    left_out = np.arange(groups) * group + rng.integers(group, size=groups)
    return np.delete(lines, left_out), lines[left_out]


@with_numbers
def random_phase_multisine(
    rng: np.random.Generator,
    period: float,
    sample_time: float,
    harmonics: ArrayLike,
    rms: float,
    mean: float = 2.4,
    amplitudes: ArrayLike | None = None,
    periods: int = 1,
    lower: float = 1.1,
    upper: float = 3.75,
) -> NDArray[np.float64]:
    """Return whole periods of a bias plus a multisine, which is a sum of sines with random phases.

    The signal is not clipped to the limits, because clipping would put power at frequencies that are not among
    `harmonics`. Instead, the phases are drawn anew, up to a hundred times, until the signal lies within the limits.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator for the phases, which are uniformly distributed from 0 to 2π.
    period : float
        Period, s; rounded to whole samples, so that the signal is exactly periodic.
    sample_time : float
        Time between two samples, s.
    harmonics : (m,) array_like of int
        Frequencies of the sines in units of ``1 / period``, for example from `odd_harmonics`; below half the sample
        rate.
    rms : float
        Root mean square of the sum of sines without the bias, V.
    mean : float
        Bias, V.
    amplitudes : (m,) array_like of float, optional
        Amplitudes of the sines relative to each other; all equal by default.
    periods : int
        Number of periods.
    lower, upper : float
        Limits of the command, V; infinite for none.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If an argument is out of its range, or if no drawn phases satisfy the limits. In the latter case, the
        error message states a smaller `rms` for which there are such phases.

    References
    ----------
    Pintelon & Schoukens, System Identification: A Frequency Domain Approach (2nd ed. 2012), chapter 4.
    """
    require_generator(rng)
    n = sample_count("period", period, sample_time)
    lines = _checked_lines(harmonics, n)
    shape = _checked_amplitudes(amplitudes, lines.size)
    if periods < 1 or not rms >= 0.0 or not lower < mean < upper:
        raise DataError(
            f"{periods} periods, rms {rms:g}, mean {mean:g}, limits {lower:g} and {upper:g}: need one period, "
            "rms >= 0 and lower < mean < upper"
        )
    shape = shape / np.sqrt(np.sum(shape**2) / 2.0)  # the sum then has an rms of 1
    best = 0.0
    for _ in range(ATTEMPTS):
        spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
        spectrum[lines] = 0.5 * n * shape * np.exp(2j * np.pi * rng.random(lines.size))
        wave = np.fft.irfft(spectrum, n)
        best = max(best, min((upper - mean) / wave.max(), (lower - mean) / wave.min()))
        if rms <= best:
            return np.tile(mean + rms * wave, periods)
    raise DataError(
        f"rms {rms:g} V about {mean:g} V: {ATTEMPTS} draws of the phases left the limits {lower:g} and "
        f"{upper:g} V; an rms of {np.floor(best * 1e4) / 1e4:g} V kept to them"
    )


def _checked_lines(harmonics: ArrayLike, n: int) -> NDArray[np.int64]:
    given = np.asarray(harmonics)
    highest = (n - 1) // 2
    if (
        given.ndim != 1
        or given.dtype.kind not in "iu"
        or np.unique(given).size != given.size
        or not 1 <= min(given, default=0) <= max(given) <= highest
    ):
        raise DataError(
            f"harmonics {given!r}: need distinct whole numbers from 1 to {highest}, below half the sample rate"
        )
    return given.astype(np.int64)


def _checked_amplitudes(amplitudes: ArrayLike | None, m: int) -> NDArray[np.float64]:
    given = np.ones(m) if amplitudes is None else real_numbers(amplitudes, "amplitudes")
    if given.shape != (m,) or not np.isfinite(given).all() or not given.min() >= 0.0 or not given.any():
        raise DataError(f"amplitudes of shape {given.shape}: need {m}, one a harmonic, none negative and not all zero")
    return given

"""Holds, staircases and triangles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.plant.arrays import real_numbers, require_generator
from deatwin.plant.errors import DataError
from deatwin.plant.excitation.samples import sample_count, with_numbers


@with_numbers
def random_holds(
    rng: np.random.Generator,
    duration: float,
    sample_time: float,
    lower: float,
    upper: float,
    shortest: float = 2.0,
    longest: float = 25.0,
) -> NDArray[np.float64]:
    """Return random levels, each held for a random time; levels and times are uniformly distributed.

    Parameters
    ----------
    rng : numpy.random.Generator
        Random generator for levels and times.
    duration : float
        Length, s; rounded to whole samples. The end of the signal may cut the last hold short.
    sample_time : float
        Time between two samples, s.
    lower, upper : float
        Range of the levels, V.
    shortest, longest : float
        Range of the hold times, s. Each hold time is rounded to whole samples, and is at least one sample.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If `lower` is not below `upper`, `shortest` is not above 0 or exceeds `longest`, or the duration is shorter than
        a sample.
    """
    require_generator(rng)
    n = sample_count("duration", duration, sample_time)
    _check_range(lower, upper)
    if not 0.0 < shortest <= longest < np.inf:
        raise DataError(f"holds {shortest:g} to {longest:g} s: need 0 < shortest <= longest")
    command = np.empty(n)
    first = 0
    while first < n:
        hold = max(1, round(rng.uniform(shortest, longest) / sample_time))
        command[first : first + hold] = rng.uniform(lower, upper)
        first += hold
    return command


@with_numbers
def staircase(
    sample_time: float, lower: float = 1.1, upper: float = 3.75, levels: int = 6, hold: float = 300.0
) -> NDArray[np.float64]:
    """Return a staircase that rises in equal steps from the lowest to the highest level, and falls again.

    Each level except the highest is held twice, on the way up and on the way down. The response distinguishes creep
    from hysteresis. With creep, the motion continues during each hold, in the direction of the last step. With
    hysteresis, the film is at rest during the holds, but the reading differs between the two holds at one level.

    Parameters
    ----------
    sample_time : float
        Time between two samples, s.
    lower, upper : float
        Lowest and highest level, V.
    levels : int
        Number of levels, at least two.
    hold : float
        Time at each level, s; rounded to whole samples.

    Returns
    -------
    (n,) array
        Commands, V, with ``2 * levels - 1`` holds.

    Raises
    ------
    DataError
        If there are fewer than two levels, `lower` is not below `upper`, or the hold is shorter than a sample.

    Examples
    --------
    >>> staircase(sample_time=1.0, lower=0.0, upper=2.0, levels=3, hold=1.0)
    array([0., 1., 2., 1., 0.])
    """
    _check_range(lower, upper)
    if levels < 2:
        raise DataError(f"{levels} levels: a staircase needs at least two")
    up = np.linspace(lower, upper, levels)
    return np.repeat(np.r_[up, up[-2::-1]], sample_count("hold", hold, sample_time))


@with_numbers
def triangles(
    sample_time: float,
    lower: float = 1.1,
    upper: float = 3.75,
    rates: Sequence[float] = (1e-3, 1e-2, 1e-1),
    cycles: int = 1,
) -> NDArray[np.float64]:
    """Return triangle waves at several rates, one after the other.

    The response distinguishes hysteresis from a linear lag. At decreasing rates, the loop of reading over command stays
    open with hysteresis, and closes with a lag.

    Parameters
    ----------
    sample_time : float
        Time between two samples, s.
    lower, upper : float
        Lowest and highest command of each triangle, V; a cycle starts at `lower`.
    rates : sequence of float
        Frequencies of the triangle waves, Hz. Each cycle is rounded to an even number of samples, so that one sample
        lies at the peak.
    cycles : int
        Number of cycles at each rate, at least one.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If there are no rates or no cycles, `lower` is not below `upper`, or a rate is not above 0 or exceeds half the
        sample rate.
    """
    _check_range(lower, upper)
    rates = real_numbers(rates, "rates").ravel().tolist()
    if not sample_time > 0.0 or cycles < 1 or len(rates) == 0:
        raise DataError(
            f"sample time {sample_time:g} s, {cycles} cycles, {len(rates)} rates: need a sample time above 0, "
            "one cycle and one rate"
        )
    highest = 0.5 / sample_time
    if not all(0.0 < rate <= highest for rate in rates):
        raise DataError(
            f"rates {', '.join(f'{rate:g}' for rate in rates)} Hz: they must be above 0 and at most half the "
            f"sample rate, {highest:g} Hz"
        )
    halves = [sample_count("half a cycle", 0.5 / rate, sample_time) for rate in rates]
    rise = [np.r_[np.arange(half), np.arange(half, 0, -1)] / half for half in halves]
    return lower + (upper - lower) * np.concatenate([np.tile(cycle, cycles) for cycle in rise])


def _check_range(lower: float, upper: float) -> None:
    if not -np.inf < lower < upper < np.inf:
        raise DataError(f"levels {lower:g} to {upper:g} V: need lower < upper")

"""Rests and changes of polarity, for any signal."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.excitation.samples import command_array, sample_count


def with_rests(
    commands: ArrayLike, sample_time: float, every: float, rest: float, level: float = 0.0
) -> NDArray[np.float64]:
    """Return a signal with rests inserted between its pieces.

    The reading during a rest shows what remains of creep, drift and charge, and a shift of the sensor's zero.

    Parameters
    ----------
    commands : (n,) array_like
        Commands, V; all of them are kept.
    sample_time : float
        Time between two samples, s.
    every : float
        Length of the pieces, s; rounded to whole samples. The last piece may be shorter; no rest follows it.
    rest : float
        Length of the rests, s; rounded to whole samples.
    level : float
        Command at rest, V.

    Returns
    -------
    (n + k m,) array
        Commands, V, with k rests of m samples each.

    Raises
    ------
    DataError
        If the commands are not a one-dimensional array of finite numbers, or a time is shorter than a sample.

    Examples
    --------
    >>> with_rests([1.0, 2.0, 3.0], sample_time=1.0, every=1.0, rest=2.0)
    array([1., 0., 0., 2., 0., 0., 3.])
    """
    array = command_array(commands)
    piece = sample_count("every", every, sample_time)
    ends = np.arange(piece, array.size, piece)
    return np.insert(array, np.repeat(ends, sample_count("rest", rest, sample_time)), level)


def with_alternating_polarity(commands: ArrayLike, sample_time: float, segment: float) -> NDArray[np.float64]:
    """Return a signal with the sign of every second segment reversed.

    The Maxwell stress is proportional to the square of the voltage. A response that changes with the sign therefore
    reveals charge in the film, an amplifier offset, or an amplifier of one polarity.

    Parameters
    ----------
    commands : (n,) array_like
        Commands, V.
    sample_time : float
        Time between two samples, s.
    segment : float
        Time between reversals, s; rounded to whole samples. The first segment keeps its sign.

    Returns
    -------
    (n,) array
        Commands, V.

    Raises
    ------
    DataError
        If the commands are not a one-dimensional array of finite numbers, or the segment is shorter than a sample.

    Examples
    --------
    >>> with_alternating_polarity([1.0, 2.0, 3.0], sample_time=1.0, segment=1.0)
    array([ 1., -2.,  3.])

    Examples
    --------
    >>> with_alternating_polarity([1.0, 2.0, 3.0, 4.0], sample_time=1.0, segment=2.0)
    array([ 1.,  2., -3., -4.])
    """
    array = command_array(commands)
    odd = np.arange(array.size) // sample_count("segment", segment, sample_time) % 2
    return np.where(odd == 1, -array, array)

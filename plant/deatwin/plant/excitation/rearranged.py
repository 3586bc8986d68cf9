"""Changes of polarity, for any signal."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.excitation.samples import command_array, sample_count, with_numbers


@with_numbers
def with_alternating_polarity(commands: ArrayLike, sample_time: float, segment: float) -> NDArray[np.float64]:
    """Return a signal with the sign of every second segment reversed.

    The Maxwell stress is proportional to the square of the voltage, so that the sign should have no influence. A
    response that changes with the sign reveals charge in the film, an offset of the amplifier, or a unipolar amplifier.

    Parameters
    ----------
    commands : (n,) array_like
        Commands, V.
    sample_time : float
        Time between two samples, s.
    segment : float
        Duration of a segment, s; rounded to whole samples. The first segment keeps its sign.

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
    >>> with_alternating_polarity([1.0, 2.0, 3.0, 4.0], sample_time=1.0, segment=2.0)
    array([ 1.,  2., -3., -4.])
    """
    array = command_array(commands)
    odd = np.arange(array.size) // sample_count("segment", segment, sample_time) % 2
    return np.where(odd == 1, -array, array)

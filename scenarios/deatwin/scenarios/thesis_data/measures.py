"""Shape, loops and spectra of a recording as numbers, simulated or measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deatwin.plant.errors import DataError

__all__ = ["Line", "LinearShare", "linear_share", "local_gain", "loop_area", "mean_curve", "straight_line"]

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A straight line through the lower part of a voltage-displacement curve.

    Parameters
    ----------
    gain : float
        Its slope, m/V.
    offset : float
        Its displacement at 0 V, m.
    misfit : float
        Largest distance of the curve from it in that part, over the full stroke of the whole curve.
    """

    gain: float
    offset: float
    misfit: float


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearShare:
    """Spectra of an output, and of what the best linear model makes of the input.

    Parameters
    ----------
    frequencies : ndarray, shape (n,)
        Middle of each band, Hz.
    inputs : ndarray, shape (n,)
        Spectral density of the input, unit² / Hz.
    outputs, explained : ndarray, shape (n,)
        Spectral density of the output, and of its part that is coherent with the input, unit² / Hz.
    width : float
        Of a band, Hz.
    """

    frequencies: Array
    inputs: Array
    outputs: Array
    explained: Array
    width: float

    def above(self, frequency: float) -> tuple[float, float, float]:
        """Powers above a frequency.

        Parameters
        ----------
        frequency : float
            Hz.

        Returns
        -------
        tuple of float
            Of the input, of the output, and of the output's part that a linear model explains.
        """
        there = self.frequencies > frequency
        return tuple(float(p[there].sum() * self.width) for p in (self.inputs, self.outputs, self.explained))  # type: ignore[return-value]


def mean_curve(commands: ArrayLike, readings: ArrayLike, width: float = 0.05, least: int = 20) -> tuple[Array, Array]:
    """Mean reading for each command, as a recording shows it.

    Parameters
    ----------
    commands, readings : (n,) array_like
        Samples, V and m.
    width : float
        Of a bin of commands, V.
    least : int
        Samples that a bin needs.

    Returns
    -------
    levels, means : ndarray, shape (m,)
        Mean command, V, and mean reading, m, of each bin.
    """
    u, y = np.asarray(commands, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    number = np.floor((u - u.min()) / width + 1e-9).astype(int)
    count = np.bincount(number)
    used = count >= least
    return tuple(np.bincount(number, v)[used] / count[used] for v in (u, y))  # type: ignore[return-value]


def straight_line(levels: ArrayLike, displacements: ArrayLike, below: float = 2.5) -> Line:
    """The straight line that fits a voltage-displacement curve best in its lower part.

    Parameters
    ----------
    levels, displacements : (n,) array_like
        The curve, V and m, for example of `mean_curve`.
    below : float
        End of the lower part, V.

    Returns
    -------
    Line

    Raises
    ------
    DataError
        If the lower part has fewer than three points.
    """
    u, y = np.asarray(levels, dtype=np.float64), np.asarray(displacements, dtype=np.float64)
    lower = u <= below
    if lower.sum() < 3:
        raise DataError(f"{int(lower.sum())} points up to {below:g} V: a line needs at least three to be judged")
    gain, offset = np.polyfit(u[lower], y[lower], 1)
    misfit = np.abs(y[lower] - (offset + gain * u[lower])).max() / np.ptp(y)
    return Line(gain=float(gain), offset=float(offset), misfit=float(misfit))


def local_gain(commands: ArrayLike, readings: ArrayLike, at: float, width: float = 0.2) -> float:
    """Slope of the voltage-displacement curve at a command: that of a parabola through the samples about it.

    Parameters
    ----------
    commands, readings : (n,) array_like
        Samples or a curve, V and m.
    at : float
        Command, V.
    width : float
        Largest distance of a sample's command from it, V.

    Returns
    -------
    float
        m/V.

    Raises
    ------
    DataError
        If fewer than four samples lie there.
    """
    u, y = np.asarray(commands, dtype=np.float64) - at, np.asarray(readings, dtype=np.float64)
    near = np.abs(u) <= width
    if near.sum() < 4:
        raise DataError(f"{int(near.sum())} samples within {width:g} V of {at:g} V: a slope needs at least four")
    return float(np.polyfit(u[near], y[near], 2)[1])


def loop_area(commands: ArrayLike, readings: ArrayLike) -> float:
    r"""Area :math:`\oint u\,dy` of a closed loop, over the rectangle around it.

    Parameters
    ----------
    commands, readings : (n,) array_like
        One whole cycle, or several.

    Returns
    -------
    float
        Positive where the reading lags; of several cycles the mean. A sine with a phase lag :math:`\varphi` gives
        :math:`\frac{\pi}{4}\sin\varphi`.
    """
    u, y = np.asarray(commands, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    # Where the command sets out upwards from its lowest, a cycle begins.
    lowest = np.isclose(u, u.min())
    cycles = max(1, int(np.sum(lowest & ~np.roll(lowest, 1))))
    area = 0.5 * np.sum(u * np.roll(y, -1) - np.roll(u, -1) * y)
    return float(area / (cycles * np.ptp(u) * np.ptp(y)))


def linear_share(commands: ArrayLike, readings: ArrayLike, sample_time: float, width: float = 0.025) -> LinearShare:
    r"""Spectra of the output and of what the best linear model makes of the input as it really is.

    The model is the best linear approximation: in each band of frequencies the response
    :math:`\sum Y\bar U/\sum|U|^2`, so that the part :math:`|\sum Y\bar U|^2/\sum|U|^2` of the output's power is
    coherent with the input. No window is applied: `band_limited_noise` is one period of a periodic signal, of which
    nothing leaks, and what a drift of the output leaks above 1 Hz is small.

    Parameters
    ----------
    commands, readings : (n,) array_like
        Of the whole record.
    sample_time : float
        s.
    width : float
        Of a band, Hz; 1 Hz should be a multiple of it. Of m lines in a band, a share 1/m of the power is coherent by
        chance, to the advantage of the linear model: 4 % for the thesis' 1100 s.

    Returns
    -------
    LinearShare

    Raises
    ------
    DataError
        If the record is too short for two lines in a band.

    References
    ----------
    R. Pintelon and J. Schoukens, "System Identification: A Frequency Domain Approach", 2nd ed., Wiley 2012,
    chapter 3 (best linear approximation).
    """
    u, y = np.asarray(commands, dtype=np.float64), np.asarray(readings, dtype=np.float64)
    n = u.size
    if width * n * sample_time < 2:
        raise DataError(f"{n * sample_time:g} s: bands of {width:g} Hz need at least {2 / width:g} s")
    lines = np.arange(1, (n - 1) // 2 + 1)
    spectra = [np.fft.rfft(v - v.mean())[lines] for v in (u, y)]
    band = np.ceil(lines / (n * sample_time) / width - 1e-9).astype(int) - 1
    scale = 2 * sample_time / n / np.bincount(band)
    uu, yy = (scale * np.bincount(band, np.abs(s) ** 2) for s in spectra)
    cross = spectra[1] * spectra[0].conj()
    yu = scale * (np.bincount(band, cross.real) + 1j * np.bincount(band, cross.imag))
    return LinearShare(
        frequencies=(np.arange(uu.size) + 0.5) * width,
        inputs=uu,
        outputs=yy,
        explained=np.abs(yu) ** 2 / uu,
        width=width,
    )

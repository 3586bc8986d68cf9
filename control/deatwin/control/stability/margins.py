"""Stability margins of many sampled loops at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.control.arguments import polynomials, positive, taking
from deatwin.control.stability.circle import Places, search
from deatwin.control.stability.polynomials import jet, loop_polynomials, stable_loops
from deatwin.plant.arrays import Array, Complex
from deatwin.plant.copies import Frozen

_ROUNDING = 64 * np.finfo(float).eps  # Value of a polynomial, relative to its coefficients, below which it is rounding
_POLE = 1e3  # Gain above which a loop whose denominator is rounding has a pole


@dataclass(frozen=True, kw_only=True, eq=False)
class Margins(Frozen):
    """Margins of one or several loops L, as `margins` returns them; all margins are 0 if the closed loop is unstable.

    Each array has the shape (...) of the loops that were given to `margins`, with one entry for each loop.

    Parameters
    ----------
    gain : ndarray, shape (...)
        Gain margin: the smallest factor above 1 such that multiplying or dividing the loop gain by this factor makes
        the closed loop unstable. Infinite without a phase crossing.
    phase_deg : ndarray, shape (...)
        Phase margin, degrees: least change of phase that brings a gain crossing to -180°; infinite without a gain
        crossing.
    delay : ndarray, shape (...)
        Delay margin, s: least additional delay that brings a gain crossing to -180°; infinite without a gain crossing.
    crossover : ndarray, shape (...)
        Highest frequency at which the loop gain is one, rad/s; 0 without such a frequency.
    disk : ndarray, shape (...)
        Symmetric disk margin alpha = 2/max|S - T|, dimensionless, with the sensitivity S and the complementary
        sensitivity T. The loop stays stable if L is multiplied by any complex factor (1 + d/2)/(1 - d/2) with |d| <
        alpha. Infinite for L = 1 only.
    modulus : ndarray, shape (...)
        1/max|S|, the least distance of the Nyquist curve of L from -1, dimensionless.
    stable : ndarray of bool, shape (...)
        True if all closed-loop poles lie inside the unit circle.
    """

    gain: Array
    phase_deg: Array
    delay: Array
    crossover: Array
    disk: Array
    modulus: Array
    stable: NDArray[np.bool_]

    @property
    def disk_gain(self) -> Array:
        """Gain margin (factor) that `disk` guarantees, shape (...); infinite for a disk margin of 2 or more."""
        return np.divide(2.0 + self.disk, 2.0 - self.disk, out=np.full(self.disk.shape, np.inf), where=self.disk < 2.0)

    @property
    def disk_phase_deg(self) -> Array:
        """Phase margin that `disk` guarantees, degrees, shape (...)."""
        return np.degrees(2.0 * np.arctan(0.5 * self.disk))


@taking(numerators=polynomials, denominators=polynomials, sample_time=positive)
def margins(numerators: ArrayLike, denominators: ArrayLike, sample_time: float) -> Margins:
    """Compute the margins of loops ``L(z) = numerator / denominator`` under negative feedback.

    Use `in_series` to multiply the polynomials of models and controllers.

    Parameters
    ----------
    numerators, denominators : array_like, shapes (..., n_b) and (..., n_a)
        Coefficients of z^0, z^-1, ... of one dimensionless loop, or of several along leading axes, which broadcast
        against each other. Of falling powers of z, as in python-control, first pad the shorter polynomial with zeros at
        its front.
    sample_time : float
        Sampling time, s.

    Returns
    -------
    Margins
        Margins with the shape of the leading axes, (1,) for one loop. The loop is evaluated at 0 Hz and at half the
        sampling rate, but crossings nearer to one of these than 1e-6 rad per sample are not found.

    Raises
    ------
    ControlError
        If a polynomial has no coefficient, a coefficient is not finite, a denominator is zero, or the sampling time is
        not positive.

    References
    ----------
    Åström & Murray, Feedback Systems (2008), section 9.3, ISBN 978-0-691-13576-2.
    Seiler, Packard & Gahinet, An introduction to disk margins, IEEE Control Systems Magazine 40 (2020), section on
    the symmetric disk margin.

    Examples
    --------
    The closed loop of k z^-1/(1 - z^-1) has its pole at 1 - k, and is unstable for k above 2:

    >>> margins([0.0, 0.5], [1.0, -1.0], sample_time=1.0).gain.round(6)
    array([4.])
    """
    top, bottom, lead = loop_polynomials(numerators, denominators)
    found, stable = search(top, bottom), stable_loops(top, bottom)
    gain, phase, delay = (np.full(stable.size, np.inf) for _ in range(3))
    crossover = np.zeros(stable.size)

    real = _with_ends(found.real, stable.size)
    at, sound = _values(top, bottom, real)
    real_axis = (at.real < 0.0) & sound
    with np.errstate(over="ignore"):
        size = np.abs(at[real_axis])
        np.minimum.at(gain, real.loops[real_axis], np.maximum(size, 1.0 / size))

    at, sound = _values(top, bottom, found.gain)
    loops, angle, turned = found.gain.loops[sound], found.gain.angle[sound], np.angle(-at[sound])
    np.minimum.at(phase, loops, np.degrees(np.abs(turned)))
    samples = np.full(angle.shape, np.inf)  # no delay turns the response at 0 Hz
    np.divide(np.mod(turned, 2 * np.pi), angle, out=samples, where=angle > 0.0)
    np.minimum.at(delay, loops, samples * sample_time)
    np.maximum.at(crossover, loops, angle / sample_time)
    disk, modulus = 2.0 * found.disk.distance, found.modulus.distance
    for margin in (gain, phase, delay, disk, modulus):
        margin[~stable] = 0.0
    return Margins(
        gain=gain.reshape(lead),
        phase_deg=phase.reshape(lead),
        delay=delay.reshape(lead),
        crossover=crossover.reshape(lead),
        disk=disk.reshape(lead),
        modulus=modulus.reshape(lead),
        stable=stable.reshape(lead),
    )


def _with_ends(places: Places, count: int) -> Places:
    """Add the frequencies 0 and half the sampling rate, where every loop is real."""
    loops = np.arange(count)
    return places + Places(loops=loops, angle=np.zeros(count)) + Places(loops=loops, angle=np.full(count, np.pi))


def _values(top: Array, bottom: Array, places: Places) -> tuple[Complex, NDArray[np.bool_]]:
    """Return the loops at points, and which points can be crossings: no pole on the circle, no zero gain."""
    # If slow lags lie close together, the last digits of a denominator are rounding. Such crossings still count,
    # because margins without them would be unsafe.
    values, sizes, above_rounding = [], [], []
    for polynomial in (top, bottom):
        columns = np.ascontiguousarray(polynomial[places.loops].T)
        values.append(jet(columns, places.angle, 0)[0])
        sizes.append(np.abs(values[-1]))
        above_rounding.append(sizes[-1] > _ROUNDING * np.abs(columns).sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        at = values[0] / values[1]
    pole = ~above_rounding[1] & (sizes[0] >= _POLE * sizes[1])
    return at, above_rounding[0] & ~pole


def bandwidth_Hz(omega: Array, loops: NDArray[np.complex128]) -> Array:
    """Return the frequency at which abs(L/(1 + L)) first falls below -3 dB, else the last, (n,) Hz; `loops` (n, k)."""
    closed = np.abs(loops / (1.0 + loops))
    below = closed < np.sqrt(0.5)
    first = np.where(below.any(axis=1), below.argmax(axis=1), omega.size - 1)
    found = np.empty(len(loops))
    for n, k in enumerate(first):
        if k == 0:
            found[n] = omega[0]
            continue
        pair = np.log(closed[n, k - 1 : k + 1])
        share = np.clip((np.log(np.sqrt(0.5)) - pair[0]) / (pair[1] - pair[0]), 0.0, 1.0)
        found[n] = np.exp(np.log(omega[k - 1]) + share * np.log(omega[k] / omega[k - 1]))
    return np.asarray(found / (2 * np.pi))

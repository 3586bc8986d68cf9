r"""Columns of the plant's own error and of errors in the laws of its effects, scaled by prior deviations.

B β: bends of the instantaneous relation (polynomials of degree 2 to 7 of the simulated reading), timing (its
derivative), known directions, and slow modes. L λ: what another law of an effect would do.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.polynomial.legendre import legvander

from deatwin.ident.mismatch.thresholds import ACCURACY, TINY

DEGREES = (2, 7)
"""Smallest and largest degree of the bends: parameters imitate lower degrees, and a film's static relation has no
higher ones."""
FILTERS = 8
"""Number of time constants of other laws; a law between two of them differs from both by no more than a few per
cent."""
GRID = 200
"""Number of points on which slow modes are computed; the slowest few are smooth at this spacing."""


def bends(simulated: np.ndarray, rms: float) -> np.ndarray:
    """Return orthogonal polynomials of a reading, (n,), (n, 6); `rms`, SI, is that of their sum with normal weights.

    Columns beyond the number of different readings are 0.
    """
    # A reading with few different values has no more bends than values; a further direction is no function of it.
    first, last = DEGREES
    basis, triangle = np.linalg.qr(legvander(unit_range(simulated), last))
    lengths = np.abs(np.diagonal(triangle))
    bent = (lengths > simulated.size * np.finfo(float).eps * lengths.max())[first:]
    return basis[:, first:] * bent * rms * np.sqrt(simulated.size / max(bent.sum(), 1))


def slope(simulated: np.ndarray, times: np.ndarray, records: np.ndarray) -> np.ndarray:
    """Return the time derivative of a reading, (n,), within each recording."""
    slopes = np.zeros_like(simulated)
    for record in np.unique(records):
        own = records == record
        if own.sum() > 1:
            slopes[own] = np.gradient(simulated[own], times[own])
    return slopes


def known(directions: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    """Scale directions (n, k) of any length to given rms values, SI."""
    lengths = np.sqrt(np.mean(directions**2, axis=0))
    return directions * np.divide(sizes, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)


def slow(times: np.ndarray, records: np.ndarray, rms: float, constant: float, count: int) -> np.ndarray:
    """Return the largest principal directions of a slow first-order process in each recording, (n, count times the
    number of recordings), with given rms, SI, and time constant, s. `records`, (n,), numbers the recordings.
    """
    # What time passes between two recordings is not known, so their errors are independent.
    ends = [*(1 + np.flatnonzero(np.diff(records))), times.size]
    found = np.zeros((times.size, count * len(ends)))
    for k, (first, last) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        grid = np.linspace(times[first], times[last - 1], GRID)
        squares, modes = np.linalg.eigh(rms**2 * np.exp(-np.abs(grid[:, None] - grid) / constant))
        largest = modes[:, ::-1][:, :count] * np.sqrt(squares[::-1][:count])
        own = [np.interp(times[first:last], grid, mode) for mode in largest.T]
        found[first:last, k * count : (k + 1) * count] = np.column_stack(own)
    return found


def law(
    contribution: np.ndarray, times: np.ndarray, records: np.ndarray, level: np.ndarray | float = 1.0
) -> np.ndarray:
    """Return an orthonormal basis, (n, k), of the changes that another law may make to an effect's contribution, (n,).

    Both are over the noise's relative `level`, (n,). `records`, (n,), numbers the recordings, each of which begins anew.
    """
    # Another law may be bent (powers of the contribution, and its absolute value), change with time, or have other time
    # constants (first-order filters, from one sample to the whole recording).
    from scipy.signal import lfilter

    does, clock = contribution * level, unit_range(times)
    along, grids = does / max(float(np.abs(does).max()), TINY), _grids(times, records)
    step = _step(times)
    longest = max(float(np.ptp(grid)) for _, grid in grids)  # pauses between recordings do not count
    decays = np.exp(-step / np.geomspace(step, max(longest, 2.0 * step), FILTERS))
    columns = [along, along**2, along**3, np.abs(along), along * clock, along * clock**2]
    each = list(_bridged(along, grids))
    columns += [_counted([lfilter([1.0 - k], [1.0, -k], piece) for piece in each], grids) for k in decays]
    together = np.column_stack(columns) / np.reshape(level, (-1, 1))
    basis, sizes, _ = np.linalg.svd(together, full_matrices=False)
    return np.asarray(basis[:, sizes > ACCURACY * sizes[0]])


def limited(
    change: np.ndarray, does: np.ndarray, times: np.ndarray, records: np.ndarray, level: np.ndarray | float = 1.0
) -> np.ndarray:
    """Limit a change, (n,), in each octave of frequency to what an effect, (n,), does there and above.

    Both are over the noise's relative `level`, (n,). `records`, (n,), numbers the recordings, each of which begins anew:
    what is constant over one of them is not limited.
    """
    # Another law of a slow effect is slow, too; but that of a fast one may have slow parts, as a square has. A level that
    # changes fast is part of neither. Missing samples free no law, so gaps are bridged. A cosine transform of each
    # recording has no jump at its ends.
    from scipy.fft import dct, idct

    grids = _grids(times, records)
    longest = max(grid.size for _, grid in grids)
    where = np.concatenate(
        [
            np.floor(np.log2(np.maximum(np.arange(grid.size) * (longest / grid.size), 0.5))).astype(int)
            for _, grid in grids
        ]
    )
    spectra = [
        np.concatenate([dct(piece, norm="ortho") for piece in _bridged(rows, grids)])
        for rows in (change * level, does * level)
    ]
    own, other = (np.bincount(where + 1, weights=spectrum**2) for spectrum in spectra)
    above = np.cumsum(other[::-1])[::-1]
    shares = np.sqrt(np.minimum(np.divide(above, own, out=np.ones_like(own), where=own > 0.0), 1.0))
    shares[0] = 1.0
    kept = np.split(spectra[0] * shares[where + 1], np.cumsum([grid.size for _, grid in grids])[:-1])
    return _counted([idct(piece, norm="ortho") for piece in kept], grids) / level


def begun(change: np.ndarray, does: np.ndarray, records: np.ndarray, level: np.ndarray | float = 1.0) -> np.ndarray:
    """Limit a change, (n,), at each time to the most that an effect, (n,), has done by then in the same recording.

    Both are over the noise's relative `level`, (n,). `records`, (n,), numbers the recordings, each of which begins anew.
    """
    # An effect that has not begun cannot err, whatever its law: an event does nothing before its time.
    pieces = np.split(np.abs(does * level), 1 + np.flatnonzero(np.diff(records)))
    most = np.concatenate([np.maximum.accumulate(piece) for piece in pieces])
    return np.asarray(np.clip(change * level, -most, most) / level)


_Grids = list[tuple[np.ndarray, np.ndarray]]
"""Times of the samples of each recording, and equally spaced times from its first to its last sample."""


def _step(times: np.ndarray) -> float:
    steps = np.diff(times)
    return float(np.median(steps)) if steps.size else 1.0


def _grids(times: np.ndarray, records: np.ndarray) -> _Grids:
    step, clocks = _step(times), np.split(times, 1 + np.flatnonzero(np.diff(records)))
    return [(clock, np.linspace(clock[0], clock[-1], 1 + round(float(np.ptp(clock)) / step))) for clock in clocks]


def _bridged(values: np.ndarray, grids: _Grids) -> Iterator[np.ndarray]:
    """Yield the values, (n,), of each recording at equally spaced times, with straight lines over gaps."""
    pieces = np.split(values, np.cumsum([clock.size for clock, _ in grids])[:-1])
    return (np.interp(grid, clock, piece) for (clock, grid), piece in zip(grids, pieces, strict=True))


def _counted(pieces: Sequence[np.ndarray], grids: _Grids) -> np.ndarray:
    """Return the values at the samples, (n,), from those at equally spaced times."""
    pairs = zip(grids, pieces, strict=True)
    return np.concatenate([np.interp(clock, grid, piece) for (clock, grid), piece in pairs])


def unit_range(values: np.ndarray) -> np.ndarray:
    """Scale values to the range from -1 to 1."""
    low, high = float(values.min()), float(values.max())
    return np.zeros_like(values) if high == low else 2.0 * (values - low) / (high - low) - 1.0

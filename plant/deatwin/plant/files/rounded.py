"""Times that were stored with too few digits: in single precision, or to some decimals.

Each lies half of its own last digit off the clock, or a whole one where digits were cut off. Where all rows lie so near
to one even clock they were sampled evenly: an uneven clock drifts away from it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_FEW, _SHARE = 3, 0.1
"""Steps that differ from the usual one: their least number if times are rounded, and their least share of all steps if
times are rounded coarsely."""
_FINE = 0.7  # Digit, in steps, above which rounding is coarse: a lost or repeated row is off by a whole step
_SAME = 1e-6  # Relative difference from the usual step below which a step equals it
_SLACK = 0.1  # Tolerance of the fitted clock, in digits, because rounding moves it a little
_LOOKS = 500  # Number of times that are examined for their digits
_DECIMALS = range(13)
_EXACT = 1e-8  # Digit, s, that is too fine for the text of any single-precision number from 1 s on
_UNITS = (1.0, 1e3, 1e6, 1e9)  # Factors from s to the unit in which times may have been stored: s, ms, us or ns


@dataclass(frozen=True, kw_only=True)
class Rounded:
    """Even clock that fits rounded times."""

    sample_time: float  # Sample time, s
    start: float  # Time of the first row, s
    digit: float  # Least difference that the file can store, in the median row, s


def rounded_clock(timepts: Floats, stated: float | None = None) -> Rounded | None:
    """Return the even clock that fits times (n,) within their rounding, or None; only the `stated` one, s, if given."""
    steps = np.diff(timepts)
    usual = float(np.median(steps))
    odd = np.abs(steps - usual) > _SAME * abs(usual)
    if (steps < 0.0).any() or odd.sum() < (1 if stated else _FEW) or (digits := _digits(timepts)) is None:
        return None
    # If a digit is as coarse as a step, a few odd steps are lost or repeated rows rather than rounding.
    if float(np.median(digits)) > _FINE * usual > 0.0 and odd.mean() < _SHARE:
        return None
    ranks = np.arange(len(timepts)) - 0.5 * (len(timepts) - 1)
    fitted = float(ranks @ timepts / (ranks @ ranks))
    for sample_time in [stated] if stated else _simple(fitted):
        late = timepts - sample_time * np.arange(len(timepts))
        # Each time determines the start of the clock to within half its digit; one start must fit all times.
        latest, earliest = float((late + 0.5 * digits).min()), float((late - 0.5 * digits).max())
        if earliest - latest <= _SLACK * float(np.median(digits)):
            start = 0.5 * (latest + earliest)
            return Rounded(sample_time=sample_time, start=start, digit=float(np.median(digits)))
    return None


def each_as_often(timepts: Floats) -> bool:
    """Return whether all timestamps, except the first and last, appear in the same number of rows, two at least."""
    often = np.diff(np.flatnonzero(np.diff(timepts) > 0.0))
    return bool(often.size and often[0] > 1 and (often == often[0]).all())


def _simple(fitted: float) -> Iterator[float]:
    """Return sample times near a fitted one: first those with few digits, as time or rate; last the fitted one."""
    for digits in range(1, 6):
        yield float(f"{fitted:.{digits}g}")
        yield 1.0 / float(f"{1.0 / fitted:.{digits}g}")
    yield fitted


def _digits(timepts: Floats) -> Floats | None:
    """Return the last stored digit of each time, (n,) s; None for times with full double precision."""
    sizes = np.abs(timepts)
    single = _single(timepts)
    digits = np.zeros_like(sizes) if single is None else single
    powers = np.floor(np.log10(np.maximum(sizes, 1e-12)))
    finest = np.inf
    for power in np.unique(powers)[::-1]:  # larger numbers have no more decimals than smaller ones
        rows = powers == power
        decimals = next((d for d in _DECIMALS if _on_grid(timepts[rows], d)), None)
        if decimals is not None:
            finest = min(finest, 10.0**-decimals)
            # The shortest text of a single-precision number may be off by another half of its digit.
            coarse = digits[rows] * (1.0 if finest < _EXACT else 2.0)
            digits[rows] = np.where(digits[rows] > finest, coarse, finest)
        elif single is None:
            return None
    return digits


def _single(timepts: Floats) -> Floats | None:
    """Return the spacing of single-precision numbers, (n,) s; None if the times have higher precision."""
    looks = timepts[np.linspace(0, len(timepts) - 1, min(_LOOKS, len(timepts))).astype(int)]
    for unit in _UNITS:
        for known in (np.float64, str):
            back = np.array([float(known(np.float32(value))) for value in unit * looks]) / unit
            if np.allclose(back, looks, rtol=1e-14, atol=0.0):
                return np.spacing(np.abs(unit * timepts).astype(np.float32)).astype(np.float64) / unit
    return None


def _on_grid(values: Floats, decimals: int) -> bool:
    return bool(np.allclose(values, np.round(values, decimals), rtol=1e-14, atol=1e-15))

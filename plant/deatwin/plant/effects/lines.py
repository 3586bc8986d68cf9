"""Find oscillations of a residual, as starting points for effects with a frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEIGHBOURS = 101
"""Number of spectral bins above whose median a line must stand out: 25 times the resolution of the record, because the
spectrum is computed on a grid four times finer."""
HIGHEST = 0.48  # Highest frequency of a peak, as a share of the sampling rate: just below the half
CYCLES = 60  # Number of periods tried for a slow cycle, evenly spaced in their logarithm


@dataclass(frozen=True, kw_only=True)
class Tone:
    r"""A sine, :math:`a\cos(2\pi ft + \varphi)`."""

    amplitude: float  # Amplitude a, in the unit of the residual
    frequency: float  # Frequency f, Hz
    phase: float  # Phase :math:`\varphi` at clock 0, rad, between -pi and pi
    explained: float  # Share of the variance that the sine explains, 0 to 1


def tone_at(timepts: np.ndarray, values: np.ndarray, frequency: float) -> Tone:
    """Fit a sine with a constant at a frequency, Hz (Zechmeister & Kürster, Astron. Astrophys. 496 (2009) 577)."""
    angle = 2 * np.pi * frequency * timepts
    columns = np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    columns -= columns.mean(axis=0)
    level = values - values.mean()
    cosine, sine = np.linalg.lstsq(columns, level, rcond=None)[0]
    left = level - columns @ [cosine, sine]
    return Tone(
        amplitude=float(np.hypot(cosine, sine)),
        frequency=frequency,
        phase=float(np.arctan2(sine, cosine)),
        explained=float(1 - left @ left / max(level @ level, 1e-300)),
    )


def tones(timepts: np.ndarray, residual: np.ndarray, count: int = 3) -> tuple[Tone, ...]:
    """Return spectral lines of a residual (n,) that exceed their neighbourhood, best first."""
    from scipy.ndimage import median_filter

    if residual.size < 16:
        return ()
    left = residual - np.polynomial.Polynomial.fit(timepts, residual, 1)(timepts)
    found: list[Tone] = []
    for _ in range(count):
        frequencies, power = _periodogram(timepts, left)
        floor = median_filter(power, size=min(NEIGHBOURS, power.size), mode="reflect")
        # With fewer than one and a half cycles, a line cannot be distinguished from drift.
        inside = frequencies * np.ptp(timepts) >= 1.5
        if not (inside & (floor > 0)).any():
            break
        score = np.where(inside, power / np.maximum(floor, 1e-300), 0.0)
        tone = _refined(timepts, left, float(frequencies[np.argmax(score)]))
        left = left - tone.amplitude * np.cos(2 * np.pi * tone.frequency * timepts + tone.phase)
        found.append(tone)
    return tuple(found)


def slow_cycles(
    timepts: np.ndarray, residual: np.ndarray, periods: tuple[float, float], count: int = 3
) -> tuple[Tone, ...]:
    """Return slow cycles that explain most of a residual, best first. Shapes: `timepts` (n,); `residual` (n,)."""
    shortest, longest = periods[0], min(periods[1], 2 * float(np.ptp(timepts)))
    if longest <= shortest:
        return ()
    tried = [tone_at(timepts, residual, 1 / p) for p in np.geomspace(shortest, longest, CYCLES)]
    explained = np.array([t.explained for t in tried])
    return tuple(_refined(timepts, residual, tried[k].frequency) for k in _maxima(explained)[:count])


def spectral_peaks(
    timepts: np.ndarray, residual: np.ndarray, band: tuple[float, float], count: int = 4
) -> tuple[float, ...]:
    """Return peaks of Welch's spectrum in a `band`, Hz, highest first; none for fewer than 64 samples."""
    from scipy.signal import find_peaks, welch

    if residual.size < 64:
        return ()
    rate = 1 / _sample_time(timepts)
    frequencies, power = welch(residual, fs=rate, nperseg=min(256, residual.size))
    inside = (frequencies >= band[0]) & (frequencies <= min(band[1], HIGHEST * rate))
    peaks, seen = find_peaks(np.log(np.maximum(power[inside], 1e-300)), prominence=0.0)
    best = peaks[np.argsort(-seen["prominences"], kind="stable")][:count]
    return tuple(float(f) for f in frequencies[inside][best])


def _maxima(values: np.ndarray) -> list[int]:
    """Return positions of local maxima, highest first."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    peaks = np.flatnonzero((values >= padded[:-2]) & (values >= padded[2:]))
    return [int(k) for k in peaks[np.argsort(-values[peaks], kind="stable")]]


def _sample_time(timepts: np.ndarray) -> float:
    return float(np.median(np.diff(timepts)))


def _periodogram(timepts: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and power on a grid four times finer than the resolution of the record."""
    step = _sample_time(timepts)
    rows = np.rint((timepts - timepts.min()) / step).astype(int)
    even = np.zeros(int(rows.max()) + 1)
    np.add.at(even, rows, values)
    size = 4 * even.size
    return np.fft.rfftfreq(size, step), np.abs(np.fft.rfft(even, size)) ** 2


def _refined(timepts: np.ndarray, values: np.ndarray, frequency: float) -> Tone:
    """Return the best line near an approximate frequency."""
    from scipy.optimize import minimize_scalar

    width = 0.5 / float(np.ptp(timepts))
    found = minimize_scalar(
        lambda f: -tone_at(timepts, values, f).explained,
        bounds=(max(frequency - width, 0.1 * frequency), frequency + width),
        method="bounded",
        options={"xatol": 1e-4 * width},
    )
    return tone_at(timepts, values, float(found.x))

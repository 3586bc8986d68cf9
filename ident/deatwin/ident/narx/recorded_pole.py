"""Estimate the largest pole from recordings alone, by a long ARX model, with its standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from deatwin.ident.narx.long_arx import FOR_EACH, RESOLVED, first_samples
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording

_LAGS = 50
"""Most lags; Akaike's criterion chooses how many are needed. Sensor noise on a fast-sampled plant needs forty."""
_WIDE = 1.96  # Standard deviations on either side within which 95 % of a normal law lie
# Growth per sample that no sensible loop holds: the sensitivity of a loop one sample late is at least as large (Seron,
# Braslavsky & Goodwin, "Fundamental Limitations in Filtering and Control", Springer 1997, section 3.3).
_FASTEST = 2.0
_RARELY_LESS = 0.063  # Standard deviations on either side within which 5 % of a normal law lie


@dataclass(frozen=True, kw_only=True)
class RecordedPole:
    """Largest pole of a long ARX model, with the standard deviation of its magnitude. Outside the unit circle it is the
    plant's, even in a loop, if the controller sees no disturbance before the output shows it (Ljung, 1999, section
    13.4)."""

    pole: complex
    deviation: float

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the magnitude."""
        half = _WIDE * self.deviation
        return abs(self.pole) - half, abs(self.pole) + half


def recorded_pole(recordings: Sequence[Recording], first_lag: int = 1) -> RecordedPole | None:
    """Return the largest pole of recordings whose inputs act from `first_lag` on; None if they are too short, or if it
    cannot be the plant's, as after a low pass of the readings, which looks ahead."""
    signals = _scaled(recordings)
    n_inputs, n_outputs = len(signals[0][0]), len(signals[0][1])
    n_samples, width = sum(outputs.shape[1] for _, outputs in signals), n_inputs + n_outputs
    most = min(_LAGS, (n_samples // FOR_EACH - 1) // (width + len(signals)))
    signals = [one for one in signals if one[1].shape[1] > most]
    if most < 1 or not signals:
        return None
    head = 1 if first_lag else 1 + n_inputs
    columns = np.concatenate([_columns(*one, most, first_lag) for one in signals], axis=1)
    n = columns.shape[1]
    triangle = np.asarray(np.linalg.qr(columns.T, mode="r"), dtype=np.float64)
    tail = triangle[:, -n_outputs:]
    floor = n * RESOLVED**2 * np.eye(n_outputs)
    left = [tail[k:].T @ tail[k:] + floor for k in range(head, head + most * width + 1, width)]  # with 0, 1, ... lags
    costs = [
        n * np.linalg.slogdet(squares / n)[1] + 2.0 * n_outputs * width * lags for lags, squares in enumerate(left)
    ]
    lags = int(np.argmin(costs))
    if lags == 0:  # the outputs have no dynamics
        return RecordedPole(pole=0.0, deviation=0.0)
    size = head + lags * width
    inverse = np.linalg.pinv(triangle[:size, :size], rcond=1e-10)
    own = head + (np.arange(lags)[:, None] * width + np.arange(n_outputs)).ravel()
    theta, covariance = (inverse @ tail[:size])[own], (inverse @ inverse.T)[np.ix_(own, own)]
    found, drive = _largest(theta, covariance, left[lags] / (n - size))
    return None if _would_have_grown(found, drive, signals) else found


def _scaled(recordings: Sequence[Recording]) -> list[tuple[Array, Array]]:
    """Return moving inputs and all outputs of the first samples, without means and in standard deviations."""
    beginnings = first_samples(recordings)
    signals = []
    for kind in ("inputs", "outputs"):
        parts = [getattr(record, kind) for record in beginnings]
        together = np.concatenate(parts, axis=1)
        spread, moving = together.std(axis=1), np.ptp(together, axis=1) > 0.0
        kept = moving if kind == "inputs" else np.ones_like(moving)
        scale = np.where(moving, spread, 1.0)[kept, None]
        signals.append([(part[kept] - together.mean(axis=1)[kept, None]) / scale for part in parts])
    return list(zip(*signals, strict=True))


def _columns(inputs: Array, outputs: Array, most: int, first_lag: int) -> Array:
    """Return constant, inputs at lag 0 if they count, both signals at each lag, and the target; shape (n_columns, n)."""
    n = outputs.shape[1]
    lagged = [signal[:, most - lag : n - lag] for lag in range(1, most + 1) for signal in (outputs, inputs)]
    at_once = [] if first_lag else [inputs[:, most:]]
    return np.concatenate([np.ones((1, n - most)), *at_once, *lagged, outputs[:, most:]])


def _would_have_grown(found: RecordedPole, drive: Array, signals: Sequence[tuple[Array, Array]]) -> bool:
    """Return whether no loop holds the pole's mode, or whether in 19 of 20 cases the mode would have left the outputs'
    span while inputs stood still. `drive` (n_outputs,) is in standard deviations per sample; a plant resting on a stop
    counts as stable."""
    rate = float(np.log(max(found.interval[0], 1.0)))
    if rate == 0.0 or rate > np.log(_FASTEST):
        return rate > 0.0
    for inputs, outputs in signals:
        moved = np.flatnonzero(np.any(np.diff(inputs, axis=1) != 0.0, axis=0)) + 1
        lasted = max(end - begin for begin, end in pairwise([0, *moved.tolist(), outputs.shape[1]]))
        growth = lasted * rate - 0.5 * np.log(np.expm1(2.0 * rate))  # of the root of the sum of squares
        span = np.ptp(outputs, axis=1)
        if np.any(np.log(np.maximum(_RARELY_LESS * drive, np.finfo(float).tiny)) + growth > np.log(span + RESOLVED)):
            return True
    return False


def _largest(theta: Array, covariance: Array, noise: Array) -> tuple[RecordedPole, Array]:
    """Return the companion matrix' largest eigenvalue with its standard deviation, and the drive of its mode by output.
    Shapes: `theta` (lags * n_outputs, n_outputs); `covariance` (X'X)^-1 of its rows; `noise` (n_outputs, n_outputs)."""
    from scipy.linalg import eig

    n_outputs = theta.shape[1]
    companion = np.eye(theta.shape[0], k=-n_outputs)
    companion[:n_outputs] = theta.T
    values, left, right = eig(companion, left=True, right=True)
    which = int(np.argmax(np.abs(values)))
    value, row, column = values[which], left[:, which].conj(), right[:, which]
    turn = np.conj(value) / max(abs(value), np.finfo(float).tiny)
    slopes = np.real(turn * np.outer(row[:n_outputs], column) / (row @ column))
    variance = float(np.einsum("ij,ab,ia,jb->", noise, covariance, slopes, slopes))
    driven = np.sqrt(np.real(row[:n_outputs] @ noise @ row[:n_outputs].conj())) / abs(row @ column)
    drive = np.asarray(driven * np.abs(column[:n_outputs]), dtype=np.float64)
    return RecordedPole(pole=complex(value), deviation=max(variance, 0.0) ** 0.5), drive

"""Features for a quantity in the plant: functions of its signal, its rate, its past, and the clock."""

from __future__ import annotations

import numpy as np

from deatwin.ident.greybox.filter_linear import Linear
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.mismatch.thresholds import TINY
from deatwin.plant.arrays import Array
from deatwin.plant.effects.base import Place

TIMES = 8
"""Number of time constants of the low passes, from two samples to a third of the record."""
HINGES = (0.5, 0.75, 0.9, 0.97)
"""Quantiles of a signal at which a characteristic may bend."""
PLAYS = (0.01, 0.03, 0.1, 0.3)
"""Half widths of the play operators, as shares of the signal's range."""
STEEP = (0.1, 0.5)
"""Rates over which friction changes its sign, in standard deviations of the rate."""


def features(linear: Linear, opening: Opening) -> Array:
    """Return dimensionless features, (n, n_features), of which a combination may be what enters at a place."""
    # What enters at the drive can depend only on the command and its past; what enters elsewhere, on the motion and its
    # past, as the reading shows it. The features are polynomials and hinges of that signal, low passes of it and of its
    # square, and the square of the former, play operators (rate-independent memory), friction and drag of its rate; and
    # the clock.
    values = linear.states[signal_at(linear, opening)]
    signal = values / max(float(np.abs(values).max()), TINY)
    times = np.geomspace(2.0, max(signal.size / 3, 4.0), TIMES)
    clock = np.arange(signal.size)[:, None]
    columns = [
        np.ones((signal.size, 1)),
        1 - np.exp(-clock / times[TIMES // 2 :]),
        signal[:, None] ** np.arange(1, 4),
        np.maximum(signal[:, None] - np.quantile(signal, HINGES), 0.0),
        *(_past(signal, time) for time in times),
        np.stack([play(signal, share * np.ptp(signal)) for share in PLAYS], axis=1),
        _of_rate(signal),
    ]
    return np.hstack(columns)


def signal_at(linear: Linear, opening: Opening) -> str:
    """Return the name of the signal on which the unknown input at a place can depend."""
    rig = linear.plant.rig
    return rig.input_name if opening.place == Place.DRIVE.value else rig.output_name


def _past(signal: Array, time: float) -> Array:
    """Return low passes of a signal and of its square, and the square of the first; `time` in samples."""
    from scipy.signal import lfilter

    kept = np.exp(-1 / time)
    first, second = (
        lfilter([1 - kept], [1.0, -kept], course - course[0]) + course[0] for course in (signal, signal**2)
    )
    return np.stack([first, second, first**2], axis=1)


def play(signal: Array, width: float) -> Array:
    """Apply the play operator: the output follows the signal only when pushed by an end of the slot."""
    moved, at = [], float(signal[0])
    for value in signal.tolist():
        at = min(max(at, value - width), value + width)
        moved.append(at)
    return np.array(moved)


def _of_rate(signal: Array) -> Array:
    rate = np.gradient(signal)
    rate = rate / max(float(rate.std()), TINY)
    friction = [np.tanh(rate / steep) for steep in STEEP]
    return np.stack([rate, rate * np.abs(rate), *friction], axis=1)

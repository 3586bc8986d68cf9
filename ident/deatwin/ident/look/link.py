"""Whether an output follows an input at all, by coherence and by a whitened regression, and after what dead time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.excited import Excitation
from deatwin.ident.narx.preprocess import DeadTime, DeadTimeStatus, estimate_dead_time
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Array = NDArray[np.float64]

_SEGMENTS = 15
"""Behind Hann windows that overlap by half; so many tell a coherence of 0.5 from none at each of a hundred lines."""
_INDEPENDENT = _SEGMENTS / (1.0 + 2.0 / 36.0 * (1.0 - 1.0 / _SEGMENTS))
"""As many independent segments: neighbours have (1/6)^2 of their power in common (Welch, 1967)."""
_CHANCE = 0.01
_SHORTEST = 16
"""Samples of a segment, of which 8 lines remain."""


class LinkStatus(Enum):
    """Whether an output follows an input; the value is a sentence."""

    LINKED = "the output follows the input"
    EVEN = "the output follows the square of the input, and not the input itself"
    LOOP = "the output follows the input, and the input follows the output: a loop is suspected"
    UNSEEN = "nothing in the output follows the input beyond chance: check the columns and the wiring"
    UNTOLD = "not tested: the input or the output is constant, or the recording is too short"


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """What ties an output to an input.

    Parameters
    ----------
    input_name, output_name : str
        Names of the two signals.
    status : LinkStatus
        Whether there is a link.
    frequencies : ndarray, shape (n_lines,)
        Lines at which the coherence was estimated, in Hz; empty where the recording is too short.
    coherence, coherence_squared : ndarray, shape (n_lines,)
        Coherence of the output with the input, and with its square, from 0 to 1.
    chance : float
        Coherence that none of the lines of unlinked signals exceeds, but for 1 in 100 recordings.
    in_band : float or None
        Median coherence over the excited band; None without lines there.
    dead_time : DeadTime or None
        Estimated dead time; None where it could not be looked for.
    """

    input_name: str
    output_name: str
    status: LinkStatus
    frequencies: Array
    coherence: Array
    coherence_squared: Array
    chance: float
    in_band: float | None
    dead_time: DeadTime | None

    def __str__(self) -> str:
        text = f"{self.input_name} to {self.output_name}: {self.status.value}"
        if self.in_band is not None:
            text += f"; coherence {self.in_band:.2g} in the excited band (median; chance reaches {self.chance:.2g})"
        if self.dead_time is not None and self.dead_time.samples is not None and self.dead_time.interval is not None:
            low, high = self.dead_time.interval
            text += f"; dead time {self.dead_time.samples} samples, {self.dead_time.seconds:.4g} s ({low} to {high} samples)"
        return text


def links_of(records: Sequence[Recording], excitations: Sequence[Excitation | None]) -> tuple[Link, ...]:
    """Return the link of each input to each output. `excitations` one for each input."""
    longest = max(records, key=lambda record: record.n_samples)
    found = []
    for row in range(longest.outputs.shape[0]):
        try:
            dead_times: Sequence[DeadTime | None] = estimate_dead_time(records, output=row)
        except ModelError:  # a constant output
            dead_times = [None] * longest.inputs.shape[0]
        found += [
            _link(longest, column, row, excited, dead_time)
            for column, (excited, dead_time) in enumerate(zip(excitations, dead_times, strict=True))
        ]
    return tuple(found)


def _link(record: Recording, column: int, row: int, excited: Excitation | None, dead_time: DeadTime | None) -> Link:
    u, y = record.inputs[column], record.outputs[row]
    frequencies = plain = squared = np.empty(0)
    chance, in_band = 1.0, None
    inside = np.empty(0, dtype=bool)
    if u.size // ((_SEGMENTS + 1) // 2) >= _SHORTEST and np.ptp(u) > 0.0 and np.ptp(y) > 0.0:
        frequencies, plain = _coherence(u, y, record.sample_time)
        squared = _coherence(u**2, y, record.sample_time)[1] if np.ptp(u**2) > 0.0 else np.zeros_like(plain)
        bands = ((0.0, np.inf),) if excited is None else excited.bands
        inside = np.any([(frequencies >= low) & (frequencies <= high) for low, high in bands], axis=0)
        inside = inside if inside.any() else np.ones_like(inside)
        chance = 1.0 - (_CHANCE / inside.sum()) ** (1.0 / (_INDEPENDENT - 1.0))
        in_band = float(np.median(plain[inside]))
    return Link(
        input_name=record.input_names[column],
        output_name=record.output_names[row],
        status=_status(plain[inside], squared[inside], chance, dead_time),
        frequencies=frequencies,
        coherence=plain,
        coherence_squared=squared,
        chance=chance,
        in_band=in_band,
        dead_time=dead_time,
    )


def _coherence(u: Array, y: Array, sample_time: float) -> tuple[Array, Array]:
    """Return frequencies above 0 Hz in Hz, and the coherence there. Shapes: `u, y` (n,); returns (n_lines,) each."""
    from scipy.signal import coherence

    length = 2 * u.size // (_SEGMENTS + 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        frequencies, found = coherence(u, y, 1.0 / sample_time, nperseg=length, detrend="linear")
    return frequencies[1:], np.nan_to_num(found[1:])


def _status(plain: Array, squared: Array, chance: float, dead_time: DeadTime | None) -> LinkStatus:
    """Return what coherence and regression say together: each of them sees links that the other does not."""
    found = None if dead_time is None else dead_time.status
    if found is DeadTimeStatus.LOOP and dead_time is not None and dead_time.samples is not None:
        return LinkStatus.LOOP
    if found in (DeadTimeStatus.FOUND, DeadTimeStatus.AT_ONCE) or np.any(plain > chance):
        return LinkStatus.LINKED
    if np.any(squared > chance):
        return LinkStatus.EVEN
    tested = plain.size or found is DeadTimeStatus.UNSEEN
    return LinkStatus.UNSEEN if tested else LinkStatus.UNTOLD

"""Test whether an output follows an input, by coherence and a whitened regression, and estimate the dead time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.excited import Excitation
from deatwin.ident.narx.preprocess import DeadTime, DeadTimeStatus, estimate_dead_time
from deatwin.plant.arrays import Array
from deatwin.plant.copies import Frozen
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

_SEGMENTS = 15
"""Behind Hann windows that overlap by half; so many tell a coherence of 0.5 from none at each of a hundred lines."""
_INDEPENDENT = _SEGMENTS / (1.0 + 2.0 / 36.0 * (1.0 - 1.0 / _SEGMENTS))
"""As many independent segments: neighbours have (1/6)^2 of their power in common (Welch, 1967)."""
_CHANCE = 0.002  # Of each of the two coherences; with the regression, whose chance is 1 %, 1.4 % together
_BESIDE = 1.5  # Lines behind a Hann window that tell as much as one independent line: its noise bandwidth
LINE_CHANCE = 1.0 - _CHANCE ** (1.0 / (_INDEPENDENT - 1.0))
"""Coherence that one line of unlinked signals exceeds in 1 of 500 recordings."""
_FAINT = 0.1
"""Share of the mean power of the excited lines below which a line holds what leaks from others, as between harmonics."""
_EVEN = 2.0
"""Times the coherence with the input that that with its square must be: with an offset both follow, and alike."""
_DRIFT = 3  # First line that a drift does not reach: a Hann window smears it over the two above 0 Hz
_FEWEST_LINES = 3  # Excited lines from which on a mean over them is one; slower inputs move once or twice in a segment
_SHORTEST = 16  # Samples of a segment, of which 8 lines remain


class LinkStatus(Enum):
    """Answer to the question whether an output follows an input; each value is a sentence."""

    LINKED = "the output follows the input"
    EVEN = "the output follows the square of the input, and not the input itself"
    LOOP = (
        "the output follows the input, and the output's past predicts the input: the recording was made in a closed loop, or the "
        "input was measured with noise"
    )
    UNSEEN = "the output follows the input no more than chance explains: check the columns and the wiring"
    SLOW = "the input varies too slowly or too rarely to distinguish a response from a drift"
    SHORT = "not tested: the recording is too short"
    STILL = "not tested: the input or the output is constant"


@dataclass(frozen=True, kw_only=True, eq=False)
class Link(Frozen):
    """Result of testing one input and one output: status, coherence and dead time."""

    input_name: str
    output_name: str
    status: LinkStatus
    frequencies: Array  # shape (n_lines,): where the coherence was estimated, Hz; empty where that was not possible
    coherence: Array  # shape (n_lines,): with the input
    coherence_squared: Array  # shape (n_lines,): with its square
    chance: float  # Mean over the excited band that unlinked signals exceed in 1 of 500 recordings
    in_band: float | None  # Mean over the excited band; None without lines there
    dead_time: DeadTime | None  # None where it could not be looked for

    def __str__(self) -> str:
        text = f"{self.input_name} to {self.output_name}: {self.status.value}"
        if self.in_band is not None:
            text += f"; coherence {self.in_band:.2g} in the excited band (chance alone gives up to {self.chance:.2g})"
        interval = None if self.dead_time is None or self.status is LinkStatus.EVEN else self.dead_time.interval
        if self.dead_time is not None and self.dead_time.samples is not None and interval is not None:
            low, high = interval
            unit = "sample" if self.dead_time.samples == 1 else "samples"
            text += f"; dead time {self.dead_time.samples} {unit}, {self.dead_time.seconds:.4g} s (95 % interval {low} to {high} samples)"
        return text


def links_of(records: Sequence[Recording], excitations: Sequence[Excitation | None]) -> tuple[Link, ...]:
    """Test each pair of input and output. `excitations` holds one entry per input."""
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
    moves = np.ptp(u) > 0.0 and np.ptp(y) > 0.0
    frequencies = plain = squared = np.empty(0)
    chance, in_band, in_band_squared = 1.0, None, 0.0
    if moves and u.size // ((_SEGMENTS + 1) // 2) >= _SHORTEST:
        frequencies, plain, power = _coherence(u, y, record.sample_time)
        squared, power_squared = np.zeros_like(plain), np.zeros_like(plain)
        if np.ptp(u**2) > 0.0:
            _, squared, power_squared = _coherence(u**2, y, record.sample_time)
        bands = () if excited is None else excited.bands
        inside = np.zeros(plain.size, dtype=bool)
        for low, high in bands:
            inside |= (frequencies >= low) & (frequencies <= high)
        inside &= power > _FAINT * power[inside].mean() if inside.any() else inside
        of_square = inside
        if inside.sum() < _FEWEST_LINES:  # a tone, which the end of a band may cut, or a slow input
            inside, of_square = _tones(power), _tones(power_squared)
        if inside.any():
            chance = _mean_by_chance(max(min(inside.sum(), of_square.sum() or np.inf) / _BESIDE, 1.0))
            in_band = float(plain[inside].mean())
            in_band_squared = float(squared[of_square].mean()) if of_square.any() else 0.0
    status = _status(dead_time, in_band or 0.0, in_band_squared, chance)
    if status is LinkStatus.UNSEEN and in_band is None:
        status = LinkStatus.SLOW if frequencies.size else LinkStatus.SHORT
    return Link(
        input_name=record.input_names[column],
        output_name=record.output_names[row],
        status=status if moves else LinkStatus.STILL,
        frequencies=frequencies,
        coherence=plain,
        coherence_squared=squared,
        chance=chance,
        in_band=in_band,
        dead_time=dead_time,
    )


def _tones(power: Array) -> NDArray[np.bool_]:
    """Return the lines that hold tones; none if the strongest line is one that a drift also fills. `power` (n,)."""
    strong = power > _FAINT * power.max()
    strong[: _DRIFT - 1] = False
    return strong if np.argmax(power) >= _DRIFT - 1 and power.max() > 0.0 else np.zeros_like(strong)


def _mean_by_chance(lines: float) -> float:
    """Return the mean coherence that unlinked lines exceed once in 500: it is a gamma variable."""
    from scipy.special import gammainccinv

    return float(gammainccinv(lines, _CHANCE) / (lines * _INDEPENDENT))


def _coherence(u: Array, y: Array, sample_time: float) -> tuple[Array, Array, Array]:
    """Return frequencies above 0 Hz, coherence and the input's power, (n_lines,) each. Shapes: `u, y` (n,)."""
    from scipy.signal import coherence, welch

    about = {"fs": 1.0 / sample_time, "nperseg": 2 * u.size // (_SEGMENTS + 1), "detrend": "linear"}
    with np.errstate(invalid="ignore", divide="ignore"):
        frequencies, found = coherence(u, y, **about)
    return frequencies[1:], np.nan_to_num(found[1:]), welch(u, **about)[1][1:]


def _status(dead_time: DeadTime | None, plain: float, squared: float, chance: float) -> LinkStatus:
    """Combine regression and mean coherence, because each detects links that the other misses."""
    acts = dead_time is not None and dead_time.interval is not None
    # Where the square explains the output, what the regression takes for a weak linear effect is chance.
    if squared > chance and squared > _EVEN * plain and not (acts and plain > chance):
        return LinkStatus.EVEN
    if acts and dead_time is not None and dead_time.status is DeadTimeStatus.LOOP:
        return LinkStatus.LOOP
    return LinkStatus.LINKED if acts or plain > chance else LinkStatus.UNSEEN

"""Classify an input: find its shape, its levels, and the period after which it repeats itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.ident.narx.levels import few_levels
from deatwin.ident.narx.repeats import period_of
from deatwin.ident.soundness import noise_of_bends, runs
from deatwin.plant.arrays import Array

_STILL = 1e-9  # Share of the range by which a held level may move: what arithmetic and decimal files make of one level
_NOISY = 0.02  # Share of the range above which what is fast in a signal is its motion and no noise upon levels
_SIGMAS = 4.0
"""Standard deviations of its noise within which a measured level counts as held: 1 value in 16 000 lies farther off."""
_MOSTLY = 0.5  # Share of the samples that holds make up where the signal consists of them
_HELD = 3  # Changes of nothing in a row from which on it is a hold; shorter ones come of coarse readings, too
_PURE = 0.9  # Share of the speeds, or of the power, that the same few make up where a signal consists of them
_CLEAR, _SAME_SPEED = 30.0, 0.1  # A rise this many times the noise tells its speed within a tenth, twice over
_SLOW_LINES = 3
_TONE_LINES = 9
"""Three tones hold 90 % of their power in three lines each behind a Hann window, whose main lobe is that wide."""
_FEWEST = 16  # Samples below which no shape is told


class InputShape(Enum):
    """Shape of an input over time; each value is a phrase for a sentence."""

    CONSTANT = "constant"
    TWO_LEVEL = "two levels"
    STEPS = "steps between levels that are held"
    RAMPS = "straight ramps"
    TONES = "one or a few sine tones"
    NOISE = "many frequencies, as in noise"
    SHORT = "too few samples to recognise its shape"


@dataclass(frozen=True, kw_only=True)
class InputPattern:
    """Shape and period of an input."""

    name: str
    shape: InputShape
    levels: int  # Of an input that is constant, has two levels, or holds them without noise; else 0
    hold_s: float | None  # Median time for which a level is held, s; None where none is
    period_s: float | None  # Time after which the input repeats itself, twice at least, s
    periods: int  # Whole ones; 0 where it does not repeat itself

    def __str__(self) -> str:
        text = self.shape.value
        if self.shape is InputShape.STEPS and self.levels:
            text += f", {self.levels} levels"
        if self.hold_s is not None:
            text += f", each held for {self.hold_s:.3g} s (median)"
        if self.periods:
            text += f", {self.periods} periods of {self.period_s:.4g} s"
        return text


def pattern_of(name: str, values: Array, sample_time: float) -> InputPattern:
    """Return the shape and the period of an input. `values` (n,); `sample_time` s."""
    shape, levels, hold = _shape(values)
    period = None if shape in (InputShape.CONSTANT, InputShape.SHORT) else period_of(values)
    return InputPattern(
        name=name,
        shape=shape,
        levels=levels,
        hold_s=None if hold is None else hold * sample_time,
        period_s=None if period is None else period * sample_time,
        periods=0 if period is None else int((values.size + 0.5) // period),
    )


def _shape(values: Array) -> tuple[InputShape, int, float | None]:
    """Return the shape, the number of levels and the median hold in samples."""
    span = float(np.ptp(values))
    if not span > 0.0:
        return InputShape.CONSTANT, 1, None
    if values.size < _FEWEST:
        return InputShape.SHORT, 0, None
    noise = noise_of_bends(values)
    exact = noise <= _STILL * span
    still = _STILL * span if exact or noise > _NOISY * span else _SIGMAS * noise
    holds = [run for run in runs(np.abs(np.diff(values)) <= 2.0 * still) if np.ptp(values[run]) <= 2.0 * still]
    if exact and few_levels(values, 2).size == 2:
        return InputShape.TWO_LEVEL, 2, float(np.median([run.size + 1 for run in holds] or [1]))
    holds = [run for run in holds if run.size >= _HELD]
    if sum(run.size for run in holds) > _MOSTLY * values.size:
        hold = float(np.median([run.size + 1 for run in holds]))
        centre = 0.5 * (values.max() + values.min())
        spreads = [np.ptp(np.percentile(part, (2, 98))) for part in (values[values > centre], values[values <= centre])]
        if max(spreads) <= 2.0 * still:
            return InputShape.TWO_LEVEL, 2, hold
        return InputShape.STEPS, few_levels(values, values.size // 2).size if exact else 0, hold
    if _straight(values, noise):
        return InputShape.RAMPS, 0, None
    return InputShape.TONES if _tonal(values) else InputShape.NOISE, 0, None


def _straight(values: Array, noise: float) -> bool:
    """Return whether a signal nearly always rises, and falls, at one speed, judged over steps larger than the noise."""
    step = 1
    while step <= values.size // 20:
        rises = values[step:] - values[:-step]
        if np.median(np.abs(rises)) > _CLEAR * noise:
            usual = [
                float(np.median(part)) if (part := rises[rises * sign > 0.0]).size else 0.0 for sign in (1.0, -1.0)
            ]
            off = np.abs(rises - np.where(rises > 0.0, *usual))
            return bool((off <= _SAME_SPEED * np.abs(np.where(rises > 0.0, *usual))).mean() > _PURE)
        step *= 2
    return False


def _tonal(values: Array) -> bool:
    """Return whether a few lines hold nearly all power; the lowest lines, which a drift fills, are ignored."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(values.size))) ** 2
    few = np.sort(power[_SLOW_LINES:])[-_TONE_LINES:]
    return values.size > 8 * _TONE_LINES and bool(few.sum() > _PURE * power.sum())

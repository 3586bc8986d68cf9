"""Test whether a residual belongs to the plant or to a disturbance that no model of the plant can predict.

First, patterns are removed that the catalogue's physics may cause although they do not repeat with the command: slow
drifts and steps of level and gain, effects of the largest motion so far, and tones. Nothing is concluded if less than a
mismatch remains. If commands were repeated, the remainder repeats with them if it belongs to the plant. Without repeats
there is only a weaker test: a disturbance cannot be predicted, in parts that the predictor has not seen, from command,
motion and their past; neither can its size. White noise is a disturbance even if its size can be predicted, as for
noise that grows with the reading, because a plant's residual has memory. Between the bounds nothing is decided.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from deatwin.ident.greybox.tangent import taken_off
from deatwin.ident.mismatch.detect.leftover import Leftover
from deatwin.ident.mismatch.detect.null import error_terms
from deatwin.ident.mismatch.excess import beyond_noise
from deatwin.ident.mismatch.locate.closure import play
from deatwin.ident.mismatch.quality.bursts import BEND, has_lines
from deatwin.ident.mismatch.quality.repeats import Repeats, repeatability
from deatwin.ident.mismatch.result import OriginSummary
from deatwin.ident.mismatch.thresholds import (
    BLOCK_SAMPLES,
    DEVIATIONS,
    FEWEST_SAMPLES,
    MOST,
    PRACTICAL_SHARE,
    ROUNDING,
    TINY,
)
from deatwin.ident.soundness import neighbours_deviation

FOREIGN = 0.3
"""Repeatable share of a residual: a disturbance's is certainly below it; that of the plant is certainly above `MOST`."""
COSINES = 8
"""Number of slow cosines per experiment that count as drift of level or gain."""
STEPS, TONES = 2, 3
STEP_TIMES = 60
FOLDS = 6
RIDGES = 10.0 ** np.arange(-3, 4)
"""Penalties of the predictor, as shares of the variance, of which the best one is used."""
PLAYS = (0.05, 0.2)
"""Widths of two play operators, as shares of the range of the motion."""
FEWEST_SECONDS = 20.0
"""Smallest duration of recordings from which anything is concluded without repeats."""


class Origin(Enum):
    """Origin of a residual."""

    PLANT = "plant"
    DISTURBANCE = "disturbance"
    UNDECIDED = "undecided"


def origin_of(left: Leftover, repeats: Repeats | None, practical: float) -> OriginSummary:
    """Decide whether a residual comes from the plant or a disturbance; `practical` is the rms that counts, SI."""
    rest = without_forms(left)
    size = beyond_noise(float(np.mean(rest**2)), left.noise)
    noise, samples = _is_noise(left), left.residual.size
    if samples < FEWEST_SAMPLES or not (noise or (size >= practical and samples * left.sample_time >= FEWEST_SECONDS)):
        return OriginSummary.none(size)
    if repeats is not None:
        found = repeatability(rest, repeats, left.noise)
        low, share, high = found.low, found.share, found.high
        # A residual that repeats with the opposite sign also repeats.
        foreign, own, by = max(high, -low) < FOREIGN, low > MOST, "repeats"
    else:
        terms = _predictors(left)
        low, share, high = _predictable(rest, terms, left.noise**2)
        tied = _predictable(rest**2 - np.mean(rest**2), terms, 0.0)[2] >= PRACTICAL_SHARE
        foreign = share < PRACTICAL_SHARE if noise else high < PRACTICAL_SHARE and not tied
        own, by = low > MOST, "prediction"
    origin = Origin.DISTURBANCE if foreign else Origin.PLANT if own else Origin.UNDECIDED
    return OriginSummary(by=by, share=share, low=low, high=high, left=size, conclusion=origin.value)


def _is_noise(left: Leftover) -> bool:
    """Return whether the residual beyond the noise is mostly white noise, possibly of varying level."""
    pieces = [left.residual[r] for r in left.records if r.stop - r.start >= BLOCK_SAMPLES]
    if not pieces:
        return False
    bends = np.concatenate([neighbours_deviation(piece)[2:-2] for piece in pieces])
    white, whole = float(np.mean(bends**2)) / BEND, float(np.mean(np.concatenate(pieces) ** 2))
    if whole - white >= white - left.noise**2:
        return False
    levels = [np.sqrt(np.convolve(piece**2, np.ones(BLOCK_SAMPLES) / BLOCK_SAMPLES, "same")) for piece in pieces]
    return not any(has_lines(piece / level) for piece, level in zip(pieces, levels, strict=True))


@dataclass(frozen=True, eq=False)
class _Forms:
    """Orthonormal bases of the patterns within each experiment, and of further ones, (n, k), beside these."""

    within: tuple[tuple[slice, np.ndarray], ...]
    further: np.ndarray

    def taken_off(self, values: np.ndarray) -> np.ndarray:
        """Return the part of values, (n,) or (n, j), that no pattern explains."""
        # One basis for all experiments would take their number squared times as long.
        rest = values.copy()
        for inside, basis in self.within:
            rest[inside] = taken_off(rest[inside], basis)
        return taken_off(rest, self.further)

    def beside(self, columns: np.ndarray) -> _Forms:
        """Return the bases with further columns, (n, j)."""
        left, length = self.taken_off(columns), np.linalg.norm(columns, axis=0)
        new = np.linalg.norm(left, axis=0) > ROUNDING * length  # a tone may be found twice
        return _Forms(self.within, np.concatenate([self.further, _orthonormal(left[:, new])], axis=1))


def without_forms(left: Leftover) -> np.ndarray:
    """Return the residual, (n,), without drifts and steps of level and gain, effects of the largest motion, and tones."""
    moves = left.readings - left.readings.mean()
    moves = moves / max(float(moves.std()), TINY)
    edges = [0, *(np.flatnonzero(np.diff(left.experiment)) + 1).tolist(), moves.size]
    each = [slice(first, last) for first, last in pairwise(edges)]
    within = ((own, _orthonormal(_patterns(left.timepts[own], left.readings[own], moves[own]))) for own in each)
    forms = _Forms(tuple(within), np.empty((moves.size, 0)))
    rest = forms.taken_off(left.residual)
    for _ in range(STEPS):
        forms = forms.beside(_best_step(left, rest, forms, moves))
        rest = forms.taken_off(rest)
    for _ in range(TONES):
        forms = forms.beside(_best_tone(left, rest))
        rest = forms.taken_off(rest)
    return rest


def _patterns(timepts: np.ndarray, readings: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return slow drifts and effects of the largest motion so far in an experiment, of level and gain, (n, k)."""
    phase = np.pi * (timepts - timepts[0]) / max(timepts[-1] - timepts[0], TINY)
    slow = np.cos(phase[:, None] * np.arange(COSINES + 1))
    # film that is stretched further softens once
    farthest = np.stack([extreme.accumulate(readings) for extreme in (np.maximum, np.minimum)], axis=1)
    return np.concatenate([slow, slow * moves[:, None], farthest, farthest * moves[:, None]], axis=1)


def _best_step(left: Leftover, rest: np.ndarray, forms: _Forms, moves: np.ndarray) -> np.ndarray:
    """Return a step of level and one of gain, at the time at which they explain most of the residual."""
    best, gain = np.zeros((rest.size, 2)), 0.0
    for position in np.linspace(0, rest.size, STEP_TIMES + 2)[1:-1].astype(int):
        after = np.zeros(rest.size)
        after[position:] = left.experiment[position:] == left.experiment[position]
        step = np.stack([after, after * moves], axis=1)
        explained = float(np.sum((_orthonormal(forms.taken_off(step)).T @ rest) ** 2))
        if explained > gain:
            best, gain = step, explained
    return best


def _best_tone(left: Leftover, rest: np.ndarray) -> np.ndarray:
    """Return sine and cosine at the strongest line, whose frequency may lie between the lines of the transform."""
    lines = 4 * rest.size
    power = np.abs(np.fft.rfft(rest, n=lines)) ** 2
    frequency = np.argmax(power) / lines / left.sample_time
    phase = 2 * np.pi * frequency * left.timepts
    return np.stack([np.cos(phase), np.sin(phase)], axis=1)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis of the space that columns span."""
    scale = np.linalg.norm(columns, axis=0)
    tall, small = np.linalg.qr(columns / np.where(scale > 0, scale, 1.0))
    left, singular, _ = np.linalg.svd(small)
    return np.asarray(tall @ left[:, singular > ROUNDING * max(float(singular.max(initial=0.0)), TINY)])


def _predictors(left: Leftover) -> np.ndarray:
    """Return predictors that a plant could form from the command: motion, its past, rates, their signs, backlash."""
    reading, command = left.readings, left.commands
    rate = np.concatenate([np.gradient(reading[r]) if reading[r].size > 1 else 0 * reading[r] for r in left.records])
    drive = np.concatenate([np.gradient(command[r]) if command[r].size > 1 else 0 * command[r] for r in left.records])
    usual = max(float(np.std(rate)), TINY)
    plays = [play(reading, width * float(np.ptp(reading))) for width in PLAYS]
    columns = [
        error_terms(left)[0],
        *(
            x[:, None]
            for x in (
                rate,
                np.abs(rate),
                rate * np.abs(rate),
                np.tanh(10 * rate / usual),
                drive,
                np.abs(drive),
                command,
                command**2,
                *plays,
                *(reading - play for play in plays),
            )
        ),
    ]
    together = np.concatenate(columns, axis=1)
    together = together - together.mean(axis=0)
    deviation = together.std(axis=0)
    return together[:, deviation > 0] / deviation[deviation > 0]


def _predictable(values: np.ndarray, terms: np.ndarray, noise: float) -> tuple[float, float, float]:
    """Return the share of the variance beyond noise that ridge regression predicts in unseen folds, between bounds."""
    # The bounds come from a jackknife over the folds. The upper one is the largest over all penalties, so that a
    # residual does not count as unpredictable because of the choice of the penalty.
    folds = np.minimum(np.arange(values.size) * FOLDS // values.size, FOLDS - 1)
    grams = [terms[folds == k].T @ terms[folds == k] for k in range(FOLDS)]
    crosses = [terms[folds == k].T @ values[folds == k] for k in range(FOLDS)]
    lost = np.zeros((FOLDS, RIDGES.size))
    for k in range(FOLDS):
        weights, vectors = np.linalg.eigh(sum(grams) - grams[k])
        seen = vectors.T @ (sum(crosses) - crosses[k])
        penalties = values.size * RIDGES
        estimates = vectors @ (seen[:, None] / (np.maximum(weights, 0.0)[:, None] + penalties))
        lost[k] = np.mean((values[folds == k, None] - terms[folds == k] @ estimates) ** 2, axis=0)
    before = np.array([np.mean(values[folds == k] ** 2) for k in range(FOLDS)])
    gained = before[:, None] - lost

    def share(kept: np.ndarray) -> np.ndarray:
        total = np.mean(before[kept])
        return np.asarray(np.mean(gained[kept], axis=0) / max(total - noise, PRACTICAL_SHARE * total))

    out = np.stack([share(np.arange(FOLDS) != k) for k in range(FOLDS)])
    deviation = np.sqrt((FOLDS - 1) * np.mean((out - out.mean(axis=0)) ** 2, axis=0))
    middle = share(np.arange(FOLDS) >= 0)
    best = int(np.argmax(middle))
    return (
        float(middle[best] - DEVIATIONS * deviation[best]),
        float(middle[best]),
        float(np.max(middle + DEVIATIONS * deviation)),
    )

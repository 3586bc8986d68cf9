"""Estimate the sensor's noise from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.ident.mismatch.excess import PRACTICAL_SHARE
from deatwin.ident.mismatch.quality.repeats import Repeats
from deatwin.ident.soundness import neighbours_deviation, runs, samples_in

MIDDLE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""Weights of five values in `neighbours_deviation`: white noise passes, and hardly anything of a smooth signal."""
TOP_OF_SPECTRUM = 0.8
"""Share of the Nyquist frequency above which a residual is taken to be sensor noise."""
SHEET_TOLERANCE = float(np.sqrt(1.0 + PRACTICAL_SHARE))
"""Nothing that counts as a mismatch may be left of a noise that is said to be as the sheet has it,"""
SCATTER = 4.4
"""but for two standard errors of the spectrum's top: each is 2.2 over the root of the samples, of white noise."""
FEWEST_OF_A_PIECE = 8
"""Samples of a record from which its spectrum tells anything."""
SEGMENT_SAMPLES = 64
"""Length of a segment, so short that ringing after a step or a reversal is in few of them."""
REST_SECONDS = 4.0
"""A command must have stood still for this long before the readings rest,"""
REST_SHARE = 0.002
"""within this share of its range."""
FEWEST = 200
"""Samples from which a noise can be told."""
KNOTS = 15
"""Values of a signal, in the middles of as many equal shares of its samples, between which the logarithm of the noise's
variance runs straight."""
RISES = (0.1, 0.3, 1.0, 3.0)
"""Deviations beforehand by which that changes from knot to knot, all alike likely: by a tenth up to a factor of 20."""
SURE = float(np.log(20.0))
"""Log odds from which on the level varies: of constant noise, at most 1 in 20 reaches odds of 20."""
ANY = 10.0
"""Deviation of that logarithm beforehand: a factor of e^10 either way."""
LOG_MEAN, LOG_VARIANCE = -float(np.euler_gamma + np.log(2.0)), float(np.pi**2 / 2.0)
"""Mean and variance of the logarithm of a squared standard normal variable."""
TIED = tuple(
    float(np.sum(MIDDLE[lag:] * MIDDLE[: MIDDLE.size - lag]) / np.sum(MIDDLE**2)) for lag in range(1, MIDDLE.size)
)
"""Correlations of neighbouring deviations of white noise from the cubic through four neighbours."""


class NoiseSource(Enum):
    """Source of the noise level."""

    SHEET = "the data sheet"
    REPEATS = "differences between repeats of the same command"
    RESTS = "the readings while the command rests"
    TOP_OF_SPECTRUM = "the top of the residual's spectrum"


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """The sensor's noise, and what each source says of it."""

    level: float  # standard deviation, SI
    source: NoiseSource  # the one that was believed
    estimates: dict[NoiseSource, float]  # what each available source says, SI

    @property
    def sentence(self) -> str:
        """Return a sentence that says where the noise level comes from."""
        return f"the noise is estimated from {self.source.value}"


def noise_level(
    residuals: Sequence[np.ndarray],
    sample_time: float,
    sheet: float,
    commands: Sequence[np.ndarray] = (),
    repeats: Repeats | None = None,
) -> NoiseFloor:
    """Return the sensor's noise by its data sheet (`sheet`, SI; 0 if none) unless all other sources say clearly more.

    Then, and without a data sheet, the source that says least is believed. Shapes: `residuals` of a calibrated plant,
    SI, and `commands` (n_r,) each.
    """
    # Differences between repeats of a command are free of whatever the plant lacks; readings at rest are free of what
    # it lacks in motion; the top of the residual's spectrum is free of what it lacks at low frequencies. Each can only
    # say too much: repeats where a disturbance comes in, rests where it is there too, the spectrum where fast motion is
    # missing. What a sensor does in a rig is seldom less than its data sheet says.
    found: dict[NoiseSource, float] = {}
    if repeats is not None and repeats.first.size >= FEWEST:
        together = np.concatenate(residuals)
        apart = (together[repeats.first] - together[repeats.second]) / np.sqrt(2)
        found[NoiseSource.REPEATS] = _white([apart], 0.0)
    resting = [piece for e, u in zip(residuals, commands, strict=False) for piece in _at_rest(e, u, sample_time)]
    if sum(piece.size for piece in resting) >= FEWEST:
        found[NoiseSource.RESTS] = _white([np.concatenate([piece - piece.mean() for piece in resting])], 0.0)
    found[NoiseSource.TOP_OF_SPECTRUM] = _white(residuals, TOP_OF_SPECTRUM)
    # Where readings come in steps, none may be seen to change in a rest.
    seen = {source: level for source, level in found.items() if level > 0.0} or found
    best = min(seen, key=lambda source: seen[source])
    samples = sum(residual.size for residual in residuals)
    if sheet == 0.0 or found[best] > (SHEET_TOLERANCE + SCATTER / np.sqrt(samples)) * sheet:
        return NoiseFloor(level=found[best], source=best, estimates=found)
    return NoiseFloor(level=sheet, source=NoiseSource.SHEET, estimates={NoiseSource.SHEET: sheet, **found})


def noise_levels(
    residuals: Sequence[np.ndarray], signals: Sequence[Sequence[np.ndarray]], least: float
) -> tuple[np.ndarray, ...] | None:
    """Estimate how the level of white noise varies with one of some signals; None if it does not, or is not white.

    Shapes: `residuals` (n_r,) each, SI, nan where unknown; `signals` likewise, each over all records; returns (n_r,)
    each, relative to the root of the harmonic mean of the variance. Levels below `least`, SI, do not matter.
    """
    # The distance of each residual from the cubic through its neighbours is that of the noise, whatever smooth motion
    # the plant lacks. The logarithm of its square is the logarithm of the noise's variance plus an error of known mean
    # and variance (Harvey, Econometrica 44 (1976) 461, doi:10.2307/1913974) that single large values hardly move. Its
    # regression on a signal runs straight from knot to knot, by a random walk beforehand; the error of neighbours is
    # tied, cov = 2 arcsin² ρ, and so counts as that of fewer independent values. Constant noise is kept unless it is 20
    # times less likely, and where weights for the levels would not change the noise's power by the share to which it is
    # known.
    bends = np.concatenate([_bends(residual) for residual in residuals])
    known = np.flatnonzero(np.isfinite(bends) & (bends != 0.0))  # of readings in steps, some lie on a line
    if known.size < FEWEST:
        return None
    logs = np.log(bends[known] ** 2) - LOG_MEAN
    fits = [_with_signal(logs, np.concatenate(signal), known) for signal in signals]
    gained, variances = max(fits, key=lambda fit: fit[0])
    variances = np.maximum(variances, least**2)
    seen = np.isfinite(np.concatenate(residuals))
    harmonic = 1.0 / float(np.mean(1.0 / variances[seen]))
    if gained - np.log(len(fits)) <= SURE or np.mean(variances[seen]) < (1.0 + PRACTICAL_SHARE) * harmonic:
        return None
    louder = variances > np.median(variances[known])
    if not all(_is_white(bends, some & np.isfinite(bends)) for some in (louder, ~louder)):
        return None
    levels = np.sqrt(variances / harmonic)
    return tuple(np.split(levels, np.cumsum([residual.size for residual in residuals])[:-1]))


def _bends(residual: np.ndarray) -> np.ndarray:
    """Return the distance of each value from the cubic through its neighbours, with the noise's variance; NaN if
    unknown.
    """
    found = np.full(residual.size, np.nan)
    if residual.size >= MIDDLE.size:
        found[2:-2] = neighbours_deviation(residual)[2:-2] / np.linalg.norm(MIDDLE)
    return found


def _with_signal(logs: np.ndarray, signal: np.ndarray, known: np.ndarray) -> tuple[float, np.ndarray]:
    """Return log odds that log variances `logs` (k,), of the samples `known`, vary with a signal (n,); and the
    variances (n,).
    """
    from scipy.ndimage import convolve1d

    knots = np.unique(
        np.quantile(signal[known], (np.arange(KNOTS) + 0.5) / KNOTS)
    )  # beyond, few samples ring after steps
    hats = np.stack([np.interp(signal, knots, unit) for unit in np.eye(knots.size)], axis=1)
    effective = LOG_VARIANCE + 4.0 * sum(float(np.arcsin(tie)) ** 2 for tie in TIED)
    shares = MIDDLE**2 / np.sum(MIDDLE**2)  # a bend has its variance from five samples
    middle, seen = float(logs.mean()), convolve1d(hats, shares, axis=0, mode="nearest")[known]
    squares, along = seen.T @ seen / effective, seen.T @ (logs - middle) / effective
    steps, level = np.diff(np.eye(knots.size), axis=0), np.ones((knots.size, knots.size)) / (knots.size * ANY) ** 2
    constant = -0.5 * float(np.log(1.0 + ANY**2 * known.size / effective))
    fits = []
    for rise in RISES:
        prior = steps.T @ steps / rise**2 + level
        mean = np.linalg.solve(squares + prior, along)
        logs_of = np.linalg.slogdet(prior)[1] - np.linalg.slogdet(squares + prior)[1]
        fits.append((0.5 * float(along @ mean + logs_of) - constant, mean))
    odds = float(np.logaddexp.reduce([gained for gained, _ in fits]) - np.log(len(fits)))
    return odds, np.exp(middle + hats @ max(fits, key=lambda fit: fit[0])[1])


def _is_white(bends: np.ndarray, some: np.ndarray) -> bool:
    """Return whether at most a share of the deviations' power is smooth; smooth deviations keep their sign."""
    pairs = np.flatnonzero(some[1:] & some[:-1])
    if not pairs.size:
        return False
    signs = float(np.mean(np.sign(bends[pairs] * bends[pairs + 1])))
    tie = TIED[0] + PRACTICAL_SHARE * (1.0 - TIED[0])
    return signs < 2.0 / np.pi * float(np.arcsin(tie))


def rests(command: np.ndarray, sample_time: float) -> np.ndarray:
    """Return a mask, (n,), of samples at which a command, (n,), has stood still for four seconds."""
    resting = np.zeros(command.size, dtype=bool)
    still = np.abs(np.diff(command, prepend=command[0])) <= REST_SHARE * np.ptp(command)
    for run in runs(still):
        if np.ptp(command[run]) <= REST_SHARE * np.ptp(command):
            resting[run[samples_in(REST_SECONDS, sample_time) :]] = True
    return resting


def _at_rest(residual: np.ndarray, command: np.ndarray, sample_time: float) -> list[np.ndarray]:
    return [residual[run] for run in runs(rests(command, sample_time)) if run.size >= FEWEST // 4]


def _white(pieces: Sequence[np.ndarray], above: float) -> float:
    """Return the deviation of white noise with the median power density seen above a share of the Nyquist frequency."""
    # The median over the lines ignores tones and slow errors. The median over the segments ignores bursts, such as the
    # error after each step of a plant that answers too early.
    from scipy.signal import welch

    powers, weights = [], []
    for piece in [piece for piece in pieces if piece.size >= FEWEST_OF_A_PIECE] or [np.concatenate(pieces)]:
        frequency, density = welch(piece, 1.0, nperseg=min(SEGMENT_SAMPLES, piece.size), average="median")
        asked = density[1:][frequency[1:] >= above * frequency[-1]]
        # At half the sample rate the one-sided density is but half of the others', and has another median.
        asked = asked[:-1] if frequency[-1] == 0.5 and asked.size > 1 else asked
        powers.append(np.median(asked) / 2.0)
        weights.append(piece.size)
    return float(np.sqrt(np.average(powers, weights=weights)))

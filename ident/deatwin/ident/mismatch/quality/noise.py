"""Estimate the sensor's noise from recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.ident.mismatch.quality.repeats import Repeats
from deatwin.ident.mismatch.thresholds import FEWEST_SAMPLES, PRACTICAL_SHARE, STRONG
from deatwin.ident.soundness import neighbours_deviation, runs, samples_in

MIDDLE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
"""Weights of five successive values in `neighbours_deviation`: they pass white noise, with 35/18 of its power, and
hardly anything that is smooth."""
TOP_OF_SPECTRUM = 0.8
"""Share of the Nyquist frequency above which a residual is taken to be sensor noise."""
SHEET_TOLERANCE = float(np.sqrt(1.0 + PRACTICAL_SHARE))
"""Ratio to the data sheet's noise up to which an estimate agrees with it: a larger excess would count as a mismatch."""
SCATTER = 4.4
"""Margin added to that ratio, times the root of the number of samples: two standard errors of the estimate from the top
of the spectrum, each of which is 2.2 over that root for white noise."""
FEWEST_OF_A_PIECE = 8
"""Smallest number of samples of a piece from which a spectrum is estimated."""
SEGMENT_SAMPLES = 64
"""Length of a segment for the spectrum, so short that few segments contain ringing after a step or a reversal."""
REST_SECONDS = 4.0
"""Time for which a command must have been constant before the readings count as at rest, s."""
REST_SHARE = 0.002
"""Largest change of a command that counts as constant, as a share of its range."""
KNOTS = 15
"""Number of knots between which the logarithm of the noise variance is linear in a signal; they lie in the middles of
as many equal shares of the signal's samples."""
RISES = (0.1, 0.3, 1.0, 3.0)
"""Prior standard deviations of the change of that logarithm from knot to knot, all equally likely: from a tenth to a
factor of 20 in the variance."""
ANY = 10.0
"""Prior standard deviation of the mean of that logarithm: a factor of e^10 either way."""
LOG_MEAN, LOG_VARIANCE = -float(np.euler_gamma + np.log(2.0)), float(np.pi**2 / 2.0)
"""Mean and variance of the logarithm of a squared standard normal variable."""
TIED = tuple(
    float(np.sum(MIDDLE[lag:] * MIDDLE[: MIDDLE.size - lag]) / np.sum(MIDDLE**2)) for lag in range(1, MIDDLE.size)
)
"""Correlations, at lags 1 to 4, of the deviations of white noise from the cubic through four neighbours."""


class NoiseSource(Enum):
    """Source of the noise level."""

    SHEET = "the value stated for the sensor"
    REPEATS = "differences between repeats of the same command"
    RESTS = "the readings while the command rests"
    TOP_OF_SPECTRUM = "the highest frequencies of the residual"


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Noise level of the sensor, and the estimate of each source."""

    level: float  # standard deviation, SI
    source: NoiseSource  # source of `level`
    estimates: dict[NoiseSource, float]  # estimate of each available source, SI

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
    """Return the noise from the data sheet (`sheet`, SI; 0 if none) unless all other estimates are clearly larger.

    Then, or without a data sheet, the smallest other estimate is returned. Shapes: `residuals` of a calibrated plant,
    SI, and `commands` (n_r,) each.
    """
    # Differences between repeats of a command are free of whatever the plant lacks; readings at rest are free of what
    # it lacks in motion; the top of the residual's spectrum is free of what it lacks at low frequencies. Each can only
    # overestimate the noise: repeats if a disturbance enters, rests if it is present there too, the spectrum if fast
    # motion is missing. The noise of a sensor in a rig is seldom smaller than its data sheet says.
    found: dict[NoiseSource, float] = {}
    if repeats is not None and repeats.first.size >= FEWEST_SAMPLES:
        together = np.concatenate(residuals)
        apart = (together[repeats.first] - together[repeats.second]) / np.sqrt(2)
        found[NoiseSource.REPEATS] = _white([apart], 0.0)
    resting = [piece for e, u in zip(residuals, commands, strict=False) for piece in _at_rest(e, u, sample_time)]
    if sum(piece.size for piece in resting) >= FEWEST_SAMPLES:
        found[NoiseSource.RESTS] = _white([np.concatenate([piece - piece.mean() for piece in resting])], 0.0)
    found[NoiseSource.TOP_OF_SPECTRUM] = _white(residuals, TOP_OF_SPECTRUM)
    # Readings in coarse steps may be constant at rest; an estimate of 0 is ignored.
    seen = {source: level for source, level in found.items() if level > 0.0} or found
    best = min(seen, key=lambda source: seen[source])
    samples = sum(residual.size for residual in residuals)
    if sheet == 0.0 or found[best] > (SHEET_TOLERANCE + SCATTER / np.sqrt(samples)) * sheet:
        return NoiseFloor(level=found[best], source=best, estimates=found)
    return NoiseFloor(level=sheet, source=NoiseSource.SHEET, estimates={NoiseSource.SHEET: sheet, **found})


def noise_levels(
    residuals: Sequence[np.ndarray], signals: Sequence[Sequence[np.ndarray]], least: float
) -> tuple[np.ndarray, ...] | None:
    """Estimate how the level of white noise varies with one of several signals; None if it is constant or not white.

    Shapes: `residuals` (n_r,) each, SI, NaN where unknown; `signals` likewise, each over all records; returns (n_r,)
    each, relative to the root of the harmonic mean of the variance. Levels below `least`, SI, count as `least`.
    """
    # The deviation of each residual from the cubic through its neighbours is that of the noise, whatever smooth motion
    # the plant lacks. The logarithm of its square is the logarithm of the noise variance plus an error of known mean
    # and variance (Harvey, Econometrica 44 (1976) 461, doi:10.2307/1913974), on which single large values have little
    # influence. The regression on a signal is linear between knots, with a random walk as its prior. The errors of
    # neighbours are correlated, cov = 2 arcsin² ρ, and so count as fewer independent values. A varying level is
    # accepted only if it is 20 times as likely as a constant one, and if weighting by it changes the noise's power by
    # more than the share to which that is known.
    bends = np.concatenate([_bends(residual) for residual in residuals])
    known = np.flatnonzero(np.isfinite(bends) & (bends != 0.0))  # readings in coarse steps may lie exactly on a cubic
    if known.size < FEWEST_SAMPLES:
        return None
    logs = np.log(bends[known] ** 2) - LOG_MEAN
    fits = [_with_signal(logs, np.concatenate(signal), known) for signal in signals]
    gained, variances = max(fits, key=lambda fit: fit[0])
    variances = np.maximum(variances, least**2)
    seen = np.isfinite(np.concatenate(residuals))
    harmonic = 1.0 / float(np.mean(1.0 / variances[seen]))
    if gained - np.log(len(fits)) <= STRONG or np.mean(variances[seen]) < (1.0 + PRACTICAL_SHARE) * harmonic:
        return None
    louder = variances > np.median(variances[known])
    if not all(_is_white(bends, some & np.isfinite(bends)) for some in (louder, ~louder)):
        return None
    levels = np.sqrt(variances / harmonic)
    return tuple(np.split(levels, np.cumsum([residual.size for residual in residuals])[:-1]))


def _bends(residual: np.ndarray) -> np.ndarray:
    """Return the deviation of each value from the cubic through its neighbours, scaled to the noise's variance; NaN if
    unknown.
    """
    found = np.full(residual.size, np.nan)
    if residual.size >= MIDDLE.size:
        found[2:-2] = neighbours_deviation(residual)[2:-2] / np.linalg.norm(MIDDLE)
    return found


def _with_signal(logs: np.ndarray, signal: np.ndarray, known: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the log odds that log variances `logs` (k,), at samples `known`, vary with a signal (n,); and all
    variances (n,).
    """
    from scipy.ndimage import convolve1d

    knots = np.unique(
        np.quantile(signal[known], (np.arange(KNOTS) + 0.5) / KNOTS)
    )  # the few samples beyond the outer knots ring after steps
    hats = np.stack([np.interp(signal, knots, unit) for unit in np.eye(knots.size)], axis=1)
    effective = LOG_VARIANCE + 4.0 * sum(float(np.arcsin(tie)) ** 2 for tie in TIED)
    shares = MIDDLE**2 / np.sum(MIDDLE**2)  # a deviation gets its variance from five samples
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
    """Return whether at most `PRACTICAL_SHARE` of the deviations' power is smooth; smooth deviations keep their sign."""
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
    return [residual[run] for run in runs(rests(command, sample_time)) if run.size >= FEWEST_SAMPLES // 4]


def _white(pieces: Sequence[np.ndarray], above: float) -> float:
    """Return the deviation of white noise with the median power density found above a share of the Nyquist frequency."""
    # The median over the spectral lines ignores tones and slow errors. The median over the segments ignores bursts,
    # such as the error after each step of a plant that answers too early.
    from scipy.signal import welch

    # Densities of equally long segments are averaged over the pieces first: the median over the lines of a single
    # segment is far below their mean.
    densities: dict[int, list[tuple[np.ndarray, int]]] = {}
    for piece in [piece for piece in pieces if piece.size >= FEWEST_OF_A_PIECE] or [np.concatenate(pieces)]:
        segment = min(SEGMENT_SAMPLES, piece.size)
        density = welch(piece, 1.0, nperseg=segment, average="median")[1]
        densities.setdefault(segment, []).append((density, piece.size))
    powers, weights = [], []
    for segment, found in densities.items():
        frequency, sizes = np.fft.rfftfreq(segment), [size for _, size in found]
        density = np.average([density for density, _ in found], axis=0, weights=sizes)
        asked = density[1:][frequency[1:] >= above * frequency[-1]]
        # At half the sample rate the one-sided density is only half of the others, and has another median.
        asked = asked[:-1] if frequency[-1] == 0.5 and asked.size > 1 else asked
        powers.append(np.median(asked) / 2.0)
        weights.append(sum(sizes))
    return float(np.sqrt(np.average(powers, weights=weights)))

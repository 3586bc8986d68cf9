"""The sensor's noise, as recordings show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from deatwin.ident.mismatch.excess import PRACTICAL_SHARE
from deatwin.ident.mismatch.gate.repeats import Repeats
from deatwin.ident.soundness import runs, samples_in

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


class NoiseSource(Enum):
    """Source of the noise level."""

    SHEET = "the data sheet"
    REPEATS = "differences between repeats of the same command"
    RESTS = "the readings while the command rests"
    TOP_OF_SPECTRUM = "the top of the residual's spectrum"


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """The sensor's noise, and what each source says of it.

    Parameters
    ----------
    level : float
        Standard deviation, SI.
    source : NoiseSource
        Which source was believed.
    estimates : dict of NoiseSource to float
        What each available source says, SI.
    """

    level: float
    source: NoiseSource
    estimates: dict[NoiseSource, float]

    @property
    def sentence(self) -> str:
        """Return where the level comes from, in one plain sentence."""
        return f"the noise is estimated from {self.source.value}"


def noise_level(
    residuals: Sequence[np.ndarray],
    sample_time: float,
    sheet: float,
    commands: Sequence[np.ndarray] = (),
    repeats: Repeats | None = None,
) -> NoiseFloor:
    """Ask every source for the sensor's noise; the one that says least is the best.

    Differences between repeats of a command are free of whatever the plant lacks; readings at rest are free of what it
    lacks in motion; the top of the residual's spectrum is free of what it lacks at low frequencies. Each can only say
    too much: repeats where a disturbance comes in, rests where it is there too, the spectrum where fast motion is
    missing. The data sheet is believed unless all of them say clearly more: what a sensor does in a rig is seldom less.
    Without a data sheet (0) the best one is believed.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (n_r,) each
        Of a calibrated plant, one for each record, SI.
    sample_time : float
        s.
    sheet : float
        What the data sheet says, SI; 0 where it is silent.
    commands : sequence of ndarray, shape (n_r,) each
        For rests; none are looked for without.
    repeats : Repeats, optional
        Over the same samples.

    Returns
    -------
    NoiseFloor
    """
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


def rests(command: np.ndarray, sample_time: float) -> np.ndarray:
    """Samples at which a command has stood still for four seconds.

    Parameters
    ----------
    command : ndarray, shape (n,)
        In its unit.
    sample_time : float
        s.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    resting = np.zeros(command.size, dtype=bool)
    still = np.abs(np.diff(command, prepend=command[0])) <= REST_SHARE * np.ptp(command)
    for run in runs(still):
        if np.ptp(command[run]) <= REST_SHARE * np.ptp(command):
            resting[run[samples_in(REST_SECONDS, sample_time) :]] = True
    return resting


def _at_rest(residual: np.ndarray, command: np.ndarray, sample_time: float) -> list[np.ndarray]:
    return [residual[run] for run in runs(rests(command, sample_time)) if run.size >= FEWEST // 4]


def _white(pieces: Sequence[np.ndarray], above: float) -> float:
    """Standard deviation of white noise with the median power density seen above a share of the Nyquist frequency.

    The median over the lines passes by tones, and by what is slow where all lines are asked; that over the segments, by
    what comes in bursts, as the error of a plant that answers too early to each step.
    """
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

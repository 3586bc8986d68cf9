"""Test whether an explanation holds in each record and at small and large amplitudes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import ClassVar

import numpy as np

from deatwin.ident.mismatch.losses import block_losses, bootstrap_gain
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import BLOCK_SAMPLES
from deatwin.plant.datasets import Metadata, variable
from deatwin.plant.recording import label

FEWEST_BLOCKS = 6
"""Smallest number of blocks for which a part of the held-out data is judged by itself."""
THIRDS = ("lowest amplitudes", "middle amplitudes", "highest amplitudes")


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """Residuals before and after in one part of the held-out data: one record, or blocks of similar amplitude."""

    part: str
    before: float = field(metadata=variable(unit=attrgetter("output_unit"), about="rms residual"))
    after: float = field(metadata=variable(unit=attrgetter("output_unit"), about="rms residual"))
    # One-sided bounds.
    gain_low: float = field(
        metadata=variable(unit=attrgetter("output_unit"), about="lower 95 % bound of the reduction of the rms residual")
    )
    gain_high: float = field(
        metadata=variable(unit=attrgetter("output_unit"), about="upper 95 % bound of the reduction of the rms residual")
    )
    floor: float = field(
        metadata=variable(unit=attrgetter("output_unit"), about="rms of sensor noise and model error together")
    )
    model_error: float = field(
        metadata=variable(unit=attrgetter("output_unit"), about="rms of the allowed model error")
    )

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "worse": variable(),
    }

    @property
    def worse(self) -> bool:
        """Return whether the residual certainly grows in this part, by more than the model error."""
        grows = self.after**2 - self.before**2
        return self.gain_high < 0.0 and self.after > self.floor and grows > self.model_error**2


def transfers(
    base: Candidate, amended: Candidate, problem: DiagnosisProblem, rng: np.random.Generator
) -> tuple[Transfer, ...]:
    """Compare two candidates on each record, if several are long, and on each third of blocks by the command's rms."""
    error = amended.calibration.plant.rig.model_error
    floor = float(np.hypot(amended.noise, error))
    parts = [*_records(base, amended, problem), *_thirds(base, amended, problem)]
    return tuple(
        Transfer(
            part=name,
            before=float(np.sqrt(before.mean())),
            after=float(np.sqrt(after.mean())),
            gain_low=bootstrap_gain(before, after, rng),
            gain_high=-bootstrap_gain(after, before, rng),
            floor=floor,
            model_error=error,
        )
        for name, before, after in parts
    )


Losses = tuple[str, np.ndarray, np.ndarray]


def _records(base: Candidate, amended: Candidate, problem: DiagnosisProblem) -> list[Losses]:
    names = [
        f"{label(record)}, {part.reading}" if part.reading else label(record)
        for part in problem.unseen
        for record in part.experiment.recordings
    ]
    cuts = np.cumsum([mask.sum() for part in problem.unseen for mask in part.masks])[:-1]
    pieces = zip(names, np.split(base.unseen, cuts), np.split(amended.unseen, cuts), strict=True)
    found = [
        (name, block_losses(before), block_losses(after))
        for name, before, after in pieces
        if before.size >= FEWEST_BLOCKS * BLOCK_SAMPLES
    ]
    return found if len(found) > 1 else []


def _thirds(base: Candidate, amended: Candidate, problem: DiagnosisProblem) -> list[Losses]:
    pairs = [pair for part in problem.unseen for pair in zip(part.experiment.recordings, part.masks, strict=True)]
    # Mean square of the command in the same blocks as the losses.
    amplitudes = block_losses(np.concatenate([record.inputs[0, mask] for record, mask in pairs]))
    before, after = block_losses(base.unseen), block_losses(amended.unseen)
    thirds = np.array_split(np.argsort(amplitudes, kind="stable"), 3)
    return [
        (name, before[np.sort(which)], after[np.sort(which)])
        for name, which in zip(THIRDS, thirds, strict=True)
        if which.size >= FEWEST_BLOCKS
    ]

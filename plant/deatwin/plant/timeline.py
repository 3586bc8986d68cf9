"""Commands of an experiment on one clock, from rest to the end of its last recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.recording import Experiment, Recording, label
from deatwin.plant.rigs.base import ReadingTime, StartProcedure
from deatwin.plant.safe_read import ROWS

OFF_CLOCK = 0.01  # Largest distance of a record's start from the clock of the record before, in samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Timeline:
    """Commands of an experiment, each held for one sample."""

    commands: np.ndarray  # shape (n,): Commands from the start procedure through all recordings, in the command's unit
    start: float  # Clock time at which the first command is applied, s
    sample_time: float  # s
    readings: tuple[np.ndarray, ...]
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(
        cls, experiment: Experiment, procedure: StartProcedure, sample_time: float, reading: ReadingTime
    ) -> Timeline:
        """Arrange the commands of an experiment."""
        if abs(experiment.sample_time / sample_time - 1) > 1e-3:
            raise DataError(
                f"the recording is sampled every {experiment.sample_time:g} s but the rig file says "
                f"{sample_time:g} s ({1 / sample_time:g} Hz); write sample_rate_Hz = {1 / experiment.sample_time:.6g} in "
                f"the rig file, or resample the recording: --resample {sample_time:g}, in Python resample={sample_time:g}"
            )
        parts = [_start_commands(procedure, experiment.recordings[0].inputs[0, 0], sample_time)]
        origin = experiment.start - parts[0].size * sample_time
        first, readings = parts[0].size, []
        offset = -1 if reading is ReadingTime.START_OF_HOLD else 0
        before = None
        for record in experiment.recordings:
            at = first + (0 if before is None else _pause(before, record))
            _require_few(at + record.n_samples, f"up to the end of {label(record)}", sample_time)
            if at > first:  # between records the last command is held
                parts.append(np.full(at - first, parts[-1][-1] if parts[-1].size else record.inputs[0, 0]))
            parts.append(record.inputs[0])
            readings.append(np.arange(at, at + record.n_samples) + offset)
            first, before = at + record.n_samples, record
        commands = np.concatenate(parts)
        rows = [r - offset for r in readings]
        return cls(
            commands=commands,
            start=origin,
            sample_time=sample_time,
            readings=tuple(readings),
            channels=_channels(experiment, rows, commands.size),
        )


def _pause(before: Recording, record: Recording) -> int:
    """Return the number of samples between two records, from the end of the first, so that no errors add up."""
    pause = (record.start - before.end) / before.sample_time
    if abs(pause - round(pause)) > OFF_CLOCK:
        raise DataError(
            f"{label(record)}: it starts at {record.start:.9g} s, {abs(pause - round(pause)):.2g} of a sample off the "
            f"clock of {label(before)}; shift its times onto that clock, or give it as an experiment of its own "
            "(--experiment)"
        )
    return round(pause)


def _channels(experiment: Experiment, rows: list[np.ndarray], count: int) -> dict[str, np.ndarray]:
    """Return extra channels on the experiment's clock; between measurements, the last value is kept."""
    pairs = (pair for record in experiment.recordings for pair in record.extras.items())
    names = dict.fromkeys(name for name, values in pairs if np.isfinite(values).any())
    return {name: _kept(experiment, rows, count, name) for name in names}


def _kept(experiment: Experiment, rows: list[np.ndarray], count: int, name: str) -> np.ndarray:
    values = np.full(count, np.nan)
    for record, at in zip(experiment.recordings, rows, strict=True):
        if name in record.extras:
            values[at] = record.extras[name]
    measured = np.flatnonzero(np.isfinite(values))
    last = np.searchsorted(measured, np.arange(count), side="right") - 1
    return values[measured[np.maximum(last, 0)]]


def _start_commands(procedure: StartProcedure, first: float, sample_time: float) -> np.ndarray:
    """Return a linear ramp, then a hold. Each held value is the ramp's mean over its sample."""
    ramp = round(procedure.ramp / sample_time)
    hold = round(procedure.hold / sample_time)
    _require_few(ramp + hold, f"in the start procedure of {procedure.ramp + procedure.hold:g} s", sample_time)
    shares = (np.arange(ramp) + 0.5) / max(ramp, 1)
    rest = procedure.rest_command
    return np.concatenate([rest + (first - rest) * shares, np.full(hold, first)])


def _require_few(samples: int, what: str, sample_time: float) -> None:
    if samples > ROWS:
        raise DataError(f"{what} there are {samples:.3g} samples of {sample_time:g} s; at most {ROWS:.3g} can be run")

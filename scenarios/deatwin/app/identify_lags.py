"""Input lags that compete in `deatwin identify`, chosen by the dead times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deatwin.ident.narx.preprocess import DeadTime
    from deatwin.plant.recording import Recording


FIRST, LAST = 0, 2
"""The first and last input lag without a dead time."""


@dataclass(frozen=True, kw_only=True)
class InputLags:
    """Input lags, and why these."""

    lags: tuple[int, ...]  # Samples, ascending
    dead_times: tuple[DeadTime, ...]
    sentences: tuple[str, ...]  # For the user

    @property
    def document(self) -> list[dict[str, Any]]:
        """The dead times as plain data."""
        return [
            {
                "input": one.input_name,
                "status": one.status.name.lower(),
                "samples": one.samples,
                "interval": one.interval,
                "seconds": one.seconds,
                "probability": one.probability,
            }
            for one in self.dead_times
        ]


def choose_input_lags(recordings: Sequence[Recording], first: int | None, last: int | None) -> InputLags:
    """Return the input lags that compete: those that were asked for, else three from each dead time on."""
    from deatwin.ident.narx.preprocess import estimate_dead_time, lags_after

    usual = tuple(range(FIRST if first is None else first, (LAST if last is None else last) + 1))
    dead_times = estimate_dead_time(recordings)
    said = [str(one) for one in dead_times]
    late = [one for one in dead_times if one.interval is not None and one.interval[0] > 1]
    if first is None and last is None:
        if not late:
            return InputLags(lags=usual, dead_times=dead_times, sentences=tuple(said))
        shifted = set(lags_after(late, len(usual))) | (set(usual) if len(late) < len(dead_times) else set())
        lags = tuple(sorted(shifted))
        said.append(f"the input lags that compete are therefore {_written(lags)}")
        return InputLags(lags=lags, dead_times=dead_times, sentences=tuple(said))
    missed = [one.interval for one in late if one.interval is not None and one.interval[0] > usual[-1]]
    if missed:
        low, high = min(one[0] for one in missed), max(one[1] for one in missed)
        said.append(
            f"the input lags that were asked for end at {usual[-1]}, before the input acts: take "
            f"--first-input-lag {low} --input-lags {high + LAST}"
        )
    return InputLags(lags=usual, dead_times=dead_times, sentences=tuple(said))


def _written(lags: tuple[int, ...]) -> str:
    """Lags, each run of them by its ends."""
    starts = [lag for lag in lags if lag - 1 not in lags]
    ends = [lag for lag in lags if lag + 1 not in lags]
    runs = [f"{start} to {end}" if end > start else str(start) for start, end in zip(starts, ends, strict=True)]
    return ", ".join(runs)

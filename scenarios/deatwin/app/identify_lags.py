"""Choose the lags for `deatwin identify`: those of the input by dead times, those of the output by stability."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from deatwin.ident.narx import NarxIdentifier, NarxModel
from deatwin.ident.narx.preprocess import DeadTime, DeadTimeStatus, estimate_dead_time, lags_after
from deatwin.ident.narx.unstable import poles_at
from deatwin.plant.recording import Recording

FIRST, LAST = 0, 2  # First and last input lag if there is no dead time
_WITHIN = (
    "the recording was made in a closed loop, where an input lag of 0 would model the reaction of the controller; give "
    "--first-input-lag 0 only if each reading is taken at the end of its sample interval"
)
OUTPUT_LAGS = 2  # Number of output lags, unless others are requested


@dataclass(frozen=True, kw_only=True)
class InputLags:
    """Input lags with the reason for their choice."""

    lags: tuple[int, ...]  # Samples, ascending
    dead_times: tuple[DeadTime, ...]
    sentences: tuple[str, ...]  # Sentences for the user

    @property
    def document(self) -> list[dict[str, Any]]:
        """Return the dead times as plain data."""
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
    """Return the requested input lags or, without a request, three from each dead time on."""
    usual = tuple(range(FIRST if first is None else first, (LAST if last is None else last) + 1))
    longest = max(usual, default=0)
    dead_times = estimate_dead_time(recordings)
    told = [one for one in dead_times if one.status is not DeadTimeStatus.ALIKE]
    late = [one for one in told if (ends := one.interval) and (ends[0] > 1 or ends[1] > longest)]
    said = [str(one) for one in dead_times]
    if first is not None or last is not None:
        lags = usual
        missed = [one.interval for one in late if one.interval is not None and one.interval[0] > longest]
        if missed:
            low, high = min(one[0] for one in missed), max(one[1] for one in missed)
            said.append(
                f"the given input lags end at {longest}, before the input has any effect; take "
                f"--first-input-lag {low} --input-lags {high + LAST}"
            )
    elif late:
        early = len(late) < len(dead_times) or any(one.interval is not None and one.interval[0] == 0 for one in late)
        lags = tuple(sorted({*lags_after(late, len(usual)), *(usual if early else ())}))
        said.append(f"the candidate input lags are therefore {_written(lags)}")
    else:
        # A lag before the dead time could enter the model only by chance, or as the controller's response.
        loop = any(one.status is DeadTimeStatus.LOOP for one in dead_times)
        none_at_once = all(one.status is DeadTimeStatus.FOUND and one.interval != (0, 1) for one in dead_times)
        lags = tuple(lag for lag in usual if lag or not (none_at_once or loop))
        if loop:
            said.append(f"{_WITHIN}; the candidate input lags are {_written(lags)}")
    return InputLags(lags=lags, dead_times=dead_times, sentences=tuple(said))


def disagreements(model: NarxModel, found: InputLags, *, by_free_run: bool) -> list[str]:
    """Return a sentence for each input that is not in the model, or starts outside the interval of its dead time."""
    acting = (DeadTimeStatus.FOUND, DeadTimeStatus.AT_ONCE, DeadTimeStatus.LOOP)
    said = []
    for row, one in enumerate(found.dead_times):
        lags = [v.lag for term in model.terms for v, _ in term.factors if v.kind == "u" and v.index == row]
        if not lags and one.status in acting and one.interval is not None and one.interval[1] in found.lags:
            advice = (
                "use --method frols, which chooses terms by the prediction one step ahead"
                if by_free_run
                else "record with a stronger input"
            )
            said.append(
                f"no term of the model contains {one.input_name}, although this input has an effect and its lags "
                f"{_written(found.lags)} were candidates; {advice}"
            )
        elif not lags:
            said.append(
                f"no term of the model contains {one.input_name}, so the model does not describe its effect; allow later "
                "lags (--input-lags), or record with a stronger input"
            )
        elif (
            one.status is not DeadTimeStatus.ALIKE
            and one.interval is not None
            and not one.interval[0] <= min(lags) <= one.interval[1]
        ):
            said.append(
                f"{one.input_name} begins to act on the output after {one.samples} {'sample' if one.samples == 1 else 'samples'}, but "
                f"its first lag in the model is {min(lags)}; the first number is more reliable, because noise can hide a lag "
                "when terms are chosen"
            )
    return said


def bounded(
    identifier: NarxIdentifier,
    training: Sequence[Recording],
    fit: Callable[[NarxIdentifier], None],
    *,
    may_choose: bool,
) -> tuple[NarxIdentifier, tuple[str, ...]]:
    """Return an identifier whose model runs free over its data, and sentences on what this required."""
    # A lag with an unstable negative pole, which no continuous plant has, imitates later inputs after a sharp low pass.
    if not _diverges(identifier.model_, training):
        return identifier, ()
    pole = poles_at(identifier.model_, training)[:1]
    spurious = bool(np.all((pole.imag == 0.0) & (pole.real < -1.0)))
    for fewer in range(OUTPUT_LAGS - 1, 0, -1) if may_choose and spurious else ():
        tried = type(identifier)(**(identifier.get_params(deep=False) | {"output_lags": fewer}))
        fit(tried)
        if not _diverges(tried.model_, training):
            return tried, (
                f"the model uses only {fewer} lag of the output, because with {OUTPUT_LAGS} lags it had an unstable pole at a "
                "negative z, which no sampled plant has",
            )
    return identifier, (
        "the free run of the model diverges on its own training recordings, so do not simulate with this model; unless the "
        "actuator is unstable, take fewer --output-lags, a lower --degree, or --method semp",
    )


def _diverges(model: NarxModel, training: Sequence[Recording]) -> bool:
    return not all(model.simulate(record).status.ok for record in training)


def _written(lags: tuple[int, ...]) -> str:
    """Write lags, with runs abbreviated to their ends."""
    starts = [lag for lag in lags if lag - 1 not in lags]
    ends = [lag for lag in lags if lag + 1 not in lags]
    runs = [f"{start} to {end}" if end > start else str(start) for start, end in zip(starts, ends, strict=True)]
    return ", ".join(runs)

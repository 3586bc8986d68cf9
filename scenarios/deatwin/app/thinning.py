"""Recordings that are sampled faster than a NARX model needs, decimated or said to be so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from deatwin.ident.narx.preprocess import SamplingChoice, SamplingStatus, choose_sampling, decimate
from deatwin.plant.errors import DataError
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime

LEAST = 100
"""Samples that are left of each recording at least where decimation is offered: of fewer, a model of some terms has no
held-out part that could judge it."""
_FAR = 10
"""Factor of decimation from which it is advised: the sampling time suits a model at 10 to 20 samples to the time scale of
the output, and a few times as many do it no harm."""
_ENDS = 20
"""New samples that the filter of `decimate` takes from both ends, about."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Thinned:
    """Recordings for identification."""

    records: list[Recording]  # Decimated, or as they came
    notes: list[str]  # On decimation that was done, or would help


def thinned(records: list[Recording], wanted: str | None, reading: ReadingTime, *, held_out: float) -> Thinned:
    """Decimate recordings as it was asked for; where it was not, say so if they are sampled too fast. `records` of
    one sample time.
    """
    if wanted not in (None, "auto"):
        made = [decimate(record, int(wanted), reading=reading) for record in records]
        return Thinned(records=made, notes=[_done(int(wanted), made)] if int(wanted) > 1 else [])
    choice = _choice([record.section(0, round(record.n_samples * (1 - held_out))) for record in records])
    if choice is None or choice.status is not SamplingStatus.DECIMATE:
        why = "the output's correlation cannot be had" if choice is None else choice.status.value
        return Thinned(records=records, notes=[] if wanted is None else [f"not decimated: {why}"])
    slower, reason = choice.sample_time * choice.factor, _reason(choice)
    if wanted == "auto":
        made = [decimate(record, choice.factor, reading=reading) for record in records]
        return Thinned(records=made, notes=[f"{_done(choice.factor, made)}: {reason}"])
    if not advised(records, choice):
        return Thinned(records=records, notes=[])
    return Thinned(
        records=records,
        notes=[
            f"sampled far faster, every {choice.sample_time:g} s, than a NARX model needs: {reason}, so neighbouring "
            f"regressors are all but the same; --decimate auto goes to {slower:g} s"
        ],
    )


def advised(records: Sequence[Recording], choice: SamplingChoice) -> bool:
    """Return whether recordings are sampled far too fast, and each still gives and judges a model once decimated."""
    shortest = min(record.n_samples for record in records)
    return choice.factor >= _FAR and shortest >= (LEAST + _ENDS) * choice.factor


def _choice(records: Sequence[Recording]) -> SamplingChoice | None:
    """The sampling time that suits; None where the output cannot tell."""
    try:
        return choose_sampling(records)
    except DataError:
        return None


def _reason(choice: SamplingChoice) -> str:
    return (
        f"the output's correlation has its first minimum, or vanishes, at {choice.first_minimum} samples, where 10 to 20 "
        f"suffice, and the output moves up to {choice.highest:.3g} Hz only, where 10 samples a period suffice"
    )


def _done(factor: int, made: Sequence[Recording]) -> str:
    return f"decimated by {factor} to {made[0].sample_time:g} s, all signals behind one low-pass filter"

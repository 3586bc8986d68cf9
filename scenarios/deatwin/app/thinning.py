"""Decimate recordings that are sampled faster than a NARX model needs, or warn about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.app.identify_lags import OUTPUT_LAGS, choose_input_lags
from deatwin.ident.narx import Frols, NarxModel
from deatwin.ident.narx.preprocess import SamplingChoice, SamplingStatus, choose_sampling, decimate
from deatwin.ident.narx.reliance import hold_out
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.base import ReadingTime

LEAST = 100
"""Least samples of each recording after a decimation that is offered: with fewer, a model of some terms has no held-out
part that could judge it."""
_FAR = 10
"""Factor from which decimation is advised: 10 to 20 samples per time scale of the output suit a model, and a few times
as many do no harm."""
_CLEARLY = 2.0
"""Ratio of two free-run errors from which one is clearly worse; half of it may be chance."""
_SLIGHT = 0.01  # Difference of two free runs, in the output's standard deviations, that changes no decision
_ENDS = 20  # New samples, about, that the filter of `decimate` takes from both ends


@dataclass(frozen=True, kw_only=True, eq=False)
class Thinned:
    """Recordings for identification."""

    records: list[Recording]  # Decimated recordings, or the original ones
    notes: list[str]  # Notes on decimation that was done, or would help


def thinned(records: list[Recording], wanted: str | None, reading: ReadingTime, *, held_out: float) -> Thinned:
    """Decimate recordings of one sample time as requested; otherwise warn if they are sampled too fast."""
    if wanted not in (None, "auto"):
        made = [decimate(record, int(wanted), reading=reading) for record in records]
        return Thinned(records=made, notes=[_done(int(wanted), made)] if int(wanted) > 1 else [])
    choice = _choice([record.section(0, round(record.n_samples * (1 - held_out))) for record in records])
    if choice is None or choice.status is not SamplingStatus.DECIMATE:
        why = "the output's autocorrelation cannot be computed" if choice is None else choice.status.value
        return Thinned(records=records, notes=[] if wanted is None else [f"not decimated: {why}"])
    slower, reason = choice.sample_time * choice.factor, _reason(choice)
    if wanted == "auto":
        made = [decimate(record, choice.factor, reading=reading) for record in records]
        return Thinned(records=made, notes=[_done(choice.factor, made, f", because {reason}")])
    told = (
        f"the recordings are sampled every {choice.sample_time:g} s, far too fast for a NARX model ({reason}); use "
        f"--decimate auto, which keeps a sample every {slower:g} s"
    )
    return Thinned(records=records, notes=[told] if advised(records, choice) else [])


def advised(records: Sequence[Recording], choice: SamplingChoice) -> bool:
    """Return whether recordings are sampled far too fast, and are long enough after decimation."""
    shortest = min(record.n_samples for record in records)
    return choice.factor >= _FAR and shortest >= (LEAST + _ENDS) * choice.factor


def lost(model: NarxModel, unseen: Sequence[Recording], whole: Sequence[Recording]) -> list[str]:
    """Return a sentence if a linear model of the `whole` recordings is clearly better than the decimated model."""
    if model.sample_time == whole[0].sample_time:
        return []
    training, ends = hold_out(whole)
    lags = choose_input_lags(training, None, None).lags
    try:
        linear = Frols(output_lags=OUTPUT_LAGS, input_lags=lags, degree=1).fit(training).model_
    except ModelError:  # for example, the input is constant over the beginning
        return []
    before, diverges = _free_run(linear, ends)
    after, diverged = _free_run(model, unseen)
    slight = _SLIGHT * float(np.concatenate([part.outputs[0] for part in ends]).std())
    if diverges or not (diverged or after > max(_CLEARLY * before, before + slight)):
        return []
    unit = model.output_units[0]
    how = "diverges" if diverged else f"has an error of {with_unit(after, unit)} rms"
    return [
        "decimation lost information; leave --decimate out, or choose a smaller factor (on held-out data, the free run of the "
        f"model {how}, while the free run of a linear model of the undecimated data has an error of only "
        f"{with_unit(before, unit)} rms)"
    ]


def _free_run(model: NarxModel, parts: Sequence[Recording]) -> tuple[float, bool]:
    """Return the rms error of free runs, and whether one diverges."""
    runs = [model.simulate(part) for part in parts]
    errors = np.concatenate([run.residuals[0] for run in runs])
    return float(np.sqrt(np.mean(errors**2))), not all(run.status.ok for run in runs)


def _choice(records: Sequence[Recording]) -> SamplingChoice | None:
    """Return a suitable sampling time; None if the output does not determine it."""
    try:
        return choose_sampling(records)
    except DataError:
        return None


def _reason(choice: SamplingChoice) -> str:
    return (
        f"the autocorrelation of the output takes {choice.first_minimum} samples to reach its first minimum or zero, although "
        f"10 to 20 samples are enough, and the output contains frequencies only up to {choice.highest:.3g} Hz"
    )


def _done(factor: int, made: Sequence[Recording], why: str = "") -> str:
    return f"decimated by {factor} to {made[0].sample_time:g} s{why}; all signals passed the same low-pass filter"

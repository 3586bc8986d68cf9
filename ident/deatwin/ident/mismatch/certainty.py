"""How sure a verdict is: the figures that decided it, in one line beside its sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from deatwin.ident.mismatch.detect.origin import FOREIGN
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.located import PlaceSummary
from deatwin.ident.mismatch.quality.quality import FEWEST_FAULTY
from deatwin.ident.mismatch.result import LEAST_TOLD
from deatwin.ident.mismatch.say import at_body, called, headline, likely_places, number
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import CREDIBLE, NEGLIGIBLE, PRACTICAL_SHARE, SIGNIFICANCE
from deatwin.ident.mismatch.verdict import Verdict
from deatwin.plant.amplitudes import amount, written_unit
from deatwin.plant.words import spaced

HARDLY = LEAST_TOLD / 2
"""Probability that is shown as 0 %."""


@checks_its_arguments
def how_sure(diagnosis: Diagnosis) -> str:
    """State in one line how sure the verdict of a diagnosis is.

    Parameters
    ----------
    diagnosis : Diagnosis
        Finished diagnosis.

    Returns
    -------
    str
        One sentence without initial capital and full stop. It states the probabilities of the likeliest explanations;
        for a verdict that names no effects, it states the numbers that decided the verdict. Empty if the diagnosis
        contains none of these numbers.
    """
    return _LINES[diagnosis.verdict](diagnosis)


@checks_its_arguments
def next_step(diagnosis: Diagnosis) -> str:
    """Say in one line what to do after a verdict.

    Parameters
    ----------
    diagnosis : Diagnosis
        Finished diagnosis.

    Returns
    -------
    str
        One sentence without initial capital and full stop.
    """
    advised = diagnosis.advice
    if diagnosis.verdict is Verdict.UNKNOWN and (places := likely_places(diagnosis)):
        return f"check the readings for a fault at the times of the mismatch; if there is none, add an effect of your own {places}"
    if diagnosis.verdict is not Verdict.AMBIGUOUS:
        return diagnosis.verdict.advice
    if advised is not None and advised.file is not None:
        also = f", measure {advised.measure} as well" if advised.undecided and advised.measure else ""
        mass = advised.added_mass_g
        if mass is not None:  # another rig, whose recordings stand alone
            load = f"add {number(mass)} g to the load, state the new mass in the rig file"
            return f"{load}, apply the input in {advised.file}, record the response{also}, and diagnose this recording alone"
        return f"apply the input in {advised.file}, record the response{also}, and diagnose all recordings together"
    if advised is not None and advised.measure is not None:
        return f"record again and measure {advised.measure} as well, then diagnose all recordings together"
    return diagnosis.verdict.advice


def _named(diagnosis: Diagnosis) -> str:
    if not diagnosis.explanations:
        return ""
    answer = diagnosis.explanations[0]
    first = answer.probability
    likely = f"{called(answer.effects, diagnosis)} {_is(diagnosis)} {percent(first)} likely"
    untried = "causes that were not tried"
    if CREDIBLE - first < HARDLY:
        return f"{likely}, and the remaining {percent(1.0 - CREDIBLE)} is kept for {untried}"
    return f"{likely}, other explanations from the catalogue {_rest(CREDIBLE, first)}, and {untried} {percent(1.0 - CREDIBLE)}"


def _ambiguous(diagnosis: Diagnosis) -> str:
    if not diagnosis.explanations:
        return ""
    first, *others = headline(diagnosis)[0]
    rest = _rest(1.0, first.probability, *(one.probability for one in others))
    said = [
        f"{called(first.effects, diagnosis)} {_is(diagnosis)} {percent(first.probability)} likely",
        *(f"{called(one.effects, diagnosis)} {percent(one.probability)}" for one in others),
    ]
    return f"{', '.join(said)}, and any other cause {rest}"


def _is(diagnosis: Diagnosis) -> str:
    """Return the verb for the effects of the first explanation."""
    return "are" if len(diagnosis.explanations[0].effects) > 1 else "is"


def _partly(diagnosis: Diagnosis) -> str:
    if not diagnosis.causes:
        return ""
    first, *others = diagnosis.causes
    said = [f"{spaced(first.effect)} is {percent(first.probability)} likely to be a part of what is missing"]
    return ", and ".join([*said, *(f"{spaced(cause.effect)} {percent(cause.probability)}" for cause in others)])


def _clean(diagnosis: Diagnosis) -> str:
    found = diagnosis.detection
    if found.p_value is None or found.excess is None:
        return ""
    if found.taken_up:
        small = "too small to count as a mismatch"
        if found.practical is not None:
            small = f"below {_rms(found.practical, diagnosis)}, the smallest error that counts as a mismatch"
        return f"after the fit to all recordings, the error beyond sensor noise is {small}"
    chance = f"p = {number(found.p_value)}"
    if found.practical is not None and found.excess < found.practical:
        least = _rms(found.practical, diagnosis)
        small = f"but errors below {least} do not count as a mismatch"
        needed = (
            small
            if found.p_value < SIGNIFICANCE
            else f"and a mismatch would need at least {least} and p < {SIGNIFICANCE:g}"
        )
        return f"{_beyond(found.excess, diagnosis)}; all tests of the residual together give {chance}, {needed}"
    return f"{_beyond(found.excess, diagnosis)}, but it may be due to chance ({chance}; an error of this size counts only if p < {SIGNIFICANCE:g})"


def _unknown(diagnosis: Diagnosis) -> str:
    located = diagnosis.location.place if diagnosis.location else ()
    best = max(located, key=_accounted, default=None)
    effect = ""
    if best is not None:
        where = at_body(f"{best.signal or 'one'} at the {best.place}", diagnosis)
        by = best.effect if best.effect and best.score >= (best.explained or 0.0) else where
        share = f"the largest share of the mismatch, {100 * _accounted(best):.0f} %"
        effect = f"of all effects and signals, each taken alone, {spaced(by)} accounts for {share}"
    return "; ".join(filter(None, [_beyond_noise(diagnosis), effect]))


def _accounted(place: PlaceSummary) -> float:
    """Return the larger of the shares that the best effect at a place explains and that its signals predict."""
    return max(place.score, place.explained or 0.0)


def _disturbance(diagnosis: Diagnosis) -> str:
    origin = diagnosis.detection.origin
    if origin is None or origin.by == "nothing":
        return _beyond_noise(diagnosis)
    power = f"{_estimated(origin.share)} % of the power of the mismatch"
    if origin.by == "repeats":
        found, bound = f"{power} repeats with the command", FOREIGN
    else:
        # The limit is that of one regression's predictions; correlations within the fitted data may be larger.
        found, bound = (
            f"a regression on command and motion predicts {power} in data to which it was not fitted",
            PRACTICAL_SHARE,
        )
    # White noise of changing level is a disturbance by its share alone.
    judged = "limit" if origin.high < bound else "share"
    return (
        f"{found} (upper limit: {_estimated(origin.high)} %), and a mismatch counts as a disturbance only if this {judged} is "
        f"below {100 * bound:g} %"
    )


def _beyond_noise(diagnosis: Diagnosis) -> str:
    found = diagnosis.detection
    if found.p_value is None or found.excess is None:
        return ""
    beyond = _beyond(found.excess, diagnosis)
    if found.practical is None:
        return beyond
    return f"{beyond}, and errors below {_rms(found.practical, diagnosis)} do not count as a mismatch"


def _beyond(excess: float, diagnosis: Diagnosis) -> str:
    larger = "the larger of the errors on fitted and on held-out data"
    return f"the error beyond sensor noise is {_rms(excess, diagnosis)} ({larger})"


def _data_fault(diagnosis: Diagnosis) -> str:
    bad = sum(fault.samples for fault in diagnosis.faults)
    experiments = () if diagnosis.readings is None else diagnosis.readings.experiments
    whole = sum(record.timepts.size for one in experiments for record in one.recordings)
    if not whole:
        return f"{bad} samples are faulty"
    accepted = int(max(FEWEST_FAULTY, NEGLIGIBLE * whole))
    return f"{bad} of {whole} samples ({number(100 * bad / whole)} %) are faulty, and at most {accepted} are accepted"


def _not_testable(diagnosis: Diagnosis) -> str:
    moved = diagnosis.detection.moved
    by = "hardly moves the reading" if moved is None else f"moves the reading by only {_rms(moved, diagnosis)}"
    return (
        f"the command {by}, while sensor noise is {_rms(diagnosis.noise, diagnosis)} and the allowed model error is "
        f"{_rms(diagnosis.model_error, diagnosis)}"
    )


def _rms(value: float, diagnosis: Diagnosis) -> str:
    return f"{amount(number(value), written_unit(diagnosis.output.unit))} rms"


def percent(probability: float) -> str:
    """Write a probability in per cent."""
    return f"{100 * probability:.0f} %" if probability >= LEAST_TOLD else f"below {100 * LEAST_TOLD:g} %"


def _rest(whole: float, *shown: float) -> str:
    """Write what some probabilities leave of a whole, so that the percentages as shown add up to the whole."""
    rest = whole - sum(shown)
    if rest < LEAST_TOLD:
        return percent(rest)
    return f"{100 * whole - sum(round(100 * one) for one in shown if one >= LEAST_TOLD):.0f} %"


def _estimated(share: float) -> str:
    """Write a share in per cent; an estimate below 0 counts as 0."""
    percent = max(100 * share, 0.0)
    return f"{percent:.1f}" if 0.05 <= percent < 1 else f"{percent:.0f}"


_LINES: Mapping[Verdict, Callable[[Diagnosis], str]] = {
    Verdict.NONE: _clean,
    Verdict.PARAMETERS: _clean,
    Verdict.NAMED: _named,
    Verdict.AMBIGUOUS: _ambiguous,
    Verdict.PARTLY: _partly,
    Verdict.UNKNOWN: _unknown,
    Verdict.DISTURBANCE: _disturbance,
    Verdict.DATA_FAULT: _data_fault,
    Verdict.NOT_TESTABLE: _not_testable,
}

"""How sure a verdict is: the figures that decided it, in one line beside its sentence."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from deatwin.ident.mismatch.conclude import MARGIN
from deatwin.ident.mismatch.detect.detect import DRAWS
from deatwin.ident.mismatch.detect.law import LEVEL
from deatwin.ident.mismatch.detect.origin import FOREIGN, UNPREDICTED
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.quality.quality import FAULTY_SHARE, FEWEST_FAULTY
from deatwin.ident.mismatch.result import LEAST_TOLD, DetectionSummary
from deatwin.ident.mismatch.say import number, title_of
from deatwin.ident.mismatch.verdict import Explanation, Verdict
from deatwin.plant.amplitudes import amount, written_unit

HARDLY = 0.005
"""Probability that is shown as 0 %."""


def how_sure(diagnosis: Diagnosis) -> str:
    """State in one line how sure the verdict of a diagnosis is.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis whose verdict is judged.

    Returns
    -------
    str
        Probabilities of the explanations, or the figures that decided a verdict without causes; no capital and no full
        stop. Empty if the diagnosis has none of these figures.
    """
    return _LINES[diagnosis.verdict](diagnosis)


def _named(diagnosis: Diagnosis) -> str:
    if not diagnosis.explanations:
        return ""
    held = diagnosis.verification is not None and diagnosis.verification.holds
    tested = "; it passes all tests on held-out data" if held else ""
    first = diagnosis.explanations[0].probability
    if 1.0 - MARGIN - first < HARDLY:
        return (
            f"this explanation has a probability of {_percent(first)}, the highest that is stated, since {_percent(MARGIN)} "
            f"is kept for causes that were not tried{tested}"
        )
    return f"{', '.join([f'this explanation has a probability of {_percent(first)}', *_others(diagnosis)])}{tested}"


def _ambiguous(diagnosis: Diagnosis) -> str:
    if not diagnosis.explanations:
        return ""
    first, *others = diagnosis.explanations
    ranked = [first, *sorted(others, key=lambda each: -each.probability)]
    shown = [f"{_called(each, diagnosis)} {_percent(each.probability)}" for each in ranked]
    return ", ".join([*shown, *_others(diagnosis)])


def _called(explanation: Explanation, diagnosis: Diagnosis) -> str:
    """Return the names of an explanation's effects; a single one is alone if another explanation contains it."""
    answer, effects = diagnosis.explanations[0].effects, explanation.effects
    names = [name.replace("_", " ") if name in answer else title_of(name, diagnosis) for name in effects]
    alone = len(effects) == 1 and any(set(effects) < set(other.effects) for other in diagnosis.explanations)
    return (" and ".join(names) or "no effect") + (" alone" if alone else "")


def _others(diagnosis: Diagnosis) -> list[str]:
    """Return the probabilities of the explanations that were ruled out, and of those that were not tried."""
    rest = 1.0 - MARGIN - sum(e.probability for e in diagnosis.explanations)
    ruled_out = [f"other explanations that were tried {_percent(rest)}"] if rest >= HARDLY else []
    return [*ruled_out, f"causes that were not tried {_percent(MARGIN)}"]


def _partly(diagnosis: Diagnosis) -> str:
    said = [f"{cause.effect.replace('_', ' ')} {_percent(cause.probability)}" for cause in diagnosis.causes]
    return f"probability of being a part of what is missing: {', '.join(said)}; what else is missing is not known"


def _clean(diagnosis: Diagnosis) -> str:
    found = diagnosis.detection
    if found.p_value is None or found.excess is None:
        return ""
    if found.taken_up:
        return (
            f"after the fit to a part of the data, the error exceeded the noise by {_rms(found.excess, diagnosis)} "
            f"({_chance(found)}); after the fit to all data, the excess is too small to count as a mismatch"
            f"{_limit(diagnosis, ' (limit: {})')}"
        )
    return (
        f"{_chance(found)}; {_unexplained(found.excess, diagnosis)}; a mismatch is reported only if the probability is below "
        f"{LEVEL:g}{_limit(diagnosis, ' and that part is at least {}')}, or if that part is far larger"
    )


def _unknown(diagnosis: Diagnosis) -> str:
    located = diagnosis.location.place if diagnosis.location else ()
    best = max((place.score for place in located), default=None)
    effect = (
        ""
        if best is None
        else f"; no single effect and no signal accounts for more than {100 * best:.0f} % of the mismatch"
    )
    return _beyond_chance(diagnosis) + effect


def _disturbance(diagnosis: Diagnosis) -> str:
    origin = diagnosis.detection.origin
    if origin is None or origin.by == "nothing":
        return _beyond_chance(diagnosis)
    repeats = origin.by == "repeats"
    what = "repeats with the command" if repeats else "can be predicted from command and motion"
    return (
        f"apart from slow drifts, single steps and pure tones, {_estimated(origin.share)} % of the mismatch's power {what} "
        f"(at most {_estimated(origin.high)} %, two standard deviations higher); a mismatch counts as a disturbance if this "
        f"share is below {100 * (FOREIGN if repeats else UNPREDICTED):g} %"
    )


def _beyond_chance(diagnosis: Diagnosis) -> str:
    found = diagnosis.detection
    if found.p_value is None or found.excess is None:
        return ""
    enough = _limit(diagnosis, ", where {} would suffice for a mismatch")
    return f"{_chance(found)}; {_unexplained(found.excess, diagnosis)}{enough}"


def _data_fault(diagnosis: Diagnosis) -> str:
    bad = sum(fault.samples for fault in diagnosis.faults)
    experiments = () if diagnosis.readings is None else diagnosis.readings.experiments
    whole = sum(record.timepts.size for one in experiments for record in one.recordings)
    of_all = f" of {whole} samples ({number(100 * bad / whole)} %)" if whole else " samples"
    return (
        f"{bad}{of_all} are faulty; a recording counts as faulty if more than {FEWEST_FAULTY} samples and more than "
        f"{100 * FAULTY_SHARE:g} % of all samples are"
    )


def _not_testable(diagnosis: Diagnosis) -> str:
    moved, noise = diagnosis.detection.moved, _rms(diagnosis.noise, diagnosis)
    by = "too little" if moved is None else f"by {_rms(moved, diagnosis)}"
    return (
        f"the command moves the reading {by}; the sensor noise is {noise}, and the stated model error is "
        f"{_rms(diagnosis.model_error, diagnosis)}"
    )


def _chance(found: DetectionSummary) -> str:
    at_most = "at most " if found.p_value is not None and found.p_value < 1 / DRAWS else ""
    return (
        f"if the plant lacked nothing, a residual at least this unusual would occur with a probability of "
        f"{at_most}{number(found.p_value or 0.0)}"
    )


def _unexplained(excess: float, diagnosis: Diagnosis) -> str:
    """Return how large the error is beyond the noise."""
    return f"the part of the error that noise does not explain is {_rms(excess, diagnosis)}"


def _limit(diagnosis: Diagnosis, form: str) -> str:
    """Return the smallest excess that counts as a mismatch, in a clause; empty if unknown."""
    least = diagnosis.detection.practical
    return "" if least is None else form.format(_rms(least, diagnosis))


def _rms(value: float, diagnosis: Diagnosis) -> str:
    return f"{amount(number(value), written_unit(diagnosis.output.unit))} rms"


def _percent(probability: float) -> str:
    return f"{100 * probability:.0f} %" if probability >= LEAST_TOLD else f"below {100 * LEAST_TOLD:g} %"


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

"""The conclusion in a few plain sentences; the verdict decides which words are allowed.

The first sentence is the finding, and each of the others states one fact. Every number is a field of ``diagnosis.json``,
rounded as it is shown. Shares are shown in per cent, and amplitudes of a further reading in a unit with a prefix. There are
three exceptions: the 95 % of all intervals, stated at the first one, the number of explanations that are not named, and a
bound: a risk of less than a thousandth is written as below 0.1 %, since the digits of so small a prediction mean nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.locate.region import BRANCH, RATE, SINCE_REST
from deatwin.ident.mismatch.located import Band, LocationSummary, Region, Unexplained, Window
from deatwin.ident.mismatch.naming.places import timing_error
from deatwin.ident.mismatch.result import Fault
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import MOST, NEGLIGIBLE, ROUNDING
from deatwin.ident.mismatch.verdict import Cause, Explanation, FittedParameter, Interval, Verdict
from deatwin.plant.amplitudes import written_unit
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.errors import ModelError
from deatwin.plant.prefixes import prefixed, range_with_unit, resolving, time_span
from deatwin.plant.recording import label
from deatwin.plant.words import as_sentence, listed, spaced

COUNTED = {2: "two effects", 3: "three effects"}
MOST_CHANGED = 2
"""Largest number of changed parameters that are named."""
MOST_NAMED = 3
"""Number of faults, and of possible explanations, that are named; a single further explanation is named, too. A report
lists all of them in a table."""
_LEVEL = "95 % interval: "


def number(value: float, digits: int = 3) -> str:
    """Write a number as the sentence shows it: rounded to significant digits, never with an exponent."""
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False).rstrip(".")


def rig_field(name: str, value: object) -> str:
    """Write a field of a rig.

    >>> rig_field("contact_radius", 0.0030004), rig_field("reading", "start of hold")
    ('contact radius = 0.003', "reading = 'start of hold'")
    """
    return f"{spaced(name)} = {field_value(value)}"


def field_value(value: object) -> str:
    """Write the value of a rig's field: a number with up to four digits, never with an exponent."""
    return np.format_float_positional(float(f"{value:.4g}"), trim="-") if isinstance(value, float) else repr(value)


def risk(share: float) -> str:
    """Write a predicted risk in per cent, without the sign, to two digits, or as a bound below a thousandth."""
    return number(100 * share, 2) if share >= NEGLIGIBLE else f"below {100 * NEGLIGIBLE:g}"


@checks_its_arguments
def say(diagnosis: Diagnosis) -> str:
    """Write the conclusion of a diagnosis in plain sentences.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis to describe. Its field `sentence` is ignored.

    Returns
    -------
    str
        Several sentences, the finding first.
    """
    said = " ".join(as_sentence(one) for one in _SENTENCES[diagnosis.verdict](diagnosis) if one)
    first, level, rest = said.partition(_LEVEL)
    return first + level + rest.replace(_LEVEL, "")


def notes_of(diagnosis: Diagnosis) -> list[str]:
    """Return the warnings, without those that the sentence states as well."""
    return [text for text in diagnosis.warnings if text.rpartition(": ")[2] not in diagnosis.sentence]


def _none(diagnosis: Diagnosis) -> list[str]:
    return ["the recordings show no missing physics", _left(_of_first(diagnosis)), _accounted(diagnosis)]


def _parameters(diagnosis: Diagnosis) -> list[str]:
    taken_up = diagnosis.detection.taken_up
    late = diagnosis.parameters.get("delay.time") if taken_up else None
    return [
        "the recordings show no missing physics: only parameters of the model were wrong",
        _restated(diagnosis),
        _changed(diagnosis),
        _left(_of_first(diagnosis)),
        f"after a fit to all recordings, {_accounted(diagnosis)}" if taken_up else _accounted(diagnosis),
        "" if late is None else f"the fit to all recordings includes a dead time of {_with_interval(late)}",
    ]


def _restated(diagnosis: Diagnosis) -> str:
    """Name the numbers of the rig that differ from the stated ones."""
    form = diagnosis.forms[0].form if diagnosis.forms else {}
    numbers = [rig_field(name, value) for name, value in form.items() if isinstance(value, float)]
    return (
        f"the recordings fit a rig with {listed(numbers)} (in SI units) better than the nominal one" if numbers else ""
    )


def _changed(diagnosis: Diagnosis) -> str:
    """Name the parameters that the calibration changed by the largest factors, if they differ from nominal ones for sure."""
    factors = {
        name: abs(float(np.log(p.value / p.nominal)))
        for name, p in diagnosis.parameters.items()
        if p.nominal and p.value / p.nominal > 0.0 and not p.low <= p.nominal <= p.high
    }
    largest = sorted(factors, key=lambda name: -factors[name])[:MOST_CHANGED]
    said = [_beside_nominal(name, diagnosis.parameters[name]) for name in largest]
    return f"the largest changes are those of {listed(said)}" if said else ""


def _beside_nominal(name: str, parameter: FittedParameter) -> str:
    return f"{spaced(name)} (from {range_with_unit(parameter.nominal or 0.0, parameter.value, parameter.unit)})"


def _named(diagnosis: Diagnosis) -> list[str]:
    causes = diagnosis.causes
    count = "an effect" if len(causes) == 1 else COUNTED.get(len(causes), "several effects")
    physics = ", and ".join(_physics(cause, diagnosis) for cause in causes)
    return [f"the model lacks {count}: {physics}", _explained(causes), _gain(diagnosis)]


def _explained(causes: Sequence[Cause]) -> str:
    """Write the share of the mismatch that each cause explains."""
    first, *others = causes
    whole = "of the mismatch between model and recordings"
    if not others:
        return f"{spaced(first.effect)} explains {_share(first)} {whole}"
    # The others imitate a part of each cause, so the shares need not add up to the whole.
    each = [f"without {spaced(c.effect)}, {100 * c.share_explained:.0f} %" for c in others]
    start = f"without {spaced(first.effect)}, {100 * first.share_explained:.0f} % {whole} would return"
    return f"{', '.join([start, *each[:-1]])}, and {each[-1]}"


def _effects(diagnosis: Diagnosis) -> list[str]:
    return [spaced(cause.effect) for cause in diagnosis.causes]


def _ambiguous(diagnosis: Diagnosis) -> list[str]:
    known = tuple(cause.effect for cause in diagnosis.causes)
    first, others = headline(diagnosis)
    possible = [called(one.effects, diagnosis) for one in first] + [f"one of {others} others"] * (others > 0)
    physics = ", and ".join(_physics(cause, diagnosis) for cause in diagnosis.causes)
    perhaps = f"perhaps {or_listed(possible)}"
    finding = f"something is missing from the model, and these recordings cannot decide what: {perhaps}"
    if any(not one.effects for one in diagnosis.explanations):
        finding = f"these recordings cannot decide whether something is missing from the model: {perhaps}"
    return [
        finding,
        f"if the missing {'effects are' if len(known) > 1 else 'effect is'} {called(known, diagnosis)}, {physics}",
        *(_or_nothing(cause, diagnosis) for cause in diagnosis.causes),
        _gain(diagnosis),
        *_next(diagnosis),
    ]


def ranked(diagnosis: Diagnosis) -> list[Explanation]:
    """Return the first explanation and then its alternatives, the likeliest of these first."""
    explanations = diagnosis.explanations
    return [*explanations[:1], *sorted(explanations[1:], key=lambda one: -one.probability)]


def headline(diagnosis: Diagnosis) -> tuple[list[Explanation], int]:
    """Return the explanations that are named, the first before its alternatives, and the number of the others."""
    every = ranked(diagnosis)
    others = len(every) - MOST_NAMED
    return (every[:MOST_NAMED], others) if others > 1 else (every, 0)  # a single other one is named, too


def called(effects: Sequence[str], diagnosis: Diagnosis) -> str:
    """Return the names of an explanation's effects; a single one is alone if another explanation contains it."""
    answer = tuple(cause.effect for cause in diagnosis.causes)
    effects = answer if set(effects) == set(answer) else effects  # in the order of the causes
    names = [spaced(name) if name in answer else title_of(name, diagnosis) for name in effects]
    others = (answer, *(one.effects for one in diagnosis.explanations))
    alone = len(effects) == 1 and any(set(effects) < set(other) for other in others)
    return (listed(names) or "no effect at all") + (" alone" if alone else "")


def or_listed(texts: Sequence[str]) -> str:
    """Join possibilities in words.

    >>> or_listed(["A", "B", "C"]), or_listed(["A", "B"]), or_listed(["A"])
    ('A, B, or C', 'A, or B', 'A')
    """
    return ", or ".join([*filter(None, [", ".join(texts[:-1])]), *texts[-1:]])


def title_of(cause: str, diagnosis: Diagnosis) -> str:
    """Return the name of an alternative's effect, or its names at further places if it acts only there."""
    effects = (effect for rival in diagnosis.rival_models.values() for effect in rival.plant.effects)
    titles = dict.fromkeys(effect.title for effect in effects if effect.cause == cause)
    return spaced(cause) if "" in titles else " or ".join(titles) or spaced(cause)


def _or_nothing(cause: Cause, diagnosis: Diagnosis) -> str:
    """Return a warning if the interval of a strength includes zero, unless every explanation has this effect."""
    if diagnosis.explanations and all(cause.effect in one.effects for one in diagnosis.explanations):
        return ""
    strength = cause.parameters.get(_effect(cause, diagnosis).strength)
    absent = strength is not None and strength.low <= 0.0 <= strength.high
    name = spaced(cause.effect)
    reason = "because the 95 % interval of its strength includes zero"
    return f"these recordings do not prove that {name} is present, {reason}" if absent else ""


def _partly(diagnosis: Diagnosis) -> list[str]:
    left = diagnosis.unexplained
    if left is None:
        raise ModelError("a diagnosis of a part of the mismatch needs the unexplained remainder")
    return [
        f"the model lacks {listed(_effects(diagnosis))}, and something else that could not be identified",
        *(_physics(cause, diagnosis) for cause in diagnosis.causes),
        _explained(diagnosis.causes),
        f"of the {_amplitude(left.mismatch, diagnosis)} mismatch, {_amplitude(left.rms, diagnosis)} remain unexplained"
        f"{_mostly(left, diagnosis)}",
        _gain(diagnosis),
    ]


def _mostly(left: Unexplained, diagnosis: Diagnosis) -> str:
    """Return where most of the remaining mismatch lies, if one range holds more than half of it."""
    window, band, region = left.time, left.frequency, left.region
    if window is not None and window.score > MOST:
        return f", mostly {_between(window)}"
    if band is not None:
        return f", mostly {_at(band)}"
    return "" if region is None else f", mostly {_in(region, diagnosis)}"


def _at(band: Band) -> str:
    high = number(band.to_Hz, 2)
    return f"from {number(band.from_Hz, 2)} to {high} Hz" if band.from_Hz > 0 else f"below {high} Hz"


def unit_of(signal: str, diagnosis: Diagnosis) -> str:
    """Return the unit of an operating signal, as it is shown; empty if unknown."""
    unit = written_unit(diagnosis.output.unit)
    if signal == diagnosis.output.name:
        return unit
    if signal.endswith(RATE):
        return f"{unit or '1'}/s"
    known = diagnosis.readings and diagnosis.readings.experiments[0].recordings[0].input_units[0]
    return known if known and known != "1" else ""


def ends(region: Region) -> tuple[float, float]:
    """Return the ends of a region, 0 in place of an end that is only a rounding error beside the other."""
    least = ROUNDING * max(abs(region.low), abs(region.high))
    low, high = (end if abs(end) > least else 0.0 for end in (region.low, region.high))
    return low, high


def since_rest(region: Region) -> str:
    """Return a range of the time since the command rested, in the words of a condition; it is 0 during a rest."""
    low, high = ends(region)
    first, last = number(low), number(high)
    during = f"during rests of the command and up to {last} s after the last one"
    span = during if low <= 0.0 else f"{first} to {last} s after the last rest of the command"
    return f"{span}, or after the start of the recording if there was none"


def _in(region: Region, diagnosis: Diagnosis) -> str:
    """Return a range of an operating signal, in the words of a condition."""
    if region.signal == BRANCH:
        return f"while the reading {'rises' if region.high > 0 else 'falls'}"
    if region.signal == SINCE_REST:
        return since_rest(region)
    span, signal = " to ".join(number(end) for end in ends(region)), spaced(region.signal)
    article = "an" if signal[:1].lower() in "aeio" else "a"
    return f"at {article} {signal} from {span} {unit_of(region.signal, diagnosis)}".rstrip()


def _unknown(diagnosis: Diagnosis) -> list[str]:
    form, tests = diagnosis.free_form, diagnosis.verification
    return [
        "something is missing from the model, and no effect of the catalogue explains it",
        f"{_left(_shown(diagnosis))} ({_noise(diagnosis)})",
        *_where(diagnosis),
        "the explanation that fitted best failed its tests on held-out data"
        if tests is not None and not tests.holds
        else "",
        ""
        if form is None
        else f"a fitted formula without physical meaning lowers the error on held-out data from {_rounded(form.before)} to "
        f"{_amplitude(form.after, diagnosis)}",
    ]


def _where(diagnosis: Diagnosis) -> list[str]:
    """Return when, how fast and under which conditions the mismatch occurs, and where in the chain to look for it."""
    found = diagnosis.location
    if found is None:
        return []
    region = max(found.region, key=lambda one: abs(one.mean_residual), default=None)
    places = likely_places(diagnosis)
    return [
        _when(found, diagnosis),
        _how_fast(found),
        ""
        if region is None
        else f"the mean residual is largest in magnitude, {_size(region.mean_residual, diagnosis)}, {_in(region, diagnosis)}",
        f"if the readings are sound, first look for the cause {places}, because the signals there predict the mismatch best"
        if places
        else "",
    ]


def likely_places(diagnosis: Diagnosis) -> str:
    """Return the places whose signals predict most of the mismatch, as ``at the film or the ball``; empty if none do."""
    best: dict[str, list[str]] = {}
    for place in diagnosis.location.place if diagnosis.location else ():
        if place.among_best and (place.explained or 0.0) > MOST:
            signals = best.setdefault(at_body(spaced(place.place), diagnosis), [])
            signals += [spaced(place.signal)] if place.signal else []
    places = [f"{place} ({', '.join(signals)})" if signals else place for place, signals in best.items()]
    return f"at the {' or the '.join(places)}" if places else ""


def _how_fast(found: LocationSummary) -> str:
    """Return the range of frequencies that holds most of the mismatch's power; empty if none does."""
    band = next((b for b in found.frequency if b.power > MOST * sum(one.power for one in found.frequency)), None)
    return "" if band is None else f"most of the power of the mismatch lies at frequencies {_at(band)}"


def _when(found: LocationSummary, diagnosis: Diagnosis) -> str:
    """Return the stretch of time that holds most of the mismatch; empty if its times are unknown."""
    longest = max(found.time, key=lambda window: window.score, default=None)
    if longest is None:
        return ""
    if longest.score <= MOST:
        return "the mismatch is spread over the recordings"
    share = f"{100 * longest.score:.0f} % lies {_between(longest)}{_recorded(longest, diagnosis)}"
    return f"of the mismatch between model and recordings, {share}"


def _recorded(window: Window, diagnosis: Diagnosis) -> str:
    """Return the recording that holds a stretch of time; empty if there is only one, or if clocks overlap."""
    experiments = () if diagnosis.readings is None else diagnosis.readings.experiments
    records = [record for one in experiments for record in one.recordings]
    holding = [r for r in records if r.start < window.to_s and window.from_s < r.end]
    return f" of {label(holding[0])}" if len(records) > 1 and len(holding) == 1 else ""


def _between(window: Window) -> str:
    """Write a stretch of time to two digits of its length, or to whole seconds if it is longer than ten."""
    length = max(window.to_s - window.from_s, 0.1)
    decimals = max(0, 1 - int(np.floor(np.log10(length))))
    return f"between {window.from_s:.{decimals}f} and {window.to_s:.{decimals}f} s"


def _disturbance(diagnosis: Diagnosis) -> list[str]:
    origin = diagnosis.detection.origin
    repeated = origin is None or origin.by == "repeats"
    unlike = "does not repeat with the command" if repeated else "cannot be predicted from command and motion"
    return [
        f"the mismatch between model and recordings is a disturbance, not missing physics: it {unlike}",
        f"{_left(_shown(diagnosis))} ({_noise(diagnosis)})",
        ""
        if origin is None
        else f"{_part(origin.share)} the mismatch repeats with the command"
        if repeated
        else f"a regression on command and motion predicts {_part(origin.share)} the mismatch in data to which it was not "
        "fitted",
        "" if diagnosis.location is None else _how_fast(diagnosis.location),
    ]


def _data_fault(diagnosis: Diagnosis) -> list[str]:
    faults = diagnosis.faults
    many = any(fault.experiment > 1 for fault in faults)
    said = [_fault(fault, many) for fault in faults[:MOST_NAMED]]
    if len(said) == 1:
        return [f"the recording is faulty: {said[0]}"]
    one = len({(fault.experiment, fault.recording) for fault in faults}) == 1
    return [
        "the recording is faulty" if one else "the recordings are faulty",
        *said,
        "the report lists further faults" if len(faults) > MOST_NAMED else "",
    ]


def _not_testable(diagnosis: Diagnosis) -> list[str]:
    return [
        "the input moves the actuator too little to test whether physics is missing",
        f"{_left(_shown(diagnosis))} ({_noise(diagnosis)})",
    ]


_SENTENCES: Mapping[Verdict, Callable[[Diagnosis], list[str]]] = {
    Verdict.NONE: _none,
    Verdict.PARAMETERS: _parameters,
    Verdict.NAMED: _named,
    Verdict.AMBIGUOUS: _ambiguous,
    Verdict.PARTLY: _partly,
    Verdict.UNKNOWN: _unknown,
    Verdict.DISTURBANCE: _disturbance,
    Verdict.DATA_FAULT: _data_fault,
    Verdict.NOT_TESTABLE: _not_testable,
}


def _left(shown: _Shown) -> str:
    """Write the error of the calibrated base plant."""
    return (
        f"the calibrated model has an error{shown.reading and f' in {shown.reading}'} of {shown.sized(shown.fitted)} on fitted "
        f"data and {shown.sized(shown.unseen)} on held-out data"
    )


def _accounted(diagnosis: Diagnosis) -> str:
    return (
        f"sensor noise ({_amplitude(diagnosis.noise, diagnosis)}) and the allowed model error "
        f"({_amplitude(diagnosis.model_error, diagnosis)}) explain the error of the calibrated model"
    )


def _gain(diagnosis: Diagnosis) -> str:
    shown, gain = _shown(diagnosis), diagnosis.fit.unseen.gain_low
    if shown.after is None or gain is None:
        raise ModelError("a diagnosis with causes needs the error that they leave on held-out data")
    chance = "" if gain > 0 else ", but this reduction could be due to chance"
    findings = diagnosis.findings
    late = ["the timing error of the rig"] if findings is not None and timing_error(findings.answer) else []
    return (
        f"adding {listed([*_effects(diagnosis), *late])} to the model lowers the error"
        f"{shown.reading and f' of {shown.reading}'} on held-out data from {_rounded(shown.unseen)} to "
        f"{shown.sized(shown.after)}{chance} ({_noise(diagnosis)})"
    )


@dataclass(frozen=True, kw_only=True)
class _Shown:
    """Errors of one reading in one unit, and the name of the reading in a sentence."""

    fitted: float
    unseen: float
    after: float | None
    noise: float
    unit: str
    reading: str = ""

    def sized(self, value: float) -> str:
        return f"{_rounded(value)} {self.unit}".rstrip() + " rms"


def _of_first(diagnosis: Diagnosis) -> _Shown:
    """Return the errors of the first reading, with its name if there are others."""
    fit = diagnosis.fit
    return _Shown(
        fitted=fit.fitted.before,
        unseen=fit.unseen.before,
        after=fit.unseen.after,
        noise=diagnosis.noise,
        unit=written_unit(diagnosis.output.unit),
        reading=f"the {spaced(diagnosis.output.name)}" if diagnosis.taught else "",
    )


def _shown(diagnosis: Diagnosis) -> _Shown:
    """Return the errors of the reading whose mismatch is largest relative to its noise."""
    several = diagnosis.taught or ()
    most = max(several, key=lambda one: one.unseen.before / one.noise if one.noise else 0.0, default=None)
    if most is None or most is several[0]:
        return _of_first(diagnosis)
    size, unit = prefixed(most.unseen.before, most.unit)
    return _Shown(
        fitted=most.fitted.before / size,
        unseen=most.unseen.before / size,
        after=None if most.unseen.after is None else most.unseen.after / size,
        noise=most.noise / size,
        unit=unit,
        reading=f"the {most.name}",
    )


def _noise(diagnosis: Diagnosis) -> str:
    shown = _shown(diagnosis)
    return f"sensor noise: {shown.sized(shown.noise)}"


def _amplitude(value: float, diagnosis: Diagnosis) -> str:
    return f"{_size(value, diagnosis)} rms"


def _size(value: float, diagnosis: Diagnosis) -> str:
    return f"{_rounded(value)} {written_unit(diagnosis.output.unit)}".rstrip()


def _rounded(value: float) -> str:
    return number(value, 3 if abs(value) >= 10 else 2)


def _share(cause: Cause) -> str:
    only = "only " if cause.share_explained < MOST else ""
    return f"{only}{100 * cause.share_explained:.0f} %"


def _part(share: float) -> str:
    """Write a share in per cent; an estimated share may be negative."""
    percent = round(100 * share)
    return f"{percent} % of" if percent > 0 else "none of"


def _physics(cause: Cause, diagnosis: Diagnosis) -> str:
    """Write an effect in its own words, which a user's effect also brings along."""
    text = at_body(_effect(cause, diagnosis).wording, diagnosis).format(
        **{n: _with_interval(in_percent(n, p)) for n, p in cause.parameters.items()}
    )
    others = [f"the {at_body(spaced(place), diagnosis)}" for place in (cause.places or ())[1:]]
    elsewhere = f" (or at {' or '.join(others)}: these recordings cannot decide)" if others else ""
    return text[0].lower() + text[1:] + elsewhere


def at_body(text: str, diagnosis: Diagnosis) -> str:
    """Return a text in which the moving part has its name on this rig."""
    model = diagnosis.model or diagnosis.base_model
    return text if model is None else re.sub(r"\bball\b", lambda _: model.plant.rig.body, text)


def _effect(cause: Cause, diagnosis: Diagnosis) -> Effect:
    own = () if diagnosis.model is None else diagnosis.model.plant.effects
    return next((e for e in own if e.cause == cause.effect), None) or effect_named(cause.effect)


def in_percent(name: str, parameter: Interval) -> Interval:
    """Return a relative change, such as relative_loss, in per cent; any other parameter unchanged."""
    if parameter.unit != "1" or not name.startswith("relative_"):
        return parameter
    return Interval(value=100 * parameter.value, low=100 * parameter.low, high=100 * parameter.high, unit="%")


def _with_interval(parameter: Interval) -> str:
    shown = parameter.shown
    digits = resolving(parameter.low, parameter.high)
    value, low, high = (number(each, digits) for each in (shown.value, shown.low, shown.high))
    unit = shown.unit.removeprefix("1")  # the 1 of 1/K is not written
    return f"{value} {unit} ({_LEVEL}{low} to {high})".replace("  ", " ")


def _next(diagnosis: Diagnosis) -> list[str]:
    """Return what the advised experiment would decide."""
    advised = diagnosis.advice
    if advised is None:
        return []
    before, after = (
        "" if share is None else risk(share) for share in (advised.confusion_before, advised.confusion_after)
    )
    if advised.seconds is None:
        measure = advised.measure
        none = "no input within the rig's limits would distinguish the explanations"
        return [] if measure is None else [f"{none}, so measure {measure}"]
    if before == after and not advised.undecided:
        return []  # the recordings at hand have decided already as far as figures tell
    mass = advised.added_mass_g
    load = "" if mass is None else f" with {number(mass)} g added to the load"
    return [
        f"recording the response to the {number(advised.seconds)} s of input in {advised.file}{load} would lower the "
        f"probability that a wrong explanation fits better than the true one from {before} to {after} %",
        f"also measure {advised.measure}, because the input in {advised.file} cannot distinguish all explanations"
        if advised.undecided
        else "",
    ]


def _fault(fault: Fault, many: bool) -> str:
    which = fault.file + (f" of experiment {fault.experiment}" if many else "")
    samples = f"{fault.samples} samples between {time_span(fault.from_s, fault.to_s, between=' and ')}"
    return f"in {which}, {fault.fault} in {samples if fault.samples > 1 else f'one sample, at {fault.from_s:.2f} s'}"

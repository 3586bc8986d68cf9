"""Assemble the conclusion of a diagnosis from the results of its steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from deatwin.ident.greybox.parts import first_only
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.excess import beyond_noise
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.layout import Readings
from deatwin.ident.mismatch.likelihood.beforehand import is_wrong
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.located import LocationSummary, PlaceSummary
from deatwin.ident.mismatch.model_error import differences, with_model_error
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.criteria import acts, explained, held_back_by, suffices, takes_most
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.decide import Naming, is_possible, normalised
from deatwin.ident.mismatch.naming.places import causes_of, missing_effects, timing_error
from deatwin.ident.mismatch.partly import unexplained
from deatwin.ident.mismatch.quality.compared import factors
from deatwin.ident.mismatch.quality.quality import faults_of
from deatwin.ident.mismatch.refit.equals import exchanged_lags
from deatwin.ident.mismatch.refit.fitted import fitted_parameters
from deatwin.ident.mismatch.refit.search import gap_around
from deatwin.ident.mismatch.result import Errors, FitSummary, IndistinguishablePair, Output, UnseenErrors
from deatwin.ident.mismatch.say import field_value, number, rig_field, say
from deatwin.ident.mismatch.steps import variants_tried
from deatwin.ident.mismatch.taught import errors_in, taught
from deatwin.ident.mismatch.thresholds import CREDIBLE, DISTINGUISHED
from deatwin.ident.mismatch.verdict import CandidateSummary, Cause, Explanation, Interval, Verdict
from deatwin.ident.mismatch.verify.verify import share_of, shares_explained
from deatwin.plant.amplitudes import amount, written_unit
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.effects.base import Alone, Effect
from deatwin.plant.model import Plant
from deatwin.plant.prefixes import range_with_unit, with_unit
from deatwin.plant.recording import label
from deatwin.plant.resolution import solved_like
from deatwin.plant.words import spaced


def conclude(findings: Findings) -> Diagnosis:
    """Write the diagnosis from the findings of all steps."""
    rig, base, answer = findings.final.plant.rig, findings.base, findings.answer
    (unit, size), experiments = findings.unit, findings.checked.experiments
    further = dict.fromkeys(part.reading for part in findings.problem.everything if part.reading)
    model = CalibratedPlant(
        plant=with_model_error(findings.final.plant, findings.problem.stated_error),
        noise=base.noise,
        model_error=_left(findings),
        names=findings.final.names,
        covariance=findings.intervals.covariance,
        provenance={"verdict": findings.verdict.value},
    )
    causes = _causes(findings) if findings.named else ()
    alternatives = findings.naming.alternatives if findings.named else ()
    names = tuple(dict.fromkeys(e for c in (answer, *alternatives) for e in causes_of(c)))
    diagnosis = Diagnosis(
        output=Output(name=rig.output_name, unit=unit),
        verdict=findings.verdict,
        noise=base.noise / size,
        model_error=rig.model_error / size,
        detection=findings.detection.summary,
        location=_location(findings),
        unexplained=None
        if findings.left is None
        else unexplained(
            answer, base.chosen, findings.left, sum(r.duration for e in experiments for r in e.recordings)
        ),
        free_form=None if findings.discovery is None else findings.discovery.summary,
        causes=causes,
        names=names,
        rivals=tuple(causes_of(alternative) for alternative in alternatives),
        explanations=_explanations(findings),
        indistinguishable=_indistinguishable(findings) if findings.named else (),
        advice=None if findings.advice is None else findings.advice.summary,
        sentence="",
        fit=_fit_summary(findings),
        warnings=(
            *findings.checked.findings,
            *findings.checked.notes,
            *(findings.verification.failures if findings.naming.best is not None else ()),
            *_left_over(findings),
            *_late(findings),
            *_placed_unseen(findings),
            *_form(findings),
            *_restated(findings),
            *_scaled(findings),
            *_variants_of_alternatives(findings),
            *(
                f"{name} was not tried, because the model with this effect could not be simulated"
                for name in findings.naming.failed
            ),
            *_at_bounds(findings),
            *_widened(findings.final.plant),
            *exchanged_lags(findings.final),
            *_held_back(findings),
            *_nearest(findings),
            *_alike_but_unlikely(findings),
            *_hardly_shown(findings),
            *_doubtful_values(findings),
        ),
        verification=findings.verification.summary if findings.verification.ablations else None,
        faults=faults_of(findings.checked),
        taught=taught(findings),
        parameters=fitted_parameters(findings.problem.nominal, findings.base_intervals),
        forms=variants_tried(findings.problem, base),
        model=model,
        base_model=_base_model(findings),
        rival_models=_rival_models(findings) if findings.named else {},
        candidates=_candidates(findings),
        readings=_readings(findings, model),
        further=tuple(_readings(findings, model, name) for name in further),
        findings=findings,
    )
    return replace(diagnosis, sentence=say(diagnosis))


def _held_back(findings: Findings) -> Iterator[str]:
    """If nothing explains the recordings, name the likeliest effect that only a parameter range excludes."""
    naming = findings.naming
    if findings.verdict is not Verdict.UNKNOWN or naming.best is not None:
        return
    alone = [c for c in naming.candidates if len(c.effects) == 1]
    held = [c for c in alone if takes_most(c, naming.base) and suffices(c, naming.base) and held_back_by(c)]
    for candidate in sorted(held, key=lambda c: -c.evidence)[:1]:
        yield (
            f"{_in_words(candidate)} would explain the recordings, but only with "
            f"{', '.join(held_back_by(candidate))} outside the allowed range"
        )


def _nearest(findings: Findings) -> Iterator[str]:
    """If nothing explains the recordings, name the single effect that removes most of the mismatch, if any does."""
    naming = findings.naming
    if findings.verdict is not Verdict.UNKNOWN or naming.best is not None:
        return
    alone = [c for c in naming.candidates if len(c.effects) == 1 and takes_most(c, naming.base)]
    able = [c for c in alone if acts(c, naming.base) and not held_back_by(c) and not suffices(c, naming.base)]
    if able:
        nearest = max(able, key=lambda c: c.evidence)
        share = round(100 * max(explained(nearest, naming.base), 0.0))
        yield (
            f"of the effects in the catalogue, {_in_words(nearest)} comes closest, but it removes only {share} % of the "
            "mismatch's power, so other physics acts beside or instead of it"
        )


def _hardly_shown(findings: Findings) -> Iterator[str]:
    """Warn if the best explanation has a cycle of which the recordings show less than a quarter."""
    best = findings.naming.best
    if (
        findings.verdict is Verdict.UNKNOWN
        and best is not None
        and not shows_its_cycles(best, findings.problem.everything)
    ):
        yield (
            f"{_in_words(best)} could explain the recordings, but less than a quarter of a "
            "cycle was recorded, and so short a part of a cycle cannot be distinguished from any other slow change"
        )


def _doubtful_values(findings: Findings) -> Iterator[str]:
    """Warn of fitted parameters so far from nominal that the nominal value is more probably wrong than inaccurate."""
    if findings.verdict is not Verdict.PARAMETERS:
        return
    nominal, fitted = findings.problem.nominal.parameters, findings.final.plant.parameters
    for name in findings.final.names:
        if name in nominal and is_wrong(fitted[name], nominal[name]):
            found, known = (amount(number(p.value), p.unit) for p in (fitted[name], nominal[name]))
            yield (
                f"the fitted {spaced(name)}, {found}, is far from its nominal value, {known}: measure this parameter "
                "if you can, because missing physics can change fitted values (a missing lag, for example, changes the damping)"
            )


def _alike_but_unlikely(findings: Findings) -> Iterator[str]:
    """Yield explanations that these inputs cannot distinguish from the answer, but whose strength is unlikely."""
    naming = findings.naming
    if not findings.named or naming.best is None:
        return
    near = {distance.effects[1] for distance in naming.distances if distance.d2 < DISTINGUISHED}
    known = {"+".join(alternative.effects) for alternative in naming.alternatives}
    for other in naming.candidates:
        name = "+".join(other.effects)
        if name in near and name not in known and not is_possible(other, naming.best):
            yield (
                f"these recordings could also be explained by {_in_words(other)}, but only with an unusual strength, so this "
                "explanation does not count as an alternative"
            )


def _left(findings: Findings) -> float:
    """Return the final plant's rms error on held-out data, SI."""
    if findings.discovery is not None:
        return beyond_noise(findings.discovery.after**2, findings.base.noise)
    return findings.answer.unseen_test.size if findings.named else _base_error(findings)


def _base_error(findings: Findings) -> float:
    """Return the rms error of the reported base plant, SI: on held-out data unless it was fitted to them."""
    taken_up = findings.detection.taken_up
    unseen = findings.base.chosen.unseen_test.size
    return unseen if taken_up is None else beyond_noise(taken_up.rms**2, findings.base.noise)


def _indistinguishable(findings: Findings) -> tuple[IndistinguishablePair, ...]:
    known = {"+".join(c.effects): "+".join(causes_of(c)) for c in (findings.answer, *findings.naming.alternatives)}
    return tuple(
        IndistinguishablePair(effects=tuple(known[name] for name in pair.effects), d2=pair.d2)
        for pair in findings.naming.distances
        if all(name in known for name in pair.effects)
    )


def _late(findings: Findings) -> Iterator[str]:
    """Tell the timing error that the amended plant includes."""
    plant = findings.final.plant
    for effect in timing_error(findings.answer):
        time = plant.parameters[f"{effect.name}.time"]
        yield (
            f"the amended model also includes a {effect.title or spaced(effect.name)} of "
            f"{with_unit(time.value, time.unit)}, which counts as a timing error of the rig, not as missing physics"
        )


def _left_over(findings: Findings) -> list[str]:
    """Warn if a good explanation leaves more than the model error."""
    if not findings.named or findings.answer.adequate or findings.left is not None:
        return []
    unit, size = findings.unit
    left = max(findings.answer.fitted_test.size, findings.answer.unseen_test.size) / size
    said = amount(f"{left:.3g}", written_unit(unit))
    return [f"the explanation leaves an error of {said} rms, more than the allowed model error"]


def _widened(plant: Plant) -> Iterator[str]:
    """Warn of parameters of effects that were fitted beyond their usual ranges."""
    for usual in (p for effect in plant.effects for p in effect.parameters):
        value = plant.parameters[usual.name].value
        if not usual.lower <= value <= usual.upper:
            span = range_with_unit(usual.lower, usual.upper, usual.unit)
            yield f"the fitted {spaced(usual.name)} lies outside its usual range of {span}"


def _at_bounds(findings: Findings) -> Iterator[str]:
    """Warn of fitted parameters at a bound; for the rig's own ones, a wrong statement about the rig is a likely reason."""
    for name in findings.final.at_bound:
        advice = ": check what is stated about the rig" if name in findings.problem.nominal.parameters else ""
        yield f"the fitted {spaced(name)} lies at a bound of its allowed range{advice}"


def _placed_unseen(findings: Findings) -> Iterator[str]:
    """Warn of events whose times were fitted to held-out data."""
    problem, plant = findings.problem, findings.answer.calibration.plant
    for name in plant.event_times if findings.named else ():
        if gap_around(plant, name, problem.fitted, problem.everything) is not None:
            yield f"{name} was fitted to held-out data, so these data are not a fully independent test"


def _form(findings: Findings) -> list[str]:
    """Warn if the recordings contradict the rig file, or fit one of its interpretations better."""
    stated, found = differences([findings.problem.nominal.rig, findings.final.plant.rig])
    return [
        f"the recordings fit a rig with {rig_field(name, found[name])} better than one with {rig_field(name, value)}"
        for name, value in stated.items()
    ]


def _restated(findings: Findings) -> Iterator[str]:
    """Tell with which other number of the rig the recordings could also be explained."""
    nominal = findings.problem.nominal.rig
    for variant in findings.restated:
        stated, found = differences([nominal, variant.calibration.plant.rig])
        changes = [f"{rig_field(name, found[name])} instead of {field_value(value)}" for name, value in stated.items()]
        yield f"a rig with {' and '.join(changes)} would also explain the recordings, without any effect: check this"


def _scaled(findings: Findings) -> Iterator[str]:
    """Warn if readings are a multiple of the nominal model's that no calibration reaches."""
    for part, factor in factors(findings.problem, findings.base.chosen.calibration.plant):
        yield (
            f"{label(part.experiment.recordings[0])}: {factor:.3g} times the readings of the nominal model explain most of "
            "the readings, but no calibration does: check signs and units of the readings and of the command, and the gain"
        )


def _variants_of_alternatives(findings: Findings) -> Iterator[str]:
    """Warn of alternatives in other rig variants than the answer's."""
    for alternative in findings.naming.alternatives if findings.named else ():
        _, found = differences([findings.answer.calibration.plant.rig, alternative.calibration.plant.rig])
        if found:
            variant = ", ".join(rig_field(name, value) for name, value in found.items())
            explanation = _in_words(alternative) or "no effect at all"
            yield f"the alternative explanation, {explanation}, requires that the rig has {variant}"


def _in_words(explanation: Candidate) -> str:
    """Return the names of an explanation's effects as in a sentence."""
    effects = [e for e in explanation.calibration.plant.effects if e.name in explanation.effects]
    return " and ".join(effect.title or spaced(effect.name) for effect in effects)


def _causes(findings: Findings) -> tuple[Cause, ...]:
    final, base, weights = findings.final, findings.base, _weights(findings)
    shares = shares_explained(base.chosen, findings.answer, findings.naming.candidates, base.noise)
    missing = {effect.name for effect in missing_effects(findings.answer)}
    causes, every = [], findings.problem.everywhere
    for effect in final.plant.effects:
        if effect.name not in missing:
            continue  # the nominal plant has it already, or it is a timing error
        parameters = {}
        for parameter in effect.parameters:
            low, high = findings.intervals.interval(parameter.name)
            value = final.plant.parameters[parameter.name].value
            short = parameter.name.removeprefix(f"{effect.name}.")
            parameters[short] = Interval(value=value, low=low, high=high, unit=parameter.unit)
        places, same = _places(effect, findings), {e.name for e in every if e.cause == effect.cause}
        weight = sum(p for names, p in weights.items() if same.intersection(names))
        causes.append(
            Cause(
                effect=effect.cause,
                place=places[0] if len(places) == 1 and (effect.places or effect.placed_at) else None,
                places=places if len(places) > 1 else None,
                family=effect.family.value,
                probability=CREDIBLE * min(1.0, weight),
                share_explained=shares[effect.name],
                parameters=parameters,
            )
        )
    return tuple(sorted(causes, key=lambda c: -c.share_explained))


def _weights(findings: Findings) -> Mapping[tuple[str, ...], float]:
    """Return the probabilities of all explanations; alternatives that evidence cannot compare have the answer's."""
    naming, known = findings.naming, findings.naming.probabilities
    unknown = [c.effects for c in naming.alternatives if c.effects not in known]
    return normalised({**known, **dict.fromkeys(unknown, known[findings.answer.effects])}) if unknown else known


def _explanations(findings: Findings) -> tuple[Explanation, ...]:
    """Return the probabilities of the answer and of its alternatives, each over all places of its effects."""
    if not findings.named or findings.verdict is Verdict.PARTLY:
        return ()
    explanations = (findings.answer, *findings.naming.alternatives)
    causes_by_names = {c.effects: causes_of(c) for c in (*findings.naming.candidates, *explanations)}
    weights: dict[tuple[str, ...], float] = {}
    for names, weight in _weights(findings).items():
        causes = tuple(sorted(causes_by_names[names]))
        weights[causes] = weights.get(causes, 0.0) + weight
    offered = dict.fromkeys(map(causes_of, explanations))
    return tuple(
        Explanation(effects=causes, probability=CREDIBLE * min(1.0, weights[tuple(sorted(causes))]))
        for causes in offered
    )


def _places(effect: Effect, findings: Findings) -> tuple[str, ...]:
    """Return the places where an effect of the answer may act, beginning with that in the amended plant."""
    nominal, others = findings.problem.nominal, findings.elsewhere
    found = [effect, *(e for c in others for e in c.calibration.plant.effects if e.cause == effect.cause)]
    if not nominal.rig.further:
        same = [at for at, site in effect.places.items() if site.alone is Alone.AS_FIRST]
        found += [e for e in map(effect.placed, same) if nominal.accepts(e)]
    return tuple(dict.fromkeys(e.placed_at or e.signal for e in found))


def _fit_summary(findings: Findings) -> FitSummary:
    size, pair = findings.unit[1], [errors_in(findings, held_out=held_out) for held_out in (False, True)]
    fitted, unseen = ((one.before / size, None if one.after is None else one.after / size) for one in pair)
    gain = findings.verification.gain_low / size if findings.named else None
    return FitSummary(
        fitted=Errors(before=fitted[0], after=fitted[1]),
        unseen=UnseenErrors(before=unseen[0], after=unseen[1], gain_low=gain),
    )


def _location(findings: Findings) -> LocationSummary | None:
    """Return the location of the mismatch, with places ranked by their best single effect."""
    # If no effect was tried at a place, its score is the share that its signals predict.
    if findings.location is None:
        return None
    located = findings.location.summary
    found = {place.place: place for place in located.place}
    place_of = {effect.name: effect.place.value for effect in findings.problem.everywhere}
    base = findings.base.chosen
    best: dict[str, Candidate] = {}
    for candidate in (c for c in findings.naming.candidates if len(c.effects) == 1):
        place = place_of[candidate.effects[0]]
        best[place] = min(best.get(place, candidate), candidate, key=lambda c: float(c.losses.mean()))
    for place, candidate in best.items():
        share = share_of(base, candidate, base, base.noise)
        (effect,) = candidate.effects
        found[place] = replace(found.get(place, PlaceSummary(place=place, score=share)), score=share, effect=effect)
    return replace(located, place=tuple(sorted(found.values(), key=lambda entry: -entry.score)))


def _readings(findings: Findings, model: CalibratedPlant, reading: str = "") -> Readings:
    plant, experiments = findings.calibrated.plant, findings.checked.experiments
    return Readings(
        experiments=experiments,
        base=readings(plant, experiments, reading),
        amended=readings(model.plant, experiments, reading) if model.plant.effects != plant.effects else None,
        unseen=tuple(part.masks for part in first_only(findings.problem.unseen)),
        reading=reading,
    )


def _candidates(findings: Findings) -> tuple[CandidateSummary, ...]:
    return tuple(
        CandidateSummary(
            effects=c.effects, fitted=c.calibration.rms, unseen=c.unseen_test.rms, d2=_distance_to(c, findings.naming)
        )
        for c in findings.naming.candidates
    )


def _base_model(findings: Findings) -> CalibratedPlant:
    calibration = findings.base_intervals
    return CalibratedPlant(
        plant=calibration.plant,
        noise=findings.base.noise,
        model_error=_base_error(findings),
        names=calibration.names,
        covariance=calibration.covariance,
    )


def _distance_to(candidate: Candidate, naming: Naming) -> float | None:
    """Return d² from the answer if it is known for the candidate's own rig variant."""
    told = next(
        (alternative for alternative in naming.alternatives if alternative.effects == candidate.effects), candidate
    )
    if any(differences([told.calibration.plant.rig, candidate.calibration.plant.rig])):
        return None
    name = "+".join(candidate.effects)
    return next((pair.d2 for pair in naming.distances if pair.effects[1] == name), None)


def _rival_models(findings: Findings) -> dict[str, CalibratedPlant]:
    """Return the alternatives as plants, each with its error on held-out data as model error."""
    noise, stated = findings.base.noise, findings.problem.stated_error
    return {
        "+".join(alternative.effects) or "none": CalibratedPlant(
            plant=with_model_error(solved_like(alternative.calibration.plant, findings.final.plant), stated),
            noise=noise,
            model_error=alternative.unseen_test.size,
            names=alternative.calibration.names,
            covariance=alternative.calibration.covariance,
            provenance={"verdict": findings.verdict.value, "rival_of": "+".join(findings.answer.effects)},
        )
        for alternative in findings.naming.alternatives
    }

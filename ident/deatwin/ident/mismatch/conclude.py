"""The conclusion of a diagnosis, put together from what its steps found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.detect import Detection
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.discover.discovery import Discovery
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence
from deatwin.ident.mismatch.floor import with_model_error
from deatwin.ident.mismatch.gate.faults import faults_of
from deatwin.ident.mismatch.gate.gate import Gate
from deatwin.ident.mismatch.locate import Location, readings
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.worth import held_back_by, suffices, takes_most
from deatwin.ident.mismatch.refit.base import Base, differences
from deatwin.ident.mismatch.refit.fitted import fitted_parameters
from deatwin.ident.mismatch.refit.search import gap_around
from deatwin.ident.mismatch.say import say
from deatwin.ident.mismatch.steps import forms_tried
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import shares_explained
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.calibrated import CalibratedPlant

MARGIN = 0.05
"""Left of a cause's probability to what evidence cannot know: of 48 causes that were named in a study of concealed
physics (long recordings, seed 2006) two were wrong, where evidence alone said one in ten thousand. That is 0.5 to 14 %
(95 %): a margin, and no estimate."""
NOWHERE: Mapping[str, list[Any]] = {"time": [], "frequency": [], "region": [], "place": [], "response": []}
"""Where nothing is missing."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """What the steps of a diagnosis found.

    Parameters
    ----------
    bench : Bench
        Plant, effects and recordings.
    checked : Gate
        State of the recordings.
    base : Base
        The calibrated base plant.
    detection : Detection
        Whether anything is missing.
    location : Location or None
        Where it is missing; None where nothing is.
    naming : Naming
        The explanations that were tried.
    verification : Verification
        On unseen data.
    advice : Advice or None
        The experiment that would tell rivals apart.
    discovery : Discovery or None
        A free form of what no effect explains.
    verdict : Verdict
        The conclusion.
    answer : Candidate
        The explanation, or the base plant.
    final : Calibration
        The answer, fitted to all sound samples.
    """

    bench: Bench
    checked: Gate
    base: Base
    detection: Detection
    location: Location | None
    naming: Naming
    verification: Verification
    advice: Advice | None
    discovery: Discovery | None
    verdict: Verdict
    answer: Candidate
    final: Calibration

    @property
    def named(self) -> bool:
        """Whether the answer has causes."""
        return bool(self.answer.effects)

    @property
    def calibrated(self) -> Calibration:
        """The base plant as it is reported: fitted to all recordings where that took up what seemed to be missing."""
        taken_up = self.detection.taken_up
        return self.base.chosen.calibration if taken_up is None else taken_up

    @property
    def unit(self) -> tuple[str, float]:
        """Unit of amplitudes, and its SI size."""
        return amplitude_unit(self.final.plant.rig.output_unit)


def conclude(findings: Findings) -> Diagnosis:
    """Write the diagnosis.

    Parameters
    ----------
    findings : Findings
        Of all steps.

    Returns
    -------
    Diagnosis
    """
    rig, base, answer = findings.final.plant.rig, findings.base, findings.answer
    unit, size = findings.unit
    model = CalibratedPlant(
        plant=with_model_error(findings.final.plant, findings.bench.stated_error),
        noise=base.noise,
        model_error=_left(findings),
        names=findings.final.names,
        covariance=findings.final.covariance,
        provenance={"verdict": findings.verdict.value},
    )
    causes = _causes(findings) if findings.named else ()
    rivals = findings.naming.rivals if findings.named else ()
    names = tuple(dict.fromkeys(e for c in (answer, *rivals) for e in c.effects))
    fit = _fit_table(findings)
    diagnosis = Diagnosis(
        output={"name": rig.output_name, "unit": unit},
        verdict=findings.verdict,
        noise=base.noise / size,
        model_error=rig.model_error / size,
        detect=findings.detection.to_dict(),
        locate=NOWHERE if findings.location is None else {**findings.location.to_dict(), "place": _places(findings)},
        free_form=None if findings.discovery is None else findings.discovery.to_dict(),
        causes=causes,
        names=names,
        rivals=tuple(rival.effects for rival in rivals),
        indistinguishable=_indistinguishable(findings) if findings.named else (),
        next_experiment=findings.advice.to_dict() if findings.advice is not None else None,
        sentence="",
        fit=fit,
        warnings=(
            *findings.checked.findings,
            *findings.checked.notes,
            *(findings.verification.failures if findings.naming.best is not None else ()),
            *_left_over(findings),
            *_placed_unseen(findings),
            *_form(findings),
            *_forms_of_rivals(findings),
            *(f"{name} could not be tried: no fit with it could be simulated" for name in findings.naming.failed),
            *(f"{name} ended on a bound of its range" for name in findings.final.at_bound),
            *_held_back(findings),
        ),
        verification=findings.verification.to_dict() if findings.verification.ablations else None,
        faults=faults_of(findings.checked),
        parameters=fitted_parameters(findings.bench.nominal, findings.calibrated),
        forms=forms_tried(findings.bench, base),
        model=model,
        evidence=_evidence(findings, model),
    )
    return replace(diagnosis, sentence=say(diagnosis))


def _held_back(findings: Findings) -> Iterator[str]:
    """Where nothing explains the recordings, the likeliest single effect that only the plant's own ranges refuse."""
    naming = findings.naming
    if findings.verdict is not Verdict.UNKNOWN or naming.best is not None:
        return
    alone = [c for c in naming.candidates if len(c.effects) == 1]
    held = [c for c in alone if takes_most(c, naming.base) and suffices(c, naming.base) and held_back_by(c)]
    for candidate in sorted(held, key=lambda c: -c.evidence)[:1]:
        yield (
            f"{candidate.effects[0]} would explain the recordings if {', '.join(held_back_by(candidate))} "
            "might leave the range that is given"
        )


def _left(findings: Findings) -> float:
    """Rms of what the final plant gets wrong on unseen data, SI."""
    if findings.discovery is not None:
        return _beyond(findings.discovery.after, findings.base.noise)
    return findings.answer.unseen_test.size if findings.named else _base_error(findings)


def _base_error(findings: Findings) -> float:
    """Rms of what the base plant as it is reported gets wrong, SI: on the unseen part, if any is unseen by now."""
    taken_up = findings.detection.taken_up
    unseen = findings.base.chosen.unseen_test.size
    return unseen if taken_up is None else _beyond(taken_up.rms, findings.base.noise)


def _beyond(rms: float, noise: float) -> float:
    return float(np.sqrt(max(rms**2 - noise**2, 0.0)))


def _indistinguishable(findings: Findings) -> tuple[dict[str, Any], ...]:
    rivals = {"+".join(rival.effects) for rival in findings.naming.rivals}
    return tuple(
        {"effects": list(pair.effects), "d2": pair.d2}
        for pair in findings.naming.distances
        if pair.effects[1] in rivals
    )


def _left_over(findings: Findings) -> list[str]:
    """Where an explanation is good, but leaves more than the plant's own error."""
    if not findings.named or findings.answer.adequate:
        return []
    unit, size = findings.unit
    left = max(findings.answer.fitted_test.size, findings.answer.unseen_test.size) / size
    return [f"what is left ({left:.3g} {unit}) is more than the plant's own model error"]


def _placed_unseen(findings: Findings) -> Iterator[str]:
    """Events whose times no fitted reading could tell."""
    bench, plant = findings.bench, findings.answer.calibration.plant
    for name in plant.event_times if findings.named else ():
        if gap_around(plant, name, bench.fitted, bench.everything) is not None:
            yield f"{name} lies among unseen data, which alone could tell it: the error there saw this one number"


def _form(findings: Findings) -> list[str]:
    """What the recordings say of the rig where they speak against its file, or where the file is silent."""
    stated, found = differences([findings.bench.nominal.rig, findings.final.plant.rig])
    return [
        f"the recordings fit a rig with {name} = {found[name]!r} better than with {value!r}"
        for name, value in stated.items()
    ]


def _forms_of_rivals(findings: Findings) -> Iterator[str]:
    """Rivals that explain the recordings on another form of the rig than the answer's."""
    for rival in findings.naming.rivals if findings.named else ():
        _, found = differences([findings.answer.calibration.plant.rig, rival.calibration.plant.rig])
        if found:
            form = ", ".join(f"{name} = {value!r}" for name, value in found.items())
            yield f"{'+'.join(rival.effects) or 'nothing missing'} explains the recordings on a rig with {form}"


def _causes(findings: Findings) -> tuple[Cause, ...]:
    naming, final, base = findings.naming, findings.final, findings.base
    shares = shares_explained(base.chosen, findings.answer, naming.candidates, base.noise)
    causes = []
    for effect in final.plant.effects:
        if effect.name not in findings.answer.effects:
            continue  # the plant on the bench had it already
        parameters = {}
        for parameter in effect.parameters:
            low, high = final.interval(parameter.name)
            value = final.plant.parameters[parameter.name].value
            short = parameter.name.removeprefix(f"{effect.name}.")
            parameters[short] = Interval(value=value, low=low, high=high, unit=parameter.unit)
        weight = sum(p for names, p in naming.probabilities.items() if effect.name in names)
        causes.append(
            Cause(
                effect=effect.name,
                family=effect.family.value,
                probability=(1.0 - MARGIN) * min(1.0, weight),
                share_explained=shares[effect.name],
                parameters=parameters,
            )
        )
    return tuple(sorted(causes, key=lambda c: -c.share_explained))


def _fit_table(findings: Findings) -> dict[str, dict[str, float | None]]:
    checks, size = findings.verification, findings.unit[1]
    after = (checks.fitted_after, checks.unseen_after, checks.gain_low) if findings.named else (None, None, None)
    fitted, unseen, gain = (None if value is None else value / size for value in after)
    return {
        "fitted": {"before": checks.fitted_before / size, "after": fitted},
        "unseen": {"before": checks.unseen_before / size, "after": unseen, "gain_low": gain},
    }


def _places(findings: Findings) -> list[dict[str, Any]]:
    """The places, the one first whose effects take up most of the mismatch, each at best and alone.

    Where no effect was tried at a place, its score is the share that something unknown there explains.
    """
    opened = [] if findings.location is None else findings.location.place.to_dict()
    found = {place["place"]: place for place in opened}
    place_of = {effect.name: effect.place.value for effect in findings.bench.effects}
    base = findings.base.chosen
    missing = max(float(base.losses.mean()) - base.noise**2, 1e-300)
    shares: dict[str, float] = {}
    for candidate in findings.naming.candidates:
        if len(candidate.effects) == 1:
            place = place_of[candidate.effects[0]]
            share = float(np.clip((base.losses.mean() - candidate.losses.mean()) / missing, 0.0, 1.0))
            shares[place] = max(shares.get(place, 0.0), share)
    for place, share in shares.items():
        found[place] = {**found.get(place, {"place": place}), "score": share}
    return sorted(found.values(), key=lambda entry: -entry["score"])


def _evidence(findings: Findings, model: CalibratedPlant) -> Evidence:
    base, experiments = findings.base, findings.checked.experiments
    calibration = findings.calibrated
    return Evidence(
        experiments=experiments,
        base=readings(calibration.plant, experiments),
        amended=readings(model.plant, experiments) if model.plant.effects != calibration.plant.effects else None,
        unseen=tuple(part.masks for part in findings.bench.unseen),
        candidates=tuple(
            CandidateSummary(
                effects=c.effects,
                fitted=c.calibration.rms,
                unseen=c.unseen_test.rms,
                d2=_distance_to(c, findings.naming),
            )
            for c in findings.naming.candidates
        ),
        noise=base.noise,
        model_error=calibration.plant.rig.model_error,
        base_model=CalibratedPlant(
            plant=calibration.plant,
            noise=base.noise,
            model_error=_base_error(findings),
            names=calibration.names,
            covariance=calibration.covariance,
        ),
        at_bound=calibration.at_bound,
        noise_source=findings.detection.sensor.source.value,
        checked=findings.checked,
        detection=findings.detection,
        location=findings.location,
        discovery=findings.discovery,
        advice=findings.advice,
        verification=findings.verification if findings.named else None,
        rivals=_rivals(findings) if findings.named else {},
    )


def _distance_to(candidate: Candidate, naming: Naming) -> float | None:
    """d² from the answer, where it is known; that to a rival is not that of its effects in another form of the rig."""
    told = next((rival for rival in naming.rivals if rival.effects == candidate.effects), candidate)
    if any(differences([told.calibration.plant.rig, candidate.calibration.plant.rig])):
        return None
    name = "+".join(candidate.effects)
    return next((pair.d2 for pair in naming.distances if pair.effects[1] == name), None)


def _rivals(findings: Findings) -> dict[str, CalibratedPlant]:
    """The rivals as plants, each with what it leaves of the unseen data as its model error."""
    noise, stated = findings.base.noise, findings.bench.stated_error
    return {
        "+".join(rival.effects) or "none": CalibratedPlant(
            plant=with_model_error(rival.calibration.plant, stated),
            noise=noise,
            model_error=rival.unseen_test.size,
            names=rival.calibration.names,
            covariance=rival.calibration.covariance,
            provenance={"verdict": findings.verdict.value, "rival_of": "+".join(findings.answer.effects)},
        )
        for rival in findings.naming.rivals
    }

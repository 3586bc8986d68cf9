"""The conclusion of a diagnosis, put together from what its steps found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.advice import Advice
from deatwin.ident.mismatch.base import Base
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.candidate import Candidate
from deatwin.ident.mismatch.decide import Naming
from deatwin.ident.mismatch.detect import Detection
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence, readings, tracks
from deatwin.ident.mismatch.faults import faults_of
from deatwin.ident.mismatch.fitted import fitted_parameters
from deatwin.ident.mismatch.floor import with_model_error
from deatwin.ident.mismatch.gate import Gate
from deatwin.ident.mismatch.locate import locate_frequency, locate_region, locate_time
from deatwin.ident.mismatch.locate.response import locate_response
from deatwin.ident.mismatch.say import say
from deatwin.ident.mismatch.verify import Verification, shares_explained
from deatwin.plant.calibrated import CalibratedPlant

__all__ = ["Findings", "conclude"]

UNITS: Mapping[str, tuple[str, float]] = {"m": ("um", 1e-6)}
"""Units in which amplitudes are reported, with their SI size; others are reported in SI."""


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
    naming : Naming
        The explanations that were tried.
    verification : Verification
        On unseen data.
    advice : Advice or None
        The experiment that would tell rivals apart.
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
    naming: Naming
    verification: Verification
    advice: Advice | None
    verdict: Verdict
    answer: Candidate
    final: Calibration

    @property
    def named(self) -> bool:
        """Whether the answer has causes."""
        return bool(self.answer.effects)

    @property
    def unit(self) -> tuple[str, float]:
        """Unit of amplitudes, and its SI size."""
        output_unit = self.final.plant.rig.output_unit
        return UNITS.get(output_unit, (output_unit, 1.0))


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
        plant=with_model_error(findings.final.plant, findings.bench.stated_error), noise=base.noise,
        model_error=answer.unseen_test.size,
        names=findings.final.names, covariance=findings.final.covariance,
        provenance={"verdict": findings.verdict.value},
    )  # fmt: skip
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
        locate=_locate(findings),
        causes=causes,
        names=names,
        indistinguishable=_indistinguishable(findings) if findings.named else (),
        next_experiment=findings.advice.to_dict() if findings.advice is not None else None,
        sentence="",
        fit=fit,
        warnings=(
            *findings.checked.findings,
            *_form(findings),
            *(f"{name} could not be tried: no fit with it could be simulated" for name in findings.naming.failed),
            *(f"{name} ended on a bound of its range" for name in findings.final.at_bound),
        ),
        verification=findings.verification.to_dict() if findings.verification.ablations else None,
        faults=faults_of(findings.checked),
        parameters=fitted_parameters(findings.bench.nominal, base.chosen.calibration),
        model=model,
        evidence=_evidence(findings, model),
    )
    return replace(diagnosis, sentence=say(diagnosis))


def _indistinguishable(findings: Findings) -> tuple[dict[str, Any], ...]:
    rivals = {"+".join(rival.effects) for rival in findings.naming.rivals}
    return tuple(
        {"effects": list(pair.effects), "d2": pair.d2}
        for pair in findings.naming.distances
        if pair.effects[1] in rivals
    )


def _form(findings: Findings) -> list[str]:
    """What the recordings say of the rig where they speak against its file, or where the file is silent."""
    nominal, final = findings.bench.nominal, findings.final.plant
    stated, found = nominal.rig.to_dict(), with_model_error(final, nominal.rig.model_error).rig.to_dict()
    return [
        f"the recordings fit a rig with {name} = {found[name]!r} better than with {value!r}"
        for name, value in stated.items()
        if found[name] != value
    ]


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
            Cause(effect=effect.name, family=effect.family.value, probability=min(1.0, weight),
                  share_explained=shares[effect.name], parameters=parameters)
        )  # fmt: skip
    return tuple(sorted(causes, key=lambda c: -c.share_explained))


def _fit_table(findings: Findings) -> dict[str, dict[str, float | None]]:
    checks, size = findings.verification, findings.unit[1]
    after = (checks.fitted_after, checks.unseen_after, checks.gain_low) if findings.named else (None, None, None)
    fitted, unseen, gain = (None if value is None else value / size for value in after)
    return {
        "fitted": {"before": checks.fitted_before / size, "after": fitted},
        "unseen": {"before": checks.unseen_before / size, "after": unseen, "gain_low": gain},
    }


def _locate(findings: Findings) -> dict[str, list[dict[str, Any]] | None]:
    chosen, noise = findings.base.chosen, findings.base.noise
    if not findings.detection.mismatch:
        return {"time": [], "frequency": [], "region": [], "place": [], "response": []}
    plant = chosen.calibration.plant
    found = tracks(plant, findings.checked.experiments)
    windows = locate_time(found, noise**2 + plant.rig.model_error**2)
    bands = locate_frequency(found, noise)
    regions = locate_region(found, findings.unit[1])
    return {
        "time": [{"from_s": w.from_s, "to_s": w.to_s, "score": w.score} for w in windows],
        "frequency": [{"from_Hz": b.from_Hz, "to_Hz": b.to_Hz, "excess_dB": b.excess_dB} for b in bands],
        "region": [
            {"signal": r.signal, "from": r.low, "to": r.high, "mean_residual": r.mean_residual} for r in regions
        ],
        "place": _places(findings),
        "response": _responses(findings),
    }


def _responses(findings: Findings) -> list[dict[str, Any]] | None:
    """Orders and bands in which the response of the recordings is not that of the base plant; None if not tested."""
    plant, checked = findings.base.chosen.calibration.plant, findings.checked
    simulated = [y for each in readings(plant, checked.experiments) for y in each]
    records = [record for experiment in checked.experiments for record in experiment.recordings]
    sound = [mask for masks in checked.sound for mask in masks]
    # A reading at fault says nothing of the response: the simulated one takes its place.
    measured = [
        replace(record, outputs=np.where(mask, record.outputs, y))
        for record, mask, y in zip(records, sound, simulated, strict=True)
    ]
    found = locate_response(measured, simulated, plant.rig.model_error)
    return None if found is None else [asdict(difference) for difference in found]


def _places(findings: Findings) -> list[dict[str, Any]]:
    """How much of the mismatch an effect at each place can take up, at best and alone."""
    place = {e.name: e.place.value for e in findings.bench.effects}
    before = float(findings.base.chosen.losses.mean())
    missing = max(before - findings.base.noise**2, 1e-300)
    scores: dict[str, float] = {}
    for candidate in findings.naming.candidates:
        if len(candidate.effects) == 1:
            share = float(np.clip((before - candidate.losses.mean()) / missing, 0.0, 1.0))
            where = place[candidate.effects[0]]
            scores[where] = max(scores.get(where, 0.0), share)
    return [{"place": p, "score": s} for p, s in sorted(scores.items(), key=lambda item: -item[1])]


def _evidence(findings: Findings, model: CalibratedPlant) -> Evidence:
    base, experiments = findings.base, findings.checked.experiments
    calibration = base.chosen.calibration
    apart = {pair.effects[1]: pair.d2 for pair in findings.naming.distances}
    return Evidence(
        experiments=experiments,
        base=readings(calibration.plant, experiments),
        amended=readings(model.plant, experiments) if findings.named else None,
        unseen=tuple(part.masks for part in findings.bench.unseen),
        candidates=tuple(
            CandidateSummary(
                effects=c.effects, fitted=c.calibration.rms, unseen=c.unseen_test.rms, d2=apart.get("+".join(c.effects))
            )
            for c in findings.naming.candidates
        ),
        noise=base.noise,
        model_error=calibration.plant.rig.model_error,
        base_model=CalibratedPlant(
            plant=calibration.plant, noise=base.noise, model_error=base.chosen.unseen_test.size,
            names=calibration.names, covariance=calibration.covariance,
        ),
        at_bound=calibration.at_bound, noise_source=findings.detection.sensor.source.value, checked=findings.checked,
        detection=findings.detection, advice=findings.advice,
        verification=findings.verification if findings.named else None,
    )  # fmt: skip

"""From recordings to a verdict: gate, base refit, detect, locate, name, verify, say. Read it top to bottom."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.fit import Calibration, Part, calibrate
from deatwin.ident.mismatch.base import Base, calibrate_base
from deatwin.ident.mismatch.detect import detect
from deatwin.ident.mismatch.diagnosis import Cause, Diagnosis, Interval, Verdict
from deatwin.ident.mismatch.evidence import CandidateSummary, Evidence, readings, tracks
from deatwin.ident.mismatch.gate import Gate, Soundness, gate, split
from deatwin.ident.mismatch.locate import locate_frequency, locate_region, locate_time
from deatwin.ident.mismatch.name import (
    Candidate,
    Naming,
    detectable_size,
    free_run_residuals,
    try_pairs,
    try_singles,
)
from deatwin.ident.mismatch.say import sentence
from deatwin.ident.mismatch.verify import Verification, shares_explained, verify
from deatwin.ident.parallel import run_jobs
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import catalogue
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

__all__ = ["diagnose"]

Progress = Callable[[float, str], None]
CLEARLY_BETTER = 0.8
"""A rival form of the rig is tried with effects where it leaves less than this share of the mean square."""
UNITS = {"m": ("um", 1e-6), "N": ("N", 1.0)}
"""Units in which amplitudes are reported, with their SI size; others are reported in SI."""


def diagnose(
    plant: Plant,
    experiments: Experiment | Sequence[Experiment],
    *,
    effects: Sequence[Effect] | None = None,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find out what physics a plant lacks to explain recordings.

    Parameters
    ----------
    plant : Plant
        Nominal; it is calibrated first.
    experiments : Experiment or sequence of Experiment
        Each starts from rest.
    effects : sequence of Effect, optional
        What may be missing; the whole catalogue by default. Those that the rig cannot take are passed over.
    jobs : int
        Worker processes.
    seed : int
        Of all random numbers.
    progress : callable, optional
        Called with the share that is done and what is being done.

    Returns
    -------
    Diagnosis
        Verdict, evidence, and the calibrated (amended) plant.

    Raises
    ------
    DataError, ModelError
        If the recordings cannot be used at all.
    SimulationError
        If the plant cannot be simulated on them.
    """
    tell = progress or (lambda share, text: None)
    rng = np.random.default_rng(seed)
    chosen = [e for e in (catalogue() if effects is None else effects) if plant.accepts(e)]
    several = (experiments,) if isinstance(experiments, Experiment) else tuple(experiments)

    tell(0.0, "checking the recordings")
    checked = gate(plant, several)
    fitted, unseen, everything = split(checked)
    tell(0.02, "calibrating the base plant")
    base = calibrate_base(plant, fitted, unseen, jobs=jobs)
    onset = _late_onset(base, checked)
    if onset is not None:
        fitted, unseen, everything = split(checked, onset)
        base = calibrate_base(plant, fitted, unseen, jobs=jobs)

    naming = Naming(candidates=(base.chosen,), best=None, rivals=(), probabilities={})
    if base.chosen.mismatch and checked.soundness is Soundness.SOUND:
        tell(0.3, "trying single effects")
        naming = _name(plant, base, chosen, fitted, unseen, jobs, lambda share, text: tell(0.3 + 0.6 * share, text))
        base = _base_of(naming, base)
    tell(0.9, "verifying on unseen data")
    best = naming.best
    checks = verify(base.chosen, best or base.chosen, rng)
    verdict = _verdict(plant, checked, base, naming, checks, everything)
    answer = best if best is not None and verdict in (Verdict.NAMED, Verdict.AMBIGUOUS) else base.chosen
    final = _refit(answer, everything)
    tell(0.97, "locating the mismatch")
    result = _report(verdict, checked, base, naming, checks, final, chosen, (fitted, unseen), jobs)
    tell(1.0, "done")
    return result


def _late_onset(base: Base, checked: Gate) -> float | None:
    """Where a mismatch begins that only the unseen part has."""
    chosen = base.chosen
    if chosen.fitted_test.mismatch or not chosen.unseen_test.mismatch:
        return None
    floor = base.noise**2 + chosen.calibration.plant.rig.model_error**2
    windows = locate_time(tracks(chosen.calibration.plant, checked.experiments), floor)
    return max(windows, key=lambda w: w.score).from_s if windows else None


def _name(
    plant: Plant, base: Base, effects: Sequence[Effect], fitted: Sequence[Part], unseen: Sequence[Part], jobs: int, tell: Progress
) -> Naming:
    """Single effects, then pairs; where neither is adequate, single effects on a rival form of the rig."""
    noise = base.noise
    nominal = plant.with_rig(base.chosen.calibration.plant.rig)
    singles = try_singles(
        nominal, base.chosen, effects, fitted, unseen, noise=noise, jobs=jobs,
        finished=lambda share: tell(0.5 * share, "trying single effects"),
    )  # fmt: skip
    if singles.best is not None:
        return singles
    pairs = try_pairs(
        nominal, singles, effects, fitted, unseen, noise=noise, jobs=jobs,
        finished=lambda share: tell(0.5 + 0.5 * share, "trying pairs of effects"),
    )  # fmt: skip
    better = [r for r in base.rivals if r.losses.mean() < CLEARLY_BETTER * base.chosen.losses.mean()]
    if pairs.best is None and better:
        other = plant.with_rig(better[0].calibration.plant.rig)
        second = try_singles(other, better[0], effects, fitted, unseen, noise=noise, jobs=jobs)
        if second.best is not None:
            return second
    return pairs


def _base_of(naming: Naming, base: Base) -> Base:
    """The base on whose form the naming was done."""
    first = naming.candidates[0]
    return base if first is base.chosen else replace(base, chosen=first)


def _verdict(
    plant: Plant, checked: Gate, base: Base, naming: Naming, checks: Verification, everything: Sequence[Part]
) -> Verdict:
    if checked.soundness is Soundness.FAULTY:
        return Verdict.DATA_FAULT
    if not base.chosen.mismatch:
        return Verdict.PARAMETERS if _nominal_is_off(plant, everything, base) else Verdict.NONE
    if naming.best is None or not checks.holds:
        return Verdict.UNKNOWN
    return Verdict.AMBIGUOUS if naming.rivals else Verdict.NAMED


def _nominal_is_off(plant: Plant, everything: Sequence[Part], base: Base) -> bool:
    residuals = free_run_residuals(plant, everything)
    return residuals is None or detect(residuals, base.noise, plant.rig.model_error).mismatch


def _refit(answer: Candidate, everything: Sequence[Part]) -> Calibration:
    """After the judgement the answer is fitted to all sound samples."""
    final = calibrate(answer.calibration.plant, everything)
    return final if final.status.ok else answer.calibration


def _report(
    verdict: Verdict,
    checked: Gate,
    base: Base,
    naming: Naming,
    checks: Verification,
    final: Calibration,
    effects: Sequence[Effect],
    parts: tuple[Sequence[Part], Sequence[Part]],
    jobs: int,
) -> Diagnosis:
    rig = final.plant.rig
    unit, size = UNITS.get(rig.output_unit, (rig.output_unit, 1.0))
    named = verdict in (Verdict.NAMED, Verdict.AMBIGUOUS)
    answer = naming.best if named and naming.best is not None else base.chosen
    model = CalibratedPlant(
        plant=final.plant, noise=base.noise, model_error=answer.unseen_test.excess, names=final.names,
        covariance=final.covariance, provenance={"verdict": verdict.value},
    )  # fmt: skip
    causes = _causes(answer, base, naming, final) if named else ()
    rivals = naming.rivals if named else ()
    names = tuple(dict.fromkeys(e for c in (answer, *rivals) for e in c.effects)) if named else ()
    fit = _fit_table(checks, named, size)
    test = base.chosen.unseen_test if base.chosen.unseen_test.mismatch else base.chosen.fitted_test
    return Diagnosis(
        output={"name": rig.output_name, "unit": unit},
        verdict=verdict,
        noise=base.noise / size,
        model_error=rig.model_error / size,
        detect={
            "p_value": test.p_value,
            "excess": test.excess / size,
            "smallest_detectable": _smallest(base, effects, parts[0], size, jobs),
        },
        locate=_locate(base, naming, checked, effects, size),
        causes=causes,
        names=names,
        indistinguishable=tuple(_distance(answer, rival, base.noise) for rival in rivals),
        sentence=sentence(verdict, causes, names, fit, base.noise / size, unit, checked.findings),
        fit=fit,
        warnings=(*checked.findings, *(f"{n} ended on a bound of its range" for n in final.at_bound)),
        model=model,
        evidence=_evidence(base, naming, model, checked, parts[1], named),
    )


def _causes(answer: Candidate, base: Base, naming: Naming, final: Calibration) -> tuple[Cause, ...]:
    shares = shares_explained(base.chosen, answer, naming.candidates, base.noise)
    causes = []
    for effect in final.plant.effects:
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


def _fit_table(checks: Verification, named: bool, size: float) -> dict[str, dict[str, float | None]]:
    return {
        "fitted": {"before": checks.fitted_before / size, "after": checks.fitted_after / size if named else None},
        "unseen": {
            "before": checks.unseen_before / size,
            "after": checks.unseen_after / size if named else None,
            "gain_low": checks.gain_low / size if named else None,
        },
    }


def _smallest(
    base: Base, effects: Sequence[Effect], fitted: Sequence[Part], size: float, jobs: int
) -> dict[str, float | None]:
    """Rms that each effect would need to add to the readings to be detected, in the report's unit."""
    sizes = run_jobs(detectable_size, [(base.chosen.calibration, e, fitted) for e in effects], workers=jobs)
    return {e.name: None if s is None else s / size for e, s in zip(effects, sizes, strict=True)}


def _locate(
    base: Base, naming: Naming, checked: Gate, effects: Sequence[Effect], size: float
) -> dict[str, list[dict[str, object]]]:
    if not base.chosen.mismatch:
        return {"time": [], "frequency": [], "region": [], "place": []}
    plant = base.chosen.calibration.plant
    found = tracks(plant, checked.experiments)
    floor = base.noise**2 + plant.rig.model_error**2
    return {
        "time": [{"from_s": w.from_s, "to_s": w.to_s, "score": w.score} for w in locate_time(found, floor)],
        "frequency": [
            {"from_Hz": b.from_Hz, "to_Hz": b.to_Hz, "excess_dB": b.excess_dB}
            for b in locate_frequency(found, base.noise)
        ],
        "region": [
            {"signal": r.signal, "from": r.low, "to": r.high, "mean_residual": r.mean_residual}
            for r in locate_region(found, size)
        ],
        "place": _places(base, naming, effects),
    }


def _places(base: Base, naming: Naming, effects: Sequence[Effect]) -> list[dict[str, object]]:
    """How much of the mismatch an effect at each place can take up, at best and alone."""
    place = {e.name: e.place.value for e in effects}
    missing = max(float(base.chosen.losses.mean()) - base.noise**2, 1e-300)
    scores: dict[str, float] = {}
    for candidate in naming.candidates:
        if len(candidate.effects) == 1:
            share = float((base.chosen.losses.mean() - candidate.losses.mean()) / missing)
            where = place[candidate.effects[0]]
            scores[where] = max(scores.get(where, 0.0), float(np.clip(share, 0.0, 1.0)))
    return [{"place": p, "score": s} for p, s in sorted(scores.items(), key=lambda item: -item[1])]


def _distance(one: Candidate, other: Candidate, noise: float) -> dict[str, object]:
    """How far apart two explanations are on these recordings, in units of the noise: d² of mismatch.md 7.4."""
    difference = other.losses.mean() - one.losses.mean()
    samples = one.calibration.residuals.size + one.unseen.size
    return {"effects": ["+".join(one.effects), "+".join(other.effects)],
            "d2": float(max(difference, 0.0) * samples / noise**2)}  # fmt: skip


def _evidence(
    base: Base, naming: Naming, model: CalibratedPlant, checked: Gate, unseen: Sequence[Part], named: bool
) -> Evidence:
    base_plant = base.chosen.calibration.plant
    return Evidence(
        experiments=checked.experiments,
        base=readings(base_plant, checked.experiments),
        amended=readings(model.plant, checked.experiments) if named else None,
        unseen=tuple(part.masks for part in unseen),
        candidates=tuple(
            CandidateSummary(effects=c.effects, fitted=c.calibration.rms, unseen=c.unseen_test.rms)
            for c in naming.candidates
        ),
        noise=base.noise,
        model_error=base_plant.rig.model_error,
        base_model=CalibratedPlant(
            plant=base_plant, noise=base.noise, model_error=base.chosen.unseen_test.excess,
            names=base.chosen.calibration.names, covariance=base.chosen.calibration.covariance,
        ),
    )  # fmt: skip

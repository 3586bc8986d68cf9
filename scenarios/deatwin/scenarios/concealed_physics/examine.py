"""Examine one case: diagnosis and baselines get the nominal plant and the recordings only, the oracle and the advised
experiment then ask the generator, and the check is run. What is right is decided when all cases are through.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from deatwin.ident.discrepancy import gaussian_process, narx, sparse_dynamics, track_of
from deatwin.ident.greybox import Calibration, Part, calibrate
from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch import Diagnosis, DiagnosisProblem, diagnose, linearised_responses
from deatwin.ident.mismatch.naming.screen import leads
from deatwin.ident.mismatch.refit.search import at_its_time, finish, search
from deatwin.plant import DeatwinError, Effect, Experiment, Plant, SimulationError, effect_named
from deatwin.scenarios.concealed_physics.generator.specimens import CaseSpec, Specimen, make

BASELINES = {"pysindy": sparse_dynamics, "gaussian_process": gaussian_process, "narx": narx}
"""Models of the residual that do not ask which physics is missing, in the order of the tables."""


def examine(spec: CaseSpec, seconds: float, check_seconds: float) -> dict[str, Any]:
    """Make a case, diagnose it, and judge what came out on the check record."""
    specimen = make(spec, seconds=seconds, check_seconds=check_seconds)
    diagnosis = _diagnosed(spec, specimen.plant, specimen.experiments)
    parts = [Part.whole(experiment) for experiment in specimen.experiments]
    base = _base(diagnosis, parts)
    oracle = _oracle(specimen, diagnosis, base, parts)
    return {
        "status": "done",
        "ratio": specimen.ratio,
        "noise_true": specimen.noise,
        "diagnosis": _essence(diagnosis),
        "parameters": _parameters(diagnosis, specimen),
        "baselines": _baselines(base.plant, specimen),
        "check": {
            "nominal": check_rms(specimen.plant, specimen),
            "base": check_rms(base.plant, specimen),
            "diagnosis": check_rms(diagnosis.model.plant, specimen) if diagnosis.model else None,
            "oracle": None if oracle is None else check_rms(oracle, specimen),
        },
        "advised": _advised(spec, specimen, diagnosis),
    }


def _diagnosed(spec: CaseSpec, plant: Plant, experiments: Sequence[Experiment]) -> Diagnosis:
    """Diagnose with the effects given for a case, or with the whole catalogue."""
    known = [effect for effect in plant.rig.effects() if effect.name in spec.library] if spec.library else None
    return diagnose(plant, experiments, effects=known, jobs=1, seed=spec.seed)


def check_rms(plant: Plant, specimen: Specimen) -> float | None:
    """Return the rms error of a plant's free run over the check record, which the diagnosis has not seen."""
    check = specimen.check.recordings
    outputs = plant.simulate(specimen.whole).outputs[-len(check) :]
    errors = np.concatenate([r.outputs[0] - y[0] for r, y in zip(check, outputs, strict=True)])
    return float(np.sqrt(np.mean(errors**2))) if np.isfinite(errors).all() else None


def _base(diagnosis: Diagnosis, parts: Sequence[Part]) -> Calibration:
    """Return the base plant of the diagnosis, fitted to all samples like the answer."""
    if diagnosis.base_model is None:
        raise SimulationError("the diagnosis kept no base plant to compare with")
    found = calibrate(diagnosis.base_model.plant, parts, starts=1)
    if not found.status.ok:
        raise SimulationError("the base plant of the diagnosis cannot be fitted to the whole recordings")
    return found


def _essence(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the parts of a diagnosis that the study counts."""
    data = diagnosis.to_dict()
    kept = "verdict noise model_error detect causes set rivals indistinguishable sentence fit free_form warnings"
    tried = diagnosis.candidates
    return {
        **{name: data[name] for name in (*kept.split(), "next_experiment")},
        "tried": [{"effects": list(c.effects), "fitted": c.fitted, "unseen": c.unseen, "d2": c.d2} for c in tried],
    }


def _parameters(diagnosis: Diagnosis, specimen: Specimen) -> list[dict[str, Any]]:
    """Return intervals of added parameters that have a true value, because generator and catalogue define them alike."""
    known = specimen.parameters
    return [
        {"name": f"{cause.effect}.{name}", "true": known[f"{cause.effect}.{name}"], "low": p.low, "high": p.high}
        for cause in diagnosis.causes
        for name, p in cause.parameters.items()
        if f"{cause.effect}.{name}" in known
    ]


def _baselines(plant: Plant, specimen: Specimen) -> dict[str, Any]:
    track = track_of(plant, specimen.whole, len(specimen.whole.recordings) - len(specimen.check.recordings))
    found: dict[str, Any] = {}
    for name, learn in BASELINES.items():
        try:
            correction = learn(track)
        except (DeatwinError, ValueError, np.linalg.LinAlgError) as error:
            found[name] = {"rms": None, "term": "", "failure": f"{type(error).__name__}: {error}"}
            continue
        left = float(track.size * np.sqrt(np.mean((track.judged.residual - correction.predicted) ** 2)))
        found[name] = {
            "rms": left if np.isfinite(left) else None,
            "term": correction.term,
            "failure": correction.failure,
        }
    return found


def _oracle(specimen: Specimen, diagnosis: Diagnosis, base: Calibration, parts: Sequence[Part]) -> Plant | None:
    """Fit the true effects in the base plant by a separate search, which shows where the diagnosis went wrong."""
    if not specimen.truth:
        return None
    nominal = specimen.plant.with_rig(base.plant.rig)
    found = _consulted(nominal, base, parts, specimen.truth)
    rivals = [] if found is None else [found]
    if diagnosis.model is not None and {c.effect for c in diagnosis.causes} == set(specimen.truth):
        rivals.append(diagnosis.model.plant)
    return min(rivals, key=lambda plant: _squares(plant, parts), default=None)


def _squares(plant: Plant, parts: Sequence[Part]) -> float:
    left = free_run_residuals(plant, parts)
    return float("inf") if left is None else float(np.sum(left**2))


def _advised(spec: CaseSpec, specimen: Specimen, diagnosis: Diagnosis) -> dict[str, Any] | None:
    """Repeat an undecided diagnosis with the advised experiment."""
    advice = None if diagnosis.findings is None else diagnosis.findings.advice
    if spec.kind != "tie" or advice is None:
        return None
    if advice.recording is None:
        return {"failure": advice.sentence}
    stands = specimen if advice.added_mass is None else specimen.heavier(advice.added_mass)
    try:
        record = stands.record(Experiment(recordings=(advice.recording,)), spec.seed + 1)
    except SimulationError as error:
        return {"failure": str(error)}
    if advice.added_mass is None:
        again = _diagnosed(spec, stands.plant, (*specimen.experiments, record))
    else:
        effects = [effect for effect in stands.plant.rig.effects() if effect.name in diagnosis.names]
        again = diagnose(stands.plant, record, effects=effects, jobs=1, seed=spec.seed)
    return {"failure": "", **{k: v for k, v in _essence(again).items() if k in ("verdict", "causes", "set")}}


def _consulted(nominal: Plant, base: Calibration, parts: Sequence[Part], truth: Sequence[str]) -> Plant | None:
    """Fit the plant with the true effects to all samples; `base` is the fit without them."""
    if not all(nominal.accepts(effect_named(name)) for name in truth):
        return None
    typical = tuple(effect_named(name) for name in truth)
    fits = []
    for effects, plant in product((_promising(nominal, base, parts, typical), typical), (nominal, base.plant)):
        fit = search(plant.with_effects(*effects), parts)
        if fit.status.ok:
            fits.append(at_its_time(fit, parts))
    return finish(min(fits, key=lambda fit: fit.rms), parts).plant if fits else None


def _promising(
    nominal: Plant, base: Calibration, parts: Sequence[Part], effects: tuple[Effect, ...]
) -> tuple[Effect, ...]:
    """Return the effects, with the shapes that could explain most of the base plant's residual, to first order."""
    error, whole = nominal.rig.model_error, tuple(parts)
    problem = DiagnosisProblem(
        nominal=nominal,
        effects=effects,
        fitted=whole,
        unseen=whole,
        everything=whole,
        jobs=1,
        stated_error=error,
        expected_error=error,
    )
    shaped = {lead.effect.name: lead.effect for lead in leads(linearised_responses(problem, base, effects, base), base)}
    return tuple(shaped.get(effect.name, effect) for effect in effects)

"""The sealed study, which may be killed and resumed: labels, thresholds and code are hashed before its first case."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.discrepancy import gaussian_process, narx, sparse_dynamics, track_of
from deatwin.ident.greybox import Calibration, Part, calibrate
from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch import Diagnosis, DiagnosisProblem, diagnose, linearised_responses
from deatwin.ident.mismatch.advise.distance import Memory
from deatwin.ident.mismatch.naming.screen import leads
from deatwin.ident.mismatch.refit.search import at_its_time, finish, search
from deatwin.plant import DeatwinError, Effect, Experiment, Plant, SimulationError, effect_named
from deatwin.plant.interrupts import obeying
from deatwin.plant.records import finite, plain
from deatwin.scenarios.concealed_physics.cases import KEY, SIZES, case_specs, key_dict
from deatwin.scenarios.concealed_physics.generator.specimens import CaseSpec, Specimen, make
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest, thresholds
from deatwin.studies.sweep.store import CaseStore

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
        "apart": _apart(spec, specimen),
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
    """Return the intervals of the answer's parameters that have a true value."""
    if diagnosis.findings is None:
        return []
    answer, true = diagnosis.findings.intervals, specimen.parameters
    ends = {name: answer.interval(name) for name in true if name in answer.names}
    return [{"name": name, "true": true[name], "low": low, "high": high} for name, (low, high) in ends.items()]


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
    rivals = [] if found is None else [found.plant]
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


RIVALS = 3
"""Number of wrong effects that are fitted to the concealed one: those that imitate it best to first order."""


def _apart(spec: CaseSpec, specimen: Specimen) -> dict[str, Any] | None:
    """Return d² of the true effect and its best imitation, beside the sensor's noise and beside all errors."""
    if spec.kind != "effect":
        return None
    experiment, nominal, right = specimen.experiments[0], specimen.plant, KEY[spec.effects[0]]
    pairs = zip(experiment.recordings, specimen.apparatus.readings(experiment), strict=True)
    silent = Experiment(recordings=tuple(replace(record, outputs=values[None]) for record, values in pairs))
    parts = [Part.whole(silent)]
    base = calibrate(nominal, parts, starts=1)
    effects = [effect for effect in nominal.rig.effects() if nominal.accepts(effect)]
    ranked = [effect for effect in _shaped(nominal, base, parts, effects) if effect.name not in right]
    true = _consulted(nominal, base, parts, right[:1])
    rivals = {e.name: _fitted(base.plant.with_effects(e), parts) for e in ranked[:RIVALS]}
    known = {name: Memory.of(true, fit, parts).known for name, fit in rivals.items() if true and fit}
    if not known:
        return None
    alone = {name: float(np.sum(each.left**2)) / specimen.noise**2 for name, each in known.items()}
    within = {name: each.squared_distance(specimen.noise) for name, each in known.items()}
    return {"noise": min(alone.values()), "error": min(within.values()), "rival": min(within, key=within.__getitem__)}


def _consulted(nominal: Plant, base: Calibration, parts: Sequence[Part], truth: Sequence[str]) -> Calibration | None:
    """Fit the plant with the true effects to all samples; `base` is the fit without them."""
    if not all(nominal.accepts(effect_named(name)) for name in truth):
        return None
    typical = tuple(effect_named(name) for name in truth)
    if not all(map(base.plant.lacks, typical)):  # a diagnosis may give its base plant a dead time
        base = calibrate(nominal, parts, starts=1)
    shaped = {effect.name: effect for effect in _shaped(nominal, base, parts, typical)}
    promising = tuple(shaped.get(effect.name, effect) for effect in typical)
    starts = product((promising, typical), (nominal, base.plant))
    fits = [fit for effects, plant in starts if (fit := _fitted(plant.with_effects(*effects), parts))]
    return finish(min(fits, key=lambda fit: fit.rms), parts) if fits else None


def _fitted(plant: Plant, parts: Sequence[Part]) -> Calibration | None:
    fit = search(plant, parts)
    return at_its_time(fit, parts) if fit.status.ok else None


def _shaped(nominal: Plant, base: Calibration, parts: Sequence[Part], effects: Sequence[Effect]) -> list[Effect]:
    """Return effects with the shapes that explain most of the base plant's residual, the best one first."""
    error, whole = nominal.rig.model_error, tuple(parts)
    problem = DiagnosisProblem(
        nominal=nominal,
        effects=tuple(effects),
        fitted=whole,
        unseen=whole,
        everything=whole,
        jobs=1,
        stated_error=error,
        expected_error=error,
    )
    return [lead.effect for lead in leads(linearised_responses(problem, base, effects, base), base)]


CASE_SCHEMA = "deatwin/concealed-case/1"
SEALED_CODE = ("deatwin.plant", "deatwin.ident")
STORY = Path(__file__).parent
OPEN_CODE = frozenset(STORY / name for name in ("__init__.py", "results.py", "page.py"))
"""Code that counts and draws: it is not sealed, so it may be mended when the cases are through."""


def seal_of(size: str, seed: int, key: Mapping[str, Any]) -> SweepSeal:
    """Seal labels, thresholds and the code that makes and runs the cases."""
    running = sorted({*STORY.rglob("*.py"), STORY / "key.toml"} - OPEN_CODE)
    parts = {
        "size": size,
        "seed": seed,
        "key": digest(key),
        "thresholds": thresholds(),
        "code": sources_digest(SEALED_CODE, running),
        "version": version("deatwin"),
    }
    return SweepSeal(schema=CASE_SCHEMA, parts=parts)


EFFORT = {"clean": 0.5, "dirt": 0.5, "tie": 2.0}  # Work of a case of that kind; others take 1


def key_of(specs: Sequence[CaseSpec]) -> dict[str, Any]:
    """Make the key: the concealed effect of each case, and its right names."""
    return {"names": key_dict(), "cases": plain(specs)}


def carry_out(folder: Path, size: str, seed: int, jobs: int, tell: Callable[[float, str], None]) -> CaseStore:
    """Seal the study, or continue it, and run every case that has no result."""
    tell(0.0, "sealing labels and thresholds")
    specs = case_specs(size, seed)
    store = CaseStore(folder, seal_of(size, seed, key_of(specs)))
    # All kinds are mixed, so that an interrupted study holds a fair sample and the remaining time is known early.
    mixed = [specs[k] for k in np.random.default_rng(seed).permutation(len(specs))]
    run_sweep(
        partial(run_case, size),
        {spec.name: spec for spec in mixed},
        store,
        jobs=jobs,
        tell=tell,
        efforts={spec.name: EFFORT.get(spec.kind, 1.0) for spec in specs},
    )
    return store


def run_case(size: str, spec: CaseSpec) -> dict[str, Any]:
    """Run a case; an exception becomes a result, and a non-finite number None."""
    begun = time.process_time()
    of = SIZES[size]
    try:
        with obeying():
            result = examine(spec, of.seconds, of.check_seconds)
    except Exception as error:  # whatever it is, the case is counted: it failed
        result = {"status": "error", "message": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    done: dict[str, Any] = finite({**result, "seconds_in_all": round(time.process_time() - begun, 2)})
    return done

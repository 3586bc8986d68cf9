"""From recordings to a verdict: check the recordings, base refit, detect, name, verify, refit, say. Read it top to bottom."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch.advise.advise import advise
from deatwin.ident.mismatch.conclude import conclude
from deatwin.ident.mismatch.detect.detect import detect
from deatwin.ident.mismatch.detect.detection import Detection
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.discover.discover import discover
from deatwin.ident.mismatch.excess import excess_of
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.likelihood.beforehand import LEAST_ERROR
from deatwin.ident.mismatch.locate.location import locate
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.decide import Naming, nothing_tried, with_all_distances
from deatwin.ident.mismatch.naming.name import explanations
from deatwin.ident.mismatch.naming.places import without_places
from deatwin.ident.mismatch.naming.screen import linearised_responses
from deatwin.ident.mismatch.partly import acting, explains_all
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.compared import require_same_scale, without_faults, without_unknown
from deatwin.ident.mismatch.quality.quality import DataQuality, Soundness, check_quality, confirm
from deatwin.ident.mismatch.refit.base import Base, beside_alternatives
from deatwin.ident.mismatch.refit.equals import with_exchanged_lags, with_nominal_start
from deatwin.ident.mismatch.refit.restated import restated
from deatwin.ident.mismatch.refit.search import refit
from deatwin.ident.mismatch.steps import Step, base_step, fit_step, found_step, quality_step
from deatwin.ident.mismatch.verdict import Verdict
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.mismatch.verify.verify import first_that_stands, verify
from deatwin.ident.parallel import one_thread, require_workers, spawn_generators
from deatwin.plant.effects.base import Effect, require_effects
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.resolution import resolved, solved_like

Progress = Callable[[float, str], None]


@one_thread
def diagnose(
    plant: Plant,
    experiments: Experiment | Recording | Sequence[Experiment | Recording],
    *,
    effects: Sequence[Effect] | None = None,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    through: Callable[[Step], None] | None = None,
) -> Diagnosis:
    """Find the effects that are missing from a plant and explain its mismatch with recordings.

    Parameters
    ----------
    plant : Plant
        Nominal plant; it is calibrated first.
    experiments : Experiment or Recording, or a sequence of such
        Experiments and single recordings, each of which starts from rest. Put recordings that follow each other on the
        same clock into one experiment.
    effects : sequence of Effect, optional
        Effects that may be missing; by default the whole catalogue. Effects of the catalogue take the usual values and
        ranges of the rig (`Rig.scaled`); on a film rig, values that differ from the catalogue's stay as they are.
        Effects that the rig does not accept are skipped.
    jobs : int
        Number of worker processes; -1 takes all cores.
    seed : int
        Seed of all random numbers.
    progress : callable, optional
        Called with the completed share and a description of the current work.
    through : callable, optional
        Called with each finished step, for example to save its result before the diagnosis ends.

    Returns
    -------
    Diagnosis
        Verdict, the results that support it, and the calibrated plant with the effects that were found.

    Raises
    ------
    DataError
        If the recordings cannot be diagnosed; `check_quality` lists the reasons. Also if readings fall where those of
        the model rise, or differ from them as if they had another unit.
    ModelError
        If `plant` is not a Plant or there are too few samples for its parameters. Also if `seed` is not an integer of
        at least 0, or `jobs` is neither -1 nor an integer of at least 1.
    RigError
        If one of `effects` is not an `Effect`.
    SimulationError
        If the plant cannot be simulated on the recordings.
    """
    require_workers(jobs)
    for_detection, for_location, for_verification, for_advice, for_discovery, for_rest = spawn_generators(seed, 6)
    effects = None if effects is None else require_effects(effects)
    tell = progress or (lambda share, text: None)

    def keep(step: Step | None) -> None:
        if through is not None and step is not None:
            through(step)

    tell(0.0, "checking the recordings")
    checked = check_quality(plant, experiments)
    keep(quality_step(checked))

    tell(0.02, "calibrating the model")
    problem, base = prepare(plant, checked, effects, jobs=jobs)
    fitted_plant = base.chosen.calibration.plant
    usable = without_unknown(without_faults(checked, fitted_plant), fitted_plant, base.noise)
    if usable is not checked:
        checked = usable
        problem, base = prepare(plant, checked, effects, jobs=jobs)
    require_same_scale(problem, base.chosen.calibration.plant)
    for variant in (base.chosen, *base.alternatives):  # faults of the readings stand out in every variant
        checked = confirm(checked, readings(variant.calibration.plant, checked.experiments))
    keep(quality_step(checked))
    keep(base_step(problem, base))

    tell(0.25, "looking for a mismatch")
    detection = detect(base.chosen, problem, for_detection)
    if detection.mismatch and checked.soundness is Soundness.SOUND:
        before = base
        base, detection = _among_variants(problem, base, detection, for_detection)
        if base is not before:
            keep(base_step(problem, base))
    keep(found_step("detect", detection))
    if detection.mismatch:
        tell(0.26, "locating the mismatch")
    location = locate(base.chosen, problem, checked, for_location) if detection.mismatch else None
    keep(found_step("locate", location))

    fit, count = base.chosen.calibration, len(problem.effects)
    known = linearised_responses(
        problem,
        fit,
        problem.effects,
        fit,
        finished=lambda done: tell(0.27 + 0.03 * done / count, "estimating the change that each effect would cause"),
    )
    detection = detection.beside(known)
    keep(found_step("detect", detection))

    found: Iterable[Naming] = [nothing_tried(base.chosen)]
    if detection.mismatch and checked.soundness is Soundness.SOUND:
        tell(0.3, "fitting the model with added effects")
        found = explanations(
            problem,
            base.chosen,
            known,
            base.alternatives,
            finished=lambda share: tell(0.3 + 0.5 * share, "fitting the model with added effects"),
            fitted=None if through is None else lambda fit, unseen: through(fit_step(problem, fit, unseen)),
        )
    naming, verification, stands = first_that_stands(
        found, problem, for_verification, started=lambda text: tell(0.8, text)
    )
    used = naming.base.calibration.plant  # in the search, which may have taken more steps than the base fit
    problem = replace(problem, nominal=solved_like(problem.nominal, used))
    part = None if stands or len(naming.candidates) == 1 else acting(naming, problem, for_rest)
    naming, verification = (naming, verification) if part is None else part
    keep(found_step("verify", verification if verification.ablations else None))
    base = base.in_variant_of(naming.base).solved_like(replace(used, stages=plant.stages))
    naming, elsewhere = without_places(naming)
    verdict = _verdict(problem, checked, base, detection, naming, verification, stands, part is not None)
    doubted = verdict.has_causes and _contradicts_the_rig(naming.best, problem)
    numbers: list[tuple[Candidate, Detection]] = []
    if doubted or verdict in (Verdict.UNKNOWN, Verdict.AMBIGUOUS):
        tell(0.82, "looking for a wrong number in the description of the rig")
        numbers = _with_a_number_restated(problem, base, for_rest)
        better = doubted and bool(numbers) and not _contradicts_the_rig(numbers[0][0], problem)
        if better or (numbers and verdict is Verdict.UNKNOWN):
            (other, detection), *numbers = numbers
            base, location = base.in_variant_of(other), None
            keep(base_step(problem, base))
            keep(found_step("detect", detection))
            naming, verdict = nothing_tried(base.chosen), Verdict.PARAMETERS
            verification = verify(base.chosen, base.chosen, for_rest, problem)
    answer = naming.best if naming.best is not None and verdict.has_causes else base.chosen
    left = locate(answer, problem, checked, for_rest) if verdict is Verdict.PARTLY else None

    tell(0.85, "looking for a better experiment")
    naming = with_all_distances(naming, problem) if verdict is Verdict.AMBIGUOUS else naming
    alternatives = (answer, *naming.alternatives) if verdict is Verdict.AMBIGUOUS else ()
    advice = advise(problem, alternatives, for_advice, distances=naming.distances)
    keep(found_step("advise", advice))
    # a free form belongs to one reading
    unknown = verdict is Verdict.UNKNOWN and problem.of_first.fitted == problem.fitted
    discovery = discover(problem, base.chosen, for_discovery) if unknown else None
    keep(found_step("discover", discovery))

    tell(0.95, "fitting all recordings")
    last = discovery.calibration if discovery is not None else answer.calibration
    whole = verification.whole if answer is naming.best else detection.taken_up
    # The last fit has all stages, and as many steps as its effects need.
    begun = last if whole is None else whole
    least = LEAST_ERROR * answer.noise  # model error of any rig
    followed = resolved(solved_like(begun.plant, plant), checked.experiments, least)
    final = refit(begun.solved_like(followed), problem.everything)
    final = with_nominal_start(final, problem.nominal, problem.everything, max(problem.expected_error, least))
    diagnosis = conclude(
        Findings(
            problem=problem,
            checked=checked,
            base=base,
            detection=detection,
            location=location,
            naming=naming,
            verification=verification,
            advice=advice,
            discovery=discovery,
            verdict=verdict,
            answer=answer,
            final=with_exchanged_lags(final, problem.everything),
            left=left,
            elsewhere=elsewhere if answer is naming.best else (),
            restated=tuple(variant for variant, _ in numbers),
        )
    )
    tell(1.0, "done")
    return diagnosis


def _among_variants(
    problem: DiagnosisProblem, base: Base, seen: Detection, rng: np.random.Generator
) -> tuple[Base, Detection]:
    """Try all variants of the base plant, whose chosen one has a mismatch (`seen`); return the one to continue with."""
    filed = _as_filed(problem, beside_alternatives(problem, base), seen, rng)
    return _in_a_variant_that_lacks_nothing(problem, *filed, rng)


def _as_filed(
    problem: DiagnosisProblem, base: Base, seen: Detection, rng: np.random.Generator
) -> tuple[Base, Detection]:
    """Return the base plant in the rig file's own variant, and what is detected there."""
    # The chosen variant has a mismatch (`seen`). A variant other than the file's may have absorbed, badly, all that is
    # missing, so the search starts from the file's own; if nothing is missing there, nothing is missing. The chosen
    # variant is kept only if the calibration's own test is certain of a mismatch in the file's variant, but detection
    # is not.
    filed = base.as_filed(problem.nominal.rig)
    if filed is base:
        return base, seen
    again = detect(filed.chosen, problem, rng)
    in_doubt = filed.chosen.mismatch and not again.mismatch and again.taken_up is None
    return (base, seen) if in_doubt else (filed, again)


def _in_a_variant_that_lacks_nothing(
    problem: DiagnosisProblem, base: Base, seen: Detection, rng: np.random.Generator
) -> tuple[Base, Detection]:
    """Return the base plant in an alternative variant that lacks nothing, if the chosen one has a mismatch (`seen`)."""
    # The calibration keeps its variant if the mismatch is uncertain; but what another variant explains is no missing
    # physics, however small it is.
    if not seen.mismatch:
        return base, seen
    for alternative in (variant for variant in base.alternatives if variant.adequate):
        again = detect(alternative, problem, rng)
        if not again.mismatch and again.taken_up is None:
            return base.in_variant_of(alternative), again
    return base, seen


def _contradicts_the_rig(explanation: Candidate | None, problem: DiagnosisProblem) -> bool:
    """Return whether an explanation has a parameter of the rig at a bound, although its value was known beforehand."""
    at_bound = () if explanation is None else explanation.calibration.at_bound
    known = problem.nominal.parameters
    return any(name in known and not known[name].guessed for name in at_bound)


def _with_a_number_restated(
    problem: DiagnosisProblem, base: Base, rng: np.random.Generator
) -> list[tuple[Candidate, Detection]]:
    """Return the base plant with one number of the rig changed, for each number with which it then lacks nothing, and
    what is detected there; first those that need no known parameter of the rig at a bound.
    """
    tested = [(variant, detect(variant, problem, rng)) for variant in restated(problem, base.chosen)]
    sound = [(variant, seen) for variant, seen in tested if not seen.mismatch and seen.taken_up is None]
    return sorted(sound, key=lambda found: _contradicts_the_rig(found[0], problem))


def _verdict(
    problem: DiagnosisProblem,
    checked: DataQuality,
    base: Base,
    detection: Detection,
    naming: Naming,
    verification: Verification,
    stands: bool,
    partly: bool,
) -> Verdict:
    if checked.soundness is Soundness.FAULTY:
        return Verdict.DATA_FAULT
    if detection.taken_up is not None:
        return Verdict.PARAMETERS
    if not detection.mismatch:
        if not detection.testable:
            return Verdict.NOT_TESTABLE
        return Verdict.PARAMETERS if _nominal_is_off(problem, base) else Verdict.NONE
    if partly:
        return Verdict.PARTLY
    if naming.best is None or not stands:
        return Verdict.DISTURBANCE if detection.disturbance else Verdict.UNKNOWN
    if naming.alternatives:
        return Verdict.AMBIGUOUS
    if not shows_its_cycles(naming.best, problem.everything):
        return Verdict.UNKNOWN  # it may be any slow change
    return Verdict.NAMED if explains_all(naming.best, naming.base, verification.whole) else Verdict.PARTLY


def _nominal_is_off(problem: DiagnosisProblem, base: Base) -> bool:
    residuals = free_run_residuals(problem.nominal, problem.everything)
    return residuals is None or excess_of(residuals, base.noise, problem.nominal.rig.model_error).mismatch

"""From recordings to a verdict: gate, base refit, detect, name, verify, refit, say. Read it top to bottom."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from deatwin.ident.greybox.parts import free_run_residuals
from deatwin.ident.mismatch.advise.advise import advise
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.conclude import conclude
from deatwin.ident.mismatch.detect.detect import detect
from deatwin.ident.mismatch.detect.detection import Detection
from deatwin.ident.mismatch.diagnosis import Diagnosis
from deatwin.ident.mismatch.discover.discover import discover
from deatwin.ident.mismatch.excess import excess_over_floor
from deatwin.ident.mismatch.findings import Findings
from deatwin.ident.mismatch.gate.beside import without_faults
from deatwin.ident.mismatch.gate.gaps import without_unknown
from deatwin.ident.mismatch.gate.gate import Gate, Soundness, confirm, gate
from deatwin.ident.mismatch.locate.location import locate
from deatwin.ident.mismatch.locate.track import readings
from deatwin.ident.mismatch.naming.cycles import shows_its_cycles
from deatwin.ident.mismatch.naming.decide import Naming, nothing_tried, with_all_distances
from deatwin.ident.mismatch.naming.name import explanations
from deatwin.ident.mismatch.naming.places import without_places
from deatwin.ident.mismatch.naming.screen import footprints
from deatwin.ident.mismatch.partly import acting, explains_all
from deatwin.ident.mismatch.prepare import prepare
from deatwin.ident.mismatch.refit.base import Base, beside_rivals
from deatwin.ident.mismatch.refit.exchange import with_exchanged_lags
from deatwin.ident.mismatch.refit.search import refit
from deatwin.ident.mismatch.steps import Step, base_step, fit_step, found_step, gate_step
from deatwin.ident.mismatch.verdict import Verdict
from deatwin.ident.mismatch.verify.standing import first_that_stands
from deatwin.ident.mismatch.verify.verification import Verification
from deatwin.ident.parallel import spawn_generators
from deatwin.plant.effects.base import Effect
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment

Progress = Callable[[float, str], None]


def diagnose(
    plant: Plant,
    experiments: Experiment | Sequence[Experiment],
    *,
    effects: Sequence[Effect] | None = None,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
    through: Callable[[Step], None] | None = None,
) -> Diagnosis:
    """Find the physics that a plant lacks to explain recordings.

    Parameters
    ----------
    plant : Plant
        Nominal plant; it is calibrated first.
    experiments : Experiment or sequence of Experiment
        Experiments, each from rest.
    effects : sequence of Effect, optional
        Effects that may be missing; by default the whole catalogue, at the sizes of the rig if it states any
        (`Rig.sizes`). Effects that the rig does not accept are skipped.
    jobs : int
        Number of worker processes; -1 takes all cores.
    seed : int
        Seed of all random numbers.
    progress : callable, optional
        Called with the completed share and a description of the current work.
    through : callable, optional
        Called with each finished step, so that its result can be kept if the diagnosis ends early.

    Returns
    -------
    Diagnosis
        Verdict, evidence, and the calibrated plant, amended if causes were found.

    Raises
    ------
    DataError, ModelError
        If the recordings cannot be used at all.
    SimulationError
        If the plant cannot be simulated on them.
    """
    tell = progress or (lambda share, text: None)

    def keep(step: Step | None) -> None:
        if through is not None and step is not None:
            through(step)

    tell(0.0, "checking the recordings")
    checked = gate(plant, experiments)
    keep(gate_step(checked))
    for_detection, for_location, for_verification, for_advice, for_discovery, for_rest = spawn_generators(seed, 6)

    tell(0.02, "calibrating the base plant")
    bench, base = prepare(plant, checked, effects, jobs=jobs)
    fitted_plant = base.chosen.calibration.plant
    usable = without_unknown(without_faults(checked, fitted_plant), fitted_plant, base.noise)
    if usable is not checked:
        checked = usable
        bench, base = prepare(plant, checked, effects, jobs=jobs)
    for form in (base.chosen, *base.rivals):  # what is wrong with the readings stands out whatever the form
        checked = confirm(checked, readings(form.calibration.plant, checked.experiments))
    keep(gate_step(checked))
    keep(base_step(bench, base))

    tell(0.25, "looking for a mismatch")
    detection = detect(base.chosen, bench, for_detection)
    if detection.mismatch and checked.soundness is Soundness.SOUND:
        before = base
        base, detection = _among_forms(bench, base, detection, for_detection)
        if base is not before:
            keep(base_step(bench, base))
    keep(found_step("detect", detection))
    if detection.mismatch:
        tell(0.26, "locating the mismatch")
    location = locate(base.chosen, bench, checked, for_location) if detection.mismatch else None
    keep(found_step("locate", location))

    fit, count = base.chosen.calibration, len(bench.effects)
    known = footprints(
        bench,
        fit,
        bench.effects,
        fit,
        finished=lambda done: tell(0.27 + 0.03 * done / count, "estimating what each effect would change"),
    )
    detection = detection.beside(known)
    keep(found_step("detect", detection))

    found: Iterable[Naming] = [nothing_tried(base.chosen)]
    if detection.mismatch and checked.soundness is Soundness.SOUND:
        tell(0.3, "building in effects")
        found = explanations(
            bench,
            base.chosen,
            known,
            base.rivals,
            finished=lambda share: tell(0.3 + 0.5 * share, "building in effects"),
            fitted=None if through is None else lambda fit, unseen: through(fit_step(bench, fit, unseen)),
        )
    naming, verification, stands = first_that_stands(
        found, bench, for_verification, started=lambda text: tell(0.8, text)
    )
    part = None if stands or len(naming.candidates) == 1 else acting(naming, bench, for_rest)
    naming, verification = (naming, verification) if part is None else part
    keep(found_step("verify", verification if verification.ablations else None))
    base = base.in_form_of(naming.base)
    naming, elsewhere = without_places(naming)
    verdict = _verdict(bench, checked, base, detection, naming, verification, stands, part is not None)
    answer = naming.best if naming.best is not None and verdict.has_causes else base.chosen
    left = locate(answer, bench, checked, for_rest) if verdict is Verdict.PARTLY else None

    tell(0.85, "looking for a better experiment")
    naming = with_all_distances(naming, bench) if verdict is Verdict.AMBIGUOUS else naming
    rivals = (answer, *naming.rivals) if verdict is Verdict.AMBIGUOUS else ()
    advice = advise(bench, rivals, for_advice, distances=naming.distances)
    keep(found_step("advise", advice))
    unknown = verdict is Verdict.UNKNOWN and bench.of_first.fitted == bench.fitted  # a free form is of one reading
    discovery = discover(bench, base.chosen, for_discovery) if unknown else None
    keep(found_step("discover", discovery))

    tell(0.95, "fitting all recordings")
    last = discovery.calibration if discovery is not None else answer.calibration
    whole = verification.whole if answer is naming.best else detection.taken_up
    diagnosis = conclude(
        Findings(
            bench=bench,
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
            final=with_exchanged_lags(refit(last, bench.everything) if whole is None else whole, bench.everything),
            left=left,
            elsewhere=elsewhere if answer is naming.best else (),
        )
    )
    tell(1.0, "done")
    return diagnosis


def _among_forms(bench: Bench, base: Base, seen: Detection, rng: np.random.Generator) -> tuple[Base, Detection]:
    """The base plant beside all its rival forms, in the one to go on with, and what is seen there.

    A mismatch was `seen` in the form chosen.
    """
    filed = _as_filed(bench, beside_rivals(bench, base), seen, rng)
    return _in_a_form_that_lacks_nothing(bench, *filed, rng)


def _as_filed(bench: Bench, base: Base, seen: Detection, rng: np.random.Generator) -> tuple[Base, Detection]:
    """The base plant in the rig file's own form, and what is seen there; `seen` was a mismatch in the form chosen.

    What is missing may be all that another reading of the file did, and badly: it is looked for from the file's on. And
    if nothing is missing there, nothing is: another reading is no better for leaving something. Only where the plain
    test of the calibration is certain that something is, and detection is not, the other one stays.
    """
    filed = base.as_filed(bench.nominal.rig)
    if filed is base:
        return base, seen
    again = detect(filed.chosen, bench, rng)
    in_doubt = filed.chosen.mismatch and not again.mismatch and again.taken_up is None
    return (base, seen) if in_doubt else (filed, again)


def _in_a_form_that_lacks_nothing(
    bench: Bench, base: Base, seen: Detection, rng: np.random.Generator
) -> tuple[Base, Detection]:
    """The base plant in a rival form in which nothing is missing, where something was `seen` to be in the chosen one.

    A mismatch that is too small for the calibration to be certain of it does not make it take another form; but what
    another reading of the rig file does is no missing physics, however small it is.
    """
    if not seen.mismatch:
        return base, seen
    for rival in (form for form in base.rivals if form.adequate):
        again = detect(rival, bench, rng)
        if not again.mismatch and again.taken_up is None:
            return base.in_form_of(rival), again
    return base, seen


def _verdict(
    bench: Bench,
    checked: Gate,
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
        return Verdict.PARAMETERS if _nominal_is_off(bench, base) else Verdict.NONE
    if partly:
        return Verdict.PARTLY
    if naming.best is None or not stands:
        return Verdict.DISTURBANCE if detection.disturbance else Verdict.UNKNOWN
    if naming.rivals:
        return Verdict.AMBIGUOUS
    if not shows_its_cycles(naming.best, bench.everything):
        return Verdict.UNKNOWN  # it may be any slow change
    return Verdict.NAMED if explains_all(naming.best, naming.base, verification.whole) else Verdict.PARTLY


def _nominal_is_off(bench: Bench, base: Base) -> bool:
    residuals = free_run_residuals(bench.nominal, bench.everything)
    return residuals is None or excess_over_floor(residuals, base.noise, bench.nominal.rig.model_error).mismatch

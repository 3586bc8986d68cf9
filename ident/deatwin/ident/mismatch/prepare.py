"""Prepare a diagnosis: calibrate the base plant, and find the noise and model error that all later steps use."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import fields, replace

import numpy as np

from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.locate.time import locate_time
from deatwin.ident.mismatch.locate.track import readings, tracks
from deatwin.ident.mismatch.model_error import error_in, model_error_of, with_model_error
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.noise import noise_level, noise_levels
from deatwin.ident.mismatch.quality.quality import DataQuality, by_experiment, split
from deatwin.ident.mismatch.refit.base import Base, calibrate_base, enough_stages
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.soundness import noise_of_bends
from deatwin.plant.effects.base import Alone, Effect, require_effects
from deatwin.plant.effects.catalogue import catalogue, machine_catalogue
from deatwin.plant.model import Plant
from deatwin.plant.readings import Reading
from deatwin.plant.resolution import followed_plant, solved_like
from deatwin.plant.rigs.base import Rig

Levels = tuple[tuple[np.ndarray, ...], ...]
"""Relative level of the noise at each sample of each recording of each experiment."""


@checks_its_arguments
def prepare(
    plant: Plant, checked: DataQuality, effects: Sequence[Effect] | None = None, *, jobs: int = 1
) -> tuple[DiagnosisProblem, Base]:
    """Prepare the diagnosis problem from plant, effects and recordings, and calibrate the plant.

    If only the held-out data show a mismatch, a part of them is added to the fitted data.

    Parameters
    ----------
    plant : Plant
        Nominal plant.
    checked : DataQuality
        Recordings as `check_quality` returned them.
    effects : sequence of Effect, optional
        Effects that may be missing; by default all that the rig offers. The typical strengths of catalogue effects are
        adapted to the rig, as in `diagnose`. Effects that the rig does not accept are skipped.
    jobs : int
        Number of worker processes; -1 takes all cores.

    Returns
    -------
    DiagnosisProblem
        Diagnosis problem. Its plant has the model error that is expected for these recordings. This plant is simulated
        with fewer stages and more steps per sample (`Plant.stages`, `Plant.steps`) than `plant`, if the former hardly
        change the readings and the latter follow them better.
    Base
        The calibrated plant, with the same model error and numbers of stages and steps.

    Raises
    ------
    RigError
        If one of `effects` is not an `Effect`.
    SimulationError
        If the plant cannot be simulated on the recordings.
    """
    known = effects_for(plant.rig, effects)
    problem = _problem_of(plant, checked, known, jobs)
    base = calibrate_base(problem)
    # A nominal damping may be far too small, so how fast the plant moves is known only after a calibration.
    followed, _ = followed_plant(base.chosen.calibration.plant, checked.experiments)
    if followed is not base.chosen.calibration.plant:
        plant = solved_like(plant, followed)
        problem = _problem_of(plant, checked, known, jobs)
        base = calibrate_base(problem)
    noisier = _noisier(base, problem)
    if noisier:
        plant = plant.with_rig(replace(plant.rig, further=noisier))
        problem = _problem_of(plant, checked, known, jobs)
        base = calibrate_base(problem)
    levels = _levels(base, problem, checked)
    if levels is not None:
        problem = _problem_of(plant, checked, known, jobs, levels=levels)
        base = calibrate_base(problem)
    onset = _late_onset(base, checked)
    later = problem if onset is None else _problem_of(plant, checked, known, jobs, onset, levels)
    if not _same_parts(later, problem):
        problem, base = later, calibrate_base(later)
    error = model_error_of(base.chosen.calibration.plant, problem)
    alternatives = tuple(alternative.with_floor(error) for alternative in base.alternatives)
    base = replace(base, chosen=base.chosen.with_floor(error), alternatives=alternatives)
    stages = enough_stages(problem, base)
    nominal = replace(with_model_error(problem.nominal, error), stages=stages)
    return replace(problem, nominal=nominal), base.solved_like(nominal)


def effects_for(rig: Rig, effects: Sequence[Effect] | None) -> Sequence[Effect]:
    """Return the effects of a rig, or given ones: those of the catalogue at the sizes and in the words of the rig."""
    if effects is None:
        return rig.effects()
    known = {type(effect) for effect in (*catalogue(), *machine_catalogue())}
    return [_scaled(effect, rig) if type(effect) in known else effect for effect in require_effects(effects)]


def _scaled(effect: Effect, rig: Rig) -> Effect:
    """Return an effect of the catalogue at the sizes of a rig; on a film rig, which has its units, values that differ
    from the usual ones stay as they are.
    """
    if rig.sizes is not None:
        return rig.scaled(effect)
    usual = type(effect)()
    values = {f.name: getattr(effect, f.name) for f in fields(effect)}
    return replace(rig.scaled(usual), **{name: v for name, v in values.items() if v != getattr(usual, name)})


def _problem_of(
    plant: Plant,
    checked: DataQuality,
    effects: Sequence[Effect],
    jobs: int,
    onset: float | None = None,
    levels: Levels | None = None,
) -> DiagnosisProblem:
    rig = plant.rig.for_motion(_motion(checked))
    weights = _weights(rig, checked)
    fitted, unseen, everything = split(checked, onset, weights, levels)
    known = tuple(e for e in effects if plant.accepts(e))
    # Further readings can distinguish these places, so effects there are tried like all others. With one reading alone
    # they are tried only as replacements for what was found, and only if they can make a difference to it.
    beside_others = {Alone.AS_FIRST, Alone.AS_ANOTHER} if weights else set()
    in_place = {Alone.TOLD} if weights else {Alone.TOLD, Alone.AS_ANOTHER}
    return DiagnosisProblem(
        nominal=plant.with_rig(rig),
        stated_error=plant.rig.model_error,
        expected_error=rig.model_error,
        effects=(*known, *elsewhere(plant, known, beside_others)),
        elsewhere=elsewhere(plant, known, in_place),
        fitted=fitted,
        unseen=unseen,
        everything=everything,
        jobs=jobs,
    )


def elsewhere(plant: Plant, effects: Sequence[Effect], alone: Collection[Alone]) -> tuple[Effect, ...]:
    """Return the effects at further places of the plant, except where another effect does the same."""
    names = {effect.name for effect in effects}
    placed = (
        effect.placed(at)
        for effect in effects
        for at, site in effect.places.items()
        if site.alone in alone and site.covered_by not in names
    )
    return tuple(effect for effect in placed if plant.accepts(effect))


def _same_parts(one: DiagnosisProblem, other: DiagnosisProblem) -> bool:
    """Return whether the same samples are fitted."""
    masks = [[mask for part in problem.fitted for mask in part.masks] for problem in (one, other)]
    return len(masks[0]) == len(masks[1]) and all(map(np.array_equal, *masks))


def _weights(rig: Rig, checked: DataQuality) -> dict[str, float]:
    """Return weights of recorded further readings, so that no noise or practical size exceeds that of the first one."""
    # The same limit then holds for all residuals. It is exact where noise and model error have the same ratio in each
    # reading, and where the noise hides the model error. Elsewhere it is too high for the smaller of the two, which
    # costs power but causes no false alarm.
    weights = {}
    for reading in rig.further:
        error = error_in(rig, reading, [r for e in checked.experiments for r in e.recordings])
        if error is not None:
            practical = practical_size(rig.noise, rig.model_error), practical_size(reading.noise, error)
            floors = [(rig.noise, reading.noise), practical]
            weights[reading.name] = min((first / own for first, own in floors if first > 0.0 < own), default=0.0)
    return {name: weight for name, weight in weights.items() if weight}


def _noisier(base: Base, problem: DiagnosisProblem) -> tuple[Reading, ...]:
    """Return the further readings with the noise seen in the base plant's residuals, if that clearly exceeds the
    stated noise.
    """
    if not problem.nominal.rig.further:
        return ()
    fit = base.chosen.calibration
    pieces = np.split(fit.residuals, np.cumsum([part.size for part in problem.fitted])[:-1])
    found = []
    for reading in problem.nominal.rig.further:
        own = [
            (part, piece) for part, piece in zip(problem.fitted, pieces, strict=True) if part.reading == reading.name
        ]
        level = 0.0
        if own:
            weight, commands = own[0][0].weight, [part.commands for part, _ in own]
            whole = [piece / weight for _, piece in own]
            level = noise_level(whole, problem.nominal.rig.sample_time, reading.noise, commands).level
            # A current that is read late has a peak at each step, which is in every segment of its spectrum, but in few
            # samples.
            level = float(min(level, max(map(noise_of_bends, whole))))
        found.append(replace(reading, noise=max(level, reading.noise)))
    return tuple(found) if tuple(found) != problem.nominal.rig.further else ()


def _levels(base: Base, problem: DiagnosisProblem, checked: DataQuality) -> Levels | None:
    """Return the relative noise level in each recording of each experiment, if it varies with reading or command."""
    plant = base.chosen.calibration.plant
    simulated = [y for each in readings(plant, checked.experiments) for y in each]
    records = [r for experiment in checked.experiments for r in experiment.recordings]
    sound = [mask for masks in checked.usable for mask in masks]
    left = [np.where(m, r.outputs[0] - y, np.nan) for r, y, m in zip(records, simulated, sound, strict=True)]
    commands = [r.inputs[0] for r in records]
    found = noise_levels(left, (simulated, commands), max(problem.nominal.rig.noise, problem.expected_error))
    return None if found is None else by_experiment(checked, found)


def _motion(checked: DataQuality) -> float:
    """Return the standard deviation of the sound readings within each experiment, SI, however it is cut into records."""
    pairs = zip(checked.experiments, checked.usable, strict=True)
    whole = [np.concatenate([r.outputs[0, m] for r, m in zip(e.recordings, masks, strict=True)]) for e, masks in pairs]
    pieces = [piece for piece in whole if piece.size]
    return float(np.sqrt(sum(p.var() * p.size for p in pieces) / sum(p.size for p in pieces)))


def _late_onset(base: Base, checked: DataQuality) -> float | None:
    """Return the time from which a mismatch exists that only the held-out data show."""
    chosen = base.chosen
    if chosen.fitted_test.mismatch or not chosen.unseen_test.mismatch:
        return None
    floor = base.noise**2 + chosen.calibration.plant.rig.model_error**2
    windows = locate_time(tracks(chosen.calibration.plant, checked.experiments, usable=checked.usable), floor)
    return max(windows, key=lambda w: w.score).from_s if windows else None

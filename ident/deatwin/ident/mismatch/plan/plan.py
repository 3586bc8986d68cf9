"""Plan of an experiment: the effects that an input would reveal."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.advise.advise import SCREENED
from deatwin.ident.mismatch.advise.distance import confusion
from deatwin.ident.mismatch.advise.offer import SensorOffer
from deatwin.ident.mismatch.advise.sensors import offer, offered
from deatwin.ident.mismatch.advise.waveforms import REPERTOIRE, bears, limits_of, safe_limits, waveform
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.likelihood.beforehand import deviation, strength_deviation
from deatwin.ident.mismatch.likelihood.several import OwnErrors, own_errors, taken_up
from deatwin.ident.mismatch.naming.screen import response, shapes_of
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen, TellingReading
from deatwin.ident.mismatch.plan.seen import Change, distances, smallest
from deatwin.ident.mismatch.prepare import effects_for
from deatwin.ident.mismatch.thresholds import ACCURACY, DISTINGUISHED, TINY
from deatwin.ident.parallel import one_thread, require_workers, run_jobs
from deatwin.plant.actuation import actuation_curve
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.arrays import require_seed, root_mean_square
from deatwin.plant.effects.base import Effect
from deatwin.plant.errors import DataError, SimulationError
from deatwin.plant.model import Plant, require_plant
from deatwin.plant.prefixes import with_unit
from deatwin.plant.readings import Reading
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig

FEWEST, MOST = 100, 100_000
"""Smallest and largest number of samples of an advised input; all waveforms are held in memory."""
LARGE = 1e20
"""Residual size, SI, that exceeds all changes, so that effects are simulated at their typical strength."""
Progress = Callable[[float, str], None]


@one_thread
def plan_experiment(
    plant: Plant,
    commands: Recording | None = None,
    *,
    effects: Sequence[Effect] | None = None,
    seconds: float | None = None,
    jobs: int = 1,
    seed: int = 0,
    progress: Progress | None = None,
) -> ExperimentPlan:
    """Compute which effects an input would reveal, at which strength, and which it could not distinguish.

    The computation is to first order about the nominal plant. It allows for the refit of the plant's parameters and for
    the plant's model error. An effect counts as detected if its expected evidence makes it 95 % probable, and
    if the part of its response that the parameters cannot absorb is large enough for `diagnose` to count it as missing
    physics.

    Parameters
    ----------
    plant : Plant
        Nominal plant.
    commands : Recording, optional
        The input; its readings are ignored. By default, several waveforms are tried, and the one that best
        distinguishes the effects from each other is chosen.
    effects : sequence of Effect, optional
        Effects that may be missing; by default all that the rig offers. The typical strengths of catalogue effects are
        adapted to the rig, as in `diagnose`. Effects that the rig does not accept are skipped.
    seconds : float, optional
        Length of the input, s, if `commands` is omitted; by default 3000 samples.
    jobs : int
        Number of worker processes; -1 takes all cores.
    seed : int
        Seed of random waveforms.
    progress : callable, optional
        Called with the completed share and a description of the current work.

    Returns
    -------
    ExperimentPlan

    Raises
    ------
    DataError
        If `commands` is not a Recording, if both `commands` and `seconds` are given, if the rig accepts none of the
        effects, or if it states no sensor noise and the reading does not respond to the input. Without `commands`, also
        if the rig states no range of its command, or if the length is not 100 to 100,000 samples.
    ModelError
        If `plant` is not a Plant, `seed` is not an integer of at least 0, or `jobs` is neither -1 nor an integer of at
        least 1.
    RigError
        If one of `effects` is not an `Effect`.
    SimulationError
        If the nominal plant cannot be simulated with the input.
    """
    require_plant(plant, "a plan")
    if not isinstance(commands, Recording | None):
        raise DataError(f"commands must be a Recording, whose readings are ignored, not a {type(commands).__name__}")
    tell = progress or (lambda share, text: None)
    require_workers(jobs)
    require_seed(seed)
    length = SCREENED * plant.rig.sample_time if seconds is None else seconds
    if commands is None:
        _require_range_and_length(plant.rig, length)
    known = [effect for effect in effects_for(plant.rig, effects) if plant.accepts(effect)]
    if not known:
        raise DataError("there is nothing to plan for: none of the effects can be added to this rig")
    if commands is not None:
        if seconds is not None:
            raise DataError(
                "the length in seconds applies only to an input that plan suggests: give either an input or a length"
            )
        doing = "trying the effects on this input"
        tell(0.0, doing)
        wanted = _wanted(plant, known, commands.extras)
        seen = _seen(plant, commands, known, jobs, lambda done: tell(done / len(known), doing), wanted)
        return _plan(plant, seen, "", {}, known)
    inputs = _inputs(plant, length, seed)
    found: dict[str, _Seen] = {}
    for number, (name, record) in enumerate(inputs.items()):
        tell(number / len(inputs), f"trying {name}")
        try:
            found[name] = _seen(plant, record, known, jobs, partial(_told, tell, number, len(inputs), len(known), name))
        except SimulationError:
            continue
    if not found:
        raise SimulationError(
            "the nominal plant could not be simulated with any of the suggested inputs: give an input within its limits"
        )
    tried = {name: seen.confused for name, seen in found.items()}
    best = min(tried, key=lambda name: tried[name])
    with_more = _seen(plant, inputs[best], known, jobs, lambda done: None, _wanted(plant, known, ()))
    return _plan(plant, with_more, best, tried, known)


def _wanted(plant: Plant, effects: Sequence[Effect], recorded: Collection[str]) -> tuple[Reading, ...]:
    """Return readings that the rig could have in addition to its own."""
    stated = {reading.name for reading in plant.rig.further}
    return offered([plant, *(plant.with_effects(effect) for effect in effects)], {*stated, *recorded})


def _told(tell: Progress, number: int, inputs: int, effects: int, name: str, done: int) -> None:
    tell((number + done / effects) / inputs, f"trying {name}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """Changes of the readings by effects of all shapes under an input, with their products."""

    recording: Recording
    error: OwnErrors
    changes: tuple[Change, ...]
    among: np.ndarray
    left: np.ndarray  # (changes, readings), rms of each change in each reading after the parameters are fitted
    impossible: tuple[str, ...]
    beside: tuple[tuple[SensorOffer, np.ndarray], ...]  # Possible further readings, each with `among` if it is added

    @cached_property
    def typical(self) -> dict[str, int]:
        """Return, for each effect, the index of the shape with median visibility."""
        squares = np.diag(self.among) * np.array([c.typical for c in self.changes]) ** 2
        numbers: dict[str, list[int]] = {}
        for k, change in enumerate(self.changes):
            numbers.setdefault(change.effect, []).append(k)
        return {name: sorted(of, key=lambda k: squares[k])[len(of) // 2] for name, of in numbers.items()}

    def nearest(self, name: str, among: np.ndarray) -> dict[str, float]:
        """Return d² from an effect at its typical strength to each other one, and to no effect (an empty name)."""
        k = self.typical[name]
        found = {"": float(among[k, k] * self.changes[k].typical ** 2)}
        others = zip(self.typical, distances(self.changes, among, (k,))[0], strict=True)
        return found | {other: float(d2) for other, d2 in others if other != name}

    def alike(self, name: str, among: np.ndarray) -> tuple[str, ...]:
        """Return the effects that cannot be distinguished from one at its typical strength, the most similar first."""
        near = {other: d2 for other, d2 in self.nearest(name, among).items() if other and d2 < DISTINGUISHED}
        return tuple(sorted(near, key=lambda other: near[other]))

    @property
    def confused(self) -> float:
        """Return the probability of mistaking an effect for its nearest alternative, averaged over the effects."""
        near = [min(self.nearest(name, self.among).values()) for name in self.typical]
        return float(np.mean([confusion(d2) for d2 in near])) if near else confusion(0.0)

    def practical(self, k: int) -> float:
        """Return the smallest strength at which a change counts in one of the rig's readings."""
        pairs = zip(self.error.of, self.left[k], strict=False)
        return min(practical_size(one.noise, one.rms) / max(float(left), TINY) for one, left in pairs)


def _seen(
    plant: Plant,
    commands: Recording,
    effects: Sequence[Effect],
    jobs: int,
    finished: Callable[[int], None],
    wanted: Sequence[Reading] = (),
) -> _Seen:
    record, further, sensors = _with_readings(plant, commands, wanted)
    whole = plant.with_rig(replace(plant.rig.for_motion(float(np.std(record.outputs[0]))), further=further))
    first = Part.whole(Experiment(recordings=(record,)))
    parts = (first, *(replace(first, reading=reading.name) for reading in further))
    problem = Problem(plant=whole, parts=parts, names=plant.parameters.free)
    run = problem.evaluate(problem.start())
    if run is None:
        raise SimulationError(
            "for this input, the derivatives of the nominal plant's readings with respect to its parameters are not finite"
        )
    moves = problem.smooth()
    spreads = np.array([deviation(plant.parameters[name]) for name in problem.names])
    readings = np.concatenate([part.measured for part in parts])
    error = own_errors(whole.rig, parts, readings, _noise(whole.rig, record), whole.rig.model_error)
    found = run_jobs(_changes, [(whole, effect, parts) for effect in effects], workers=jobs, finished=finished)
    changes = [change for of_one in found for change in of_one]
    shown, slopes = {change.effect for change in changes}, run[1][:, moves]
    rows = np.vstack([(slopes * spreads[moves]).T, *(change.readings for change in changes)])
    each, own = error.each(rows), 1 + len(plant.rig.further)
    taken = np.sum(each[:own], axis=0)
    bases = [tangent_basis(slopes[at]) for at in error.at[:own]]
    rms = [
        [np.sqrt(np.mean(taken_off(c.readings[at], basis) ** 2)) for at, basis in zip(error.at, bases, strict=False)]
        for c in changes
    ]
    return _Seen(
        recording=record,
        error=error,
        changes=tuple(changes),
        left=np.array(rms),
        among=taken_up(taken, int(moves.sum())),
        impossible=tuple(effect.name for effect in effects if effect.name not in shown),
        beside=tuple(
            (sensor, taken_up(taken + more, int(moves.sum()))) for sensor, more in zip(sensors, each[own:], strict=True)
        ),
    )


def _noise(rig: Rig, record: Recording) -> float:
    """Return the sensor's noise, SI; without a stated noise, the accuracy of the simulation."""
    noise = max(rig.noise, ACCURACY * float(np.std(record.outputs[0])))
    if noise == 0.0:
        raise DataError(
            "the rig states no sensor noise, and the reading does not respond to this input, so no effect can be assessed"
        )
    return noise


def _changes(plant: Plant, effect: Effect, parts: tuple[Part, ...]) -> list[Change]:
    """Return the change of the readings for each shape of an effect; events are in the middle of the recording."""
    without = np.concatenate([part.measured for part in parts])  # the nominal plant's own readings
    if effect.event:
        at, clock = effect.described(effect.event), parts[0].timepts
        middle = float(np.clip((clock[0] + clock[-1]) / 2, at.lower, at.upper))
        shapes = [replace(effect, **{effect.event: middle})]
    else:
        shapes = shapes_of(effect, plant, parts)
    typical = effect.described(effect.strength)
    known = [response(plant, parts, without, shape, missing=LARGE) for shape in shapes]
    return [
        Change(
            effect=effect.name,
            readings=one.change,
            typical=typical.value,
            deviation=strength_deviation(effect),
            one_sided=typical.lower >= 0.0,
        )
        for one in known
        if one is not None
    ]


def _plan(plant: Plant, seen: _Seen, name: str, tried: dict[str, float], effects: Sequence[Effect]) -> ExperimentPlan:
    unit, size = amplitude_unit(plant.rig.output_unit)
    known = {effect.name: effect for effect in effects}
    rows = [_foreseen(seen, known[effect], size, len(effects)) for effect in seen.typical]
    return ExperimentPlan(
        output=plant.rig.output_name,
        unit=unit,
        noise=seen.error.of[0].noise / size,
        model_error=seen.error.of[0].rms / size,
        seconds=seen.recording.duration,
        waveform=name,
        effects=tuple(
            sorted(rows, key=lambda row: np.inf if row.smallest is None else row.smallest / abs(row.typical))
        ),
        impossible=seen.impossible,
        tried=tried,
        readings=_telling(seen, rows),
        recording=seen.recording,
    )


def _telling(seen: _Seen, rows: Sequence[Foreseen]) -> tuple[TellingReading, ...]:
    """Return the possible readings, those first that distinguish most of the remaining pairs."""
    left = [(row.effect, other) for row in rows for other in row.alike]
    first, found = [effect for effect, _ in left], []
    for sensor, among in seen.beside if left else ():
        alike = {(effect, other) for effect in {*first} for other in seen.alike(effect, among)}
        told = {frozenset(pair) for pair in left if not {pair, pair[::-1]} & alike}
        pairs = tuple(sorted(tuple(sorted(pair)) for pair in told))
        found.append(TellingReading(**vars(sensor), tells=pairs, left=len({frozenset(pair) for pair in left})))
    return tuple(sorted(found, key=lambda one: -len(one.tells)))


def _foreseen(seen: _Seen, effect: Effect, size: float, catalogue: int) -> Foreseen:
    k, strength = seen.typical[effect.name], effect.described(effect.strength)
    change, rms = seen.changes[k], root_mean_square(seen.changes[k].readings[seen.error.at[0]])
    least = max(smallest(float(seen.among[k, k]), change.deviation, catalogue), seen.practical(k))
    within = least <= max(abs(strength.lower), abs(strength.upper))
    visible = within and least <= abs(strength.value)
    return Foreseen(
        effect=effect.name,
        family=effect.family.value,
        strength=strength.name,
        unit=strength.unit,
        typical=strength.value,
        change=abs(strength.value) * rms / size,
        smallest=least if within else None,
        smallest_change=least * rms / size if within else None,
        alike=seen.alike(effect.name, seen.among) if visible else (),
    )


def _with_readings(
    plant: Plant, commands: Recording, wanted: Sequence[Reading]
) -> tuple[Recording, tuple[Reading, ...], list[SensorOffer]]:
    """Return an input with the nominal plant's readings, all further readings, and the possible ones among them."""
    rig, silent = plant.rig, np.zeros((1, commands.n_samples))
    record = replace(commands, outputs=silent, output_names=(rig.output_name,), output_units=(rig.output_unit,))
    run = plant.with_rig(replace(rig, further=(*rig.further, *wanted))).simulate(Experiment(recordings=(record,)))
    rows = run.require().outputs[0]
    sensors = [
        offer(one, (), float(np.abs(row).max())) for one, row in zip(wanted, rows[1 + len(rig.further) :], strict=True)
    ]
    noises = [sensor.noise for sensor in sensors]
    further = (*rig.further, *(replace(one, noise=noise) for one, noise in zip(wanted, noises, strict=True)))
    extras = {reading.name: row for reading, row in zip(further, rows[1:], strict=True)}
    return replace(record, outputs=rows[:1], extras={**record.extras, **extras}), further, sensors


def _require_range_and_length(rig: Rig, seconds: float) -> None:
    """Raise DataError if no input can be suggested for a rig, or none of the wanted length."""
    if rig.command_range is None:
        raise DataError(
            "the rig states no range of its command, so plan cannot suggest an input: give an input file, or the "
            "range (command_min_V and command_max_V, of a coupon stretch_min and stretch_max, under [drive] of a rig file, "
            "command_range of a Rig)"
        )
    least, most = FEWEST * rig.sample_time, MOST * rig.sample_time
    if not least <= seconds <= most:
        raise DataError(
            f"an input of {seconds:g} s was requested, but its length must be {least:g} to {most:g} s ({FEWEST} to {MOST} samples)"
        )


def _inputs(plant: Plant, seconds: float, seed: int) -> dict[str, Recording]:
    """Return the waveforms of the repertoire that the nominal plant tolerates."""
    rig = plant.rig
    limits = safe_limits([plant], limits_of(plant, ()))
    if limits is None:
        raise SimulationError(
            f"the simulation of the nominal plant fails over the rig's whole range of commands{_borne(plant)}"
        )
    made = {name: waveform(name, limits, seconds, rig.sample_time, np.random.default_rng(seed)) for name in REPERTOIRE}
    return {
        name: Recording.from_arrays(
            u, np.empty((0, u.size)), rig.sample_time, input_names=(rig.input_name,), input_units=(rig.input_unit,)
        )
        for name, u in made.items()
        if u is not None and bears(plant, u, limits.rest)
    }


def _borne(plant: Plant) -> str:
    """Return the end of an error text: up to which command the film bears the voltage, or nothing if it bears all."""
    rest, high = plant.rig.start.rest_command, plant.rig.command_range[1] if plant.rig.command_range else -np.inf
    ends = actuation_curve(plant, np.linspace(rest, high, 100)).limits if rest < high else {}
    if not ends:
        return ""
    verb, command = min(ends.items(), key=lambda end: end[1])
    return f"; the film {verb} at {with_unit(command, plant.rig.input_unit)}, and the range ends at {high:g}: lower it"

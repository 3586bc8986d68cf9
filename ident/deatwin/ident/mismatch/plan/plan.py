"""What an input would show of missing physics, before anything is recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from deatwin.ident.greybox.parts import Part
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.greybox.tangent import taken_off, tangent_basis
from deatwin.ident.mismatch.advise.distance import TOLD_APART, confusion
from deatwin.ident.mismatch.advise.waveforms import REPERTOIRE, bears, limits_of, safe_limits, waveform
from deatwin.ident.mismatch.excess import practical_size
from deatwin.ident.mismatch.likelihood.beforehand import ACCURACY, OwnError, deviation, strength_deviation
from deatwin.ident.mismatch.naming.screen import footprint, shapes_of
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen
from deatwin.ident.mismatch.plan.seen import Change, distances, products, smallest
from deatwin.ident.parallel import run_jobs
from deatwin.plant.amplitudes import amplitude_unit
from deatwin.plant.effects.base import Effect
from deatwin.plant.errors import DataError, SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig

SAMPLES = 3000
"""Of an input that is advised, unless its length is given: long enough for a tenth of the slow error's time."""
FEWEST, MOST = 100, 100_000
"""Samples of an input that is advised: all waveforms of that length are held in memory."""
LARGE = 1e20
"""More than is missing of any readings, SI: effects are looked at as strong as they typically are."""
TINY = 1e-300
"""Of a change that the parameters take up whole, SI."""
Progress = Callable[[float, str], None]


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
    """Foresee which effects an input would show, from which strength on, and which it could not tell apart.

    To first order about the nominal plant, by the likelihood that the readings would have: parameters are refitted, and
    the plant's own error is allowed for. An effect counts as found where its expected evidence makes it 95 % probable
    against nothing missing, and what the parameters leave of it is more than the plant's own error and a part of the
    noise, below which `diagnose` takes nothing for missing.

    Parameters
    ----------
    plant : Plant
        Nominal.
    commands : Recording, optional
        The input; its readings are not looked at. Without one the repertoire of waveforms is tried, and the one is
        taken that leaves the least confusion among the effects.
    effects : sequence of Effect, optional
        What may be missing; by default all that the rig offers. Those that it cannot take are passed over.
    seconds : float, optional
        Length of an input that is advised; by default 3000 samples.
    jobs : int
        Worker processes; -1 takes all cores.
    seed : int
        Of what is random in waveforms.
    progress : callable, optional
        Called with the share that is done and what is being done.

    Returns
    -------
    ExperimentPlan

    Raises
    ------
    DataError
        If no input is given and the rig states no range of its command, both an input and a length are given, the
        length is not one of 100 to 100,000 samples, the rig takes none of the effects, or neither noise nor motion is
        there to judge them by.
    SimulationError
        If the nominal plant cannot follow the input.
    """
    tell = progress or (lambda share, text: None)
    known = [e for e in (plant.rig.effects() if effects is None else effects) if plant.accepts(e)]
    if not known:
        raise DataError("there is nothing to plan for: this rig takes none of the effects")
    if commands is not None:
        if seconds is not None:
            raise DataError("a length in seconds is of an input that is advised: give either the input or its length")
        doing = "trying the effects on this input"
        tell(0.0, doing)
        seen = _seen(plant, commands, known, jobs, lambda done: tell(done / len(known), doing))
        return _plan(plant, seen, "", {}, known)
    inputs = _inputs(plant, SAMPLES * plant.rig.sample_time if seconds is None else seconds, seed)
    found: dict[str, _Seen] = {}
    for number, (name, record) in enumerate(inputs.items()):
        tell(number / len(inputs), f"trying {name}")
        try:
            found[name] = _seen(plant, record, known, jobs, partial(_told, tell, number, len(inputs), len(known), name))
        except SimulationError:
            continue
    if not found:
        raise SimulationError("the nominal plant can follow none of the waveforms: give an input that it bears")
    tried = {name: seen.confused for name, seen in found.items()}
    best = min(tried, key=lambda name: tried[name])
    return _plan(plant, found[best], best, tried, known)


def _told(tell: Progress, number: int, inputs: int, effects: int, name: str, done: int) -> None:
    tell((number + done / effects) / inputs, f"trying {name}")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """What an input shows: changes of all shapes, and for each pair of them what readings say."""

    recording: Recording
    error: OwnError
    changes: tuple[Change, ...]
    among: np.ndarray
    left: tuple[float, ...]  # Rms of each change once the parameters are fitted, SI
    impossible: tuple[str, ...]

    @property
    def typical(self) -> dict[str, int]:
        """Of each effect the shape that is seen neither best nor worst, by number."""
        squares = np.diag(self.among) * np.array([c.typical for c in self.changes]) ** 2
        numbers: dict[str, list[int]] = {}
        for k, change in enumerate(self.changes):
            numbers.setdefault(change.effect, []).append(k)
        return {name: sorted(of, key=lambda k: squares[k])[len(of) // 2] for name, of in numbers.items()}

    def nearest(self, name: str, apart: np.ndarray) -> dict[str, float]:
        """d² from an effect at its typical strength to each other one, and to none (an empty name)."""
        k = self.typical[name]
        found = {"": float(self.among[k, k] * self.changes[k].typical ** 2)}
        others = zip(self.typical, apart[k], strict=True)
        return found | {other: float(d2) for other, d2 in others if other != name}

    @property
    def confused(self) -> float:
        """Probability of taking an effect at its typical strength for its nearest alternative, averaged."""
        apart = distances(self.changes, self.among)
        near = [min(self.nearest(name, apart).values()) for name in self.typical]
        return float(np.mean([confusion(d2) for d2 in near])) if near else 0.5


def _seen(
    plant: Plant, commands: Recording, effects: Sequence[Effect], jobs: int, finished: Callable[[int], None]
) -> _Seen:
    record = _with_readings(plant, commands)
    part, rig = Part.whole(Experiment(recordings=(record,))), plant.rig.for_motion(float(np.std(record.outputs[0])))
    problem = Problem(plant=plant, parts=(part,), names=plant.parameters.free)
    run = problem.evaluate(problem.start())
    if run is None:
        raise SimulationError("the nominal plant's derivatives by its parameters are not finite on this input")
    moves = problem.smooth()
    spreads = np.array([deviation(plant.parameters[name]) for name in problem.names])
    error = OwnError(
        readings=record.outputs[0],
        times=part.timepts,
        records=np.zeros(part.size),
        sample_time=rig.sample_time,
        noise=_noise(rig, record),
        stated=rig.model_error,
    )
    found = run_jobs(_changes, [(plant, effect, (part,)) for effect in effects], workers=jobs, finished=finished)
    changes = [change for of_one in found for change in of_one]
    shown, basis = {change.effect for change in changes}, tangent_basis(run[1][:, moves])
    return _Seen(
        recording=record,
        error=error,
        changes=tuple(changes),
        left=tuple(float(np.sqrt(np.mean(taken_off(c.readings, basis) ** 2))) for c in changes),
        among=products(error, run[1][:, moves] * spreads[moves], changes),
        impossible=tuple(effect.name for effect in effects if effect.name not in shown),
    )


def _noise(rig: Rig, record: Recording) -> float:
    """Noise of the sensor, SI; of one that states none the accuracy of the simulation."""
    noise = max(rig.noise, ACCURACY * float(np.std(record.outputs[0])))
    if noise == 0.0:
        raise DataError("the rig states no noise, and this input does not move it: no effect could be judged")
    return noise


def _changes(plant: Plant, effect: Effect, parts: tuple[Part, ...]) -> list[Change]:
    """What an effect does at each of its shapes; an event in the middle of the recording."""
    without = parts[0].measured  # the nominal plant's own readings
    if effect.event:
        at, clock = effect.described(effect.event), parts[0].timepts
        middle = float(np.clip((clock[0] + clock[-1]) / 2, at.lower, at.upper))
        shapes = [replace(effect, **{effect.event: middle})]
    else:
        shapes = shapes_of(effect, plant, parts)
    typical = effect.described(effect.strength)
    known = [footprint(plant, parts, without, shape, missing=LARGE) for shape in shapes]
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
    apart = distances(seen.changes, seen.among)
    known = {effect.name: effect for effect in effects}
    rows = [_foreseen(seen, known[effect], apart, size, len(effects)) for effect in seen.typical]
    return ExperimentPlan(
        output=plant.rig.output_name,
        unit=unit,
        noise=seen.error.noise / size,
        model_error=seen.error.rms / size,
        seconds=seen.recording.duration,
        waveform=name,
        effects=tuple(
            sorted(rows, key=lambda row: np.inf if row.smallest is None else row.smallest / abs(row.typical))
        ),
        impossible=seen.impossible,
        tried=tried,
        recording=seen.recording,
    )


def _foreseen(seen: _Seen, effect: Effect, apart: np.ndarray, size: float, catalogue: int) -> Foreseen:
    k, strength = seen.typical[effect.name], effect.described(effect.strength)
    change, rms = seen.changes[k], float(np.sqrt(np.mean(seen.changes[k].readings ** 2)))
    practical = practical_size(seen.error.noise, seen.error.rms) / max(seen.left[k], TINY)
    least = max(smallest(float(seen.among[k, k]), change.deviation, catalogue), practical)
    within = least <= max(abs(strength.lower), abs(strength.upper))
    near = {name: d2 for name, d2 in seen.nearest(effect.name, apart).items() if name and d2 < TOLD_APART}
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
        alike=tuple(sorted(near, key=lambda name: near[name])) if visible else (),
    )


def _with_readings(plant: Plant, commands: Recording) -> Recording:
    """An input with the readings of the nominal plant."""
    rig, silent = plant.rig, np.zeros((1, commands.n_samples))
    record = replace(commands, outputs=silent, output_names=(rig.output_name,), output_units=(rig.output_unit,))
    run = plant.simulate(Experiment(recordings=(record,))).require()
    return replace(record, outputs=run.outputs[0])


def _inputs(plant: Plant, seconds: float, seed: int) -> dict[str, Recording]:
    """The repertoire, as far as the nominal plant bears it."""
    rig = plant.rig
    if rig.command_range is None:
        raise DataError(
            "the rig states no range of its command within which an input could be advised: give an input file, or the "
            "range (command_min_V and command_max_V under [drive] of a rig file, command_range of a Rig)"
        )
    least, most = FEWEST * rig.sample_time, MOST * rig.sample_time
    if not least <= seconds <= most:
        raise DataError(
            f"an input of {seconds:g} s is asked for: give {least:g} to {most:g} s, which are {FEWEST} to {MOST} samples"
        )
    limits = safe_limits([plant], limits_of(plant, ()))
    if limits is None:
        raise SimulationError("the nominal plant bears no part of the rig's range of commands")
    made = {name: waveform(name, limits, seconds, rig.sample_time, np.random.default_rng(seed)) for name in REPERTOIRE}
    return {
        name: Recording.from_arrays(
            u, np.empty((0, u.size)), rig.sample_time, input_names=(rig.input_name,), input_units=(rig.input_unit,)
        )
        for name, u in made.items()
        if u is not None and bears(plant, u, limits.rest)
    }

"""The next experiment: the input that would tell apart what the recordings at hand cannot.

A repertoire of waveforms is tried on the explanations that are left, to first order; the best are simulated with a
refit of each rival, made as long as needed, and judged for plants drawn from the posteriors, too. What the recordings
at hand hold against a refit counts, since the new one will be diagnosed together with them.

References
----------
Hunter & Reiner, Technometrics 7 (1965) 307 (the input for which the predictions of rivals differ most).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.advise.distance import TOLD_APART, confusion, difference
from deatwin.ident.mismatch.advise.question import Question
from deatwin.ident.mismatch.advise.waveforms import REPERTOIRE
from deatwin.ident.mismatch.bench import Bench
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.plant.effects.base import Family
from deatwin.plant.errors import SimulationError
from deatwin.plant.model import Plant
from deatwin.plant.parameters import Parameter

__all__ = ["advise"]

MOST_RIVALS = 8
SCREENED, SHORTEST, LONGEST = 3000, 1000, 15_000
"""Samples of an input when it is screened, and when it is advised."""
ROUND = 250
"""Samples to whose multiple a length is rounded up."""
FINALISTS, TRIED = 3, 2
"""Waveforms that are simulated with refits, and those of them that are made as long as needed."""
WANTED = 1.5 * TOLD_APART
"""d² for which a length is chosen: it grows like the length, but not exactly."""
AMPLE = 10 * WANTED * SCREENED / SHORTEST
"""d² of a screened waveform that promises ten times what is wanted at the shortest length. The first such waveform of
the repertoire, whose order is from broad and gentle to fast and special, is preferred to one that promises even more:
what a plant's equations leave out shows most where it is driven to its extremes."""
TINY = 1e-3
"""d² of explanations that predict the same."""
ATTEMPTS = 2
HEAVIER = 2.0
"""The load after a mass has been added, as a multiple."""
SIGNALS = {"film_voltage": "the voltage on the film", "capacitance": "the capacitance", "current": "the current"}
TELLING = 0.01
"""Share of a signal's variation by which explanations must differ in it for it to be worth measuring."""
Told = Callable[[float], None]


def advise(
    bench: Bench,
    rivals: Sequence[Candidate],
    rng: np.random.Generator,
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Advice | None:
    """Find the shortest safe input that tells explanations apart.

    Parameters
    ----------
    bench : Bench
        Rig and recordings.
    rivals : sequence of Candidate
        The explanations that the recordings leave, the best first; of many the first eight count.
    rng : numpy.random.Generator
        Source of posterior plants and of what is random in waveforms.
    progress : callable, optional
        Called with the share that is done and what is being done.

    Returns
    -------
    Advice or None
        None where there are not two explanations.
    """
    tell = progress or (lambda share, text: None)
    left = list(rivals[:MOST_RIVALS])
    if len(left) < 2:
        return None
    question = Question.of(bench, [rival.calibration for rival in left], left[0].noise, rng)
    tried, found = _search(question, lambda share: tell(0.6 * share, "trying inputs"))
    added, load = None, _load(question)
    if found is None and load is not None:
        heavier = question.with_mass(HEAVIER * load)
        found = _search(heavier, lambda share: tell(0.6 + 0.3 * share, "trying inputs with an added mass"))[1]
        if found is not None:
            question, added = heavier, (HEAVIER - 1) * load
    tell(0.9, "writing the advice")
    rig, before = bench.nominal.rig, confusion(question.before)
    common: dict[str, Any] = {"rivals": _labels(left), "added_mass": added, "confusion_before": before, "tried": tried,
                              "noise": question.noise, "output": (rig.output_name, rig.output_unit)}  # fmt: skip
    if found is None:
        measure = _to_measure(question, left, tried)
        return Advice(
            recording=None, waveform="", measure=measure, confusion_after=before, predicted=(), **common
        )
    return Advice(
        recording=question.recording(found.commands), waveform=found.name, measure=None,
        confusion_after=found.confusion, predicted=_predicted(question, found.commands), **common,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Input:
    """A waveform that tells the explanations apart."""

    name: str
    commands: np.ndarray
    confusion: float


def _search(question: Question, tell: Told) -> tuple[dict[str, float], _Input | None]:
    """d² of all waveforms when they are screened, and the shortest input that tells the explanations apart."""
    screened: dict[str, float] = {}
    for number, name in enumerate(REPERTOIRE):
        commands = question.commands(name, SCREENED)
        if commands is not None:
            screened[name] = question.first_order(commands)
        tell(0.5 * number / len(REPERTOIRE))
    best = sorted(screened, key=lambda name: -screened[name])[:FINALISTS]
    gentle = [name for name in screened if screened[name] > AMPLE][:1]
    lengths = {name: max(SHORTEST, _needed(question, name)) for name in {*best, *gentle}}
    order = list(REPERTOIRE)
    promising = sorted(lengths, key=lambda name: (lengths[name], order.index(name)))
    promising = [name for name in promising if lengths[name] < 2 * LONGEST]
    for number, name in enumerate(promising[:TRIED]):
        tell(0.6 + 0.4 * number / TRIED)
        found = _long_enough(question, name, lengths[name])
        if found is not None:
            return screened, found
    return screened, None


def _needed(question: Question, name: str) -> float:
    """Samples that a waveform needs if d² goes on to grow as it does to first order; what is slow grows late."""
    commands = question.commands(name, SCREENED)
    if commands is None or not question.is_safe(commands):
        return float(np.inf)
    try:
        reached = question.refitted(commands)
    except SimulationError:
        return float(np.inf)
    if reached >= TOLD_APART:
        gained = reached - question.before
        return SCREENED * (WANTED - question.before) / gained if gained > 0 else float(np.inf)
    longest = question.commands(name, LONGEST)
    if longest is None:
        return float(np.inf)
    first, last = question.first_order(commands), question.first_order(longest)
    if not 0.0 < first < last or last < TOLD_APART:
        return float(np.inf)
    growth = np.log(last / first) / np.log(LONGEST / SCREENED)
    with np.errstate(over="ignore"):  # what hardly grows needs for ever
        return float(SCREENED * (WANTED / max(reached, TINY)) ** (1 / growth))


def _long_enough(question: Question, name: str, needed: float) -> _Input | None:
    """The waveform at the length that lowers the confusion, averaged over the posteriors, to what counts as told."""
    for _ in range(ATTEMPTS):
        count = int(np.clip(ROUND * np.ceil(needed / ROUND), SHORTEST, LONGEST))
        commands = question.commands(name, count)
        if commands is None or not question.is_safe(commands):
            return None
        try:
            squared = question.refitted(commands)
            confused = _confusion(question, commands, squared) if squared >= TOLD_APART else 0.5
        except SimulationError:
            return None
        if confused <= confusion(TOLD_APART):
            return _Input(name=name, commands=commands, confusion=confused)
        if count == LONGEST:
            return None
        needed = 1.5 * count * max(1.0, TOLD_APART / max(squared, 1e-6))
    return None


def _confusion(question: Question, commands: np.ndarray, squared: float) -> float:
    """Probability of taking the wrong explanation, averaged over the posteriors, of which one d² is known."""
    draws = range(1, max(map(len, question.shifts)))
    return float(np.mean([confusion(squared), *(confusion(question.refitted(commands, draw)) for draw in draws)]))


def _load(question: Question) -> float | None:
    """The mass of a load to which some can be added, kg; None where the rig has none that is known."""
    parameters = question.fits[0].plant.parameters
    mass: Parameter | None = parameters["mass"] if "mass" in parameters else None
    return mass.value if mass is not None and mass.known and 0 < HEAVIER * mass.value <= mass.upper else None


def _predicted(question: Question, commands: np.ndarray) -> tuple[np.ndarray, ...]:
    """Readings of the best explanation, and of the others, refitted to it."""
    best, *others = question.fits
    parts = question.parts(commands)
    apart = [difference(best.plant, other, parts) for other in others]
    readings = [best.plant.simulate(parts[0].experiment).require().outputs[0][0]]
    return (*readings, *(readings[0] - d.left if d is not None else np.full_like(readings[0], np.nan) for d in apart))


def _labels(rivals: Sequence[Candidate]) -> tuple[str, ...]:
    """The effects of each explanation; the same effects on another form of the rig get a number."""
    names = [" + ".join(rival.effects) or "nothing missing" for rival in rivals]
    return tuple(f"{n} ({names[:k].count(n) + 1})" if names.count(n) > 1 else n for k, n in enumerate(names))


def _to_measure(question: Question, rivals: Sequence[Candidate], tried: dict[str, float]) -> str:
    """The further signal in which the explanations differ most, beyond its gain and offset."""
    if any(e.family is Family.ENVIRONMENT for r in rivals for e in r.calibration.plant.effects if e.name in r.effects):
        return "the temperature"
    commands = question.commands(max(tried, key=lambda name: tried[name]), SCREENED) if tried else None
    if commands is None:
        return "another signal"
    signals = [_signals(fit.plant, question, commands) for fit in question.fits]
    common = [name for name in SIGNALS if all(name in s for s in signals)]
    apart = {n: min(_unlike(a[n], b[n]) for a, b in combinations(signals, 2)) for n in common}
    telling = max(apart, key=lambda name: apart[name], default="")
    return SIGNALS[telling] if telling and apart[telling] > TELLING else "another signal"


def _signals(plant: Plant, question: Question, commands: np.ndarray) -> dict[str, np.ndarray]:
    watched = dict(plant.simulate(question.parts(commands)[0].experiment).watched[0])
    if {"capacitance", "film_voltage"} <= watched.keys():
        watched["current"] = np.gradient(watched["capacitance"] * watched["film_voltage"], question.sample_time)
    return watched


def _unlike(one: np.ndarray, other: np.ndarray) -> float:
    """The share of a signal that is no multiple of the other one, plus an offset."""
    scatter = float(np.std(one) * np.std(other))
    if not scatter > 0:
        return 0.0
    return float(np.sqrt(max(0.0, 1 - (np.mean((one - one.mean()) * (other - other.mean())) / scatter) ** 2)))

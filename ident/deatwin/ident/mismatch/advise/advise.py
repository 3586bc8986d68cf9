"""The next experiment: the input that would distinguish the remaining explanations.

A repertoire of waveforms is tried on the remaining explanations, to first order. The best waveforms are simulated with a
refit of each alternative, made as long as needed, and also judged for plants drawn from the posteriors. The existing
recordings limit these refits, because the new recording will be diagnosed together with them. If no input distinguishes
all explanations, the one that leaves the least confusion is advised, at its greatest length, if it is worth its time.

References
----------
Hunter & Reiner, Technometrics 7 (1965) 307 (the input for which the predictions of alternatives differ most).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, islice

import numpy as np

from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.advise.distance import confusion, difference
from deatwin.ident.mismatch.advise.offer import PricedReading, in_words
from deatwin.ident.mismatch.advise.question import Question
from deatwin.ident.mismatch.advise.sensors import prices
from deatwin.ident.mismatch.advise.waveforms import REPERTOIRE
from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.ident.mismatch.thresholds import DISTINGUISHED, TINY
from deatwin.plant.errors import SimulationError
from deatwin.plant.parameters import Parameter

MOST_RIVALS = 8
SCREENED, SHORTEST, LONGEST = 3000, 1000, 15_000
"""Samples of a screened or planned input, enough for a tenth of the slow error's time; smallest and largest number of
samples of an advised one."""
ROUND = 250
"""Number of samples to a multiple of which a length is rounded up."""
FINALISTS, TRIED = 3, 2
"""Number of waveforms that are simulated with refits, and of those whose length is chosen."""
WANTED = 1.5 * DISTINGUISHED
"""d² for which a length is chosen, with a margin because d² grows only roughly with the length."""
AMPLE = 10 * WANTED * SCREENED / SHORTEST
"""d² of a screened waveform that promises ten times the wanted value at the shortest length. The first such waveform is
preferred to later ones that promise more, because the repertoire is ordered from gentle to extreme waveforms, and the
plant's equations are least accurate at extremes."""
WORTHWHILE = 0.75
"""Largest share of the confusion that an advised input may leave; with three explanations it then excludes one."""
ATTEMPTS = 2
HEAVIER = 2.0
"""Ratio of the load with the added mass to the load without it."""


@checks_its_arguments
def advise(
    problem: DiagnosisProblem,
    alternatives: Sequence[Candidate],
    rng: np.random.Generator,
    *,
    distances: Sequence[Distance] = (),
    progress: Callable[[float, str], None] | None = None,
) -> Advice | None:
    """Find the shortest input within the rig's limits that distinguishes all explanations.

    If there is no such input, the advised one distinguishes some of them.

    Parameters
    ----------
    problem : DiagnosisProblem
        Diagnosis problem with the rig and the recordings.
    alternatives : sequence of Candidate
        Explanations that the recordings do not rule out, the best first. Only the first eight are used.
    rng : numpy.random.Generator
        Random generator for plants drawn from the posterior and for random waveforms.
    distances : sequence of Distance, optional
        Distances between the explanations for the existing recordings, if refits have computed them. They are used for
        `Advice.confusion_before`, because a first-order distance may be too large.
    progress : callable, optional
        Called with the completed share and a description of the current work.

    Returns
    -------
    Advice or None
        The advice; None if there are fewer than two explanations.
    """
    tell = progress or (lambda share, text: None)
    left = list(alternatives[:MOST_RIVALS])
    if len(left) < 2:
        return None
    loads = _loads(Question.of(problem, [alternative.calibration for alternative in left], left[0].noise, rng))
    found, here = _search(loads, tell), loads[0].question
    tell(0.9, "writing the advice")
    rig, before = problem.nominal.rig, _confused(here.before_told(_by_number(left, distances)))
    tried = {name: float(nearest.min()) for name, nearest in loads[0].screened.items()}
    market, numbers, labels = prices(here), range(len(left)), _labels(left)
    readings = market.among(numbers)
    without_input = Advice(
        alternatives=labels,
        recording=None,
        waveform="",
        added_mass=None,
        measure=_to_measure(readings),
        confusion_before=before,
        confusion_after=before,
        undecided=labels,
        tried=tried,
        predicted=(),
        log_odds=max(tried.values(), default=0.0) / 2.0,
        readings=readings,
        noise=here.noise,
        output=(rig.output_name, rig.output_unit),
    )
    if found is None:
        return without_input
    question, close = found.load.question, found.nearest < DISTINGUISHED
    return replace(
        without_input,
        recording=question.recording(found.commands),
        waveform=found.name,
        added_mass=found.load.added,
        measure=_to_measure(market.among(list(compress(numbers, close)))) if close.any() else None,
        log_odds=float(found.nearest.min()) / 2.0,
        confusion_after=found.confusion,
        predicted=_predicted(question, found.commands),
        undecided=tuple(compress(labels, close)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Load:
    """A question asked on the rig as it is, or with an added mass, kg."""

    question: Question
    added: float | None

    @cached_property
    def screened(self) -> dict[str, np.ndarray]:
        """Return d² from each explanation to the nearest other, for all waveforms at the screening length."""
        return _first_orders(self.question, SCREENED)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Input:
    """A waveform with d² from each explanation to the nearest other one."""

    load: _Load
    name: str
    commands: np.ndarray
    nearest: np.ndarray

    @cached_property
    def confusion(self) -> float:
        """Return the probability of choosing a wrong explanation, averaged over the posteriors."""
        question = self.load.question
        draws = range(1, max(map(len, question.shifts)))
        try:
            drawn = [question.refitted(self.commands, draw) for draw in draws]
        except SimulationError:
            return confusion(0.0)
        return float(np.mean([_confused(nearest) for nearest in (self.nearest, *drawn)]))


def _loads(question: Question) -> list[_Load]:
    """Return the question for the rig as it is and, if its load is known and can be increased, for an added mass."""
    loads, parameters = [_Load(question=question, added=None)], question.fits[0].plant.parameters
    mass: Parameter | None = parameters["mass"] if "mass" in parameters else None
    if mass is not None and mass.known and 0 < HEAVIER * mass.value <= mass.upper:
        loads.append(_Load(question=question.with_mass(HEAVIER * mass.value), added=(HEAVIER - 1) * mass.value))
    return loads


def _search(loads: Sequence[_Load], tell: Callable[[float, str], None]) -> _Input | None:
    """Return the shortest input that distinguishes all explanations, without added mass if possible; otherwise the
    best input.
    """
    searches = [(look, load) for look in (_shortest, _least_confusing) for load in loads]
    for number, (look, load) in enumerate(searches):
        tell(0.9 * number / len(searches), "trying inputs" + (" with an added mass" if load.added else ""))
        found = look(load)
        if found is not None:
            return found
    return None


def _first_orders(question: Question, count: int) -> dict[str, np.ndarray]:
    """Return the first-order d² from each explanation to the nearest other, for all waveforms at one length."""
    made = {name: question.commands(name, count) for name in REPERTOIRE}
    return {name: question.first_order(commands) for name, commands in made.items() if commands is not None}


def _shortest(load: _Load) -> _Input | None:
    """Return the shortest input that distinguishes the explanations."""
    screened = {name: float(nearest.min()) for name, nearest in load.screened.items()}
    best = sorted(screened, key=lambda name: -screened[name])[:FINALISTS]
    gentle = [name for name in screened if screened[name] > AMPLE][:1]
    lengths = {name: max(SHORTEST, _needed(load.question, name)) for name in {*best, *gentle}}
    order = list(REPERTOIRE)
    promising = sorted(lengths, key=lambda name: (lengths[name], order.index(name)))
    promising = [name for name in promising if lengths[name] < 2 * LONGEST]
    return next(filter(None, (_long_enough(load, name, lengths[name]) for name in promising[:TRIED])), None)


def _least_confusing(load: _Load) -> _Input | None:
    """Return the input of the greatest length that leaves the least confusion; None if none is worth its time."""
    # Half of that length shows slow differences well enough to preselect inputs.
    rough = {name: _confused(nearest) for name, nearest in _first_orders(load.question, LONGEST // 2).items()}
    promising = (_judged(load, name, LONGEST) for name in sorted(rough, key=lambda name: rough[name]))
    best = min(islice(filter(None, promising), TRIED), key=lambda one: _confused(one.nearest), default=None)
    return best if best and best.confusion <= WORTHWHILE * _confused(load.question.before) else None


def _needed(question: Question, name: str) -> float:
    """Return how many samples a waveform needs if d² grows as its first-order estimate does."""
    commands = question.commands(name, SCREENED)
    if commands is None or not question.is_safe(commands):
        return float(np.inf)
    try:
        reached, before = float(question.refitted(commands).min()), float(question.before.min())
    except SimulationError:
        return float(np.inf)
    if reached >= DISTINGUISHED:
        gained = reached - before
        return SCREENED * (WANTED - before) / gained if gained > 0 else float(np.inf)
    longest = question.commands(name, LONGEST)
    if longest is None:
        return float(np.inf)
    first, last = (float(question.first_order(made).min()) for made in (commands, longest))
    if not 0.0 < first < last or last < DISTINGUISHED:
        return float(np.inf)
    growth = np.log(last / first) / np.log(LONGEST / SCREENED)
    with np.errstate(over="ignore"):  # an infinite length is allowed
        return float(SCREENED * (WANTED / max(reached, TINY)) ** (1 / growth))


def _long_enough(load: _Load, name: str, needed: float) -> _Input | None:
    """Return the waveform, just long enough for the explanations to count as distinguished."""
    for _ in range(ATTEMPTS):
        count = int(np.clip(ROUND * np.ceil(needed / ROUND), SHORTEST, LONGEST))
        found = _judged(load, name, count)
        if found is None:
            return None
        least = float(found.nearest.min())
        if least >= DISTINGUISHED and found.confusion <= confusion(DISTINGUISHED):
            return found
        if count == LONGEST:
            return None
        needed = 1.5 * count * max(1.0, DISTINGUISHED / max(least, TINY))
    return None


def _judged(load: _Load, name: str, count: int) -> _Input | None:
    """Judge a waveform of a given length; None if it is not safe."""
    question = load.question
    commands = question.commands(name, count)
    if commands is None or not question.is_safe(commands):
        return None
    try:
        return _Input(load=load, name=name, commands=commands, nearest=question.refitted(commands))
    except SimulationError:
        return None


def _confused(nearest: np.ndarray) -> float:
    """Return the probability of choosing the nearest wrong explanation, averaged over all truths."""
    return float(np.mean([confusion(float(squared)) for squared in nearest]))


def _by_number(alternatives: Sequence[Candidate], distances: Sequence[Distance]) -> dict[frozenset[int], float]:
    """Return d² of pairs of explanations, given by number; effects that occur in several rig variants are omitted."""
    names = ["+".join(alternative.effects) for alternative in alternatives]
    number = {name: k for k, name in enumerate(names) if names.count(name) == 1}
    return {frozenset(number[n] for n in d.effects): d.d2 for d in distances if {*d.effects} <= {*number}}


def _predicted(question: Question, commands: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the readings that the best explanation predicts, and those of the others refitted to it."""
    best, *others = question.fits
    parts = question.parts(commands)
    apart = [difference(best.plant, other, parts) for other in others]
    readings = [best.plant.simulate(parts[0].experiment).require().outputs[0][0]]
    return (*readings, *(readings[0] - d.left if d is not None else np.full_like(readings[0], np.nan) for d in apart))


def _labels(alternatives: Sequence[Candidate]) -> tuple[str, ...]:
    """Return the effects of each explanation; equal sets in other rig variants get numbers."""
    names = [" + ".join(alternative.effects) or "nothing missing" for alternative in alternatives]
    return tuple(f"{n} ({names[:k].count(n) + 1})" if names.count(n) > 1 else n for k, n in enumerate(names))


def _to_measure(priced: Sequence[PricedReading]) -> str:
    """Return the first reading that distinguishes all explanations, in words."""
    return next((in_words(one.reading) for one in priced if one.resolves), "another signal")

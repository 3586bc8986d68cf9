r"""Which reading to buy: what each that a rig could have would tell, before anybody has it.

A reading is priced along the recordings at hand, as if it had been taken beside them. One explanation is the truth, the
other is refitted to all readings to first order, by the likelihood that the readings would have
(`deatwin.ident.mismatch.likelihood.several`). The truth then has the expected log odds :math:`d^2/2` over the other.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.greybox.parts import Part, first_only
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.mismatch.advise.distance import TOLD_APART
from deatwin.ident.mismatch.advise.offer import THERMOMETER, PricedReading, SensorOffer
from deatwin.ident.mismatch.advise.question import Question
from deatwin.ident.mismatch.likelihood.beforehand import ACCURACY, OwnError, coordinate
from deatwin.ident.mismatch.likelihood.several import own_errors, products_of, taken_up
from deatwin.plant.errors import RigError
from deatwin.plant.model import Plant
from deatwin.plant.readings import ELECTRICAL_UNITS, Reading
from deatwin.plant.recording import Experiment

SHARE = 1e-3
"""Noise of a reading of which nobody has said how noisy it is, as a share of the largest value that it would have: ten
effective bits. It is also the basic accuracy of a fast LCR meter (Keysight E4980A, data sheet 5989-4435EN: 0.10 %)."""
NOT_RECORDED = "the rig file; not recorded"
TYPICAL = "typical: a thousandth of the largest value"
PLATINUM = "typical: platinum thermometer of class AA, IEC 60751"
KELVIN = 0.1
"""Noise of such a thermometer, K."""
SOME = 1.0
"""Noise of a reading whose noise is not yet known."""

Signal = tuple[np.ndarray, np.ndarray]
"""What a fitted plant reads (n,), and the derivative (n, p) by its fitted coordinates; SI."""


def offered(plants: Sequence[Plant], recorded: Collection[str]) -> tuple[Reading, ...]:
    """Readings that some plants of one rig have and nobody recorded, those of the rig file first."""
    rig = plants[0].rig
    stated = [reading for reading in rig.further if reading.name not in recorded]
    known = {*recorded, *(reading.name for reading in stated)}
    if "temperature" in recorded:
        known.add(THERMOMETER)
    units = {**ELECTRICAL_UNITS, **rig.offers, THERMOMETER: "K"}
    more = [Reading(name=name, unit=unit, noise=SOME) for name, unit in units.items() if name not in known]
    return tuple(one for one in (*stated, *more) if any(has(plant, one) for plant in plants))


def has(plant: Plant, reading: Reading) -> bool:
    """Whether a plant has a signal that can be read."""
    try:
        return plant.with_rig(replace(plant.rig, further=(reading,))).equations is not None
    except RigError:
        return False


def offer(reading: Reading, stated: Collection[Reading], largest: float) -> SensorOffer:
    """A reading with its noise: that of the rig file, or what is typical where the `largest` value is this, SI."""
    noise, source = reading.noise, NOT_RECORDED
    if reading not in stated:
        noise, source = (KELVIN, PLATINUM) if reading.name == THERMOMETER else (SHARE * largest, TYPICAL)
    return SensorOffer(reading=reading.name, unit=reading.unit, noise=max(noise, 1e-300), noise_source=source)


def unread(parts: Sequence[Part], readings: Sequence[Reading]) -> tuple[Part, ...]:
    """Parts of readings that are not in the recordings, where the first reading counts, reading after reading."""
    silent = []
    for part in first_only(parts):
        records = part.experiment.recordings
        blank = [{one.name: np.zeros(record.n_samples) for one in readings} for record in records]
        filled = (replace(record, extras={**record.extras, **b}) for record, b in zip(records, blank, strict=True))
        silent.append(replace(part, experiment=Experiment(recordings=tuple(filled))))
    return tuple(replace(part, reading=one.name) for one in readings for part in silent)


def signals(
    plant: Plant, names: tuple[str, ...], parts: Sequence[Part], wanted: Sequence[Reading]
) -> dict[str, Signal]:
    """What a plant with its fitted coordinates makes of readings that nobody took; without those that it does not have."""
    own = [reading for reading in wanted if has(plant, reading)]
    asked = unread(parts, own)
    if not asked:
        return {}
    problem = Problem(plant=plant.with_rig(replace(plant.rig, further=tuple(own))), parts=asked, names=names)
    found = problem.evaluate(problem.start())
    if found is None:
        return {}
    pieces = np.split(np.arange(found[0].size), len(own))
    return {one.name: (-found[0][at], found[1][at]) for one, at in zip(own, pieces, strict=True)}


def error_of(
    sensor: SensorOffer, reading: Reading, readings: np.ndarray, parts: Sequence[Part], plant: Plant
) -> OwnError:
    """The plant's own error in a reading that nobody took, with these values (n,), SI."""
    first, spread = first_only(parts), float(np.std(readings))
    return OwnError(
        readings=readings,
        times=np.concatenate([part.timepts for part in first]),
        records=np.repeat(np.arange(len(first)), [part.size for part in first]),
        sample_time=plant.rig.sample_time,
        noise=max(sensor.noise, ACCURACY * spread),
        stated=max(reading.model_error, plant.rig.share_of_motion * spread),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Prices:
    """What each reading that could be had would tell of each pair of a question: `squares` are its d², (pairs,)."""

    question: Question
    squares: Mapping[SensorOffer, np.ndarray]

    def among(self, explanations: Collection[int]) -> tuple[PricedReading, ...]:
        """The readings, the best first, for telling some of the explanations apart, which are given by number."""
        asked = np.array([{*pair} <= {*explanations} for pair in self.question.pairs])
        nearest = {sensor: float(squares[asked].min()) for sensor, squares in self.squares.items() if asked.any()}
        priced = [
            PricedReading(**vars(sensor), log_odds=square / 2.0, resolves=square >= TOLD_APART)
            for sensor, square in nearest.items()
        ]
        return tuple(sorted(priced, key=lambda one: -one.log_odds))


def prices(question: Question) -> Prices:
    """Price the readings that a question's rig could have beside its recordings."""
    bench, plants = question.bench, [fit.plant for fit in question.fits]
    records = [record for part in bench.everything for record in part.experiment.recordings]
    recorded = {part.reading for part in bench.everything}
    recorded |= {"temperature"} if all("temperature" in record.extras for record in records) else set()
    wanted, parts = offered(plants, recorded), bench.fitted
    seen = [signals(fit.plant, fit.names, parts, wanted) for fit in question.fits]
    whole = [_on_the_recordings(question, number) for number in range(len(question.pairs))]
    found = {}
    for reading in wanted:
        known = [one[reading.name][0] for one in seen if reading.name in one]
        if not known:
            continue
        sensor = offer(reading, bench.nominal.rig.further, max(float(np.abs(values).max()) for values in known))
        squares = []
        for (truth, rival), (own, spread) in zip(question.pairs, whole, strict=True):
            one, other = (seen[k].get(reading.name, _constant(known[0], spread.size)) for k in (truth, rival))
            rows = np.vstack([(other[1] * spread).T, one[0] - other[0]])
            error = error_of(sensor, reading, one[0], parts, plants[truth])
            squares.append(float(taken_up(own + products_of(error, rows), spread.size)[0, 0]))
        found[sensor] = np.array(squares)
    return Prices(question=question, squares=found)


def _on_the_recordings(question: Question, number: int) -> tuple[np.ndarray, np.ndarray]:
    """What the recordings say of a pair: products (p + 1, p + 1) of derivatives and difference, and deviations (p,)."""
    bench, memory, rival = question.bench, question.memories[number], question.fits[question.pairs[number][1]]
    effects = {effect.name: effect for effect in bench.effects}
    readings = memory.known.readings
    error = own_errors(bench.nominal.rig, bench.fitted, readings, question.noise, bench.expected_error)
    largest = float(np.quantile(np.abs(error.of[0].readings), 0.99))
    known = [coordinate(rival.plant.parameters[name], bench.nominal, effects, largest) for name in rival.names]
    spread = np.array([one.deviation for one in known])
    return error.products(np.vstack([(memory.jacobian * spread).T, memory.known.left])), spread


def _constant(known: np.ndarray, count: int) -> Signal:
    """What a plant reads that has no such signal: the mean of what another one does (n,), whatever its parameters."""
    return np.full(known.size, known.mean()), np.zeros((known.size, count))

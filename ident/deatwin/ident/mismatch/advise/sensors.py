r"""Readings that a rig could have, and how well each would distinguish the explanations.

A reading is evaluated as if it had been taken with the existing recordings. One explanation is the truth, with drawn
noise; the other is refitted to all readings, to first order. The log odds follow from the likelihood of
`deatwin.ident.mismatch.likelihood.several`. This is done for the two explanations that are nearest to each other.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from deatwin.ident.greybox.parts import Part, first_only
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.mismatch.advise.offer import THERMOMETER, PricedReading, SensorOffer
from deatwin.ident.mismatch.advise.question import Question
from deatwin.ident.mismatch.likelihood.beforehand import OwnError, coordinate
from deatwin.ident.mismatch.likelihood.model import Prior
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.several import OwnErrors, own_errors, products_of, taken_up
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.thresholds import DISTINGUISHED, TINY
from deatwin.plant.errors import RigError
from deatwin.plant.model import Plant
from deatwin.plant.readings import ELECTRICAL_UNITS, Reading
from deatwin.plant.recording import Experiment

SHARE = 1e-3
"""Noise of a reading without stated noise, as a share of its largest value: ten effective bits. It is also the basic
accuracy of a fast LCR meter (Keysight E4980A, data sheet 5989-4435EN: 0.10 %)."""
NOT_RECORDED = "as stated in the rig file; this reading was not recorded"
TYPICAL = "typical: a thousandth of the largest value"
PLATINUM = "typical: platinum thermometer of class AA, IEC 60751"
KELVIN = 0.1
"""Noise of a platinum thermometer of class AA, K."""

Signal = tuple[np.ndarray, np.ndarray]
"""Readings (n,) of a fitted plant, and their derivative (n, p) by its fitted coordinates; SI."""


def offered(plants: Sequence[Plant], recorded: Collection[str]) -> tuple[Reading, ...]:
    """Return all readings that were not recorded but that all plants of a rig have, those of the rig file first."""
    rig = plants[0].rig
    stated = [reading for reading in rig.further if reading.name not in recorded]
    known = {*recorded, *(reading.name for reading in stated)}
    units = {**ELECTRICAL_UNITS, **rig.offers}
    if "temperature" not in recorded and any("temperature" in plant.channels for plant in plants):
        units |= {THERMOMETER: "K"}
    # The noise is not known yet; 1 is a placeholder.
    more = [Reading(name=name, unit=unit, noise=1.0) for name, unit in units.items() if name not in known]
    return tuple(one for one in (*stated, *more) if all(has(plant, one) for plant in plants))


def has(plant: Plant, reading: Reading) -> bool:
    """Return whether a plant has a signal that a sensor could read."""
    try:
        return plant.with_rig(replace(plant.rig, further=(reading,))).equations is not None
    except RigError:
        return False


def offer(reading: Reading, stated: Collection[Reading], largest: float) -> SensorOffer:
    """Return a reading with its noise from the rig file, or a typical one for its `largest` value, SI."""
    noise, source = reading.noise, NOT_RECORDED
    if reading not in stated:
        noise, source = (KELVIN, PLATINUM) if reading.name == THERMOMETER else (SHARE * largest, TYPICAL)
    return SensorOffer(reading=reading.name, unit=reading.unit, noise=max(noise, TINY), noise_source=source)


def unread(parts: Sequence[Part], readings: Sequence[Reading]) -> tuple[Part, ...]:
    """Return parts for unrecorded readings, at the samples at which the first reading counts."""
    silent = []
    for part in first_only(parts):
        records = part.experiment.recordings
        blank = [{one.name: np.zeros(record.n_samples) for one in readings} for record in records]
        filled = (replace(record, extras={**record.extras, **b}) for record, b in zip(records, blank, strict=True))
        # The noise level of the first reading says nothing about another one.
        silent.append(replace(part, experiment=Experiment(recordings=tuple(filled)), levels=None))
    return tuple(replace(part, reading=one.name) for one in readings for part in silent)


def signals(plant: Plant, names: tuple[str, ...], parts: Sequence[Part], wanted: Sequence[Reading]) -> list[Signal]:
    """Simulate readings that were not recorded, with derivatives; empty if the plant cannot be simulated."""
    asked = unread(parts, wanted)
    if not asked:
        return []
    fitting = Problem(plant=plant.with_rig(replace(plant.rig, further=tuple(wanted))), parts=asked, names=names)
    found = fitting.evaluate(fitting.start())
    if found is None:
        return []
    pieces = np.split(np.arange(found[0].size), len(wanted))
    return [(-found[0][at], found[1][at]) for at in pieces]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Beside:
    """A possible reading, with its noise and the responses of all explanations, in the order of the question's fits."""

    sensor: SensorOffer
    reading: Reading
    signals: tuple[Signal, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Prices:
    """Possible readings, and how well each distinguishes the explanations of a question."""

    question: Question
    beside: tuple[_Beside, ...]

    def among(self, explanations: Collection[int]) -> tuple[PricedReading, ...]:
        """Return the readings, the best first, that distinguish some explanations, given by number."""
        asked = [number for number, pair in enumerate(self.question.pairs) if {*pair} <= {*explanations}]
        found = []
        for one in self.beside if asked else ():
            nearest = min(asked, key=lambda number: self._square(one, number))
            odds = self._log_odds(one, nearest)
            found.append(PricedReading(**vars(one.sensor), log_odds=odds, resolves=2.0 * odds >= DISTINGUISHED))
        return tuple(sorted(found, key=lambda priced: -priced.log_odds))

    def _square(self, one: _Beside, number: int) -> float:
        """Return d² of a pair for known scales."""
        truth, alternative = self.question.pairs[number]
        spread = self._spreads[alternative]
        rows = np.vstack(
            [(one.signals[alternative][1] * spread).T, one.signals[truth][0] - one.signals[alternative][0]]
        )
        own = self._own(number) + products_of(self._error(one, truth), rows)
        return float(taken_up(own, spread.size)[0, 0])

    def _log_odds(self, one: _Beside, number: int) -> float:
        """Return the log odds of truth over alternative, given the recordings and a drawn reading."""
        truth, alternative = self.question.pairs[number]
        own, error = self._errors(truth), self._error(one, truth)
        size, count = own.readings.size, error.readings.size
        errors = OwnErrors(of=(*own.of, error), at=(*own.at, size + np.arange(count)))
        drawn = error.noise * np.random.default_rng(self.question.seed).standard_normal(count)
        weights = []
        for number in (truth, alternative):
            fit, (values, slopes) = self.question.fits[number], one.signals[number]
            moved = np.vstack([fit.jacobian, slopes]) * self._spreads[number]
            residual = np.concatenate([fit.residuals, drawn + one.signals[truth][0] - values])
            columns = np.column_stack([moved, errors.columns])
            weights.append(evidence(errors.likelihood(residual, columns), Prior.of((columns.shape[1], None))).log)
        return float(weights[0] - weights[1])

    def _error(self, one: _Beside, truth: int) -> OwnError:
        """Return the model error in an unrecorded reading, for an explanation's motion."""
        problem = self.question.problem
        parts = [replace(part, reading=one.reading.name, levels=None) for part in first_only(problem.fitted)]
        rig = replace(problem.nominal.rig, further=(one.reading,))
        return own_errors(rig, parts, one.signals[truth][0], 0.0, 0.0).of[0]

    def _errors(self, truth: int) -> OwnErrors:
        """Return the model error in the recorded readings, for an explanation's motion."""
        problem = self.question.problem
        readings = readings_of_fit(problem.fitted, self.question.fits[truth].residuals)
        return own_errors(problem.nominal.rig, problem.fitted, readings, self.question.noise, problem.expected_error)

    def _own(self, number: int) -> np.ndarray:
        """Return the products (p + 1, p + 1) of derivatives and difference of a pair, in the recordings."""
        (truth, alternative), memory = self.question.pairs[number], self.question.memories[number]
        rows = np.vstack([(memory.jacobian * self._spreads[alternative]).T, memory.known.left])
        return self._errors(truth).products(rows)

    @cached_property
    def _spreads(self) -> list[np.ndarray]:
        """Return the prior deviations of each explanation's coordinates, (p,) each."""
        problem = self.question.problem
        effects = {effect.name: effect for effect in problem.everywhere}
        largest = float(np.quantile(np.abs(np.concatenate([p.measured for p in first_only(problem.fitted)])), 0.99))
        return [
            np.array([coordinate(f.plant.parameters[n], problem.nominal, effects, largest).deviation for n in f.names])
            for f in self.question.fits
        ]


def prices(question: Question) -> Prices:
    """Evaluate readings that a question's rig could have in addition to its recordings."""
    problem, fits = question.problem, question.fits
    records = [record for part in problem.everything for record in part.experiment.recordings]
    recorded = {part.reading for part in problem.everything}
    recorded |= {"temperature"} if all("temperature" in record.extras for record in records) else set()
    wanted = offered([fit.plant for fit in fits], recorded)
    each = zip(*(signals(fit.plant, fit.names, problem.fitted, wanted) for fit in fits), strict=False)
    beside = []
    for one, known in zip(wanted, each, strict=False):  # empty if an explanation cannot be simulated
        largest = max(float(np.abs(values).max()) for values, _ in known)
        sensor = offer(one, problem.nominal.rig.further, largest)
        beside.append(_Beside(sensor=sensor, reading=replace(one, noise=sensor.noise), signals=known))
    return Prices(question=question, beside=tuple(beside))

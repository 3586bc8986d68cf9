"""What is done to the recordings before a structure is chosen (thesis section 4.4.2 and table B.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Frols, generate_terms
from deatwin.ident.narx.preprocess import (
    Finding,
    SamplingChoice,
    Sections,
    choose_orders,
    choose_sampling,
    choose_sections,
    inspect_recordings,
)
from deatwin.ident.narx.rules import AtMost
from deatwin.plant.fleet import Actuator
from deatwin.plant.recording import Recording
from deatwin.scenarios.fleet_models.variants import RECORDED, VARIANTS, as_variant
from deatwin.scenarios.thesis_data.drifts import at_same_input

Array = NDArray[np.float64]

SEGMENTS = 40
"""Of a recording, whose statistics are compared: 27.5 s each, thirty times as long as a reading is correlated."""
HELD_OUT = 100.0
"""The end of a stationary stretch, on which nothing is chosen or fitted, s; the same for all, so that the tests are
equally sharp."""
CHOOSING = 0.3
"""Share of the training section, its end, on which sampling time, lags and degree are chosen."""
FACTORS = (2, 4, 6)
"""Of the sampling time; the largest still has five samples to the first minimum of the correlation."""
LAGS = tuple((output, largest) for output in (1, 2) for largest in (0, 1, 2))
"""Number of output lags, and largest input lag; the input's begin with 0."""
DEGREES = (1, 2, 3, 4, 5)
"""Beyond the fifth a polynomial follows the mean curve of reading over command no better."""
RULE = AtMost(output=1)
"""The film remembers by one relaxation, so that its past enters through one value; a polynomial that is affine in it
runs free without the explosions that powers of it bring."""
MOST_TERMS = 25
SAMPLING_LAGS = 500
"""Over which the correlation of a reading is looked at."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """An actuator, recorded and looked over."""

    actuator: Actuator  # The one
    recordings: Mapping[str, Recording]
    sections: Sections  # Stationary stretches of the recording at the same input
    sampling: SamplingChoice  # What its correlation functions ask for
    findings: tuple[Finding, ...]  # What is named in the reading at the same input, and left as it is

    @property
    def name(self) -> str:
        """Of the actuator."""
        return self.actuator.name

    @property
    def stretch(self) -> tuple[float, float]:
        """The longest stationary one, s; the whole recording where there is none."""
        record = self.recordings[RECORDED]
        if not self.sections.stretches:
            return record.start, record.end
        longest = self.sections.stretches[0]
        return longest.first * record.sample_time, longest.last * record.sample_time

    def split(self, variant: str, factor: int) -> tuple[Recording, Recording]:
        """Training and held-out section: the stretch, and the end of it. `factor` every so many samples are kept."""
        record = self.recordings[variant]
        first, last = (round(time / record.sample_time) for time in self.stretch)
        whole = thinned(record.section(first, last), factor)
        cut = whole.n_samples - round(HELD_OUT / whole.sample_time)
        return whole.section(0, cut), whole.section(cut, whole.n_samples)


@dataclass(frozen=True, kw_only=True, eq=False)
class Orders:
    """Free-run errors by lags and degree at one sampling time."""

    factor: int
    errors: Array

    @property
    def means(self) -> Array:
        """Over the actuators, shape (n_lags, n_degrees)."""
        means: Array = self.errors.mean(axis=0)
        return means

    @property
    def least(self) -> Array:
        """The errors of lags and degree of the least mean error, shape (n_actuators,)."""
        i, j = np.unravel_index(np.argmin(self.means), self.means.shape)
        least: Array = self.errors[:, i, j]
        return least

    @property
    def best(self) -> tuple[int, int]:
        """Positions of lags and degree: of those as good as the best the ones with the fewest candidates."""
        places = [(int(i), int(j)) for i, j in np.argwhere(as_good(self.errors, self.least[:, None, None]))]
        return min(places, key=lambda place: (_candidates(*place), self.means[place]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What is the same for all six."""

    orders: tuple[Orders, ...]
    chosen: int  # Which of them

    @property
    def factor(self) -> int:
        """Every so many samples are kept."""
        return self.orders[self.chosen].factor

    @property
    def output_lags(self) -> int:
        """Their number."""
        return LAGS[self.orders[self.chosen].best[0]][0]

    @property
    def input_lags(self) -> tuple[int, ...]:
        """From 0 on."""
        return tuple(range(LAGS[self.orders[self.chosen].best[0]][1] + 1))

    @property
    def degree(self) -> int:
        """Of the candidates."""
        return DEGREES[self.orders[self.chosen].best[1]]


def prepare(actuator: Actuator) -> Prepared:
    """Record an actuator with and without parts of its physics, and look where it is stationary."""
    recordings = {variant: as_variant(actuator, variant).record().recordings[0] for variant in VARIANTS}
    record = recordings[RECORDED]
    level = replace(record, outputs=at_same_input(record.inputs[0], record.outputs[0], record.sample_time)[None])
    return Prepared(
        actuator=actuator,
        recordings=recordings,
        sections=choose_sections(level, n_segments=SEGMENTS),
        sampling=choose_sampling(record, n_lags=SAMPLING_LAGS),
        findings=inspect_recordings(level),
    )


def thinned(record: Recording, factor: int) -> Recording:
    """Keep every so many samples, as they are."""
    return replace(
        record,
        inputs=record.inputs[:, ::factor],
        outputs=record.outputs[:, ::factor],
        sample_time=record.sample_time * factor,
    )


def order_errors(training: Recording) -> Array:
    """Free-run errors on the end of a training section, of models that only its beginning has seen. Shapes: returns
    (n_lags, n_degrees).
    """
    cut = training.n_samples - round(CHOOSING * training.n_samples)
    end = training.section(cut, training.n_samples)
    errors = np.empty((len(LAGS), len(DEGREES)))
    for i, (output, largest) in enumerate(LAGS):
        choice = choose_orders(
            Frols(rule=RULE, max_terms=MOST_TERMS, criterion="free_run", held_out=CHOOSING),
            training.section(0, cut),
            end,
            output_lags=[output],
            input_lags=[tuple(range(largest + 1))],
            degrees=DEGREES,
        )
        errors[i] = [trial.error for trial in choice.trials]
    return errors / float(end.outputs.std())


def make_plan(errors: Mapping[int, Sequence[Array]]) -> Plan:
    """Choose sampling time, lags and degree for the whole fleet."""
    orders = tuple(Orders(factor=factor, errors=np.array(each)) for factor, each in errors.items())
    least = min((one.least for one in orders), key=np.mean)
    near = [i for i, one in enumerate(orders) if as_good(one.least, least)]
    return Plan(orders=orders, chosen=max(near, key=lambda i: orders[i].factor))


def as_good(errors: Array, least: Array) -> NDArray[np.bool_]:
    """Whether errors are as good as the least: on average not larger by more than a standard error.

    Source: Hastie, Tibshirani, Friedman, "The Elements of Statistical Learning", 2nd ed. (2009), section 7.10: the
    one-standard-error rule, here of paired differences.

    Shapes: `errors, least` (n_actuators, ...); returns (...).
    """
    finite = np.isfinite(errors).all(axis=0)
    beyond = np.where(finite, errors, 0.0) - least
    good: NDArray[np.bool_] = beyond.mean(axis=0) <= beyond.std(axis=0, ddof=1) / np.sqrt(len(beyond))
    return finite & good


def _candidates(lags: int, degree: int) -> int:
    """Number of candidate terms of one of `LAGS` and one of `DEGREES`, by their positions."""
    output, largest = LAGS[lags]
    return len(generate_terms(output, range(largest + 1), DEGREES[degree], rule=RULE))

"""A fleet of actuators: its recordings, common sampling time, lags and degree, and models of one structure.

A model of constant parameters cannot follow drift, and a polynomial of few past values no rate-independent hysteresis.
Each actuator is therefore recorded again, under the same commands and noise, without its history, then without both.
Candidates of a common structure hold the past output by itself only, so the Volterra series ends at the degree. With
products of output and command, which fit a little better, it has no end, and diverges at the size of the thesis' noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.drifts import at_same_input
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.frols import Frols
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.preprocess import (
    Finding,
    SamplingChoice,
    Sections,
    choose_orders,
    choose_sampling,
    choose_sections,
    inspect_recordings,
)
from deatwin.ident.narx.robust import robust
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.terms import AtMost, Rule, Term, generate_terms
from deatwin.ident.parallel import run_jobs
from deatwin.plant.arrays import Array
from deatwin.plant.fleet import TOLERANCES, Actuator, fleet, specification
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording

RECORDED, STEADY, FILM = "as recorded", "without its history", "without hysteresis too"
VARIANTS = (RECORDED, STEADY, FILM)
SEGMENTS = 40  # Segments of a recording whose statistics are compared: 27.5 s each, thirty correlation times
HELD_OUT = 100.0  # End of a stationary stretch, s, on which nothing is chosen or fitted; equally long for equal tests
SAMPLING_LAGS = 500  # Lags over which the correlation of a reading is examined


@dataclass(frozen=True, kw_only=True)
class Move:
    """A drift of an actuator's mean from one window of time to another."""

    number: int  # Number of the actuator
    early: tuple[float, float]  # Begin and end of the earlier window, s
    late: tuple[float, float]  # Begin and end of the later window, s
    sign: int  # 1 if the mean rises, -1 if it falls


MOVES = (
    Move(number=1, early=(0, 100), late=(1000, 1100), sign=-1),
    Move(number=2, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=3, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=4, early=(90, 190), late=(360, 460), sign=-1),
    Move(number=4, early=(360, 460), late=(640, 740), sign=1),
    Move(number=5, early=(0, 60), late=(200, 300), sign=-1),
    Move(number=5, early=(200, 300), late=(1000, 1100), sign=1),
    Move(number=6, early=(0, 45), late=(46, 146), sign=-1),
)
"""Drifts that the thesis reports for actuators 1, 2, 3 and 6, and those in the histories of 4 and 5."""
DRIFTING = ("DEA 1", "DEA 2", "DEA 3", "DEA 4", "DEA 5")
"""Actuators that drift throughout; the sixth shifts once, at 45 s, and is stationary afterwards."""


def as_variant(actuator: Actuator, variant: str) -> Actuator:
    """Remove physics from an actuator; fabrication, commands and sensor noise stay the same."""
    plant = actuator.plant
    if variant == RECORDED:
        return actuator
    film = plant.without_effects()
    if variant == STEADY:
        kept = [effect for effect in plant.effects if effect.name == "hysteresis"]
        values = {name: value for name, value in plant.values.items() if name.startswith("hysteresis.")}
        film = film.with_effects(*kept).with_values(values)
    return replace(actuator, plant=film)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """An actuator with its recording and the findings on it."""

    actuator: Actuator
    recordings: Mapping[str, Recording]  # One recording for each of `VARIANTS`
    sections: Sections  # Stretches in which the reading at the same input is stationary
    sampling: SamplingChoice  # Sampling time that its correlation functions suggest
    findings: tuple[Finding, ...]  # Findings in the reading at the same input; nothing is corrected

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.actuator.name

    @property
    def stretch(self) -> tuple[float, float]:
        """The longest stationary stretch, s; the complete recording if there is none."""
        record = self.recordings[RECORDED]
        if not self.sections.stretches:
            return record.start, record.end
        longest = self.sections.stretches[0]
        return longest.first * record.sample_time, longest.last * record.sample_time

    def split(self, variant: str, factor: int) -> tuple[Recording, Recording]:
        """Return training and held-out section of the stretch, with every `factor`-th sample."""
        record = self.recordings[variant]
        first, last = (round(time / record.sample_time) for time in self.stretch)
        whole = thinned(record.section(first, last), factor)
        cut = whole.n_samples - round(HELD_OUT / whole.sample_time)
        return whole.section(0, cut), whole.section(cut, whole.n_samples)


def prepare(actuator: Actuator) -> Prepared:
    """Record an actuator with and without parts of its physics, and find where it is stationary."""
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
    """Keep every `factor`-th sample, without filtering."""
    return replace(
        record,
        inputs=record.inputs[:, ::factor],
        outputs=record.outputs[:, ::factor],
        sample_time=record.sample_time * factor,
    )


def at_tolerance(name: str) -> Plant:
    """Return the specification with one quantity at the upper end of its tolerance."""
    wished, factor = specification(), 1 + TOLERANCES[name].share
    if hasattr(wished.rig, name):
        return wished.with_rig(replace(wished.rig, **{name: factor * getattr(wished.rig, name)}))
    return wished.with_values({name: factor * wished.parameters[name].value})


Progress = Callable[[float, str], None]

CHOOSING = 0.3  # Share of the training section, at its end, on which sampling time, lags and degree are chosen
FACTORS = (2, 4, 6)
"""Multiples of the sampling time; the largest still leaves five samples up to the first minimum of the correlation."""
LAGS = tuple((output, largest) for output in (1, 2) for largest in (0, 1, 2))
"""Number of output lags, and largest input lag; input lags begin with 0."""
DEGREES = (1, 2, 3, 4, 5)  # Degrees; beyond the fifth, a polynomial follows the mean reading over command no better
RULE = AtMost(output=1)
"""The film remembers through one relaxation; affine in one past output, a free run does not diverge by its powers."""
MOST_TERMS = 25


@dataclass(frozen=True, kw_only=True, eq=False)
class Orders:
    """Free-run errors by lags and degree at one sampling time."""

    factor: int
    errors: Array  # shape (n_actuators, n_lags, n_degrees): Errors divided by the standard deviation of the reading

    @property
    def means(self) -> Array:
        """Mean error of the actuators, shape (n_lags, n_degrees)."""
        return np.asarray(self.errors.mean(axis=0))

    @property
    def least(self) -> Array:
        """Errors for the lags and degree with the smallest mean error, shape (n_actuators,)."""
        i, j = np.unravel_index(np.argmin(self.means), self.means.shape)
        return np.asarray(self.errors[:, i, j])

    @property
    def best(self) -> tuple[int, int]:
        """Positions of lags and degree with the fewest candidates, among those as good as the best."""
        places = [(int(i), int(j)) for i, j in np.argwhere(as_good(self.errors, self.least[:, None, None]))]
        return min(places, key=lambda place: (_candidates(*place), self.means[place]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Sampling time, lags and degree for all actuators of a fleet."""

    orders: tuple[Orders, ...]
    chosen: int  # Position of the chosen sampling time in ``orders``

    @property
    def factor(self) -> int:
        """Every `factor`-th sample is kept."""
        return self.orders[self.chosen].factor

    @property
    def output_lags(self) -> int:
        """Number of output lags."""
        return LAGS[self.orders[self.chosen].best[0]][0]

    @property
    def input_lags(self) -> tuple[int, ...]:
        """Input lags, from 0 on."""
        return tuple(range(LAGS[self.orders[self.chosen].best[0]][1] + 1))

    @property
    def degree(self) -> int:
        """Degree of the candidates."""
        return DEGREES[self.orders[self.chosen].best[1]]


def prepare_fleet(seed: int, *, jobs: int = 1, progress: Progress) -> tuple[tuple[Prepared, ...], Plan]:
    """Record the fleet, and choose sections, sampling time, lags and degree."""

    def tell(first: float, last: float, count: int, doing: str) -> Callable[[int], None]:
        return lambda done: progress(first + (last - first) * done / count, doing)

    actuators = [(one,) for one in fleet(seed)]
    recording = tell(0.0, 0.8, len(actuators), "recording six actuators")
    recording(0)
    prepared = run_jobs(prepare, actuators, workers=jobs, finished=recording)
    training = [(one.split(RECORDED, factor)[0],) for factor in FACTORS for one in prepared]
    choosing = tell(0.8, 1.0, len(training), "choosing sampling time and orders")
    errors = run_jobs(order_errors, training, workers=jobs, finished=choosing)
    n = len(prepared)
    return tuple(prepared), make_plan({factor: errors[i * n : (i + 1) * n] for i, factor in enumerate(FACTORS)})


def order_errors(training: Recording) -> Array:
    """Return free-run errors on the end of a section, of models trained on its beginning, (n_lags, n_degrees)."""
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
    """Return which errors are within one standard error of the smallest (Hastie et al., 2nd ed. (2009), 7.10)."""
    finite = np.isfinite(errors).all(axis=0)
    beyond = np.where(finite, errors, 0.0) - least
    good: NDArray[np.bool_] = beyond.mean(axis=0) <= beyond.std(axis=0, ddof=1) / np.sqrt(len(beyond))
    return finite & good


def _candidates(lags: int, degree: int) -> int:
    """Return the number of candidate terms for one of `LAGS` and one of `DEGREES`, by their positions."""
    output, largest = LAGS[lags]
    return len(generate_terms(output, range(largest + 1), DEGREES[degree], rule=RULE))


Structure = tuple[Term, ...]
OPERATING_INPUT = 2.4  # Operating point at which all actuators are compared, V: the mean of the thesis' noise
BAND = (0.0, 1.0)  # Band of the thesis' noise, Hz


@dataclass(frozen=True, kw_only=True, eq=False)
class Alike:
    """An actuator with its model, which has the common structure."""

    prepared: Prepared
    factor: int  # Every `factor`-th sample of its recordings is kept
    sections: tuple[Recording, Recording]  # Training and held-out section, thinned
    model: NarxModel

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.prepared.name

    @property
    def fit_percent(self) -> float:
        """Fit of the free run over the held-out section, %; minus infinity if it diverges."""
        run = self.model.simulate(self.sections[1])
        return 100 * (1 - run.rms_error / float(self.sections[1].outputs.std())) if run.status.ok else -np.inf

    def whole(self, variant: str) -> Recording:
        """Return the complete recording of a variant, thinned."""
        return thinned(self.prepared.recordings[variant], self.factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fleet:
    """Actuators with models of one structure."""

    actuators: tuple[Alike, ...]
    plan: Plan
    structure: Structure  # Terms of all models, in the order of their parameters
    errors: Array  # shape (n_actuators,): Free-run errors of the structure, on the data on which it was chosen
    tried: int  # Number of structures from which it was chosen


def identify_fleet(seed: int, *, jobs: int = 1, progress: Progress = lambda share, text: None) -> Fleet:
    """Record the fleet, and fit one structure to each actuator."""
    prepared, plan = prepare_fleet(seed, jobs=jobs, progress=lambda share, text: progress(0.8 * share, text))
    progress(0.8, "choosing a common structure")
    return identify_alike(prepared, plan, jobs=jobs)


def identify_alike(prepared: Sequence[Prepared], plan: Plan, *, jobs: int = 1) -> Fleet:
    """Fit one structure to each of several actuators."""
    sections = [one.split(RECORDED, plan.factor) for one in prepared]
    structure, errors, tried = choose_structure([training for training, _ in sections], plan, jobs=jobs)
    actuators = tuple(
        Alike(prepared=one, factor=plan.factor, sections=both, model=fit(structure, both[0]))
        for one, both in zip(prepared, sections, strict=True)
    )
    return Fleet(actuators=actuators, plan=plan, structure=structure, errors=errors, tried=tried)


def linear_in_output(term: Term) -> bool:
    """Return whether a term contains no past output, or consists of a past output only."""
    return term.degree == 1 or not any(variable.kind == "y" for variable, _ in term.factors)


def choose_structure(
    training: Sequence[Recording], plan: Plan, rule: Rule = linear_in_output, *, jobs: int = 1
) -> tuple[Structure, Array, int]:
    """Choose the structure with the smallest free-run errors; return it, its errors, and the number tried."""
    cuts = [record.n_samples - round(CHOOSING * record.n_samples) for record in training]
    parts = [(r.section(0, cut), r.section(cut, r.n_samples)) for r, cut in zip(training, cuts, strict=True)]
    passed = run_jobs(_passed, [(beginning, plan, rule) for beginning, _ in parts], workers=jobs)
    structures = sorted({terms for each in passed for terms in each}, key=lambda s: (len(s), tuple(map(str, s))))
    errors = np.array(run_jobs(_free_run_errors, [(structures, *both) for both in parts], workers=jobs))
    least = errors[:, np.argmin(errors.mean(axis=0))]
    good = np.flatnonzero(as_good(errors, least[:, None]))
    best = min(good, key=lambda place: (len(structures[place]), errors[:, place].mean()))
    return structures[best], errors[:, best], len(structures)


def fit(structure: Sequence[Term], recording: Recording) -> NarxModel:
    """Fit a structure to a recording by least squares, with a covariance that is valid for coloured residuals."""
    return robust(Fixed(terms=tuple(structure)).fit(recording).model_, recording)


def _passed(beginning: Recording, plan: Plan, rule: Rule) -> list[Structure]:
    """Return all structures that a search visited."""
    search = Semp(output_lags=plan.output_lags, input_lags=plan.input_lags, degree=plan.degree, rule=rule)
    steps = search.fit(beginning).path_
    return [tuple(sorted(step.terms, key=lambda term: (term.degree, term.factors))) for step in steps]


def _free_run_errors(structures: Sequence[Structure], beginning: Recording, end: Recording) -> Array:
    """Return free-run errors divided by the standard deviation of the reading, shape (n_structures,)."""
    runs = [Fixed(terms=structure).fit(beginning).model_.simulate(end) for structure in structures]
    return np.array([run.rms_error if run.status.ok else np.inf for run in runs]) / float(end.outputs.std())

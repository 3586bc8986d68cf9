"""The fleet with one model structure, as the scenarios of the frequency domain need it.

Two actuators are compared term by term, and frequency by frequency, only where their models have the same terms. The
recordings, the sections, the sampling time, the lags and the degree are those of the story `semp-fleet`; of the
structures that SEMP passes on the six, one is taken for all.

The candidates hold the past output by itself only. Their Volterra series then ends at the degree, so that responses of
these orders describe the model whatever the command. With products of output and command, which `semp-fleet` allows
and which fit a little better, the series goes on without end, and at the size of the thesis' noise it diverges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx import Fixed, NarxModel, Term
from deatwin.ident.narx.robust import robust
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.terms import Rule
from deatwin.ident.parallel import run_jobs
from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording
from deatwin.scenarios.fleet_models.preparation import (
    CHOOSING,
    FACTORS,
    Plan,
    Prepared,
    as_good,
    make_plan,
    order_errors,
    prepare,
    thinned,
)
from deatwin.scenarios.fleet_models.variants import RECORDED
from deatwin.studies.voice import Progress

Array = NDArray[np.float64]
Structure = tuple[Term, ...]
ACTUATORS = (1, 2, 3, 4, 5, 6)
OPERATING_INPUT = 2.4
"""Mean of the thesis' noise, V: the operating point that all actuators are compared at."""
BAND = (0.0, 1.0)
"""Of the thesis' noise, Hz."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Alike:
    """An actuator with the model of the common structure."""

    prepared: Prepared  # Its recordings and what was found in them
    factor: int  # Every so many samples of them are kept
    sections: tuple[Recording, Recording]  # Training and held-out, thinned
    model: NarxModel

    @property
    def name(self) -> str:
        """Of the actuator."""
        return self.prepared.name

    @property
    def fit_percent(self) -> float:
        """Of the free run over the held-out section; minus infinity where it diverges."""
        run = self.model.simulate(self.sections[1])
        return 100 * (1 - run.rms_error / float(self.sections[1].outputs.std())) if run.status.ok else -np.inf

    def whole(self, variant: str = RECORDED) -> Recording:
        """The whole recording, thinned."""
        return thinned(self.prepared.recordings[variant], self.factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fleet:
    """Actuators with models of one structure."""

    actuators: tuple[Alike, ...]
    plan: Plan  # Sampling time, lags and degree
    structure: Structure  # That all models have, in the order of their parameters
    errors: Array
    tried: int  # Among how many structures


def identify_fleet(
    seed: int, numbers: Sequence[int] = ACTUATORS, *, jobs: int = 1, progress: Progress = lambda share, text: None
) -> Fleet:
    """Record the fleet, and fit one structure to each actuator."""
    prepared, plan = prepare_fleet(seed, numbers, jobs=jobs, progress=lambda share, text: progress(0.8 * share, text))
    progress(0.8, "choosing a common structure")
    return identify_alike(prepared, plan, jobs=jobs)


def prepare_fleet(
    seed: int, numbers: Sequence[int] = ACTUATORS, *, jobs: int = 1, progress: Progress = lambda share, text: None
) -> tuple[tuple[Prepared, ...], Plan]:
    """Record the fleet, and choose sections, sampling time, lags and degree."""
    chosen = [fleet(seed)[number - 1] for number in numbers]
    prepared = run_jobs(
        prepare,
        [(one,) for one in chosen],
        workers=jobs,
        finished=lambda n: progress(0.7 * n / len(chosen), "recording the actuators"),
    )
    training = [(one.split(RECORDED, factor)[0],) for factor in FACTORS for one in prepared]
    errors = run_jobs(
        order_errors,
        training,
        workers=jobs,
        finished=lambda n: progress(0.7 + 0.3 * n / len(training), "choosing sampling time and orders"),
    )
    n = len(prepared)
    return tuple(prepared), make_plan({factor: errors[i * n : (i + 1) * n] for i, factor in enumerate(FACTORS)})


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
    """Whether a term is free of the past output, or is nothing else."""
    return term.degree == 1 or not any(variable.kind == "y" for variable, _ in term.factors)


def choose_structure(
    training: Sequence[Recording], plan: Plan, rule: Rule = linear_in_output, *, jobs: int = 1
) -> tuple[Structure, Array, int]:
    """Choose the structure whose free runs follow all recordings best. Shapes: returns (n_recordings,)."""
    cuts = [record.n_samples - round(CHOOSING * record.n_samples) for record in training]
    parts = [(r.section(0, cut), r.section(cut, r.n_samples)) for r, cut in zip(training, cuts, strict=True)]
    passed = run_jobs(_passed, [(beginning, plan, rule) for beginning, _ in parts], workers=jobs)
    structures = sorted({terms for each in passed for terms in each}, key=_written)
    columns = run_jobs(_free_run_errors, [(structures, *both) for both in parts], workers=jobs)
    errors = np.array(columns)  # (n_recordings, n_structures)
    least = errors[:, np.argmin(errors.mean(axis=0))]
    good = np.flatnonzero(as_good(errors, least[:, None]))
    best = min(good, key=lambda place: (len(structures[place]), errors[:, place].mean()))
    return structures[best], errors[:, best], len(structures)


def fit(structure: Sequence[Term], recording: Recording) -> NarxModel:
    """Fit a structure to a recording by least squares, with a covariance that coloured residuals do not spoil."""
    return robust(_least_squares(structure, recording), recording)


def _passed(beginning: Recording, plan: Plan, rule: Rule) -> list[Structure]:
    """The structures on the way of a search."""
    search = Semp(output_lags=plan.output_lags, input_lags=plan.input_lags, degree=plan.degree, rule=rule)
    return [tuple(sorted(step.terms, key=_order)) for step in search.fit(beginning).path_]


def _least_squares(structure: Sequence[Term], recording: Recording) -> NarxModel:
    return Fixed(terms=tuple(structure)).fit(recording).model_


def _free_run_errors(structures: Sequence[Structure], beginning: Recording, end: Recording) -> Array:
    runs = [_least_squares(structure, beginning).simulate(end) for structure in structures]
    return np.array([run.rms_error if run.status.ok else np.inf for run in runs]) / float(end.outputs.std())


def _order(term: Term) -> tuple[object, ...]:
    return term.degree, term.factors


def _written(structure: Structure) -> tuple[object, ...]:
    return len(structure), tuple(map(str, structure))
